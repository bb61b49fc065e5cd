# SPDX-License-Identifier: GPL-3.0-or-later
"""Sensations in the Asset Browser: their library, and replacement of dropped assets by effects.

While HFX is enabled, the user's preferences list the library of built-in sensations. A dropped
asset and the effects in its place are one undo step.
"""

from contextlib import suppress
from functools import partial

import bpy
from bpy.app.handlers import persistent

from ...authoring.effects import effect_assets
from ...blender.events import add_handlers, call_soon, remove_handlers
from ...blender.translation import translated
from ...errors import HfxError
from ...files import resources
from ...text import printable
from ..shared import HfxOperator, select_only

LIBRARY_NAME = "HFX Haptics"


class HFX_OT_place_dropped(HfxOperator):
    """Replace sensations dropped from the Asset Browser by effects"""

    bl_label = "Place Sensation"
    requires = (
        (
            lambda context: effect_assets.dropped_objects(context.scene),
            "Drag a sensation out of the Asset Browser first",
        ),
    )

    def work(self, context: bpy.types.Context) -> str:
        objects, faults = [], []
        if context.object is not None and context.object.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        for dropped in effect_assets.dropped_objects(context.scene):
            try:
                objects += effect_assets.replace_dropped(context.scene, dropped)
            except HfxError as error:
                faults.append(str(error))
        if faults:
            # No error report: removing the dropped object needs an undo step.
            self.report({"WARNING"}, translated(printable("; ".join(faults))))
            return ""
        select_only(context, *objects)
        return f"Added {', '.join(effect.name for effect in objects)}"


@persistent
def _on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    for update in depsgraph.updates:
        if isinstance(update.id, bpy.types.Object) and effect_assets.SENSATION in update.id:
            # By a timer: objects must not be replaced while Blender reports updates.
            call_soon(_take)
            return


def _step_further(step: str) -> None:
    """Undo or redo a further step, as ``step`` says, if the scene has a dropped asset."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        operator = getattr(bpy.ops.ed, step)
        if effect_assets.dropped_objects(bpy.context.scene) and operator.poll():
            operator()


_undo_further, _redo_further = partial(_step_further, "undo"), partial(_step_further, "redo")


# Blender pushes an undo step of the drop itself, with the bare asset. Undo and redo skip this step.
@persistent
def _on_undo(*_: object) -> None:
    if effect_assets.dropped_objects(bpy.context.scene):
        call_soon(_undo_further)


@persistent
def _on_redo(*_: object) -> None:
    if effect_assets.dropped_objects(bpy.context.scene):
        call_soon(_redo_further)


def _take() -> float | None:
    """Timer: place the dropped sensations; again in 0.1 s while an asset is being dragged."""
    if bpy.app.timers.is_registered(_undo_further) or bpy.app.timers.is_registered(_redo_further):
        return None
    manager = bpy.context.window_manager
    window = manager.windows[0] if len(manager.windows) else None
    if window is None or not effect_assets.dropped_objects(window.scene):
        return None
    if len(window.modal_operators):  # still being dragged
        return 0.1
    with bpy.context.temp_override(window=window):
        bpy.ops.hfx.place_dropped("INVOKE_DEFAULT", True)
    return None


_HANDLERS = {"depsgraph_update_post": _on_update, "undo_post": _on_undo, "redo_post": _on_redo}


def register() -> None:
    with suppress(HfxError):  # an installation without the library
        folder = resources.effect_library()
        if (folder / effect_assets.LIBRARY_FILE).is_file():
            _remove_library()  # left by another version, or after a crash
            libraries = bpy.context.preferences.filepaths.asset_libraries
            library = libraries.new(name=LIBRARY_NAME, directory=str(folder))
            library.import_method = "APPEND"
    if not bpy.app.background:  # where timers never fire
        add_handlers(_HANDLERS)


def unregister() -> None:
    remove_handlers(_HANDLERS)
    _remove_library()


def _remove_library() -> None:
    libraries = bpy.context.preferences.filepaths.asset_libraries
    for library in [library for library in libraries if library.name == LIBRARY_NAME]:
        libraries.remove(library)
