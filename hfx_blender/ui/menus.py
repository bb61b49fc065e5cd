# SPDX-License-Identifier: GPL-3.0-or-later
"""Entries in Blender's own menus and in the 3D viewport's header.

The menus are Add > Haptic, File > Import and Export, context menus, the NLA editor's Add, and the
sequencer's Strip. The header shows the next step from a haptic body to an exported effect.
"""

from math import inf

import bpy

from ..authoring import clips, painting
from ..authoring.effects import effects, swarms
from ..blender import early_imports
from ..engine.modality import MODALITIES
from ..operators.effects.clip_operators import draw_clip_buttons
from ..operators.media_operators import active_sound
from ..operators.shared import KeyBindings, active_armature, active_body, active_effect
from ..playback.live.listening import properties_by_parameter
from ..properties.objects import SHAPES

_OWN_HEADER, _BUTTON = 900.0, 140.0
"""Widths of the viewport's header in Object Mode, and of a button, at an interface scale of 1."""


class HFX_MT_add(bpy.types.Menu):
    """Add > Haptic"""

    bl_idname = "HFX_MT_add"
    bl_label = "Haptic"

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator("hfx.add_avatar", icon="OUTLINER_OB_ARMATURE")
        layout.separator()
        icons = {"SPHERE": "SPHERE", "CUBOID": "CUBE", "CYLINDER": "MESH_CYLINDER"}

        def add(operator: str, label: str, icon: str) -> bpy.types.OperatorProperties:
            return layout.operator_menu_enum(operator, "modality", text=label, icon=icon)

        for shape, label, _ in SHAPES[:-1]:
            icon = icons.get(shape, "MESH_CAPSULE")
            add("hfx.add_volume", label, icon).shape = shape
        add("hfx.volume_from_mesh", "From Selected Mesh", "MESH_DATA")
        layout.separator()
        draw_paint_menu(layout, "Painted Effect")
        layout.menu(HFX_MT_on_part.bl_idname, icon="MOD_ARMATURE")
        add("hfx.add_spot", "Point on the Skin", "CURVE_PATH")
        layout.operator_menu_enum("hfx.add_vector_sensation", "device", icon="GRAPH")
        layout.separator()
        layout.operator_menu_enum(
            "hfx.add_from_library", "name", text="Sensation", icon="ASSET_MANAGER"
        )
        layout.operator("hfx.add_rain", icon="OUTLINER_OB_FORCE_FIELD")
        layout.operator("hfx.feel_sound", icon="SOUND")
        layout.operator("hfx.load_effects", icon="IMPORT")
        layout.operator("hfx.save_effects", icon="EXPORT")
        layout.operator("hfx.paste_effects", icon="PASTEDOWN")


class HFX_MT_on_part(bpy.types.Menu):
    """Effects on a body part, by modality"""

    bl_idname = "HFX_MT_on_part"
    bl_label = "On a Body Part"

    def draw(self, _context: bpy.types.Context) -> None:
        for id, modality in MODALITIES.items():
            texts = {"text": modality.title, "icon": modality.icon}
            self.layout.operator_menu_enum("hfx.add_on_part", "part", **texts).modality = id


class HFX_MT_list(bpy.types.Menu):
    """Actions for the selected effects of the list"""

    bl_idname = "HFX_MT_list"
    bl_label = "Effects"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_menu_enum("hfx.move_to_group", "group", icon="GROUP")
        layout.separator()
        for name in ("scale_strength", "scale_frequency", "modulate"):
            layout.operator(f"hfx.{name}")
        layout.operator("hfx.compare_takes", icon="ARROW_LEFTRIGHT")
        layout.separator()
        layout.operator("hfx.copy_effects", icon="COPYDOWN")
        layout.operator("hfx.paste_effects", icon="PASTEDOWN")
        layout.menu("HFX_MT_copy_address")
        layout.separator()
        layout.prop_menu_enum(context.scene.hfx, "list_order", icon="SORTALPHA")


class HFX_MT_object(bpy.types.Menu):
    """Actions for the active effect or body"""

    bl_idname = "HFX_MT_object"
    bl_label = "Haptic"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        effect = active_effect(context)
        if effect is not None:
            if effect.hfx.kind == "PAINTED":
                layout.operator("hfx.paint_begin", icon="BRUSH_DATA")
                layout.operator("hfx.effect_mirrored", icon="ARROW_LEFTRIGHT")
            draw_clip_buttons(layout)
            layout.operator("hfx.copy_clips", icon="COPYDOWN")
            if effect.hfx.kind in effects.ON_A_BODY:
                layout.operator_menu_enum("hfx.move_to_body", "body", icon="FORWARD")
            layout.separator()
            layout.prop(effect.hfx, "is_muted")
            layout.prop(effect.hfx, "is_solo")
            layout.separator()
            layout.operator_menu_enum("hfx.move_to_group", "group", icon="GROUP")
            layout.operator("hfx.copy_effects", icon="COPYDOWN")
            layout.operator("hfx.save_effects", icon="EXPORT")
            layout.menu("HFX_MT_copy_address")
        elif active_body(context) is None:
            layout.operator("hfx.mark_body", icon="ADD")
        else:
            draw_paint_menu(layout, "Painted Effect")
        layout.operator("hfx.paste_effects", icon="PASTEDOWN")


class HFX_MT_copy_address(bpy.types.Menu):
    """Values of the active effect with an OSC address"""

    bl_label = "Copy Address"

    def draw(self, context: bpy.types.Context) -> None:
        effect = active_effect(context)
        if effect is None:
            return
        for parameter in (*properties_by_parameter(effect), "mute"):
            text = parameter.replace("_", " ").title()
            operator = self.layout.operator("hfx.copy_address", text=text, translate=False)
            operator.parameter = parameter


