# SPDX-License-Identifier: GPL-3.0-or-later
"""Next step on the way from an empty scene to an exported effect: in the 3D viewport's header once
the scene has a haptic body, and in the sidebar until the panels of an effect offer the rest.
"""

from __future__ import annotations

import bpy

from ..authoring import clips
from ..authoring.areas import painting
from ..authoring.effects import effects, swarms
from ..operators.shared import active_armature, active_effect


def draw_first(context: bpy.types.Context, layout: bpy.types.UILayout) -> bool:
    """Draw the button of the next step until the scene has an effect; returns True if drawn."""
    scene = context.scene
    if not effects.bodies_of(scene):
        if active_armature(context) is not None:
            layout.operator("hfx.mark_body", icon="ADD")
        else:
            layout.operator(
                "hfx.add_avatar", text="Add Built-In Avatar", icon="OUTLINER_OB_ARMATURE"
            )
    elif not swarms.listed_effects(scene):
        layout.operator_menu_enum(
            "hfx.add_painted", "modality", text="Paint an Effect", icon="BRUSH_DATA"
        ).paint = True
    else:
        return False
    return True


def _draw_further(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """Draw the next step of the active effect: paint, transfer the area, add a clip, export."""
    effect = active_effect(context)
    if effect is None:
        return
    if effect.hfx.kind == "PAINTED" and not effects.area(effect)[0]:
        layout.operator("hfx.paint_begin", icon="BRUSH_DATA")
    elif effects.has_other_area(effect):
        layout.operator("hfx.area_keep", icon="FORWARD")
    elif not clips.strips_of(effect):
        layout.operator("hfx.add_clip", icon="NLA")
    else:
        layout.operator("hfx.export", icon="EXPORT")


def draw_header(self: bpy.types.Header, context: bpy.types.Context) -> None:
    active = context.object
    if active is not None and active.get(painting.PAINTED_EFFECT) is not None:
        self.layout.operator("hfx.paint_end", icon="CHECKMARK")
    elif effects.bodies_of(context.scene) and not draw_first(context, self.layout):
        _draw_further(context, self.layout)


def register() -> None:
    bpy.types.VIEW3D_HT_header.append(draw_header)


def unregister() -> None:
    bpy.types.VIEW3D_HT_header.remove(draw_header)
