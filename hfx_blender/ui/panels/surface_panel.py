# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the active object's haptic surface, and of material generation."""

import bpy

from ...authoring.surfaces import surface_updates, surfaces
from ...files.kinds import GENERATED_SUFFIX, PICTURE_SUFFIXES
from ...operators.shared import active_armature
from ...operators.surfaces import generation_operators
from ...operators.surfaces.surface_operators import active_surface
from ..sidebar import HfxPanel, PictureIcons, draw_contact_law, draw_text, draw_with_unit

_SOURCE_FIELDS = {
    "MATERIAL": ("resolution", "height_mm"),
    "IMAGE": ("image", "image_kind", "height_mm", "roughness_image"),
    "SCAN": ("scan_path", "scan_unit_mm", "resolution"),
    "PROCEDURAL": ("procedural", "seed", "resolution"),
}
_LAYERS = (
    ("relief_image", "Relief"),
    ("intensity_image", "Intensity"),
    ("sharpness_image", "Sharpness"),
)


class HFX_PT_surface(HfxPanel, bpy.types.Panel):
    """The active object's surface"""

    bl_label = "Haptic Surface"
    bl_order = 2

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        return (
            obj is not None
            and obj.type == "MESH"
            and context.mode == "OBJECT"  # other modes show a perceptual model
            and obj.hfx.role in ("NONE", "EFFECT")
            and (obj.hfx.role == "NONE" or surfaces.is_surface(obj))
        )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        obj = active_surface(context)
        if obj is None:
            layout.operator_menu_enum("hfx.add_surface", "source", text="Feel It", icon="VIEW_PAN")
            layout.operator("hfx.estimate_relief", icon="IMAGE_RGB")
            return
        settings = obj.hfx.surface
        row = layout.row(align=True)
        row.prop(settings, "source")
        row.operator("hfx.remove_surface", text="", icon="X")
        self._draw_maps(layout, obj)
        if settings.is_outdated:
            sentence = "Out of date: the material was edited. Press Make Maps."
            draw_text(context, layout, sentence, "ERROR")
        row = layout.row(align=True)
        row.operator("hfx.bake_surface", icon="RENDER_STILL")
        row.operator("hfx.stroke_pad", icon="GREASEPENCIL")
        row.operator("hfx.export_stroke", text="", icon="EXPORT")
        if settings.source in ("MATERIAL", "IMAGE"):
            layout.operator("hfx.estimate_relief", icon="IMAGE_RGB")
        if settings.note:
            icon = "ERROR" if settings.is_faulty else "INFO"
            draw_text(context, layout, settings.note, icon)
        if settings.warning and not settings.is_faulty:
            draw_text(context, layout, settings.warning, "ERROR")
        for name in _SOURCE_FIELDS.get(settings.source, ()):
            layout.prop(settings, name)
        if settings.source == "SCAN" and settings.scan_path.lower().endswith(PICTURE_SUFFIXES):
            layout.prop(settings, "scan_size_mm")
            layout.prop(settings, "height_mm")
        if settings.source != "MAP":
            layout.prop_search(settings, "uv_map", obj.data, "uv_layers")
            layout.prop(settings, "use_own_scale")
            if settings.use_own_scale:
                layout.prop(settings, "uv_mm")

    @staticmethod
    def _draw_maps(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
        """Draw the material and the haptic maps present, in two columns."""
        surface_updates.on_shown(obj)
        shown = [(obj.active_material, "Material")]
        shown += [(getattr(obj.hfx.surface, name), label) for name, label in _LAYERS]
        grid = layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        for image, label in shown:
            if image is None:
                continue
            column = grid.column(align=True)
            column.template_icon(icon_value=layout.icon(image), scale=4.0)
            column.label(text=label)


class SurfacePanel(HfxPanel):
    """Base of subpanels of an object with a haptic surface."""

    bl_parent_id = "HFX_PT_surface"
    subject = staticmethod(active_surface)


class HFX_PT_surface_files(SurfacePanel, bpy.types.Panel):
    """A surface from a picture, a scan or a file of maps, and back"""

    bl_label = "Files"
    bl_order = 1
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        row.operator("hfx.load_surface_image", text="Image", icon="IMAGE_DATA")
        row.operator("hfx.load_scan", text="Scan", icon="MOD_OCEAN")
        row = layout.row(align=True)
        row.operator("hfx.import_texture", icon="IMPORT")
        row.operator("hfx.export_texture", icon="EXPORT")


class HFX_PT_surface_felt(SurfacePanel, bpy.types.Panel):
    """Rendering of the surface as vibration"""

    bl_label = "Felt As"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        hfx = context.object.hfx
        settings = hfx.surface
        layout.prop(settings, "renderer")
        layout.prop(hfx, "intensity")
        draw_with_unit(layout, hfx, "amplitude", "Strongest (m/s²)")
        if settings.renderer == "MCHA":
            for name in ("blur_mm", "full_slope", "lowest_hz", "highest_hz", "use_steps"):
                layout.prop(settings, name)
        else:
            layout.prop(settings, "drive")
            if settings.renderer == "TEXTILE":
                layout.prop(hfx, "frequency", text="Carrier (Hz)")
        layout.prop(settings, "sound")
        draw_contact_law(layout, hfx)


class HFX_PT_surface_calibration(SurfacePanel, bpy.types.Panel):
    """Calibration of the strength of fabrics, for you and for a device"""

    bl_label = "Calibration"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        chosen = context.window_manager.hfx_surface_calibration
        layout.prop_search(chosen, "device", context.scene.hfx, "devices")
        layout.prop(chosen, "fabric")
        row = layout.row()
        row.prop(chosen, "speed", expand=True)
        layout.prop(chosen, "drive", slider=True)
        layout.operator("hfx.feel_fabric", icon="PLAY")


_icons = PictureIcons()


class HFX_PT_generation(HfxPanel, bpy.types.Panel):
    """Generate a material with a haptic surface, from text or a picture"""

    bl_label = "Material from Words or Picture"
    bl_order = 1  # above the surface's panel, to keep results in sight
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        # A running generation stays in sight with any selection, and can be cancelled.
        if context.mode != "OBJECT" or generation_operators.running is not None or obj is None:
            return context.mode == "OBJECT"
        is_free = obj.hfx.role == "NONE" and active_armature(context) is None
        return obj.type == "MESH" and (is_free or surfaces.is_surface(obj))

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        generation = context.window_manager.hfx_generation
        layout.row().prop(generation, "source", expand=True)
        if generation.source == "WORDS":
            layout.prop(generation, "words", text="", icon="GREASEPENCIL")
            layout.prop(generation, "negative")
            row = layout.row(align=True)
            row.prop(generation, "seed")
            row.prop(generation, "variations")
            layout.prop(generation, "resolution")
        else:
            layout.prop(generation, "picture", text="")
            layout.prop(generation, "size_mm")
            layout.prop(generation, "height_mm")
            layout.prop(generation, "tiles")
        layout.prop(generation, "use_steps")
        if generation_operators.running is not None:
            share = generation_operators.running.share
            row = layout.row(align=True)
            row.progress(factor=share, text=f"{share:.0%}")
            row.operator("hfx.cancel_generation", text="", icon="X")
            return
        layout.operator("hfx.generate_surface", icon="SHADERFX")
        self._draw_results(context, layout)

    @staticmethod
    def _draw_results(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        obj = context.object
        is_felt = obj is not None and obj.hfx.surface.source == "GENERATED"
        if is_felt and obj.hfx.kind == "SURFACE":
            layout.operator("hfx.stroke_pad", icon="GREASEPENCIL")
        grid = layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        for number, record in enumerate(generation_operators.results):
            column = grid.column(align=True)
            colours = record.with_name(record.name.removesuffix(GENERATED_SUFFIX) + ".colour.png")
            icon = _icons.number_of(colours, only_folder=True)
            column.template_icon(icon_value=icon, scale=5.0)
            column.operator("hfx.use_generated").number = number
        if is_felt and obj.hfx.surface.note:
            draw_text(context, layout, obj.hfx.surface.note, "INFO")


def unregister() -> None:
    _icons.free()
