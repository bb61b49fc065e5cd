# SPDX-License-Identifier: GPL-3.0-or-later
"""A point on the skin: a path is clicked on the back and followed by the point, or is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import bpy
import hands
import numpy as np

FPS = 24
START = 24  # frames
STRAIGHT, FREEHAND = 2, 1  # of the panel's buttons, row by row
PLACES = [(0.09, 1.36), (-0.09, 1.36), (-0.09, 1.18)]  # X and Z, metres; the wearer's left is +X


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    yield from hands.add_avatar(h)
    vibration = hands.MODALITIES.index("vibration")
    yield from hands.add_haptic(h, hands.POINT_ROW, vibration, shot="1_menu.png")
    h.check(point().hfx.kind == "SPOT", "a point on the skin is added")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+KP_1")
    yield 1.0
    pixels = h.shot("2_point.png")
    h.check(is_red(h, pixels, (0.0, 1.25)), "it is felt in the middle of the back")

    yield from h.press_button("HFX_OT_draw_path", which=STRAIGHT)
    for position in PLACES:
        yield from h.click(*seen(h, position))
        yield 0.3
    h.shot("3_clicked.png")
    yield from h.key("Return")
    yield 0.8
    knots = np.array(point()["hfx_path"]).reshape(-1, 3)
    off = max(np.linalg.norm(knots[:, [0, 2]] - position, axis=1).min() for position in PLACES)
    pixel_m = 0.1 / (seen(h, (0.0, 1.3))[0] - seen(h, (0.1, 1.3))[0])
    h.check(
        off < 2.0 * abs(pixel_m),
        f"the path leads over what was clicked, {1000 * off:.1f} mm beside it",
    )
    h.check((knots[:, 1] > 0).all(), "on the back")
    paths = hands.module("authoring.paths.paths")
    shortest = sum(float(np.hypot(*np.subtract(b, a))) for a, b in pairwise(PLACES))
    clicked = paths.length_m(point())
    h.check(shortest <= clicked + 0.008 < 1.3 * shortest, f"{clicked:.3f} m along the skin")

    yield from hands.go_to(h, START)
    start = bpy.context.scene.frame_current
    yield from h.press_button("HFX_OT_move_along_path")
    yield from hands.adjust(h, {0: "2"}, shot="4_move.png")
    curve = paths.motion_of(point())
    keys = [tuple(round(float(v), 3) for v in key.co) for key in curve.keyframe_points]
    h.check(keys == [(start, 0.0), (start + 2 * FPS, 1.0)], f"it moves for 2 s {keys}")
    first, corner, last = PLACES
    for frame, here, away in ((start, first, last), (start + 2 * FPS, last, first)):
        yield from hands.go_to(h, frame)
        yield 1.0
        pixels = h.shot(f"5_frame_{frame}.png")
        h.check(is_red(h, pixels, here), f"at frame {frame} it is felt at {here}")
        h.check(not is_red(h, pixels, away), f"and not at {away}")
    yield from hands.go_to(h, start + FPS)
    yield 1.0
    h.shot("6_corner.png")
    h.document("editor_point.png")

    yield from h.press_button("HFX_OT_draw_path", which=FREEHAND)
    yield from h.drag(along(h, [first, last]), step=0.05)
    yield 0.8
    h.shot("7_freehand.png")
    drawn = paths.length_m(point())
    straight = float(np.hypot(*np.subtract(last, first)))
    h.check(0.9 * straight < drawn < 1.3 * straight, f"drawn freehand: {drawn:.3f} m")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 0.8
    again = paths.length_m(point())
    h.check(abs(again - clicked) < 1e-6, f"Ctrl+Z brings the clicked path back ({again:.3f} m)")

    yield from h.press_button("HFX_OT_draw_path", which=STRAIGHT)
    yield from h.click(*seen(h, corner))
    yield from h.key("Escape")
    yield 0.5
    h.check(abs(paths.length_m(point()) - clicked) < 1e-6, "Escape leaves the path as it is")


def point() -> bpy.types.Object:
    return hands.effect("vibration")


def seen(h: Any, place: tuple[float, float]) -> tuple[float, float]:
    """Position of a place of the back in the window."""
    x, z = place
    return h.xy_of((x, 0.1, z))  # type: ignore[no-any-return]


def along(h: Any, line: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Places in the window along a straight line on the back."""
    start, end = (np.array(seen(h, position)) for position in line)
    return [tuple(start + (end - start) * share) for share in np.linspace(0, 1, 13)]


def is_red(h: Any, pixels: np.ndarray, place: tuple[float, float]) -> bool:
    red, green, blue = hands.tint(pixels, seen(h, place), 8)
    return bool(red > 1.2 * green and red > 1.2 * blue)
