# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the active haptic effect, its contact response, and the export."""

from __future__ import annotations

import bpy

from ...authoring import responses
from ...authoring.areas.painting import PAINTED_EFFECT
from ...authoring.effects import effects
from ...authoring.surfaces import surfaces
from ...engine.modality import MODALITIES, Parameter
from ...operators.effects.response import active_volume
from ...operators.export_operator import draw_devices, last_written
from ...operators.shared import active_effect
from ..sidebar import HfxPanel, draw_text
from .effects_panel import draw_moving

_DIMENSIONS = {
    "CUBOID": ("size",),
    "SPHERE": ("radius",),
    "CYLINDER": ("radius", "height"),
    "CAPSULE": ("radius", "height"),
    "MESH": (),
}


class HFX_PT_effect(HfxPanel, bpy.types.Panel):
    """The active effect"""

    bl_label = "Haptic Effect"
    bl_order = 1

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        if obj is None or surfaces.is_surface(obj):
            return False  # surfaces have their own panel
        return active_effect(context) is not None or bool(obj.get(PAINTED_EFFECT))

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        obj = context.object
        if obj.get(PAINTED_EFFECT):
            layout.label(text=f"Painting '{obj[PAINTED_EFFECT].name}'", icon="BRUSH_DATA")
            return
        effect = active_effect(context)
        hfx = effect.hfx
        if effects.is_locked(effect):
            draw_text(context, layout, "Of a linked file: its settings are locked", "LOCKED")
            layout.operator("hfx.make_editable", icon="UNLOCKED")
        layout.prop(effect, "name")
        layout.prop(hfx, "modality")
        row = layout.row()
        row.alert = hfx.intensity <= 0.0  # a silent effect
        row.prop(hfx, "intensity")
        for control in MODALITIES[hfx.modality].controls:
            _draw_parameter(layout, hfx, control)
        if hfx.modality == "temperature":
            layout.prop(hfx, "temperature_reference")
        if hfx.kind == "VOLUME":
            _draw_volume(layout, hfx)
        else:
            layout.prop(hfx, "body")
            if effects.body_in(context.scene, effect) is None:
                draw_moving(context, layout, "ACTIVE")


def _draw_parameter(
    layout: bpy.types.UILayout, hfx: bpy.types.PropertyGroup, control: Parameter
) -> None:
    name = control.prop
    row = layout.row(align=True)
    row.use_property_split = False  # split labels are too narrow for units
    label = hfx.bl_rna.properties[name].name
    row.prop(hfx, name, text=f"{label} ({control.symbol})")
    row.prop_decorator(hfx, name)


def _draw_volume(layout: bpy.types.UILayout, hfx: bpy.types.PropertyGroup) -> None:
    if hfx.shape != "MESH":
        layout.prop(hfx, "shape")
    for name in _DIMENSIONS[hfx.shape]:
        layout.prop(hfx, name)
    layout.prop(hfx, "falloff")
    if hfx.falloff != "none":
        layout.prop(hfx, "falloff_share")


class HFX_PT_export(HfxPanel, bpy.types.Panel):
    """Export the haptic effects to files"""

    bl_label = "Haptic Export"
    bl_order = 5

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        draw_devices(context, layout)
        layout.operator("hfx.export", icon="EXPORT")
        for written in last_written:
            row = layout.row(align=True)
            files = "1 file" if written.count == 1 else f"{written.count} files"
            row.label(
                text=f"Wrote {files}{written.warned}",
                icon="ERROR" if written.warnings else "CHECKMARK",
            )
            row.operator("wm.path_open", text="Open", icon="FILE_FOLDER").filepath = str(
                written.folder
            )


class HFX_PT_sampling(HfxPanel, bpy.types.Panel):
    """Resolution of the recording in time and space"""

    bl_label = "Sampling"
    bl_parent_id = "HFX_PT_export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(context.scene.hfx, "rate")
        layout.prop(context.scene.hfx, "tolerance")
        if context.scene.hfx.tolerance == "CUSTOM":
            layout.prop(context.scene.hfx, "tolerance_custom", text=" ")


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
    def _draw_filter(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
        column = layout.column()
        column.use_property_split = True
        column.active = not settings.is_muted
        column.prop(settings, "kind")
        in_space = settings.kind == "distance" or (
            settings.kind == "sine" and settings.domain != "time"
        )
        if not in_space:
            column.prop(settings, "operation")
        if settings.kind == "distance":
            column.prop(settings, "about")
        if settings.kind == "sine":
            column.prop(settings, "domain")
        for name in responses.properties_of(settings):
            column.prop(settings, name)
