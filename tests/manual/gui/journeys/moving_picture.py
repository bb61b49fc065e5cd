# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of the README's moving picture: paint, add a clip, let a volume pass, and play.

Writes the window as numbered pictures, and ``film.json``: the part of the window that the moving
picture shows, and the milliseconds of each picture. ``docs/regenerate.py film`` joins them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import bpy
import hands
import numpy as np
from mathutils import Euler

LAST = 108
CLIP_START, PASSED = 50, 96  # frames
STRIDE = 2  # frames of the scene for a picture
HIGHER = 50  # pixels of the timeline, so that a clip is seen
WIDER = 10  # pixels of the brush's radius
# Across the chest and the belly, X and Z in metres; the wearer's left is +X.
STROKE = ((0.13, 1.33), (-0.11, 1.30), (0.10, 1.20), (-0.10, 1.13), (0.07, 1.05), (-0.05, 1.00))
BESIDE, BEYOND = (0.7, -0.1, 1.2), -0.7  # of the volume, metres
VIEWED = (0.3, 0.0, 1.15)  # right of the body: the sidebar covers the view's right part


class Film:
    """Numbered pictures of the window with their duration."""

    def __init__(self, h: Any) -> None:
        self._h = h
        self._durations_ms: list[int] = []

    def add(self, milliseconds: int) -> None:
        self._h.shot(f"film_{len(self._durations_ms):04}.png")
        self._durations_ms.append(milliseconds)

    def save(self) -> None:
        view, line = self._h.area(), hands.timeline(self._h)
        height = self._h.window.height
        box = (view.x, height - view.y - view.height, view.x + view.width, height - line.y)
        text = json.dumps({"box": box, "milliseconds": self._durations_ms})
        (self._h.out / "film.json").write_text(text, encoding="utf-8")


def steps(h: Any) -> Iterator[float]:
    film = Film(h)
    yield from set_up(h)
    yield from paint(h, film)
    yield from add_passing_volume(h, film)
    yield from play(h, film)
    film.save()
    total_s = sum(json.loads((h.out / "film.json").read_text())["milliseconds"]) / 1000
    h.check(12 < total_s < 18, f"the film takes {total_s:.1f} s")


