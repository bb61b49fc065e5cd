# SPDX-License-Identifier: GPL-3.0-or-later
"""Editing a painted area as a whole: grow, smooth, mirror, from an image or a selection, copy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty

from ...authoring.areas import painting
from ...authoring.effects import effects
from ...engine.body.parts import SIDES
from ...errors import InputError
from ..shared import HfxOperator, painted_effect

if TYPE_CHECKING:
    from ...engine.arrays import F64
    from ...engine.body.model import PerceptualModel

BLENDS = (
    ("replace", "Replace", "The new area only"),
    ("add", "Add", "Both areas"),
    ("subtract", "Subtract", "The old area without the new one"),
    ("multiply", "Multiply", "Product of both areas"),
)
_BLEND_TIP = "Combination of the new area with the old area"


class _AreaOperator(HfxOperator):
    """Base of operators on the active painted effect, during painting or not."""

    requires = ((painted_effect, "Select a painted effect"),)

    @staticmethod
    def model(effect: bpy.types.Object) -> PerceptualModel:
        from ...engine.body.model import load_model

        return load_model(effects.model_id_for(effect.hfx.modality))

    @staticmethod
    def covers(effect: bpy.types.Object, count: int) -> str:
        return f"'{effect.name}' covers {count} vertices"


def _blend(effect: bpy.types.Object, weights: F64, how: str) -> int:
    """Combine weights (V,) with an effect's area, by a key of :data:`BLENDS`; returns the number
    of painted vertices.
    """
    from ...engine.body import areas

    blended = areas.blended(painting.weights_of(effect), weights, how)
    return painting.set_weights(effect, blended)


class HFX_OT_area_filter(_AreaOperator):
    """Change the whole painted area, from vertex to neighbouring vertex"""

    bl_idname = "hfx.area_filter"
    bl_label = "Change Area"

    action: EnumProperty(
        name="Action",
        description="Change of the area",
        items=(
            ("grow", "Grow", "Grow by one vertex per step"),
            ("shrink", "Shrink", "Shrink by one vertex per step"),
            ("smooth", "Smooth", "Soften the edge"),
            ("invert", "Invert", "Swap painted and unpainted skin"),
            ("clear", "Clear", "Paint nothing"),
        ),
    )
    steps: IntProperty(name="Steps", description="Number of steps", default=1, min=1, max=50)

    def work(self, context: bpy.types.Context) -> str:
        import numpy as np

        from ...engine.body import areas

        effect = painted_effect(context)
        model = self.model(effect)
        if self.action == "clear":  # also unreadable areas
            return self.covers(effect, painting.set_weights(effect, np.zeros(len(model))))
        weights = painting.weights_of(effect)
        if self.action == "invert":
            weights = 1.0 - weights
        else:
            change = {"grow": areas.grow, "shrink": areas.shrink, "smooth": areas.smooth}
            weights = change[self.action](model, weights, self.steps)
        return self.covers(effect, painting.set_weights(effect, weights))


class HFX_OT_area_mirror(_AreaOperator):
    """Mirror the painted area between the left and the right of the body"""

    bl_idname = "hfx.area_mirror"
    bl_label = "Mirror Area"

    action: EnumProperty(
        name="Action",
        description="Change of the area",
        items=(
            ("flip", "Swap Sides", "Left becomes right, right becomes left"),
            ("left", "Left to Right", "Copy the body's left to its right"),
            ("right", "Right to Left", "Copy the body's right to its left"),
        ),
    )

    def work(self, context: bpy.types.Context) -> str:
        from ...engine.body import areas

        effect = painted_effect(context)
        model, weights = self.model(effect), painting.weights_of(effect)
        if self.action == "flip":
            weights = areas.mirrored(model, weights)
        else:
            weights = areas.symmetric(model, weights, SIDES.index(self.action))
        return self.covers(effect, painting.set_weights(effect, weights))


class HFX_OT_area_from_image(_AreaOperator):
    """Paint the area from an image, laid over the body by the avatar's UV map"""

    bl_idname = "hfx.area_from_image"
    bl_label = "Area from Image"

    image: StringProperty(name="Image", description="One of this file's images")
    uv_map: StringProperty(name="UV Map", description="Empty: the UV map active for rendering")
    channel: EnumProperty(
        name="Channel",
        description="Channel of the image used as strength",
        items=(
            ("brightness", "Brightness", "Bright is strong"),
            ("darkness", "Darkness", "Dark is strong"),
            ("alpha", "Alpha", "Opaque is strong"),
        ),
    )
    blend: EnumProperty(name="Blend", description=_BLEND_TIP, items=BLENDS)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop_search(self, "image", bpy.data, "images")
        layout.prop(self, "channel")
        layout.prop(self, "blend")
        layout.prop(self, "uv_map")

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.areas import picture_areas

        effect = painted_effect(context)
        picture = bpy.data.images.get(self.image)
        if picture is None:
            names = ", ".join(f"'{image.name}'" for image in bpy.data.images) or "none"
            raise InputError(f"There is no image '{self.image}'; this file has: {names}.")
        weights = picture_areas.weights_of_image(effect, picture, self.channel, self.uv_map)
        return self.covers(effect, _blend(effect, weights, self.blend))


