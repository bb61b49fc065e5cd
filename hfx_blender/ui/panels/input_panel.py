# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of live input: tracked bodies, and values received by OSC."""

import bpy

from ...blender.translation import translated
from ...playback.live.body_tracking import Tracker, body_tracking
from ...playback.live.listening import listening
from ...playback.live.live_handlers import is_playing
from ..sidebar import HfxPanel, draw_text


class HFX_PT_live_input(HfxPanel, bpy.types.Panel):
    """Bodies that follow tracked persons, and values of other programs"""

    bl_label = "Live Input"
    bl_order = 7
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        for tracker in body_tracking.trackers:
            _draw_tracker(context, layout.box(), tracker)
        if body_tracking.fault:
            draw_text(context, layout, body_tracking.fault, "ERROR")
        layout.operator("hfx.track_body", icon="ARMATURE_DATA")
        if listening.receiver is None:
            layout.operator("hfx.listen", icon="IMPORT")
        else:
            _draw_listening(context, layout.box(), listening.receiver.port)
        if listening.fault:
            draw_text(context, layout, listening.fault, "ERROR")


def _draw_tracker(context: bpy.types.Context, box: bpy.types.UILayout, tracker: Tracker) -> None:
    """Draw a tracked body: name, source, state, and buttons that record and stop."""
    name = tracker.armature.name
    box.label(text=f"{name}: {tracker.source.title}", icon="ARMATURE_DATA", translate=False)
    if not tracker.has_poses:
        draw_text(context, box, "Waiting for a sender", "SORTTIME")
    elif tracker.is_lost:
        text = "The sender is lost: devices fade to silence until it returns"
        draw_text(context, box, text, "UNLINKED")
    elif is_playing():
        draw_text(context, box, "Paused while the animation plays", "PAUSE")
    else:
        draw_text(context, box, "Following", "LINKED")
    row = box.row(align=True)
    is_recording = tracker.recording is not None
    text = "Finish Recording" if is_recording else "Record Body"
    record = row.operator("hfx.track_record", text=text, icon="REC", depress=is_recording)
    record.name = name
    row.operator("hfx.track_stop", text="", icon="X").name = name


def _draw_listening(context: bpy.types.Context, box: bpy.types.UILayout, port: int) -> None:
    """Draw the port, the newest values by address, and buttons that record and stop."""
    box.label(text=translated(f"Listening on port {port}"), icon="LINKED", translate=False)
    for address, value in listening.newest.items():
        draw_text(context, box, f"{address}  {translated(value)}")
    row = box.row(align=True)
    is_recording = listening.is_recording
    text = "Finish Recording" if is_recording else "Record Values"
    row.operator("hfx.listen_record", text=text, icon="REC", depress=is_recording)
    row.operator("hfx.listen_stop", text="", icon="X")
