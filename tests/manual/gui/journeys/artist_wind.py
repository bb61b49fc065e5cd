# SPDX-License-Identifier: GPL-3.0-or-later
"""A technical artist lets the wind blow through a box, and lightning strike three times.

Wind from 5 s to 7 s in 2 x 2 x 3 m; pressure on the whole body, three times a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

FPS = 24
WHOLE_BODY = 0, 0  # column and row of Fill Body Part
STRIKES = (126, 140, 158)  # frames


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    yield from hands.add_avatar(h)

    wind = hands.MODALITIES.index("wind")
    yield from hands.add_haptic(h, hands.VOLUME_ROW + hands.SHAPES.index("CUBOID"), wind)
    fields = yield from h.fields(h.region("UI"))
    for field, value in zip(fields[1:4], ("2", "2", "3"), strict=True):
        yield from h.enter(field, value)
    size = tuple(round(item, 3) for item in hands.effect("wind").hfx.size)
    h.check(size == (2, 2, 3), f"a box of {size} m")

    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("r", "y")
    yield from h.text("90")
    yield from h.key("Return", "g", "z")
    yield from h.text("1")
    yield from h.key("Return")
    yield 0.5
    world = hands.effect("wind").matrix_world
    blows = world.col[2].to_3d().normalized()
    h.check(abs(abs(blows.x) - 1) < 1e-4, f"R turns the wind to blow from the side {tuple(blows)}")
    h.check(abs(world.translation.z - 1) < 1e-4, "G lifts it")
    yield from hands.go_to(h, 5 * FPS)
    yield from h.press_button("HFX_OT_add_clip")
    yield from hands.adjust(h, {1: "48"}, shot="1_wind.png")
    yield from hands.zoom_out(h, 6)  # the head of the wind's arrow is in view
    h.document("editor_volume.png", left=0.0, bottom=0.0)
    (strip,) = hands.clips_of(hands.effect("wind"))
    h.check(strip.frame_end - strip.frame_start == 2 * FPS, "it blows for 2 s")

    pressure = hands.MODALITIES.index("pressure")
    yield from hands.add_haptic(h, hands.PAINTED_ROW, pressure)
    yield from hands.fill_part(h, WHOLE_BODY)
    h.check(len(hands.painted_parts(hands.effect("pressure"))) == 11, "all parts are filled")
    starts = []
    for number, frame in enumerate(STRIKES):
        yield from hands.go_to(h, frame)
        starts.append(bpy.context.scene.frame_current)
        yield from h.press_button("HFX_OT_add_clip")
        if number == 0:  # all later clips take the same length
            yield from hands.adjust(h, {1: "2.4"})
    clips = hands.clips_of(hands.effect("pressure"))
    spans = [(clip.frame_start, round(clip.frame_end - clip.frame_start, 3)) for clip in clips]
    h.check(spans == [(start, 2.4) for start in starts], f"three strikes {spans}")
    h.shot("2_clips.png")

    yield from hands.go_to(h, starts[2] + 1)
    yield 0.8
    pixels = h.shot("3_strike.png")
    red, green, blue = hands.tint(pixels, h.xy_of((0.0, -0.1, 1.2)), 4)
    h.check(green > 1.2 * red, "on a strike, the body is green")
    yield from hands.go_to(h, 200)
    yield 0.8
    pixels = h.shot("4_calm.png")
    red, green, blue = hands.tint(pixels, h.xy_of((0.0, -0.1, 1.2)), 4)
    h.check(max(red, green, blue) - min(red, green, blue) < 12, "and after the storm nothing")