def set_up(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    scene = bpy.context.scene
    scene.frame_end = LAST
    scene.sync_mode = "NONE"  # each frame is drawn
    scene.cursor.location = BESIDE
    bpy.context.preferences.view.show_playback_fps = False
    space = h.area().spaces.active
    space.overlay.show_cursor = space.overlay.show_text = False
    view = space.region_3d
    view.view_perspective = "PERSP"
    view.view_rotation = Euler((np.radians(82), 0.0, np.radians(12))).to_quaternion()
    view.view_location, view.view_distance = VIEWED, 2.1
    line = hands.timeline(h)
    x, border = line.x + line.width // 2, h.window.height - line.y - line.height
    yield from h.drag([(x, border - up) for up in range(0, HIGHER + 1, 10)], step=0.1)
    yield 0.5
    with bpy.context.temp_override(window=h.window, area=line, region=line.regions[-1]):
        bpy.ops.action.view_all()
    h.undo_push()
    yield from hands.go_to(h, CLIP_START)
    yield from h.move(*h.xy(h.region(), 0.3, 0.5))
    yield 0.8


def paint(h: Any, film: Film) -> Iterator[float]:
    """Paint an Effect > Pressure, a stroke, and Finish, Add Clip."""
    film.add(600)
    menus = yield from h.choices(h.region("UI"))
    yield from h.move(*menus[1])  # Paint an Effect, after the palette
    film.add(300)
    yield from h.click(*menus[1])
    yield 0.6
    rows = yield from h.menu_rows()
    yield from h.move(*rows[hands.MODALITIES.index("pressure")])
    yield 0.3
    film.add(600)
    yield from h.click(*rows[hands.MODALITIES.index("pressure")])
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting has begun", 60)
    yield 1.0
    view = h.area().spaces.active.region_3d  # painting shows the whole body
    view.view_location, view.view_distance = (0.17, 0.0, 1.2), 1.4
    yield 0.5
    film.add(200)
    places = along([h.xy_of((x, -0.1, z)) for x, z in STROKE], 7)
    yield from h.move(*places[0])
    yield from h.key("f")  # the brush's radius follows the mouse
    yield from h.click(places[0][0] + WIDER, places[0][1])
    yield 0.5
    yield from h.move(*places[0])
    film.add(300)
    yield from h.input.press(1)
    for place in places[1:]:
        yield from h.input.move(*place)
        yield 0.05
        film.add(70)
    yield from h.input.release(1)
    yield 0.5
    finish = yield from h.button(h.region("UI"), bpy.types.HFX_OT_add_clip)
    yield from h.move(*finish)
    yield 0.3
    film.add(500)
    yield from h.click(*finish)
    yield from h.until(lambda: bpy.context.mode == "OBJECT", "the clip ends painting", 60)
    yield 1.0
    film.add(800)


def add_passing_volume(h: Any, film: Film) -> Iterator[float]:
    """Add a sphere of warmth and keyframe it on both sides of the body."""
    yield from hands.go_to(h, 1)
    yield from open_menu(h, film)
    warm = hands.effect("temperature")
    h.check(warm.hfx.shape == "SPHERE", "a sphere is added")
    start = h.xy_of(BESIDE)
    yield from h.move(*start)
    yield from h.key("s")
    yield from h.text("0.5")
    yield from h.key("Return")
    yield from h.key("i")
    yield 0.5
    film.add(500)
    yield from hands.go_to(h, PASSED)
    film.add(300)
    yield from h.move(*start)
    yield from h.key("g", "x")
    goal = h.xy_of((BEYOND, *BESIDE[1:]))
    for place in along([start, goal], 14)[1:]:
        yield from h.input.move(*place)
        yield 0.2
        film.add(70)
    yield from h.click(*goal)
    yield from h.key("i")
    yield 0.5
    film.add(400)
    moved = hands.effect("temperature").location.x
    h.check(moved < -0.5, f"the sphere is on the other side: {moved:.2f} m")


def open_menu(h: Any, film: Film) -> Iterator[float]:
    """Add > Haptic > Sphere > Temperature, as ``hands.add_haptic`` with pictures."""
    yield from h.move(*h.xy(h.region(), 0.12, 0.85))
    yield from h.key("shift+a")
    yield 0.4
    rows = yield from h.menu()
    entries = yield from h.submenu(rows[-1])
    yield from h.move(*rows[-1])
    film.add(300)
    kinds = yield from h.submenu(entries[hands.VOLUME_ROW + hands.SHAPES.index("SPHERE")])
    film.add(300)
    yield from h.move(*kinds[hands.MODALITIES.index("temperature")])
    yield 0.3
    film.add(500)
    yield from h.click(*kinds[hands.MODALITIES.index("temperature")])
    yield 0.8


def play(h: Any, film: Film) -> Iterator[float]:
    """Play with Space and take the drawn frames."""
    scene = bpy.context.scene
    yield from hands.go_to(h, 1)
    yield from h.move(*h.xy(h.region(), 0.12, 0.3))
    film.add(300)
    yield from h.key("space")
    yield from h.until(lambda: scene.frame_current > 1, "Space plays", 60)
    taken = [scene.frame_current]
    while taken[-1] < LAST - STRIDE:
        film.add(round(1000 * STRIDE / scene.render.fps))
        while 0 <= scene.frame_current - taken[-1] < STRIDE:
            yield 0.001
        if scene.frame_current < taken[-1]:
            break
        taken.append(scene.frame_current)
    yield from h.key("space")
    yield 0.5
    film.add(1000)
    steps_taken = np.diff(taken)
    h.check(len(taken) > 30, f"{len(taken)} frames of playback, at most {steps_taken.max()} apart")


def along(corners: Sequence[tuple[float, float]], count: int) -> list[tuple[float, float]]:
    """Points on a broken line, ``count`` on each part."""
    points = [corners[0]]
    for start, end in pairwise(np.array(corners)):
        points += [
            tuple(start + (end - start) * share) for share in np.arange(1, count + 1) / count
        ]
    return points
