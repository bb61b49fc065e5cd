# SPDX-License-Identifier: GPL-3.0-or-later
"""The HFX tab of the 3D viewport's sidebar."""

from __future__ import annotations

import bpy

from ...authoring.areas.painting import PAINTED_EFFECT
from ...authoring.effects import effects
from ...authoring.surfaces import surfaces
from ...engine.modality import MODALITIES, Parameter
from ...operators.export import draw_devices, last_written
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
            return False  # a surface has a panel of its own
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
        row.alert = hfx.intensity <= 0.0  # nothing of it is felt
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
    row.use_property_split = False  # beside the field, a label with its unit is cut off
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
    """Write what is felt to files"""

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
