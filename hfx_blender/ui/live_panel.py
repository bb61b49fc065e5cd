# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of live devices."""

from __future__ import annotations

import bpy

from ..playback.live import live
from .sidebar import HfxPanel, draw_text

STATES = {
    "connecting": ("Connecting...", "SORTTIME"),
    "connected": ("Connected, silent", "LINKED"),
    "armed": ("Playing", "PLAY"),
    "stopped": ("Stopped", "SNAP_FACE"),
    "fault": ("Fault", "ERROR"),
    "lost": ("Lost", "UNLINKED"),
    "closed": ("Closed", "UNLINKED"),
}
_MOST_ACTUATORS = 40  # of which bars and pulses are shown


class HFX_PT_live(HfxPanel, bpy.types.Panel):
    """Connect devices and feel what you design"""

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
            if not all(each.is_armed for each in live.states.values()):
                layout.operator("hfx.live_play", icon="PLAY")
        if live.fault:
            draw_text(context, layout, live.fault, "ERROR")
        elif live.lookahead_fault and live.states:
            text = f"Latency is compensated from the second playback on: {live.lookahead_fault}"
            draw_text(context, layout, text, "INFO")
        for item in context.scene.hfx.devices:
            self._draw_device(context, layout.box(), item)
        row = layout.row(align=True)
        row.operator("hfx.live_add", icon="ADD")
        row.operator("hfx.live_find", icon="VIEWZOOM")
        row.operator("hfx.live_import", text="", icon="IMPORT")
        if context.scene.hfx.devices:
            layout.prop(context.scene.hfx, "play_space")

    @staticmethod
    def _draw_device(
        context: bpy.types.Context, box: bpy.types.UILayout, item: bpy.types.PropertyGroup
    ) -> None:
        state = live.state(item.name)
        row = box.row(align=True)
        row.label(text=item.name)
        if state is None:
            row.operator("hfx.live_connect", icon="LINKED").name = item.name
        else:
            row.operator("hfx.live_disconnect", icon="UNLINKED").name = item.name
        row.operator("hfx.live_remove", text="", icon="X").name = item.name
        row = box.row(align=True)
        row.prop(item, "is_muted", text="", icon="MUTE_IPO_ON" if item.is_muted else "MUTE_IPO_OFF")
        row.prop(item, "gain", slider=True)
        if item.name in live.approved:
            box.operator("hfx.live_revoke", icon="FILE_SCRIPT").name = item.name
        if state is None:
            if item.name in live.unapproved:
                box.operator("hfx.live_approve", icon="FILE_SCRIPT").name = item.name
            return
        text, icon = STATES[state.state]
        draw_text(context, box, f"{text}: {state.text}" if state.text else text, icon)
        offset = f"Offset {live.offset_ms(item.name):g} ms"
        box.operator("hfx.live_offset", text=offset, icon="TIME").name = item.name
        device = live.device(item.name)
        if device is None or not state.is_armed:
            return
        grid = box.grid_flow(columns=2, align=True, even_columns=True)
        for k, actuator in enumerate(device.actuators[:_MOST_ACTUATORS]):
            level = state.levels[k] if k < len(state.levels) else 0.0
            text = f"{actuator.id}  {level:.0%}"
            pulse = grid.operator("hfx.live_pulse", text=text, depress=level > 0.0)
            pulse.name, pulse.actuator = item.name, k


register, unregister = bpy.utils.register_classes_factory((HFX_PT_live,))
