# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of a volume's contact response: its stack of filters."""

from __future__ import annotations

import bpy

from ...authoring import responses
from ...operators.effects.response import active_volume
from ..sidebar import HfxPanel

_ICONS = {
    "distance": "DRIVER_DISTANCE",
    "speed": "FORCE_DRAG",
    "impact": "MOD_PHYSICS",
    "proximity": "PROP_CON",
    "sine": "RNDCURVE",
}


class HFX_UL_response(bpy.types.UIList):
    """Filters of a contact response"""

    def draw_item(
        self,
        _context: bpy.types.Context,
        layout: bpy.types.UILayout,
        _data: object,
        item: bpy.types.PropertyGroup,
        _icon: int,
        _active_data: object,
        _active_property: str,
    ) -> None:
        row = layout.row(align=True)
        row.active = not item.is_muted
        row.prop(item, "name", text="", emboss=False, icon=_ICONS[item.kind])
        row.prop(item, "influence", text="", emboss=False)
        icon = "CHECKBOX_DEHLT" if item.is_muted else "CHECKBOX_HLT"
        row.prop(item, "is_muted", text="", icon=icon, emboss=False, invert_checkbox=True)


class HFX_PT_response(HfxPanel, bpy.types.Panel):
    """Response of the volume to a touch: filters, from top to bottom"""

    bl_label = "Contact Response"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return active_volume(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout, hfx = self.layout, active_volume(context).hfx
        row = layout.row()
        row.template_list("HFX_UL_response", "", hfx, "response", hfx, "response_active", rows=3)
        column = row.column(align=True)
        column.operator_menu_enum("hfx.add_response_filter", "kind", text="", icon="ADD")
        column.operator("hfx.remove_response_filter", text="", icon="REMOVE")
        column.separator()
        column.operator("hfx.move_response_filter", text="", icon="TRIA_UP").direction = "UP"
        column.operator("hfx.move_response_filter", text="", icon="TRIA_DOWN").direction = "DOWN"
        if 0 <= hfx.response_active < len(hfx.response):
            self._draw_filter(layout, hfx.response[hfx.response_active])
        if hfx.response:
            layout.operator("hfx.bake_response", icon="KEY_HLT")

    @staticmethod
    def _draw_filter(layout: bpy.types.UILayout, each: bpy.types.PropertyGroup) -> None:
        column = layout.column()
        column.use_property_split = True
        column.active = not each.is_muted
        column.prop(each, "kind")
        in_space = each.kind == "distance" or (each.kind == "sine" and each.domain != "time")
        if not in_space:
            column.prop(each, "operation")
        if each.kind == "distance":
            column.prop(each, "about")
        if each.kind == "sine":
            column.prop(each, "domain")
        for name in responses.properties_of(each):
            column.prop(each, name)
