# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the scene: all effects, clips, export, sound and video."""

import bpy

from ...authoring import clips, media
from ...authoring.effects import effects, swarms
from ...blender import compat
from ...blender.translation import translated
from ...operators.effects.clip_operators import draw_clip_buttons
from ...operators.export_operator import draw_devices, last_written
from ...operators.shared import active_armature, active_effect
from ...playback.preview.preview import preview
from ..menus import draw_first_step, draw_paint_menu
from ..sidebar import HfxPanel, draw_text
from . import clip_waveforms, list_rows

_LEAST_ROWS, _MOST_ROWS = 2, 10  # height of the list of effects
_HIGH = 800  # height of an area for larger waveforms, pixels at an interface scale of 1
_NO_BODY = "First choose a body: select your avatar's armature, or add the built-in avatar"
_NO_EFFECT = "Add an effect: a volume in space, an area painted on the body, or a sensation"
SLOW = (
    "Volumes are evaluated slowly: this installation lacks the compiled part of HFX. Install the "
    "extension's zip for your computer, or see docs/native.md"
)
_OUTSIDE = {
    "after": "After the scene's last frame: not felt",
    "before": "Before the scene's first frame: not felt",
    "beyond": "Goes on after the scene's last frame: not felt there",
    "early": "Begins before the scene's first frame: not felt there",
}


def draw_moving(context: bpy.types.Context, layout: bpy.types.UILayout, which: str) -> None:
    """Draw the warning of effects without a body; with bodies in the scene, a button or menu to
    assign one. ``which`` names the effects, as the property of ``hfx.move_to_body``: "ACTIVE" is
    the active effect, any other value all effects of deleted bodies."""
    column = layout.column()
    column.alert = True
    bodiless = effects.effects_without_body(context.scene)
    effect = active_effect(context) if which == "ACTIVE" else min(bodiless, key=effects.is_locked)
    text = f"The bodies of {len(bodiless)} effects are not in this scene: not felt"
    if which == "ACTIVE" or len(bodiless) == 1:
        text = f"'{effect.name}' {effects.missing_body_reason(effect)}: not felt"
    draw_text(context, column, text, "ERROR")
    bodies = effects.bodies_of(context.scene)
    layout = layout.column()
    layout.context_pointer_set("object", effect)  # the operator is disabled for a linked effect
    if len(bodies) > 1:
        layout.operator_menu_enum("hfx.move_to_body", "body", icon="FORWARD").which = which
    elif bodies:
        move = layout.operator(
            "hfx.move_to_body", text=translated(f"Move to Body '{bodies[0].name}'"), icon="FORWARD"
        )
        move.which, move.body = which, bodies[0].name


