# SPDX-License-Identifier: GPL-3.0-or-later
"""Reuse: effects to and from files (HJIF, too) and the clipboard, and ready sensations."""

from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper
from mathutils import Vector

from ...authoring.effects import effect_file
from ...blender.translation import translated
from ...errors import HfxError, InputError
from ...files import kinds, resources
from ...formats.registry import FORMATS
from ...text import printable, shortened
from .. import framing, shared

# effect_exchange imports numpy: within functions, to keep Blender's start short.


def _origin(context: bpy.types.Context, body: bpy.types.Object | None) -> Vector:
    """World origin of a sensation's volumes: location of the body, without a body the 3D cursor."""
    return body.matrix_world.translation if body is not None else context.scene.cursor.location


def _place(context: bpy.types.Context, sensation: effect_file.Sensation) -> list[bpy.types.Object]:
    """Add a sensation's effects to the target body at the current frame, in Object Mode, volumes
    relative to the body, or to the 3D cursor without one. Selects and returns the effects; of
    swarms the emitters are selected. InputError if the target body is ambiguous."""
    shared.to_object_mode(context)
    body = shared.target_body(context)
    from ...authoring.effects import effect_exchange, swarms

    objects = effect_exchange.place_sensation(
        context.scene,
        sensation,
        body=body,
        frame=float(context.scene.frame_current),
        origin=_origin(context, body),
    )
    seen = [obj for effect in objects for obj in swarms.objects_showing(context.scene, effect)]
    shared.select_only(context, *seen)
    return objects


def _selected(context: bpy.types.Context, title: str) -> effect_file.Sensation:
    """Sensation of the selected effects and of volumes emitted by selected objects, sorted by name.

    Its origin is the body of the first effect with a body, or else the target body.
    """
    from ...authoring.effects import effect_exchange, swarms

    chosen = swarms.selected_effects(context.scene)
    bodies = [obj.hfx.body for obj in chosen if obj.hfx.body is not None]
    body = bodies[0] if bodies else shared.target_body(context)
    origin = _origin(context, body)
    return effect_exchange.sensation_of(context.scene, chosen, title, origin=origin)


@lru_cache(maxsize=4)
def _sensations(files: tuple[tuple[str, Path, float], ...]) -> shared.EnumItems:
    """Enum items of readable sensations; the times of change in ``files`` are keys of the cache."""
    from ...authoring.effects import effect_exchange

    shipped, own = [], []
    for name, path, _ in files:
        with suppress(HfxError):  # Load Effects gives the reason for a damaged file
            sensation = effect_file.load(path)
            kind = own if name.startswith(effect_exchange.OWN) else shipped
            kind.append((name, sensation.name, sensation.description or "A sensation of your own"))
    return [*shipped, *([("", "Your Own", ""), *own] if own else [])]


@shared.kept_items
def sensation_items() -> shared.EnumItems:
    """Enum items: built-in sensations, then files in the user's folder, reread after a change."""
    from ...authoring.effects import effect_exchange

    sensations = {**effect_exchange.library(), **effect_exchange.own_library()}
    return _sensations(
        tuple((name, path, path.stat().st_mtime) for name, path in sensations.items())
    )


