# SPDX-License-Identifier: GPL-3.0-or-later
"""Playback with the colours of the preview costs little more than playback without them.

Time of Blender's main thread for a frame of an avatar that waves, with a painted trunk and a volume
around a hand, with and without *Show What Is Felt*, in turns.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import bpy
import hands

MOST = 1.1
TURNS = 5
FRAMES = 24


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    scene = bpy.context.scene
    scene.frame_end = 24
    scene.sync_mode = "NONE"  # each frame is drawn
    arm = bpy.context.object.pose.bones["upperarm01.L"]
    for frame, turn in ((1, 0.0), (12, 0.6), (24, 0.0)):
        arm.rotation_mode = "XYZ"
        arm.rotation_euler.x = turn
        arm.keyframe_insert("rotation_euler", frame=frame)
    with h.context():
        bpy.ops.hfx.add_painted(modality="pressure")
        bpy.ops.hfx.fill_part(part="torso")
        bpy.ops.hfx.add_volume(modality="vibration", radius=0.2, location=(0.5, 0.0, 1.0))
    yield 6.0  # values over time are recorded
    costs_s: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(TURNS):
        for is_shown in (True, False):
            bpy.context.window_manager.hfx_preview = is_shown
            yield 1.5
            cost_s = yield from frame_s(h)
            costs_s[is_shown].append(cost_s)
            h.shot(f"{'colours' if is_shown else 'plain'}.png")
    # Least of several turns: whatever else a machine does only lengthens one.
    shown_s, plain_s = (min(costs_s[is_shown]) for is_shown in (True, False))
    figures = f"{1000 * shown_s:.1f} ms with, {1000 * plain_s:.1f} ms without"
    h.check(shown_s <= MOST * plain_s, f"{shown_s / plain_s:.2f} times as much: {figures}")


def frame_s(h: Any) -> Iterator[float]:
    """Seconds of the main thread for a frame of playback."""
    played: list[int] = []
    count = lambda scene, *_: played.append(scene.frame_current)  # noqa: E731
    bpy.app.handlers.frame_change_post.append(count)
    with h.context():
        bpy.ops.screen.animation_play()
    yield 0.5
    before, begun_s = len(played), time.thread_time()
    while len(played) - before < FRAMES:
        yield 0.1
    cost_s = (time.thread_time() - begun_s) / (len(played) - before)
    with h.context():
        bpy.ops.screen.animation_play()
    bpy.app.handlers.frame_change_post.remove(count)
    return cost_s
