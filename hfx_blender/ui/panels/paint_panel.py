# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting panel: tools for the area of an effect, and the end of painting."""

from __future__ import annotations

import bpy

from ...authoring.areas.painting import canvas_of
from ...authoring.effects import effects
from ...operators.shared import painted_effect
from ..sidebar import HfxPanel, draw_text


class HFX_PT_area(HfxPanel, bpy.types.Panel):
    """The area of the active painted effect"""

    bl_label = "Painted Area"
    bl_order = 2

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return painted_effect(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        effect = painted_effect(context)
        canvas = canvas_of(effect)
        if canvas is None and effects.has_other_area(effect):
            column = layout.column()
            column.alert = True
            draw_text(context, column, "Painted for another modality: not felt", "ERROR")
            layout.operator("hfx.area_keep", icon="FORWARD")
        row = layout.row()
        row.scale_y = 1.3
        if canvas is None:
            row.operator("hfx.paint_begin", icon="BRUSH_DATA")
        else:
            row.operator("hfx.paint_end", icon="CHECKMARK")
            layout.prop(canvas.data, "use_mirror_x", text="Paint Both Sides", icon="MOD_MIRROR")
        layout.operator_menu_enum("hfx.fill_part", "part", icon="MOD_ARMATURE")
        row = layout.row(align=True)
        for action, label in (("grow", "Grow"), ("shrink", "Shrink"), ("smooth", "Smooth")):
            row.operator("hfx.area_filter", text=label).action = action
        layout.operator_menu_enum("hfx.area_mirror", "action", icon="MOD_MIRROR")


class HFX_PT_area_transfer(HfxPanel, bpy.types.Panel):
    """The whole area: turned round, emptied, from elsewhere, to another effect"""

    bl_label = "More"
    bl_parent_id = "HFX_PT_area"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        for action, label in (("invert", "Invert"), ("clear", "Clear")):
            row.operator("hfx.area_filter", text=label).action = action
        column = layout.column(align=True)
        column.operator("hfx.area_from_selection", icon="RESTRICT_SELECT_OFF")
        column.operator("hfx.area_from_image", icon="IMAGE_DATA")
        column = layout.column(align=True)
        column.operator("hfx.save_area", icon="FILE_TICK")
        column.operator("hfx.area_copy", icon="COPYDOWN")
        column.operator("hfx.effect_mirrored", icon="ARROW_LEFTRIGHT")
