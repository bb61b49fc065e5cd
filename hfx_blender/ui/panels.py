# SPDX-License-Identifier: GPL-3.0-or-later
"""The HFX tab of the 3D viewport's sidebar."""

from __future__ import annotations

import bpy

_PARAMETERS = {
    "vibration": ("amplitude", "frequency"),
    "pressure": ("pressure",),
    "temperature": ("temperature", "temperature_reference"),
    "wind": ("wind_speed",),
}
_DIMENSIONS = {
    "CUBOID": ("size",),
    "SPHERE": ("radius",),
    "CYLINDER": ("radius", "height"),
    "CAPSULE": ("radius", "height"),
    "MESH": (),
}


class _HfxPanel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "HFX"


class HFX_PT_effect(_HfxPanel, bpy.types.Panel):
    """The active effect, or what to do next"""

    bl_label = "Haptic Effect"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        obj = context.object
        if obj is not None and obj.get("hfx_painted_effect"):
            layout.operator("hfx.paint_end", icon="CHECKMARK")
            return
        if obj is None or obj.hfx.role != "EFFECT":
            layout.label(text="Add a body and effects:")
            layout.menu("HFX_MT_add", icon="ADD")
            layout.operator("hfx.mark_body", icon="ARMATURE_DATA")
            return
        hfx = obj.hfx
        layout.prop(obj, "name")
        layout.prop(hfx, "modality")
        layout.prop(hfx, "intensity")
        for name in _PARAMETERS[hfx.modality]:
            layout.prop(hfx, name)
        if hfx.kind == "VOLUME":
            self._draw_volume(layout, hfx)
        else:
            layout.prop(hfx, "body")
            layout.operator("hfx.paint_begin", icon="BRUSH_DATA")
            layout.operator_menu_enum("hfx.fill_part", "part", icon="MOD_ARMATURE")
        row = layout.row(align=True)
        row.operator("hfx.add_clip", icon="NLA")
        row.operator("hfx.add_heartbeat", icon="HEART")

    @staticmethod
    def _draw_volume(layout: bpy.types.UILayout, hfx: bpy.types.PropertyGroup) -> None:
        if hfx.shape != "MESH":
            layout.prop(hfx, "shape")
        for name in _DIMENSIONS[hfx.shape]:
            layout.prop(hfx, name)
        layout.prop(hfx, "falloff")
        if hfx.falloff != "none":
            layout.prop(hfx, "falloff_share")


class HFX_PT_export(_HfxPanel, bpy.types.Panel):
    """What is exported"""

    bl_label = "Haptic Export"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(context.scene.hfx, "rate")
        for device in context.scene.hfx.devices:
            layout.label(text=device.name, icon="OUTLINER_OB_FORCE_FIELD")
        layout.operator("hfx.export", icon="EXPORT")


register, unregister = bpy.utils.register_classes_factory((HFX_PT_effect, HFX_PT_export))
