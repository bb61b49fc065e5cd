# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel of sound and video for haptics."""

from __future__ import annotations

import bpy

from ...authoring import media
from ...blender import compat
from ..sidebar import HfxPanel


class HFX_PT_media(HfxPanel, bpy.types.Panel):
    """Sound and video to be heard and seen with the haptics"""

    bl_label = "Sound and Video"
    bl_order = 8
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
            row.prop(strip, "frame_start", text="Start")
            row.prop(strip, "volume")
        for owner in media.videos_of(context.scene):
            is_world = isinstance(owner, bpy.types.World)
            column = layout.box().column(align=True)
            row = column.row(align=True)
            row.prop(owner, "name", text="", icon="WORLD" if is_world else "IMAGE_DATA")
            if not is_world:
                row.prop(owner, "hide_viewport", text="")
            column.prop(owner, f'["{media.START}"]', text="Start")
        if sounds:
            layout.prop(context.scene, "sync_mode", text="Playback")