class HFX_OT_area_from_selection(_AreaOperator):
    """Set the area from the selected vertices of the painted mesh or of the avatar's meshes"""

    bl_idname = "hfx.area_from_selection"
    bl_label = "Area from Selection"

    blend: EnumProperty(name="Blend", description=_BLEND_TIP, items=BLENDS, default="add")

    def work(self, context: bpy.types.Context) -> str:
        import numpy as np

        from ...authoring.areas import picture_areas

        effect = painted_effect(context)
        if painting.canvas_of(effect) is not None:
            weights = painting.selected_vertices(effect).astype(np.float64)
        else:
            weights = picture_areas.weights_of_selection(effect)
        if not weights.any():
            raise InputError("No vertices are selected. Select some in Edit Mode first.")
        return self.covers(effect, _blend(effect, weights, self.blend))


class HFX_OT_area_copy(_AreaOperator):
    """Copy the area of the active effect to the other selected painted effects of any modality"""

    bl_idname = "hfx.area_copy"
    bl_label = "Copy Area to Selected"

    blend: EnumProperty(name="Blend", description=_BLEND_TIP, items=BLENDS)

    def work(self, context: bpy.types.Context) -> str:
        from ...engine.body import areas

        source = painted_effect(context)
        others = [
            obj
            for obj in context.selected_objects
            if obj != source and obj.hfx.role == "EFFECT" and obj.hfx.kind == "PAINTED"
        ]
        if not others:
            raise InputError("Select the target painted effects first, and this effect last.")
        weights = painting.weights_of(source)
        for effect in others:
            there = areas.transferred(self.model(source), weights, self.model(effect))
            _blend(effect, there, self.blend)
        return f"Copied the area of '{source.name}' to {len(others)} effects"


class HFX_OT_area_keep(_AreaOperator):
    """Transfer the painted area to the modality of the effect"""

    bl_idname = "hfx.area_keep"
    bl_label = "Keep Painted Area"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        effect = painted_effect(context)
        is_other = effect is not None and effects.has_other_area(effect)
        return cls.needs(is_other, "The area was painted for this modality")

    def work(self, context: bpy.types.Context) -> str:
        effect = painted_effect(context)
        return self.covers(effect, painting.transfer_area(effect))


class HFX_OT_effect_mirrored(_AreaOperator):
    """Add a copy of the effect on the other side of the body, with the same clips"""

    bl_idname = "hfx.effect_mirrored"
    bl_label = "Mirrored Copy"

    def work(self, context: bpy.types.Context) -> str:
        from ...engine.body import areas

        effect = painted_effect(context)
        if painting.canvas_of(effect) is not None:
            raise InputError("Finish painting first.")
        copy = effects.duplicate(effect)
        painting.set_weights(copy, areas.mirrored(self.model(effect), painting.weights_of(effect)))
        return f"Added '{copy.name}'"
