# SPDX-License-Identifier: GPL-3.0-or-later
"""A 360 degree video is the world around the body, in step with the timeline.

Drawn with Cycles: without a graphics card, EEVEE's shaders alone take ten minutes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands
import numpy as np
from movie_file import write_movie

FPS = 24
START = 24
RATE, PICTURES = 20, 40
WALLS = ((1.0, 0.2, 0.2), (0.2, 1.0, 0.2), (0.2, 0.3, 1.0), (1.0, 0.9, 0.2))
MOST_S = 200
STEP = 25  # of brightness, between compared pictures


def steps(h: Any) -> Iterator[float]:
    h.show_files_inside()
    yield from hands.empty_scene(h, FPS)
    scene = bpy.context.scene
    scene.frame_end = 4 * FPS
    yield from hands.add_avatar(h)
    headers = yield from h.panels(h.region("UI"))
    yield from h.click(*headers[-1])
    yield 0.8
    movie = h.out / "room.avi"
    write_room(movie)
    yield from hands.go_to(h, START)
    start = scene.frame_current
    buttons = yield from h.op_buttons(h.region("UI"))
    yield from h.click(*buttons[-1])  # Video
    yield 0.5
    yield from h.until(lambda: browser(h) is not None, "a file browser is open", 10)
    browser(h).spaces.active.active_operator.projection = "SPHERE"
    yield from h.save_as(movie)
    yield from h.until(lambda: bpy.context.scene.world.name == "room", "it is the world", 300)
    h.check(h.area().spaces.active.shading.type == "MATERIAL", "and is seen: Material Preview")
    h.area().spaces.active.region_3d.view_perspective = "PERSP"
    scene.render.engine = "CYCLES"
    # Cycles' importance tables take seconds for each picture.
    scene.world.cycles.sampling_method = "NONE"
    scene.cycles.preview_samples, scene.cycles.use_preview_denoising = 1, False
    shading = h.area().spaces.active.shading
    shading.type, shading.use_scene_world_render = "RENDERED", True
    yield from h.until(lambda: is_coloured(h), "it is drawn", MOST_S)
    yield 5.0
    before = seen(h, "0.0.png")
    for seconds in (1.0, 1.9):
        scene.frame_set(start + round(seconds * FPS))
        lit = before + STEP
        yield from h.until(lambda lit=lit: seen(h) > lit, f"brighter at {seconds} s", MOST_S)
        yield 5.0
        before = seen(h, f"{seconds}.png")
    h.document("editor_360.png", left=0.0)


def write_room(path: Any) -> None:
    """A room with walls of four colours, each a quarter of the way round; brightness increases."""
    room = np.repeat(np.array(WALLS), 16, axis=0)[None].repeat(32, axis=0)  # (32, 64, 3)
    room[24:] *= 0.4  # the floor
    light = np.linspace(0.25, 1.0, PICTURES)[:, None, None, None]
    write_movie(path, (255 * light * room).astype(np.uint8), RATE)


def seen(h: Any, name: str = "seen.png") -> float:
    """Brightness of the surroundings, outside of the body."""
    pixels = h.shot(name)
    return float(hands.tint(pixels, h.xy(h.region(), 0.15, 0.6)).max())


def is_coloured(h: Any) -> bool:
    """Test for the wall's colour there, not the viewport's grey."""
    colour = hands.tint(h.shot("seen.png"), h.xy(h.region(), 0.15, 0.6))
    return bool(colour.max() - colour.min() > 20)


def browser(h: Any) -> bpy.types.Area | None:
    areas = h.window.screen.areas
    return next((area for area in areas if area.type == "FILE_BROWSER"), None)