class HFX_MT_effect_pie(bpy.types.Menu):
    """Most used actions of the active effect"""

    bl_label = "Haptic Effect"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return active_effect(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        pie, effect = self.layout.menu_pie(), active_effect(context)
        # Left, right, bottom, top, then the upper corners.
        pie.prop(effect.hfx, "is_muted", icon="MUTE_IPO_OFF")
        pie.prop(effect.hfx, "is_solo", icon="SOLO_ON")
        pie.operator("hfx.add_clip", icon="NLA")
        if effect.hfx.kind == "PAINTED":
            pie.operator("hfx.paint_begin", icon="BRUSH_DATA")
        else:
            pie.separator()
        if effect.hfx.kind in effects.ON_A_BODY:
            pie.operator_menu_enum("hfx.move_to_body", "body", icon="FORWARD")


def draw_add_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(HFX_MT_add.bl_idname, icon="VIEW_PAN")  # icon of a hand


def draw_object_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the menu Haptic in context menus of objects, for effects, armatures and avatars."""
    if active_effect(context) is not None or active_armature(context) is not None:
        self.layout.separator()
        self.layout.menu(HFX_MT_object.bl_idname, icon="VIEW_PAN")


def draw_list_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw *Move to Group* in the context menu of the list of effects."""
    shown = getattr(context, "ui_list", None)
    if shown is not None and shown.bl_idname == "HFX_UL_effects":
        self.layout.operator_menu_enum("hfx.move_to_group", "group", icon="GROUP")


def draw_nla_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    if active_effect(context) is not None:
        self.layout.separator()
        draw_clip_buttons(self.layout, "Haptic")


def draw_strip_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    strip = active_sound(context)
    if strip is not None:
        self.layout.separator()
        self.layout.operator_context = "INVOKE_DEFAULT"
        self.layout.operator("hfx.feel_sound", icon="VIEW_PAN").strip = strip.name


def draw_paint_menu(layout: bpy.types.UILayout, text: str = "Paint an Effect") -> None:
    """Draw the menu of modalities that adds an effect and starts painting."""
    menu = layout.operator_menu_enum("hfx.add_painted", "modality", text=text, icon="BRUSH_DATA")
    menu.paint = True


def draw_first_step(context: bpy.types.Context, layout: bpy.types.UILayout) -> bool:
    """Draw the button of the next step until the scene has an effect; returns True if drawn."""
    scene = context.scene
    if not effects.bodies_of(scene):
        if active_armature(context) is not None:
            early_imports.begin()
            layout.operator("hfx.mark_body", icon="ADD")
        else:
            layout.operator(
                "hfx.add_avatar", text="Add Built-In Avatar", icon="OUTLINER_OB_ARMATURE"
            )
    elif not swarms.listed_effects(scene):
        draw_paint_menu(layout)
    else:
        return False
    return True


def draw_header(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Draw the button of the next step: *Finish Painting* during painting; once the scene has a
    body, *Paint an Effect* and the next step of the active effect (paint, transfer the area, add a
    clip), and export last. Blender's own buttons have priority: a narrow header has only the next
    step, or none of the buttons, which the HFX tab has, too."""
    active, effect, layout = context.object, active_effect(context), self.layout.row()
    # Background mode has no region.
    width = inf if context.region is None else context.region.width
    buttons = (width / (context.preferences.system.ui_scale or 1.0) - _OWN_HEADER) / _BUTTON
    buttons = int(min(max(buttons, 0.0), 2.0))
    # Drawn after the header's menus, but as buttons.
    layout.emboss = "NORMAL"
    layout.operator_context = "INVOKE_DEFAULT"
    if active is not None and active.get(painting.PAINTED_EFFECT) is not None:
        if buttons:
            layout.operator("hfx.paint_end", icon="CHECKMARK")
        if buttons > 1 and not clips.strips_of(active[painting.PAINTED_EFFECT]):
            layout.operator("hfx.add_clip", text="Finish, Add Clip", icon="NLA")
        return
    if not (buttons and effects.bodies_of(context.scene)) or draw_first_step(context, layout):
        return
    if buttons > 1 or effect is None:
        draw_paint_menu(layout)
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


_ENTRIES = {
    "VIEW3D_MT_editor_menus": draw_header,
    "VIEW3D_MT_add": draw_add_menu,
    "VIEW3D_MT_object_context_menu": draw_object_menu,
    "OUTLINER_MT_object": draw_object_menu,
    "UI_MT_list_item_context_menu": draw_list_menu,
    "NLA_MT_add": draw_nla_menu,
    "SEQUENCER_MT_context_menu": draw_strip_menu,
    "SEQUENCER_MT_strip": draw_strip_menu,
    "TOPBAR_MT_file_export": lambda menu, _context: menu.layout.operator(
        "hfx.export", text="Haptics (.hfxtrack)"
    ),
    "TOPBAR_MT_file_import": lambda menu, _context: menu.layout.operator(
        "hfx.import_hjif", text="Haptics (.hjif, .haptic, .ahap)"
    ),
}

_keys = KeyBindings("Object Mode", ("wm.call_menu_pie", "Y", {}, {"name": "HFX_MT_effect_pie"}))


def register() -> None:
    _keys.register()
    for name, entry in _ENTRIES.items():
        getattr(bpy.types, name).append(entry)


def unregister() -> None:
    _keys.unregister()
    for name, entry in reversed(_ENTRIES.items()):
        getattr(bpy.types, name).remove(entry)
