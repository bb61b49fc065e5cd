# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the active effect: parameters, contact response, painted area, path, actuators."""

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ...authoring import responses
from ...authoring.clips import strips_of
from ...authoring.effects import effects
from ...authoring.painting import PAINTED_EFFECT, canvas_of
from ...authoring.paths import paths
from ...authoring.surfaces import surfaces
from ...blender.events import push_undo_soon
from ...blender.translation import translated
from ...engine.modality import MODALITIES
from ...errors import InputError
from ...operators.effects.effect_operators import active_vector, active_volume
from ...operators.paths.path_drawing import MODES
from ...operators.paths.path_operators import active_spot
from ...operators.shared import active_effect, painted_effect
from ..sidebar import HfxPanel, draw_contact_law, draw_text, draw_with_unit
from .effects_panel import draw_moving

_LOCKED = "The effect belongs to a linked file: its settings are greyed out"


class HFX_PT_effect(HfxPanel, bpy.types.Panel):
    """The active effect"""

    bl_label = "Haptic Effect"
    bl_order = 1

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        if context.object.hfx.role == "EFFECT":
            HFX_PT_effect_presets.draw_panel_header(self.layout)

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
            layout.label(
                text=translated(f"Painting '{obj[PAINTED_EFFECT].name}'"), icon="BRUSH_DATA"
            )
            return
        effect = active_effect(context)
        hfx = effect.hfx
        if effects.is_locked(effect):
            draw_text(context, layout, _LOCKED, "LOCKED")
            layout.operator("hfx.make_editable", icon="UNLOCKED")
        # Without a label, as Blender draws names of data: there is room for a long name.
        layout.prop(effect, "name", text="", icon="EMPTY_DATA")
        layout.prop(hfx, "modality")
        row = layout.row()
        row.alert = hfx.intensity <= 0.0  # a silent effect
        row.prop(hfx, "intensity")
        for control in MODALITIES[hfx.modality].controls:
            label = hfx.bl_rna.properties[control.prop].name
            draw_with_unit(layout, hfx, control.prop, f"{translated(label)} ({control.symbol})")
        if hfx.modality == "temperature":
            layout.prop(hfx, "temperature_reference")
        _draw_level(layout, effect, is_equal=context.scene.hfx.equal_feel)
        if hfx.kind == "VOLUME":
            from ...reading.description.soundness import SIZES  # on use: it loads numpy

            if hfx.shape != "MESH":
                layout.prop(hfx, "shape")
            for name in SIZES.get(hfx.shape, ()):
                layout.prop(hfx, name)
            _draw_falloff(layout, hfx)
            draw_contact_law(layout, hfx)
        else:
            is_bodiless = effects.body_in(context.scene, effect) is None
            if is_bodiless or len(effects.bodies_of(context.scene)) > 1:
                layout.prop(hfx, "body")
            if is_bodiless:
                draw_moving(context, layout, "ACTIVE")


def _draw_level(layout: bpy.types.UILayout, effect: bpy.types.Object, *, is_equal: bool) -> None:
    """Draw the strength in dB SL; a warning below the detection threshold everywhere."""
    try:
        # On use: it loads numpy, and Blender's start does not wait for it.
        from ...authoring.effects.sensation_levels import level_text

        text = level_text(effect, is_equal=is_equal).removesuffix(" dB SL")
    except InputError:
        return  # the panel of the area states the fault
    if text:
        row = layout.row()
        row.alert = text.rpartition("to ")[2].startswith("-")
        row.label(text=translated(f"Above threshold: {text} dB"), icon="MOD_INSTANCE")


class _Presets:
    """Presets of the parameters of a modality, in Blender's preset system."""

    @property
    def preset_subdir(self) -> str:
        """Folder below Blender's folder of presets."""
        return f"hfx_haptics/{bpy.context.object.hfx.modality}"


class HFX_PT_effect_presets(_Presets, PresetPanel, bpy.types.Panel):
    """Presets of the effect's parameters"""

    bl_label = "Effect Presets"
    preset_operator = "script.execute_preset"
    preset_add_operator = "hfx.effect_preset"

    def draw(self, context: bpy.types.Context) -> None:
        # Blender would show "* Missing Paths *" before the first preset.
        folder = f"presets/{self.preset_subdir}"
        bpy.utils.user_resource("SCRIPTS", path=folder, create=True)
        super().draw(context)

    @staticmethod
    def post_cb(_context: bpy.types.Context, _file: str) -> None:
        """Push an undo step, which Blender's operator of presets does not."""
        push_undo_soon()


