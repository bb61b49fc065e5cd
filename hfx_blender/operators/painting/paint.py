# SPDX-License-Identifier: GPL-3.0-or-later
"""Weight Paint of an effect's area on its perceptual model."""

from __future__ import annotations

import json

import bpy
from bpy.props import EnumProperty, StringProperty

from ...authoring.areas import painting
from ...authoring.effects import effects
from ...blender import compat
from ...engine.body.parts import REGIONS
from ...errors import InputError
from .. import framing
from ..shared import EnumItems, HfxOperator, kept_items, painted_effect, select_only
from . import paint_view


class _PaintedOperator(HfxOperator):
    requires = ((painted_effect, "Select a painted effect"),)


class HFX_OT_paint_begin(_PaintedOperator):
    """Paint the area of the effect on its perceptual model, in Weight Paint"""

    bl_idname = "hfx.paint_begin"
    bl_label = "Paint"

    def work(self, context: bpy.types.Context) -> str:
        effect = painted_effect(context)
        if not bpy.app.background and framing.viewport(context) is None:
            raise InputError("Painting needs a 3D viewport: go to a workspace that has one first.")
        canvas = painting.begin(context, effect)
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        paint_view.hide_others(context, canvas)
        select_only(context, canvas)
        if not bpy.app.background:
            paint_view.enter(context, canvas)
            bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
            compat.set_brush_weight(context, 1.0)
            # Show weight 0 in blue: black, the default, would hide the body's shape.
            context.tool_settings.vertex_group_user = "NONE"
            bpy.ops.hfx.paint_status("INVOKE_DEFAULT")
        return "Paint, then press Finish Painting"


class HFX_OT_paint_end(HfxOperator):
    """Apply the painted weights and show the avatar again"""

    bl_idname = "hfx.paint_end"
    bl_label = "Finish Painting"
    requires = ((painting.canvas_in, "Nothing is being painted"),)

    def work(self, context: bpy.types.Context) -> str:
        canvas = painting.canvas_in(context)
        effect, hidden = canvas[painting.PAINTED_EFFECT], paint_view.hidden_by(canvas)
        layers = paint_view.layers_of(canvas)
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        count = painting.end(effect)
        paint_view.show(layers, hidden)
        paint_view.leave()
        select_only(context, effect)
        return f"'{effect.name}' covers {count} vertices"


_SAVED = "saved:"  # begins an item of the list of parts


@kept_items
def _parts() -> EnumItems:
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

    bl_idname = "hfx.fill_part"
    bl_label = "Fill Body Part"

    part: EnumProperty(
        name="Part",
        description="Body part, or saved area, to fill; added to the painted area",
        items=_parts,
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

    def work(self, context: bpy.types.Context) -> str:
        effect = painted_effect(context)
        if self.part.startswith(_SAVED):
            count = painting.add_saved(effect, self.part.removeprefix(_SAVED))
        else:
            parts = () if self.part == "all" else (self.part,)
            count = painting.fill_parts(effect, parts, self.side)
        return f"'{effect.name}' covers {count} vertices"


class HFX_OT_set_area(_PaintedOperator):
    """Set the area of the effect from a list of vertices and weights (for scripts)"""

    bl_idname = "hfx.set_area"
    bl_label = "Set Painted Area"

    area: StringProperty(name="Area", description='JSON: {"vertex id": weight, ...}')

    def work(self, context: bpy.types.Context) -> str:
        try:
            stored = {int(vertex): float(w) for vertex, w in json.loads(self.area).items()}
        except (ValueError, TypeError, AttributeError, OverflowError) as error:
            raise InputError(f"Area: expected a JSON object of weights by vertex ({error}).") from (
                error
            )
        effect = painted_effect(context)
        effects.set_area(effect, list(stored), list(stored.values()))
        return f"'{effect.name}' covers {len(stored)} vertices"


class HFX_OT_save_area(_PaintedOperator):
    """Save the painted area under a name. Fill Body Part lists saved areas in every file

    An empty area removes the name from the list
    """

    bl_idname = "hfx.save_area"
    bl_label = "Save Area"
    bl_options = {"REGISTER"}  # a file of the user's own; nothing of the scene changes

    name: StringProperty(
        name="Name", description="Name in the list; an area of the same name is replaced"
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.name = painted_effect(context).name
        return context.window_manager.invoke_props_dialog(self)

    def work(self, context: bpy.types.Context) -> str:
        count = painting.save_area(painted_effect(context), self.name.strip())
        return f"'{self.name}' saved" if count else f"'{self.name}' is no longer listed"
