# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of the clip panel: times of the active effect's clips, in the scene's time unit.

NLA strips cannot have custom property groups. The rows are stored in the window manager, not in
files, and are rebuilt after a change of their number.
"""

from __future__ import annotations

import bpy
from bpy.props import CollectionProperty, FloatProperty

from ...authoring import clips
from ...authoring.effects import effects, swarms
from ...blender.events import push_undo_soon
from ...blender.scene_info import frame_at, frames_per_shown_unit, shown_time
from ...operators.effects.clip_operators import TIMES, label_of
from ...operators.shared import active_effect
from ...playback.preview.preview import preview


def refresh() -> None:
    """Make as many rows as the active effect has clips; never from a drawing."""
    context = bpy.context
    effect, rows = active_effect(context), context.window_manager.hfx_clips
    count = 0 if effect is None else len(clips.strips_of(effect))
    if len(rows) != count:
        rows.clear()
        for _ in range(count):
            rows.add()
        preview.redraw()


def _strip(row: HfxClipRow) -> bpy.types.NlaStrip | None:
    effect, rows = active_effect(bpy.context), bpy.context.window_manager.hfx_clips
    index = next(k for k, candidate in enumerate(rows) if candidate == row)
    strips = [] if effect is None else clips.strips_of(effect)
    return strips[index][1] if index < len(strips) else None


def _time(time: str, of_strip: str, **limits: float) -> FloatProperty:
    """Property of a row for attribute ``of_strip`` of its NLA strip, in the scene's time unit; 0
    without a strip.
    """
    is_length = time.startswith("fade")

    def get(row: HfxClipRow) -> float:
        strip = _strip(row)
        if strip is None:
            return 0.0
        frame = getattr(strip, of_strip)
        return frame / _frames() if is_length else shown_time(bpy.context.scene, frame)

    def set_time(row: HfxClipRow, value: float) -> None:
        strip = _strip(row)
        if strip is not None:
            frame = value * _frames() if is_length else frame_at(bpy.context.scene, value)
            setattr(strip, of_strip, frame)
            preview.schedule_check()
            push_undo_soon()

    return FloatProperty(
        name=label_of(time), description=TIMES[time], get=get, set=set_time, **limits
    )


def _frames() -> float:
    """Frames per unit of the displayed times."""
    return frames_per_shown_unit(bpy.context.scene)


def active_group() -> list[bpy.types.Object]:
    """Listed effects of the active effect's group; empty without a group."""
    effect = active_effect(bpy.context)
    name = "" if effect is None else effects.group_of(effect)
    listed = swarms.listed_effects(bpy.context.scene) if name else []
    return [member for member in listed if effects.group_of(member) == name]


def _start(_manager: object) -> float:
    starts = [
        strip.frame_start for effect in active_group() for _, strip in clips.strips_of(effect)
    ]
    return shown_time(bpy.context.scene, min(starts)) if starts else 0.0


def _set_start(manager: object, value: float) -> None:
    clips.shift_times(active_group(), (value - _start(manager)) * _frames())
    preview.schedule_check()
    push_undo_soon()


class HfxClipRow(bpy.types.PropertyGroup):
    """Times of a clip in the scene's unit."""

    start: _time("start", "frame_start_ui")
    end: _time("end", "frame_end_ui")
    fade_in: _time("fade_in", "blend_in", min=0.0)
    fade_out: _time("fade_out", "blend_out", min=0.0)


def register() -> None:
    bpy.types.WindowManager.hfx_clips = CollectionProperty(type=HfxClipRow)
    bpy.types.WindowManager.hfx_group_start = FloatProperty(
        name="Start of the Group",
        description="Start of the group's first clip; all its clips and keyframes move along",
        get=_start,
        set=_set_start,
    )
    preview.on_scene_checked.append(refresh)


def unregister() -> None:
    preview.on_scene_checked.remove(refresh)
    del bpy.types.WindowManager.hfx_group_start
    del bpy.types.WindowManager.hfx_clips
