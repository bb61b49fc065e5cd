# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of live devices, and of values in the viewport."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ...authoring.effects import effects
from ...blender.translation import translated
from ...operators.live.connect_operators import title_of
from ...playback.live.latency import uncompensated
from ...playback.live.live import live
from ...playback.preview.preview import preview
from ...playback.timeline.timeline_recorder import recorder
from ...properties.scenes import SCHEMES
from ..sidebar import HfxPanel, PictureIcons, draw_text
from .effects_panel import SLOW

if TYPE_CHECKING:
    from ...devices.configurations.device_facts import DeviceFacts


STATES = {
    "connecting": ("Connecting...", "SORTTIME"),
    "connected": ("Connected, silent", "LINKED"),
    "armed": ("Playing", "PLAY"),
    "stopped": ("Stopped", "SNAP_FACE"),
    "frozen": ("Stopped", "SNAP_FACE"),
    "fault": ("Fault", "ERROR"),
    "lost": ("Lost", "UNLINKED"),
    "closed": ("Closed", "UNLINKED"),
}
_icons = PictureIcons()
_LONG = 9  # longest name of an actuator in two columns, letters
_BUTTONS = 6  # width of the buttons after a device's name, letters
_MOST_ACTUATORS = 40  # limit of displayed actuators


def _draw_advice(context: bpy.types.Context, box: bpy.types.UILayout) -> None:
    """Draw the duration of the slow frame that stopped the devices, and buttons with cures."""
    slow, hfx = live.slow_frames.newest, context.scene.hfx
    text = str(slow) if slow is not None else "Blender did not answer in time."
    draw_text(context, box, f"Devices stopped. {text}", "ERROR")
    column = box.column(align=True)
    if hfx.live_source == "SCENE":
        is_coarse = hfx.live_tolerance == "PREVIEW"
        column.prop_enum(
            hfx,
            "live_tolerance",
            "EXPORT" if is_coarse else "PREVIEW",
            text="Tolerance as Exported" if is_coarse else "Preview Tolerance",
        )
        column.operator("hfx.record_track", text="Play a Recorded Track Instead", icon="REC")
    if preview.content.is_slow:
        draw_text(context, box, SLOW, "INFO")
    column.operator("hfx.hide_meshes", icon="HIDE_ON")
    manager = context.window_manager
    for name, what in (("hfx_preview", "What Is Felt"), ("hfx_show_actuators", "Actuators")):
        if getattr(manager, name):
            text = translated(f"Stop Showing {translated(what)}")
            column.prop(manager, name, text=text, invert_checkbox=True, toggle=1)
    draw_text(context, box, "Then press Play: devices begin from silence")


class HFX_PT_live(HfxPanel, bpy.types.Panel):
    """Connect devices and feel the effects while you work"""

    bl_label = "Live Devices"
    bl_order = 6
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if live.states:
            column = layout.column()
            column.scale_y = 2.0
            column.alert = True
            column.operator("hfx.live_stop_all", icon="CANCEL")
            if not all(device.is_armed for device in live.states.values()):
                layout.operator("hfx.live_play", icon="PLAY")
        _draw_pages(layout)
        if any(state.state == "frozen" for state in live.states.values()):
            _draw_advice(context, layout.box())
        hfx = context.scene.hfx
        if hfx.devices:
            column = layout.column(align=True)
            column.label(text="Devices Play")
            column.row(align=True).prop(hfx, "live_source", expand=True)
            if hfx.live_source == "TRACK":
                column.prop(hfx, "live_track", text="")
                column.operator("hfx.record_track", icon="REC")
                draw_text(context, layout, live.tracks.summary(context.scene))
        if live.fault:
            draw_text(context, layout, live.fault, "ERROR")
        elif live.latencies_ms and hfx.live_source == "SCENE":
            text = uncompensated(context.scene)
            if text:  # frames without latency compensation
                draw_text(context, layout, text, "INFO")
            if recorder.must_step:
                layout.operator("hfx.update_values", icon="FILE_REFRESH")
        for item in hfx.devices:
            _draw_device(context, layout.box(), item)
        row = layout.row(align=True)
        row.operator_menu_enum("hfx.live_add", "name", icon="ADD")
        row.operator("hfx.live_find", icon="VIEWZOOM")
        layout.operator("hfx.live_import", icon="IMPORT")
        layout.operator("hfx.live_phone", icon="URL")
        layout.operator("hfx.run_study", icon="COMMUNITY")
        if hfx.devices:
            column = layout.column(align=True)
            column.label(text="Play Space")
            column.prop(hfx, "play_space", text="")


def _draw_pages(layout: bpy.types.UILayout) -> None:
    """Draw device, address and code of each connected web page."""
    from ...devices.live.live_settings import page_of

    for name in live.connected:
        address, code = page_of(live.states[name].unit)
        if code:
            column = layout.box().column(align=True)
            column.label(text=title_of(name), translate=False)
            column.label(text=address, icon="URL", translate=False)
            column.label(text=code, icon="LOCKED", translate=False)


