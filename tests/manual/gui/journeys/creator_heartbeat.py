# SPDX-License-Identifier: GPL-3.0-or-later
"""A creator makes a heartbeat on the torso: 2 beats a second for 2 s, half a second of fades.

Counts actions of the hands: the whole task takes less than a minute.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import bpy
import hands

FPS = 24
START = 13  # frames
TRUNK = 1, 1  # column and row of Fill Body Part
ACTION_SECONDS = 1.5
"""A person's pace: to find the next button, go there and click, or to type a number."""


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    yield from hands.add_avatar(h)
    yield from hands.go_to(h, START)
    start = bpy.context.scene.frame_current

    begin, before = time.monotonic(), h.actions
    yield from hands.add_haptic(h, hands.PAINTED_ROW, hands.MODALITIES.index("vibration"))
    yield from hands.fill_part(h, TRUNK, shot="1_parts.png")
    h.check(hands.painted_parts(hands.effect("vibration")) == {"torso"}, "the torso is filled")
    yield from h.press_button("HFX_OT_add_heartbeat")
    yield from hands.adjust(h, {1: "48", 2: "12", 3: "12", 4: "120"}, shot="2_heartbeat.png")
    actions = h.actions - before
    seconds = time.monotonic() - begin
    (strip,) = hands.clips_of(hands.effect("vibration"))
    h.check((strip.frame_start, strip.frame_end) == (start, start + 2 * FPS), "2 s from now on")
    h.check((strip.blend_in, strip.blend_out) == (FPS / 2, FPS / 2), "0.5 s of fades")
    h.check(abs(strip.repeat - 4) < 1e-4, "4 beats")
    h.check(
        actions * ACTION_SECONDS < 60,
        f"{actions} clicks, keys and entries ({seconds:.0f} s on this computer): "
        "less than a minute of a person's",
    )

    beat = start + 24 + round(0.08 * FPS / 2)  # the third beat, between the fades
    yield from hands.go_to(h, beat)
    yield 1.0
    pixels = h.shot("3_beat.png")
    red, green, blue = hands.tint(pixels, h.xy_of((0.0, -0.1, 1.2)))
    h.check(red > 1.3 * green and red > 1.3 * blue, "the chest is red on a beat")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    for _ in range(2):  # the step in time, the heartbeat
        yield from h.key("ctrl+z")
        yield 0.8
    h.check(not hands.clips_of(hands.effect("vibration")), "Ctrl+Z takes the heartbeat back")
