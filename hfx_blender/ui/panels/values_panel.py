# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of values in the viewport: glowing actuators, and the chart over time."""

from __future__ import annotations

import bpy

from ...playback.preview.preview import preview
from ...playback.timeline.timeline_recorder import recorder
from ..sidebar import HfxPanel, draw_text


class HFX_PT_values(HfxPanel, bpy.types.Panel):
    """Values of effects and actuators, now and over the whole timeline"""

    bl_label = "Values"
    bl_order = 7
    bl_options = {"DEFAULT_CLOSED"}  # its switches are in the list of effects, too

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        column = layout.column(align=True)
        column.prop(context.window_manager, "hfx_show_values", icon="FCURVE", toggle=True)
        column.prop(context.window_manager, "hfx_show_actuators", icon="LIGHT_POINT", toggle=True)
        layout.prop(context.scene.hfx, "preview_opacity", slider=True)
        if context.window_manager.hfx_show_values and recorder.must_step:
            draw_text(context, layout, recorder.fault, "INFO")
            layout.operator("hfx.update_values", icon="FILE_REFRESH")
        if context.window_manager.hfx_show_actuators and not len(context.scene.hfx.devices):
            draw_text(
                context, layout, "Add a device under Live Devices to see its actuators", "INFO"
            )
        notes = [
            *(preview.content.notes if context.window_manager.hfx_show_actuators else ()),
            *(recorder.result.notes if recorder.result is not None else ()),
        ]
        for note in dict.fromkeys(notes):
            draw_text(context, layout, note, "INFO")
        for fault in recorder.result.faults if recorder.result is not None else ():
            draw_text(context, layout, fault, "ERROR")
