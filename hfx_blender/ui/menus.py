# SPDX-License-Identifier: GPL-3.0-or-later
"""Entries in Blender's own menus: Add > Haptic, File > Import and Export."""

from __future__ import annotations

import bpy

from ..properties import SHAPES


class HFX_MT_add(bpy.types.Menu):
    """Add > Haptic"""

    bl_idname = "HFX_MT_add"
    bl_label = "Haptic"

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator("hfx.add_avatar", icon="OUTLINER_OB_ARMATURE")
        layout.separator()
        icons = {"SPHERE": "SPHERE", "CUBOID": "CUBE", "CYLINDER": "MESH_CYLINDER"}
        for shape, label, _ in SHAPES[:-1]:
            icon = icons.get(shape, "MESH_CAPSULE")
            layout.operator_menu_enum(
                "hfx.add_volume", "modality", text=label, icon=icon
            ).shape = shape
        layout.operator_menu_enum(
            "hfx.volume_from_mesh", "modality", text="From Selected Mesh", icon="MESH_DATA"
        )
        layout.separator()
        layout.operator_menu_enum(
            "hfx.add_painted", "modality", text="Painted Effect", icon="BRUSH_DATA"
        )
        layout.operator_menu_enum(
            "hfx.add_spot", "modality", text="Point on the Skin", icon="CURVE_PATH"
        )
        layout.operator("hfx.add_vector_sensation", icon="GRAPH")
        layout.separator()
        layout.operator_menu_enum(
            "hfx.add_from_library", "name", text="Sensation", icon="ASSET_MANAGER"
        )
        layout.operator("hfx.add_rain", icon="OUTLINER_OB_FORCE_FIELD")
        layout.operator("hfx.load_effects", icon="IMPORT")
        layout.operator("hfx.save_effects", icon="EXPORT")


def _add_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(HFX_MT_add.bl_idname, icon="VIEW_PAN")  # a hand


def _export_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator("hfx.export", text="Haptics (.hfxtrack)")


def _import_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator("hfx.import_hjif", text="Haptics (.hjif)")


_register, _unregister = bpy.utils.register_classes_factory((HFX_MT_add,))


def register() -> None:
    _register()
    bpy.types.VIEW3D_MT_add.append(_add_menu)
    bpy.types.TOPBAR_MT_file_export.append(_export_menu)
    bpy.types.TOPBAR_MT_file_import.append(_import_menu)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(_import_menu)
    bpy.types.TOPBAR_MT_file_export.remove(_export_menu)
    bpy.types.VIEW3D_MT_add.remove(_add_menu)
    _unregister()
