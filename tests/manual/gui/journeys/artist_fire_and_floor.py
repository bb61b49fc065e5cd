# SPDX-License-Identifier: GPL-3.0-or-later
"""A technical artist places the warmth of a fire and a vibrating floor, for the first two seconds.

A sphere of 2 m radius at 30 degrees, sized by the handle, moved and keyframed; a box of 2 x 2 m.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands
import numpy as np

FPS = 24


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    yield from hands.add_avatar(h)
    yield from hands.zoom_out(h, 4)

    yield from add_volume(h, "SPHERE", "temperature")
    fire = hands.effect("temperature")
    h.check(fire.hfx.shape == "SPHERE" and abs(fire.hfx.radius - 0.5) < 1e-6, "a sphere of 0.5 m")
    handle, there = h.xy_of((0.5, 0.0, 0.0)), h.xy_of((2.0, 0.0, 0.0))
    yield from h.drag([handle, *between(handle, there)])
    yield 0.5
    fire = hands.effect("temperature")
    h.check(abs(fire.hfx.radius - 2.0) < 0.15, f"its handle sizes it: {fire.hfx.radius:.2f} m")
    h.shot("1_sized.png")
    fields = yield from h.fields(h.region("UI"))
    yield from h.enter(fields[0], "30")
    fire = hands.effect("temperature")
    h.check(abs(fire.hfx.temperature - 30) < 1e-4, "30 degrees are typed in")

    yield from over_view(h)
    yield from h.key("i")
    yield 0.6
    yield from hands.go_to(h, 2 * FPS)
    last = bpy.context.scene.frame_current
    yield from over_view(h)
    yield from h.key("g")
    start = h.xy(h.region(), 0.3, 0.6)
    for position in between(start, (start[0] - 90, start[1]), 4):
        yield from h.move(*position)
    yield from h.click(start[0] - 90, start[1])
    yield from h.key("i")
    yield 0.6
    moved = hands.effect("temperature").location.x
    h.check(moved < -0.2, f"G moves it by the mouse: {moved:.2f} m")
    yield from hands.go_to(h, 1)
    back = hands.effect("temperature").matrix_world.translation.x
    h.check(abs(back) < 0.02, f"I keyframes it: {back:.2f} m at frame 1")
    yield from h.press_button("HFX_OT_add_clip")
    yield from hands.adjust(h, {1: "48"}, shot="2_clip.png")
    (strip,) = hands.clips_of(hands.effect("temperature"))
    h.check(strip.frame_end - strip.frame_start == 2 * FPS, "a clip of 2 s")

    yield from add_volume(h, "CUBOID", "vibration")
    fields = yield from h.fields(h.region("UI"))
    for field, value in zip(fields[1:5], ("100", "2", "2", "0.3"), strict=True):
        yield from h.enter(field, value)
    floor = hands.effect("vibration").hfx
    size = tuple(round(item, 3) for item in floor.size)
    h.check(floor.frequency == 100 and size == (2, 2, 0.3), f"the floor: 100 Hz, {size} m")
    yield from h.press_button("HFX_OT_add_clip")
    yield from hands.adjust(h, {1: "48"})

    ruler = [hands.ruler(h, frame) for frame in (4, 12, 20, 24)]
    yield from h.drag(ruler, step=0.3)
    yield 1.0
    at = bpy.context.scene.frame_current
    h.check(abs(at - 24) <= 1, f"dragging in the timeline scrubs ({at})")
    on_the_way = hands.effect("temperature").matrix_world.translation.x
    h.check(moved < on_the_way < -0.02, f"the fire moves on its keyframes ({on_the_way:.2f} m)")
    pixels = h.shot("3_felt.png")
    red, green, blue = hands.tint(pixels, h.xy_of((0.0, -0.1, 1.2)), 3)
    # 30 degrees of air are warmer than the neutral 24, so the colour is that of warmth: orange.
    h.check(red > 1.1 * green and green > 1.1 * blue, "the chest feels the warmth")
    red, green, blue = hands.tint(pixels, h.xy_of((0.2, -0.05, 0.1)), 2)
    h.check(red > 1.5 * green, "the feet feel the floor, too")
    shading = h.area().spaces.active.shading
    h.check(shading.wireframe_color_type == "OBJECT", "wires have the colour of their modality")
    yield from hands.go_to(h, last + 6)
    yield 0.8
    pixels = h.shot("4_after.png")
    colour = hands.tint(pixels, h.xy_of((0.0, -0.1, 1.2)), 3)
    h.check(np.ptp(colour) < 12, "after the clips nothing is felt")


def over_view(h: Any) -> Iterator[float]:
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))


def add_volume(h: Any, shape: str, modality: str) -> Iterator[float]:
    row = hands.VOLUME_ROW + hands.SHAPES.index(shape)
    yield from hands.add_haptic(h, row, hands.MODALITIES.index(modality))


def between(start: Any, end: Any, count: int = 6) -> list[tuple[float, float]]:
    shares = np.linspace(0, 1, count + 1)[1:, None]
    return [tuple(position) for position in np.array(start) * (1 - shares) + np.array(end) * shares]
