# SPDX-License-Identifier: GPL-3.0-or-later
"""Reuse: effects to and from files, and the sensations that are shipped."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from .. import file_suffixes
from ..authoring import effects
from ..errors import InputError
from .shared import EnumItems, HfxOperator, active_body, made_once, select_only

if TYPE_CHECKING:
    from ..authoring.effect_file import Sensation

# Reading and making sensations is imported where it is done: Blender's start would wait for it.


def _body(context: bpy.types.Context) -> bpy.types.Object | None:
    """Whom painted areas are put on: the active body, else the only one there is."""
    found = effects.bodies_of(context.scene)
    active = active_body(context)
    if active in found:
        return active
    if len(found) > 1:
        raise InputError("Several haptic bodies: select the one that shall feel it.")
    return found[0] if found else None


def _place(context: bpy.types.Context, sensation: Sensation) -> str:
    if context.object is not None and context.object.mode != "OBJECT":
        raise InputError("Leave painting or editing first.")
    body = _body(context)
    origin = body.matrix_world.translation if body is not None else context.scene.cursor.location
    from ..authoring import effect_exchange, response_exchange

    made = effect_exchange.place(
        context.scene,
        sensation,
        body=body,
        frame=float(context.scene.frame_current),
        origin=origin,
    )
    # A swarm's volume is in no scene; what emits it is.
    seen = [
        emitter
        for effect in made
        for emitter in (
            [effect]
            if effect.name in context.scene.objects
            else [each for each, _ in response_exchange.emitters(context.scene, effect)]
        )
    ]
    select_only(context, seen[0])
    for obj in seen[1:]:
        obj.select_set(True)
    return f"Added '{sensation.name}': {len(made)} effects"


def _sensations() -> EnumItems:
    from ..authoring import effect_exchange, effect_file

    return [
        (stem, sensation.name, sensation.description)
        for stem, path in effect_exchange.library().items()
        for sensation in [effect_file.load(path)]
    ]


class HFX_OT_add_from_library(HfxOperator):
    """Add a ready sensation at the current frame, on the body and around it"""

    bl_idname = "hfx.add_from_library"
    bl_label = "Sensation"

    name: EnumProperty(name="Sensation", items=made_once(_sensations))

    def work(self, context: bpy.types.Context) -> str:
        from ..authoring import effect_exchange

        return _place(context, effect_exchange.load_library(self.name))


class HFX_OT_load_effects(HfxOperator, ImportHelper):
    """Add the effects of a file at the current frame"""

    bl_idname = "hfx.load_effects"
    bl_label = "Load Effects"

    filename_ext = file_suffixes.EFFECT
    filter_glob: StringProperty(default=f"*{file_suffixes.EFFECT}", options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        from ..authoring import effect_file

        return _place(context, effect_file.load(Path(self.filepath)))


class HFX_OT_save_effects(HfxOperator, ExportHelper):
    """Save the selected effects, and what selected emitters emit, to a file of their own"""

    bl_idname = "hfx.save_effects"
    bl_label = "Save Effects"

    filename_ext = file_suffixes.EFFECT
    filter_glob: StringProperty(default=f"*{file_suffixes.EFFECT}", options={"HIDDEN"})
    name: StringProperty(name="Name", description="Empty: that of the file")

    def work(self, context: bpy.types.Context) -> str:
        from ..authoring import effect_exchange, effect_file, response_exchange

        selected = context.selected_objects
        found = {obj for obj in selected if obj.hfx.role == "EFFECT"}
        found.update(each for obj in selected for each in response_exchange.volumes_of(obj))
        chosen = sorted(found, key=lambda obj: obj.name)
        path = Path(self.filepath)
        title = self.name or path.stem.replace("_", " ").title()
        effect_file.save(effect_exchange.sensation_of(context.scene, chosen, title), path)
        return f"Saved {len(chosen)} effects to {path.name}"


register, unregister = bpy.utils.register_classes_factory(
    (HFX_OT_add_from_library, HFX_OT_load_effects, HFX_OT_save_effects)
)