def _draw_device(
    context: bpy.types.Context, box: bpy.types.UILayout, item: bpy.types.PropertyGroup
) -> None:
    """Draw a device's name, facts, buttons and state; while playing, a button for each actuator
    with its value, which sends a test pulse."""
    from ...devices.configurations.device_facts import facts_of
    from ...devices.live.live_settings import page_of

    facts, state = facts_of(item.name), live.state(item.name)
    row = box.row(align=True)
    icon = "DOWNARROW_HLT" if item.is_expanded else "RIGHTARROW"
    row.prop(item, "is_expanded", text="", icon=icon, emboss=False)
    draw_text(context, row, facts.title, reserved=_BUTTONS)
    row.operator("hfx.live_remove", text="", icon="X").name = item.name
    if item.is_expanded:
        _draw_facts(context, box.column(align=True), item, facts)
    if item.body is not None or len(effects.bodies_of(context.scene)) > 1:
        box.prop(item, "body", icon="ARMATURE_DATA")
    if state is None:
        box.operator("hfx.live_connect", icon="LINKED").name = item.name
    else:
        box.operator("hfx.live_disconnect", icon="UNLINKED").name = item.name
    row = box.row(align=True)
    row.prop(item, "is_muted", text="", icon="MUTE_IPO_OFF" if item.is_muted else "MUTE_IPO_ON")
    row.prop(item, "gain", slider=True)
    if item.name in live.approved:
        box.operator("hfx.live_revoke", icon="FILE_SCRIPT").name = item.name
    if state is None:
        if item.name in live.unapproved:
            box.operator("hfx.live_approve", icon="FILE_SCRIPT").name = item.name
        return
    text, icon = STATES[state.state]
    is_page = bool(page_of(state.unit)[1])  # address and code are at the top of the panel
    detail = state.text or ("" if is_page else state.unit)
    draw_text(context, box, f"{text}: {detail}" if detail else text, icon)
    device = live.device(item.name)
    if device is not None:
        from ...devices.live.connection_search import NO_DEAD_MAN
        from ...engine.rendering.device_config import VrcHapticsEncoder

        if any(isinstance(output.encoder, VrcHapticsEncoder) for output in device.outputs):
            draw_text(context, box, NO_DEAD_MAN, "INFO")
    offset = f"Offset {live.offset_ms(item.name):g} ms"
    box.operator("hfx.live_offset", text=translated(offset), icon="TIME").name = item.name
    if device is None or not state.is_armed:
        return
    box.operator("hfx.live_person", icon="USER").name = item.name
    # Long names would be cut off in two columns.
    is_long = any(len(actuator.id) > _LONG for actuator in device.actuators)
    grid = box.grid_flow(columns=1 if is_long else 2, align=True, even_columns=True)
    for k, actuator in enumerate(device.actuators[:_MOST_ACTUATORS]):
        level = state.levels[k] if k < len(state.levels) else 0.0
        text = f"{actuator.id}  {level:.0%}"
        pulse = grid.operator("hfx.live_pulse", text=text, depress=level > 0.0)
        pulse.name, pulse.actuator = item.name, k


def _draw_facts(
    context: bpy.types.Context,
    column: bpy.types.UILayout,
    item: bpy.types.PropertyGroup,
    facts: DeviceFacts,
) -> None:
    """Draw picture, maker, summary, error and rendering scheme of a device, as far as known."""
    if facts.picture is not None:
        column.template_icon(_icons.number_of(facts.picture), scale=9.0)
    for text in filter(None, (facts.maker, facts.summary)):
        draw_text(context, column, text)
    if facts.fault:
        draw_text(context, column, facts.fault, "ERROR")
    if facts.device is not None:
        column.separator()
        column.label(text="Rendering")
        column.prop(item, "scheme", text="")
        name = facts.device.scheme.name if item.scheme == "CONFIGURED" else item.scheme
        tip = next(tip for scheme, _, tip in SCHEMES if scheme == name)
        own = f"{name.title()}. " if item.scheme == "CONFIGURED" else ""
        draw_text(context, column, f"{own}{tip}")


def _header(self: bpy.types.Header, _context: bpy.types.Context) -> None:
    """Draw the stop of all devices in the header, visible without the sidebar."""
    if live.states:
        row = self.layout.row()
        row.alert = True
        row.operator("hfx.live_stop_all", icon="CANCEL")


def register() -> None:
    bpy.types.VIEW3D_HT_header.prepend(_header)


def unregister() -> None:
    bpy.types.VIEW3D_HT_header.remove(_header)
    _icons.free()


class HFX_PT_values(HfxPanel, bpy.types.Panel):
    """Values of effects and actuators, now and over the whole timeline"""

    bl_label = "Values"
    bl_order = 8
    bl_options = {"DEFAULT_CLOSED"}  # the list of effects has the same switches

    def draw(self, context: bpy.types.Context) -> None:
        layout, shown, hfx = self.layout, context.window_manager, context.scene.hfx
        column = layout.column(align=True)
        column.prop(shown, "hfx_show_values", icon="FCURVE", toggle=True)
        column.prop(shown, "hfx_show_actuators", icon="LIGHT_POINT", toggle=True)
        layout.prop(hfx, "preview_opacity", slider=True)
        if shown.hfx_show_values and recorder.must_step:
            draw_text(context, layout, recorder.fault, "INFO")
            layout.operator("hfx.update_values", icon="FILE_REFRESH")
        if shown.hfx_show_actuators and not len(hfx.devices):
            text = "Add a device under Live Devices to see its actuators"
            draw_text(context, layout, text, "INFO")
        result = recorder.result
        notes = [
            *(preview.content.notes if shown.hfx_show_actuators else ()),
            *(result.notes if result is not None else ()),
        ]
        for note in dict.fromkeys(notes):  # each once
            draw_text(context, layout, note, "INFO")
        for fault in result.faults if result is not None else ():
            draw_text(context, layout, fault, "ERROR")