class HFX_OT_effect_preset(_Presets, AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of the effect's parameters"""

    bl_idname = "hfx.effect_preset"
    bl_label = "Effect Preset"
    preset_menu = "HFX_PT_effect_presets"
    preset_defines = ("hfx = bpy.context.object.hfx",)

    @property
    def preset_values(self) -> list[str]:
        """Stored properties: parameters of the modality, intensity and falloff."""
        controls = MODALITIES[bpy.context.object.hfx.modality].controls
        names = [control.prop for control in controls]
        names += ["intensity", "temperature_reference", "falloff", "falloff_share"]
        return [f"hfx.{name}" for name in names]


def _draw_falloff(layout: bpy.types.UILayout, hfx: bpy.types.PropertyGroup) -> None:
    layout.prop(hfx, "falloff")
    if hfx.falloff != "none":
        layout.prop(hfx, "falloff_share")


_FILTER_ICONS = {
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
        row.prop(item, "name", text="", emboss=False, icon=_FILTER_ICONS[item.kind])
        row.prop(item, "influence", text="", emboss=False)
        icon = "CHECKBOX_DEHLT" if item.is_muted else "CHECKBOX_HLT"
        row.prop(item, "is_muted", text="", icon=icon, emboss=False, invert_checkbox=True)


class HFX_PT_response(HfxPanel, bpy.types.Panel):
    """Response of the volume to a touch: filters, from top to bottom"""

    bl_label = "Contact Response"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    subject = staticmethod(active_volume)

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


class HFX_PT_area(HfxPanel, bpy.types.Panel):
    """The area of the active painted effect"""

    bl_label = "Painted Area"
    bl_order = 2

    subject = staticmethod(painted_effect)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        effect = painted_effect(context)
        canvas = canvas_of(effect)
        if canvas is None and effects.has_other_area(effect):
            column = layout.column()
            column.alert = True
            draw_text(context, column, "Painted for another model: not felt", "ERROR")
            layout.operator("hfx.area_keep", icon="FORWARD")
        row = layout.row(align=True)
        row.scale_y = 1.3
        if canvas is None:
            row.operator("hfx.paint_begin", icon="BRUSH_DATA")
            layout = row
        else:
            row.operator("hfx.paint_end", icon="CHECKMARK")
            if not strips_of(effect):
                layout.operator("hfx.add_clip", text="Finish, Add Clip", icon="NLA")
            layout.prop(canvas.data, "use_mirror_x", text="Paint Both Sides", icon="MOD_MIRROR")
            layout.operator("hfx.area_atlas", icon="UV")
        layout.operator_menu_enum("hfx.fill_part", "part", icon="MOD_ARMATURE")


class HFX_PT_area_transfer(HfxPanel, bpy.types.Panel):
    """The whole area: turned round, emptied, from elsewhere, to another effect"""

    bl_label = "More"
    bl_parent_id = "HFX_PT_area"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        for actions in (("grow", "shrink", "smooth"), ("invert", "clear")):
            row = layout.row(align=True)
            for action in actions:
                row.operator("hfx.area_filter", text=action.title()).action = action
        layout.operator_menu_enum("hfx.area_mirror", "action", icon="MOD_MIRROR")
        column = layout.column(align=True)
        column.operator("hfx.area_atlas", icon="UV")
        column.operator("hfx.area_from_selection", icon="RESTRICT_SELECT_OFF")
        column.operator("hfx.area_from_image", icon="IMAGE_DATA")
        column = layout.column(align=True)
        column.operator("hfx.save_area", icon="FILE_TICK")
        column.operator("hfx.area_copy", icon="COPYDOWN")
        column.operator("hfx.effect_mirrored", icon="ARROW_LEFTRIGHT")


_PATH_ICONS = {
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

    subject = staticmethod(active_spot)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        effect = active_spot(context)
        layout.prop(effect.hfx, "radius")
        _draw_falloff(layout, effect.hfx)
        layout.prop(effect.hfx, "path_position")
        try:
            length = paths.length_m(effect)
        except InputError as error:
            layout.label(text=translated(str(error)), icon="ERROR")
            length = 0.0
        layout.label(
            text=translated(
                f"Path of {100.0 * length:.0f} cm" if length else "Does not move: draw a path"
            ),
            icon="CURVE_PATH",
        )
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator("hfx.slide_spot", text="Slide", icon="VIEW_PAN")
        row.operator("hfx.resize_spot", text="Resize", icon="CON_SIZELIMIT")
        row.operator("hfx.key_spot", text="", icon="KEY_HLT")
        grid = layout.grid_flow(columns=2, align=True, even_columns=True)
        for mode, label, _ in MODES:
            grid.operator("hfx.draw_path", text=label, icon=_PATH_ICONS[mode]).mode = mode
        grid.operator_menu_enum(
            "hfx.path_from_library", "name", text="Library", icon="ASSET_MANAGER"
        )
        layout.operator("hfx.move_along_path", icon="PLAY")
        row = layout.row(align=True)
        row.operator("hfx.reverse_path", text="Reverse", icon="ARROW_LEFTRIGHT")
        row.operator("hfx.mirror_path", text="Mirror", icon="MOD_MIRROR")
        row = layout.row(align=True)
        row.operator("hfx.load_path", text="Load", icon="IMPORT")
        row.operator("hfx.save_path", text="Save", icon="EXPORT")


class HFX_PT_vector(HfxPanel, bpy.types.Panel):
    """The strength of each actuator; the dots set keyframes"""

    bl_label = "Vector Sensation"
    bl_order = 2

    subject = staticmethod(active_vector)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        effect = active_vector(context)
        layout.label(
            text=translated(f"On '{effect.hfx.device}' only"), icon="OUTLINER_OB_FORCE_FIELD"
        )
        column = layout.column(align=True)
        for actuator in effect.hfx.drive:
            column.prop(actuator, "value", text=actuator.name, slider=True)
        layout.operator("hfx.key_actuators", icon="KEY_HLT")