class HFX_OT_add_from_library(shared.HfxOperator):
    """Add a sensation from the library at the current frame"""

    bl_label = "Sensation"

    name: EnumProperty(
        name="Sensation",
        description="A built-in sensation, or a file in your folder of effects",
        items=sensation_items,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return framing.execute_with_room(self, context)

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.effects import effect_exchange

        sensation = effect_exchange.load_library(self.name)
        _place(context, sensation)
        return f"Added '{sensation.name}'"


class HFX_OT_load_effects(shared.ImportOperator):
    """Add the effects of a file at the current frame"""

    bl_label = "Load Effects"

    filename_ext = kinds.EFFECT_SUFFIX
    filter_glob: StringProperty(default=f"*{kinds.EFFECT_SUFFIX}", options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        sensation = effect_file.load(Path(self.filepath))
        _place(context, sensation)
        return f"Added '{sensation.name}'"


class HFX_OT_save_effects(shared.HfxOperator, ExportHelper):
    """Save the selected effects to a file. Files in your folder of effects are listed in Add >
    Haptic > Sensation"""

    bl_label = "Save Effects"
    bl_options = {"REGISTER"}

    filename_ext = kinds.EFFECT_SUFFIX
    filter_glob: StringProperty(default=f"*{kinds.EFFECT_SUFFIX}", options={"HIDDEN"})
    name: StringProperty(name="Name", description="Empty: the name of the file")

    requires = ((lambda context: context.selected_objects, "Select the effects to save first"),)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.filepath:
            folder = resources.user_effects()
            # Without the folder the dialog still opens, elsewhere.
            with suppress(OSError):
                folder.mkdir(parents=True, exist_ok=True)
            stem = context.object.name if context.object is not None else "effects"
            self.filepath = str(folder / (bpy.path.clean_name(stem) + kinds.EFFECT_SUFFIX))
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str:
        path = Path(self.filepath)
        sensation = _selected(context, self.name or path.stem.replace("_", " ").title())
        effect_file.save(sensation, path)
        return f"Effects saved to {path.name}: {len(sensation.effects)}"


_IMPORTED = [info.suffix for info in FORMATS.values() if info.decode]


class HFX_OT_import_hjif(shared.ImportOperator, shared.OnBodyOperator):
    """Add the channels of a file of haptics (MPEG HJIF, .haptic, AHAP ...) as painted effects, from
    the current frame on"""

    bl_label = "Import Haptics"

    filename_ext = ".hjif"
    filter_glob: StringProperty(
        default=";".join(f"*{suffix}" for suffix in _IMPORTED), options={"HIDDEN"}
    )

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.effects import hjif_import

        objects, left_out, notes = hjif_import.import_hjif(
            context.scene,
            Path(self.filepath),
            shared.target_body(context),
            float(context.scene.frame_current),
        )
        for note in [*notes, *(f"left out {note}" for note in left_out)]:
            self.report({"WARNING"}, translated(printable(note[:1].upper() + note[1:])))
        if not objects:
            raise InputError(f"{self.filepath}: has nothing that can become an effect.")
        shared.select_only(context, *objects)
        return f"Added {', '.join(shortened([effect.name for effect in objects], 3))}"


class _DroppedFile(bpy.types.FileHandler):
    """Base of handlers of files that are dropped on any area of a window."""

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None


class HFX_FH_effects(_DroppedFile):
    bl_idname, bl_label = "HFX_FH_effects", "Haptic Effects"
    bl_import_operator, bl_file_extensions = "hfx.load_effects", kinds.EFFECT_SUFFIX


class HFX_FH_path(_DroppedFile):
    bl_idname, bl_label = "HFX_FH_path", "Haptic Path"
    bl_import_operator, bl_file_extensions = "hfx.load_path", kinds.PATH_SUFFIX


class HFX_FH_haptics(_DroppedFile):
    bl_idname, bl_label = "HFX_FH_haptics", "Haptics"
    bl_import_operator, bl_file_extensions = "hfx.import_hjif", ";".join(_IMPORTED)


copied_sensation = ""  # no clipboard in background mode


class HFX_OT_copy_effects(shared.HfxOperator):
    """Copy the selected effects with their clips to the clipboard"""

    bl_label = "Copy Effects"
    bl_options = {"REGISTER"}
    requires = ((lambda context: context.selected_objects, "Select the effects to copy first"),)

    def work(self, context: bpy.types.Context) -> str:
        global copied_sensation
        sensation = _selected(context, "Copied")
        copied_sensation = context.window_manager.clipboard = effect_file.text_of(sensation)
        return f"Effects copied: {len(sensation.effects)}"


class HFX_OT_paste_effects(shared.HfxOperator):
    """Paste copied effects at the current frame, on the active body or the only body"""

    bl_label = "Paste Effects"

    def work(self, context: bpy.types.Context) -> str:
        text = copied_sensation if bpy.app.background else context.window_manager.clipboard
        if not text.lstrip().startswith("{"):
            raise InputError("There are no effects to paste: copy some first.")
        objects = _place(context, replace(effect_file.from_text(text), name=""))
        return f"Effects pasted: {len(objects)}"
