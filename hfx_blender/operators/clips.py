# SPDX-License-Identifier: GPL-3.0-or-later
"""Clips on the timeline of an effect."""

from __future__ import annotations

import bpy
from bpy.props import FloatProperty, StringProperty

from .. import clips
from .shared import HfxOperator, active_effect


def _fps(context: bpy.types.Context) -> float:
    return context.scene.render.fps / context.scene.render.fps_base


class _ClipOperator(HfxOperator):
    start: FloatProperty(
        name="Start", description="Frame; below 0: the current one", default=-1.0, min=-1.0
    )
    duration: FloatProperty(name="Duration", default=1.0, min=0.001, unit="TIME_ABSOLUTE")
    fade_in: FloatProperty(name="Fade In", default=0.0, min=0.0, unit="TIME_ABSOLUTE")
    fade_out: FloatProperty(name="Fade Out", default=0.0, min=0.0, unit="TIME_ABSOLUTE")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if active_effect(context):
            return True
        cls.poll_message_set("Select a haptic effect")
        return False

    def span(self, context: bpy.types.Context) -> dict[str, float]:
        fps = _fps(context)
        start = self.start if self.start >= 0 else float(context.scene.frame_current)
        return {
            "frame_start": start,
            "frame_end": start + self.duration * fps,
            "fade_in": self.fade_in * fps,
            "fade_out": self.fade_out * fps,
        }


class HFX_OT_add_clip(_ClipOperator):
    """Let the effect be felt from the current frame on, for a while, with fades"""

    bl_idname = "hfx.add_clip"
    bl_label = "Add Clip"

    name: StringProperty(name="Name", default="Clip")

    def work(self, context: bpy.types.Context) -> str:
        clips.add_clip(context.object, name=self.name, **self.span(context))
        return ""


class HFX_OT_add_heartbeat(_ClipOperator):
    """Let the effect beat like a heart; fades shape the whole of it, not each beat"""

    bl_idname = "hfx.add_heartbeat"
    bl_label = "Add Heartbeat"

    beats_per_second: FloatProperty(name="Beats per Second", default=1.2, min=0.1, max=20.0)

    def work(self, context: bpy.types.Context) -> str:
        clips.add_heartbeat(
            context.object, beats_per_second=self.beats_per_second, **self.span(context)
        )
        return ""


register, unregister = bpy.utils.register_classes_factory((HFX_OT_add_clip, HFX_OT_add_heartbeat))
