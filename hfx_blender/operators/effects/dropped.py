# SPDX-License-Identifier: GPL-3.0-or-later
"""Replaces sensations dropped from the Asset Browser by effects, in one undo step."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ...authoring.effects import effect_assets
from ...blender.events import add_handlers, call_soon, remove_handlers
from ...errors import HfxError
from ...text import printable
from ..shared import HfxOperator, select_only


class HFX_OT_place_dropped(HfxOperator):
    """Replace sensations dropped from the Asset Browser by effects"""

    bl_idname = "hfx.place_dropped"
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
            self.report({"WARNING"}, printable("; ".join(faults)))
            return ""
        select_only(context, *objects)
        return f"Added {len(objects)} effects: {', '.join(effect.name for effect in objects)}"


@persistent
def _on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    for update in depsgraph.updates:
        if isinstance(update.id, bpy.types.Object) and effect_assets.SENSATION in update.id:
            call_soon(_take)
            return


@persistent
def _on_undo(*_: object) -> None:
    # Replace the undo step of the drop, which has the bare asset.
    if effect_assets.dropped_objects(bpy.context.scene):
        call_soon(_undo_further)


@persistent
def _on_redo(*_: object) -> None:
    if effect_assets.dropped_objects(bpy.context.scene):
        call_soon(_redo_further)


def _take() -> float | None:
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


def _undo_further() -> None:
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        if effect_assets.dropped_objects(bpy.context.scene) and bpy.ops.ed.undo.poll():
            bpy.ops.ed.undo()


def _redo_further() -> None:
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        if effect_assets.dropped_objects(bpy.context.scene) and bpy.ops.ed.redo.poll():
            bpy.ops.ed.redo()


_HANDLERS = {
    "depsgraph_update_post": _on_update,
    "undo_post": _on_undo,
    "redo_post": _on_redo,
}


def register() -> None:
    if not bpy.app.background:  # where timers never fire
        add_handlers(_HANDLERS)


def unregister() -> None:
    remove_handlers(_HANDLERS)
