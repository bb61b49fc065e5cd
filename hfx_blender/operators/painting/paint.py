# SPDX-License-Identifier: GPL-3.0-or-later
"""Painted area of an effect: Weight Paint on its perceptual model, changes of the whole area."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty
from mathutils.bvhtree import BVHTree

from ...authoring import atlas_pictures, clips, painting
from ...authoring.effects import effects
from ...blender import compat
from ...blender.translation import translated
from ...engine.body.parts import REGIONS, SIDES
from ...engine.modality import MODALITY_ITEMS
from ...errors import InputError
from .. import framing, shared
from . import paint_view

if TYPE_CHECKING:
    from ...engine.arrays import F64

BLENDS = (
    ("replace", "Replace", "The new area only"),
    ("add", "Add", "Both areas"),
    ("subtract", "Subtract", "The old area without the new one"),
    ("multiply", "Multiply", "Product of both areas"),
)
_BLEND_TIP = "Combination of the new area with the old area"

_ON_PAINTED: shared.Requirement = shared.painted_effect, "Select a painted effect"

# A library override stores no ID properties, such as a painted area, as these have no fixed size.
_IS_AREA_LOCAL: shared.Requirement = (
    lambda context: shared.painted_effect(context).override_library is None,
    "The area belongs to a linked file. Choose Object > Relations > Make Local first",
)


class _PaintedOperator(shared.HfxOperator):
    """Base of operators that change the active painted effect, during painting or not."""

    requires = (_ON_PAINTED, shared.IS_EDITABLE, _IS_AREA_LOCAL)


def _covers(effect: bpy.types.Object, count: int) -> str:
    return f"'{effect.name}' covers {count} vertices"


class HFX_OT_paint_begin(_PaintedOperator):
    """Paint the area of the effect on its perceptual model, in Weight Paint"""

    bl_label = "Paint"

    def work(self, context: bpy.types.Context) -> str:
        effect = shared.painted_effect(context)
        if not bpy.app.background and framing.viewport(context) is None:
            raise InputError("Painting needs a 3D viewport: go to a workspace that has one first.")
        # First: an area beyond repair is refused before the view changes.
        canvas = painting.begin(context, effect)
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        # The avatar's own meshes would cover the canvas.
        paint_view.hide_others(context, canvas)
        # The NLA Editor shows the clips of selected objects.
        shared.select_only(context, canvas, effect)
        if not bpy.app.background:
            paint_view.enter(context, canvas)
            framing.frame(context, [canvas])
            bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
            compat.set_brush_weight(context, 1.0)
            # Show weight 0 in blue: black, the default, would hide the body's shape.
            context.tool_settings.vertex_group_user = "NONE"
            bpy.ops.hfx.paint_status("INVOKE_DEFAULT")
        if clips.strips_of(effect):
            return "Paint, then press Finish Painting"
        return "Paint, then press Finish Painting, or Finish, Add Clip"


class HFX_OT_paint_end(shared.HfxOperator):
    """Apply the painted weights and show the avatar again"""

    bl_label = "Finish Painting"
    requires = ((painting.canvas_in, "Nothing is being painted"),)

    def work(self, context: bpy.types.Context) -> str:
        canvas = painting.canvas_in(context)
        effect, hidden = canvas[painting.PAINTED_EFFECT], paint_view.hidden_by(canvas)
        layers = paint_view.layers_of(canvas)
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        # `end` removes the canvas, which held the view layers and hidden objects read above.
        count = painting.end(effect)
        paint_view.show(layers, hidden)
        paint_view.leave()
        shared.select_only(context, effect)
        return _covers(effect, count)


_SAVED = "saved:"  # begins an item of the list of parts


@shared.kept_items
def part_items() -> shared.EnumItems:
    """Body parts in columns by groups, and the user's own areas."""
    items = [("all", "Whole Body", "All of the skin")]
    for group in dict.fromkeys(region.group for region in REGIONS):
        items.append(("", group, ""))
        items += [
            (region.id, region.label, f"All of it: {region.label.lower()}")
            for region in REGIONS
            if region.group == group
        ]
    names = painting.saved_names()
    if names:
        items.append(("", "My Areas", ""))
        items += [(_SAVED + name, name, "Saved by you") for name in names]
    return items


