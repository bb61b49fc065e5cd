# SPDX-License-Identifier: GPL-3.0-or-later
"""The path of a point on the skin, and the curves of a vector sensation, in the HFX tab."""

from __future__ import annotations

import bpy

from ...authoring.paths import paths
from ...errors import InputError
from ...operators.paths.path_drawing import MODES
from ...operators.paths.path_operators import active_spot
from ...operators.shared import active_effect
from ..sidebar import HfxPanel

_ICONS = {
    "PLACE": "PIVOT_CURSOR",
    "STRAIGHT": "IPO_LINEAR",
    "CURVE": "IPO_BEZIER",
    "FREEHAND": "GREASEPENCIL",
    "RECORD": "REC",
}


class HFX_PT_path(HfxPanel, bpy.types.Panel):
    """Position of the point on the skin, and its path"""

    bl_label = "Point on the Skin"
    bl_order = 2

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return active_spot(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        effect = active_spot(context)
        layout.prop(effect.hfx, "radius")
        layout.prop(effect.hfx, "falloff")
        if effect.hfx.falloff != "none":
            layout.prop(effect.hfx, "falloff_share")
        layout.prop(effect.hfx, "path_position")
        try:
            length = paths.length_m(effect)
        except InputError as error:
            layout.label(text=str(error), icon="ERROR")
            length = 0.0
        layout.label(
            text=f"Path of {100.0 * length:.0f} cm" if length else "Does not move: draw a path",
            icon="CURVE_PATH",
        )
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator("hfx.slide_spot", text="Slide", icon="VIEW_PAN")
        row.operator("hfx.resize_spot", text="Resize", icon="CON_SIZELIMIT")
        row.operator("hfx.key_spot", text="", icon="KEY_HLT")
        grid = layout.grid_flow(columns=2, align=True, even_columns=True)
        for mode, label, _ in MODES:
            grid.operator("hfx.draw_path", text=label, icon=_ICONS[mode]).mode = mode
        grid.operator_menu_enum(
            "hfx.path_from_library", "name", text="Library", icon="ASSET_MANAGER"
        )
        row = layout.row(align=True)
        row.operator("hfx.move_along_path", text="Move", icon="PLAY")
        row.operator("hfx.reverse_path", text="Reverse", icon="ARROW_LEFTRIGHT")
        row.operator("hfx.mirror_path", text="Mirror", icon="MOD_MIRROR")
        row = layout.row(align=True)
        row.operator("hfx.load_path", text="Load", icon="IMPORT")
        row.operator("hfx.save_path", text="Save", icon="EXPORT")


class HFX_PT_vector(HfxPanel, bpy.types.Panel):
    """The strength of each actuator; the dots set keyframes"""

    bl_label = "Vector Sensation"
    bl_order = 2

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        effect = active_effect(context)
        return effect is not None and effect.hfx.kind == "ACTUATORS"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        effect = active_effect(context)
        layout.label(text=f"On '{effect.hfx.device}' only", icon="OUTLINER_OB_FORCE_FIELD")
        column = layout.column(align=True)
        for actuator in effect.hfx.drive:
            column.prop(actuator, "value", text=actuator.name, slider=True)
        layout.operator("hfx.key_actuators", icon="KEY_HLT")