def draw_preview_state(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """Draw why the preview lacks colours or is slow, and the cure; nothing without a body."""
    if not effects.bodies_of(context.scene):
        return  # the panel suggests adding a body
    if preview.content.fault:
        draw_text(context, layout, preview.content.fault, "ERROR")
    if preview.content.is_slow:
        draw_text(context, layout, SLOW, "INFO")


class HFX_PT_effects(HfxPanel, bpy.types.Panel):
    """List of all effects: select, mute, solo; switches for the preview in the viewport"""

    bl_label = "Haptic Effects"
    bl_order = 0

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        self.layout.operator("hfx.workspace", text="", icon="WORKSPACE", emboss=False)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        row.prop(context.window_manager, "hfx_preview", icon="HIDE_OFF", toggle=True)
        row.prop(context.window_manager, "hfx_show_actuators", text="", icon="LIGHT_POINT")
        row.prop(context.window_manager, "hfx_show_values", text="", icon="FCURVE")
        row.prop(context.scene.hfx, "palette", text="", icon="COLOR", icon_only=True)
        listed = swarms.listed_effects(context.scene)
        if listed:
            manager = context.window_manager
            rows = min(max(sum(map(list_rows.is_shown, manager.hfx_rows)), _LEAST_ROWS), _MOST_ROWS)
            lists = ("HFX_UL_effects", "", manager, "hfx_rows", manager, "hfx_row")
            row = layout.row(align=True)  # most of the width is for names
            row.template_list(*lists, rows=rows, maxrows=rows, item_dyntip_propname="name")
            column = row.column(align=True)
            column.scale_x = 0.9
            column.menu("HFX_MT_add", text="", icon="ADD")
            column.operator("hfx.remove_effects", text="", icon="REMOVE")
            column.menu("HFX_MT_list", text="", icon="DOWNARROW_HLT")
            members = list_rows.active_group()
            if members:
                row = layout.row(align=True)
                row.enabled = not any(map(effects.is_locked, members))
                row.prop(manager, "hfx_group_gain", text="Gain", slider=True)
                if any(map(clips.strips_of, members)):
                    row.prop(manager, "hfx_group_start", text="Start")
        if effects.effects_without_body(context.scene):
            draw_moving(context, layout, "GONE")
        elif context.window_manager.hfx_preview and listed and context.mode == "OBJECT":
            draw_preview_state(context, layout)
        has_body = bool(effects.bodies_of(context.scene))
        if not has_body and active_armature(context) is None:
            draw_text(context, layout, _NO_BODY, "INFO")
        elif has_body and not listed:
            draw_text(context, layout, _NO_EFFECT, "INFO")
        row = layout.row()
        row.scale_y = 1.3
        draw_first_step(context, row)
        if not listed:
            layout.menu("HFX_MT_add", text="Add", text_ctxt="HFX", icon="ADD")
        elif has_body:
            row = layout.row(align=True)
            draw_paint_menu(row)
            # The panel of exports is below the clips, often out of view.
            row.operator("hfx.export", text="Export", icon="EXPORT")


class HFX_PT_clips(HfxPanel, bpy.types.Panel):
    """Clips of the active effect: the times while the effect is on"""

    bl_label = "Clips"
    bl_order = 3

    subject = staticmethod(active_effect)

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        row = self.layout.row(align=True)
        row.scale_y = 0.9
        row.prop(context.scene.hfx, "time_unit", text="")  # as buttons too wide for the title
        row.separator()

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        draw_clip_buttons(row)
        effect = active_effect(context)
        strips = clips.strips_of(effect)
        if strips:
            row.operator("hfx.copy_clips", text="", icon="COPYDOWN")
        # A check of the scene rebuilds the rows after this drawing: their number may differ here.
        rows = enumerate(zip(strips, context.window_manager.hfx_clips, strict=False))
        has_selected = any(strip.select for _, strip in strips)
        for number, ((_, strip), times) in sorted(rows, key=lambda row: row[1][0][1].frame_start):
            box = layout.box()
            box.enabled = not effects.is_locked(effect)
            _draw_head(box.row(align=True), strip, times)
            # Only selected clips in full: the clips just added, or chosen in the NLA Editor.
            if strip.select or not has_selected:
                _draw_clip(box, strip, times, clip_waveforms.icon(context, effect, strip, number))
            outside = clips.outside_scene(context.scene, strip)
            if outside is not None:
                column = box.column()
                column.alert = True
                draw_text(context, column, _OUTSIDE[outside], "ERROR")
                box.operator("hfx.extend_scene", icon="PREVIEW_RANGE").which = "ACTIVE"
        if not strips:
            layout.label(text="No clips: on for the whole timeline", icon="INFO")


def _draw_head(
    row: bpy.types.UILayout, strip: bpy.types.NlaStrip, times: bpy.types.PropertyGroup
) -> None:
    icon = "LAYER_ACTIVE" if strip.select else "LAYER_USED"
    row.prop(strip, "select", text="", icon=icon, emboss=False)
    row.prop(strip, "name", text="")
    if not strip.select:
        row.label(text=f"{times.start:.4g} - {times.end:.4g}", translate=False)
    row.prop(strip, "mute", text="", icon="MUTE_IPO_OFF" if strip.mute else "MUTE_IPO_ON")
    row.operator("hfx.draw_fades", text="", icon="FCURVE").name = strip.name
    row.operator("hfx.remove_clip", text="", icon="X").name = strip.name


def _draw_clip(
    box: bpy.types.UILayout,
    strip: bpy.types.NlaStrip,
    times: bpy.types.PropertyGroup,
    waveform: int,
) -> None:
    # A low area keeps room for the panels below.
    scale, area = bpy.context.preferences.system.ui_scale, bpy.context.area
    is_high = area is not None and area.height >= _HIGH * scale
    row = box.split(factor=0.36 if is_high else 0.3)
    column = row.column(align=True)
    column.template_icon(waveform, scale=6.0 if is_high else 4.0)
    if is_high:
        ends = column.split(factor=0.5)
        ends.label(text=f"{times.start:.4g}", translate=False)
        ends = ends.row()
        ends.alignment = "RIGHT"
        ends.label(text=f"{times.end:.4g}", translate=False)
    column = row.column(align=True)
    column.prop(times, "start", text="Start")
    column.prop(times, "end", text="End")
    if strip.use_animated_influence:
        column.prop(strip, "use_animated_influence", text="Fades Drawn as a Curve")
    else:
        column.prop(times, "fade_in")
        column.prop(times, "fade_out")
    box.prop(strip, "repeat", text="Repeat")


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
            count = len(written.report.files)
            row.label(
                text=translated(
                    f"Wrote {count} {'file' if count == 1 else 'files'}{written.warned}"
                ),
                icon="ERROR" if written.report.warnings else "CHECKMARK",
            )
            row.operator("hfx.show_report", text="", icon="TEXT")
            folder = str(written.report.folder)
            row.operator("wm.path_open", text="", icon="FILE_FOLDER").filepath = folder


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


class HFX_PT_perception(HfxPanel, bpy.types.Panel):
    """Perception of the wearer, in exports and live playback"""

    bl_label = "Perception"
    bl_parent_id = "HFX_PT_export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        for name in ("equal_feel", "adaptation", "persistence"):
            layout.prop(context.scene.hfx, name)


class HFX_PT_media(HfxPanel, bpy.types.Panel):
    """Sound and video to be heard and seen with the haptics"""

    bl_label = "Sound and Video"
    bl_order = 9
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        row.operator("hfx.add_sound", icon="SOUND")
        row.operator("hfx.add_video", icon="FILE_MOVIE")
        editor = context.scene.sequence_editor
        sounds = [s for s in compat.strips(editor) if s.type == "SOUND"] if editor else []
        for strip in sounds:
            column = layout.box().column(align=True)
            row = column.row(align=True)
            row.prop(strip, "name", text="", icon="SOUND")
            row.prop(strip, "mute", text="", icon="HIDE_ON" if strip.mute else "HIDE_OFF")
            row = column.row(align=True)
            row.prop(strip, "frame_start", text="Start Frame")
            row.prop(strip, "volume")
            column.operator("hfx.feel_sound", icon="VIEW_PAN").strip = strip.name
        for owner in media.videos_of(context.scene):
            is_world = isinstance(owner, bpy.types.World)
            column = layout.box().column(align=True)
            row = column.row(align=True)
            row.prop(owner, "name", text="", icon="WORLD" if is_world else "IMAGE_DATA")
            if not is_world:
                row.prop(owner, "hide_viewport", text="")
            column.prop(owner, f'["{media.START}"]', text="Start Frame")
        if sounds:
            layout.prop(context.scene, "sync_mode", text="Playback")