class HFX_OT_fill_part(_PaintedOperator):
    """Paint a whole body part at full strength"""

    bl_label = "Fill Body Part"

    part: EnumProperty(
        name="Part",
        description="Body part, or saved area, to fill; added to the painted area",
        items=part_items,
        translation_context="HFX",
    )
    side: EnumProperty(
        name="Side",
        description="Which side of the body",
        items=[
            ("both", "Both", "Both sides"),
            ("left", "Left", "The person's left, and the middle"),
            ("right", "Right", "The person's right, and the middle"),
        ],
    )
    is_cleared: BoolProperty(
        name="Clear", description="Remove the part from the area", options={"SKIP_SAVE"}
    )
    is_under_mouse: BoolProperty(options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Of the tool: the part and side under the mouse, both sides with *Paint Both Sides*."""
        if self.is_under_mouse:
            canvas = painting.canvas_of(shared.painted_effect(context))
            if canvas is None:
                return {"PASS_THROUGH"}
            tree = BVHTree.FromObject(canvas, context.evaluated_depsgraph_get())
            vertex = paint_view.vertex_under(context, canvas, tree, event)
            if vertex is None:
                # An error's popup would take the next click.
                self.report({"WARNING"}, translated("Click on the body"))
                return {"CANCELLED"}
            self.choose(vertex, canvas.data.use_mirror_x)
        return self.execute(context)

    def choose(self, vertex: int, is_mirrored: bool) -> None:
        """Set part and side from a vertex of the model."""
        from ...engine.body.regions import region_at

        model = effects.model_of(shared.painted_effect(bpy.context))
        side = SIDES[model.side[vertex]]
        self.part = region_at(model, vertex).id
        self.side = "both" if is_mirrored or side == "centre" else side

    def work(self, context: bpy.types.Context) -> str:
        import numpy as np

        from ...engine.body import areas

        effect = shared.painted_effect(context)
        before = painting.weights_of(effect)
        if self.is_cleared:  # the part alone is filled, then subtracted
            painting.set_weights(effect, np.zeros(len(before)))
        if self.part.startswith(_SAVED):
            count = painting.add_saved(effect, self.part.removeprefix(_SAVED))
        else:
            parts = () if self.part == "all" else (self.part,)
            count = painting.fill_parts(effect, parts, self.side)
        if self.is_cleared:
            rest = areas.blended(before, painting.weights_of(effect), "subtract")
            count = painting.set_weights(effect, rest)
        return _covers(effect, count)


class HFX_OT_add_on_part(shared.OnBodyOperator):
    """Add an effect that covers a body part"""

    bl_label = "On a Body Part"

    modality: EnumProperty(name="Modality", description="Sensation", items=MODALITY_ITEMS)
    part: EnumProperty(
        name="Part",
        description="Body part, or saved area",
        items=part_items,
        translation_context="HFX",
    )

    def work(self, context: bpy.types.Context) -> None:
        body = shared.target_body(context)
        shared.select_only(context, effects.add_painted(context.scene, self.modality, body))
        bpy.ops.hfx.fill_part(part=self.part)


class HFX_OT_set_area(_PaintedOperator):
    """Set the area of the effect from a list of vertices and weights (for scripts)"""

    bl_label = "Set Painted Area"

    area: StringProperty(name="Area", description='JSON: {"vertex id": weight, ...}')

    def work(self, context: bpy.types.Context) -> str:
        try:
            stored = {int(vertex): float(w) for vertex, w in json.loads(self.area).items()}
        except (ValueError, TypeError, AttributeError, OverflowError) as error:
            raise InputError(f"Area: expected a JSON object of weights by vertex ({error}).") from (
                error
            )
        effect = shared.painted_effect(context)
        effects.set_area(effect, list(stored), list(stored.values()))
        return _covers(effect, len(stored))


class HFX_OT_save_area(_PaintedOperator):
    """Save the painted area under a name. Fill Body Part lists saved areas in every file

    An empty area removes the name from the list
    """

    bl_label = "Save Area"
    requires = (_ON_PAINTED,)
    bl_options = {"REGISTER"}  # a file of the user's own; nothing of the scene changes

    name: StringProperty(
        name="Name", description="Name in the list; an area of the same name is replaced"
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.name = shared.painted_effect(context).name
        return context.window_manager.invoke_props_dialog(self)

    def work(self, context: bpy.types.Context) -> str:
        count = painting.save_area(shared.painted_effect(context), self.name.strip())
        return f"'{self.name}' saved" if count else f"'{self.name}' is no longer listed"


def _blend(effect: bpy.types.Object, weights: F64, how: str) -> int:
    """Combine weights (V,) with an effect's area by a key of BLENDS; returns its vertex count."""
    from ...engine.body import areas

    blended = areas.blended(painting.weights_of(effect), weights, how)
    return painting.set_weights(effect, blended)


class HFX_OT_area_filter(_PaintedOperator):
    """Change the whole painted area, from vertex to neighbouring vertex"""

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

        effect = shared.painted_effect(context)
        model = effects.model_of(effect)
        if self.action == "clear":  # also unreadable areas
            return _covers(effect, painting.set_weights(effect, np.zeros(len(model))))
        weights = painting.weights_of(effect)
        if self.action == "invert":
            weights = 1.0 - weights
        else:
            change = {"grow": areas.grow, "shrink": areas.shrink, "smooth": areas.smooth}
            weights = change[self.action](model, weights, self.steps)
        return _covers(effect, painting.set_weights(effect, weights))


class HFX_OT_area_mirror(_PaintedOperator):
    """Mirror the painted area between the left and the right of the body"""

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

        effect = shared.painted_effect(context)
        model, weights = effects.model_of(effect), painting.weights_of(effect)
        if self.action == "flip":
            weights = areas.mirrored(model, weights)
        else:
            weights = areas.symmetric(model, weights, SIDES.index(self.action))
        return _covers(effect, painting.set_weights(effect, weights))


class HFX_OT_area_from_image(_PaintedOperator):
    """Paint the area from an image, laid over the body by the avatar's UV map"""

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
        from ...authoring import picture_areas

        effect = shared.painted_effect(context)
        picture = bpy.data.images.get(self.image)
        if picture is None:
            names = ", ".join(f"'{image.name}'" for image in bpy.data.images) or "none"
            raise InputError(f"There is no image '{self.image}'; this file has: {names}.")
        weights = picture_areas.weights_of_image(effect, picture, self.channel, self.uv_map)
        return _covers(effect, _blend(effect, weights, self.blend))


class HFX_OT_area_atlas(_PaintedOperator):
    """Paint the area on a picture of the unrolled body in the Image Editor. The picture and the
    area stay linked"""

    bl_label = "Paint in 2D"

    def work(self, context: bpy.types.Context) -> str:
        image = atlas_pictures.picture_of(shared.painted_effect(context))
        if not bpy.app.background:
            paint_view.show_picture(context, image)
        return f"Paint on '{image.name}' in the Image Editor"


class HFX_OT_area_from_selection(_PaintedOperator):
    """Set the area from the selected vertices of the painted mesh or of the avatar's meshes"""

    bl_label = "Area from Selection"

    blend: EnumProperty(name="Blend", description=_BLEND_TIP, items=BLENDS, default="add")

    def work(self, context: bpy.types.Context) -> str:
        import numpy as np

        from ...authoring import picture_areas

        effect = shared.painted_effect(context)
        if painting.canvas_of(effect) is not None:
            weights = painting.selected_vertices(effect).astype(np.float64)
        else:
            weights = picture_areas.weights_of_selection(effect)
        if not weights.any():
            raise InputError("No vertices are selected. Select some in Edit Mode first.")
        return _covers(effect, _blend(effect, weights, self.blend))


class HFX_OT_area_copy(_PaintedOperator):
    """Copy the area of the active effect to the other selected painted effects of any modality"""

    bl_label = "Copy Area to Selected"
    requires = (_ON_PAINTED, shared.ARE_TARGETS_EDITABLE)

    blend: EnumProperty(name="Blend", description=_BLEND_TIP, items=BLENDS)

    def work(self, context: bpy.types.Context) -> str:
        from ...engine.body import areas

        source = shared.painted_effect(context)
        others = [
            obj
            for obj in context.selected_objects
            if obj != source and obj.hfx.role == "EFFECT" and obj.hfx.kind == "PAINTED"
        ]
        if not others:
            raise InputError("Select the target painted effects first, and this effect last.")
        for effect in others:
            if effect.override_library is not None:
                raise InputError(
                    f"The area of '{effect.name}' belongs to a linked file. Choose Object > "
                    "Relations > Make Local first."
                )
        weights = painting.weights_of(source)
        for effect in others:
            # Effects of another modality have a model with other vertices.
            there = areas.transferred(effects.model_of(source), weights, effects.model_of(effect))
            _blend(effect, there, self.blend)
        return f"Copied the area of '{source.name}' to {len(others)} effects"


class HFX_OT_area_keep(_PaintedOperator):
    """Transfer the painted area to the present model of the effect"""

    bl_label = "Keep Painted Area"
    requires = (
        (
            lambda context: (
                shared.painted_effect(context)
                and effects.has_other_area(shared.painted_effect(context))
            ),
            "The area was painted for this model",
        ),
        shared.IS_EDITABLE,
        _IS_AREA_LOCAL,
    )

    def work(self, context: bpy.types.Context) -> str:
        effect = shared.painted_effect(context)
        return _covers(effect, painting.transfer_area(effect))


class HFX_OT_effect_mirrored(_PaintedOperator):
    """Add a copy of the effect on the other side of the body, with the same clips"""

    bl_label = "Mirrored Copy"
    requires = (_ON_PAINTED,)

    def work(self, context: bpy.types.Context) -> str:
        from ...engine.body import areas

        effect = shared.painted_effect(context)
        if painting.canvas_of(effect) is not None:
            raise InputError("Finish painting first.")
        copy = effects.duplicate(effect)
        painting.set_weights(
            copy, areas.mirrored(effects.model_of(effect), painting.weights_of(effect))
        )
        return f"Added '{copy.name}'"
