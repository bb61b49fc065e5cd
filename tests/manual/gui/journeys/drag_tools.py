# SPDX-License-Identifier: GPL-3.0-or-later
"""Tools of the toolbar drag out effects; the pie menu of the active effect; the asset shelf."""

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
    yield from hands.zoom_out(h, 2)

    take(h, "hfx.drag_sphere")
    h.shot("1_tool.png")
    centre = h.xy_of((-0.6, 0.0, 1.2))
    rim = h.xy_of((-0.6, 0.0, 0.9))
    yield from h.drag(line(centre, rim), step=0.05)
    yield 0.5
    ball = bpy.context.object
    h.shot("2_sphere.png")
    h.check(ball.hfx.shape == "SPHERE" and ball.select_get(), "a sphere is dragged out")
    h.check(abs(ball.hfx.radius - 0.3) < 0.02, f"as far as the mouse: {ball.hfx.radius:.3f} m")
    h.check(abs(ball.location.x + 0.6) < 0.02, "about the place of the press")
    yield from h.move(*h.xy(h.region(), 0.2, 0.8))
    yield from h.key("ctrl+z")
    yield 0.8
    h.check(not effects(), "one Ctrl+Z takes it back")

    bpy.context.scene.cursor.location = (0.0, 3.0, 0.0)
    h.undo_push()
    yield from h.drag(line(h.xy_of((-0.6, 0.0, 1.2)), h.xy_of((-0.6, 0.0, 0.9))), step=0.05)
    yield 0.5
    depth = bpy.context.object.location.y
    h.check(abs(depth) < 0.2, f"beside the body as deep as the body: {depth:.2f} m")
    yield from h.key("ctrl+z")
    yield 0.8

    take(h, "hfx.drag_cuboid")
    yield from h.drag(line(h.xy_of((-1.0, 0, 0.5)), h.xy_of((-0.5, 0, 1.0))), step=0.05)
    yield from h.move(*h.xy_of((-0.4, 0, 1.0)))
    yield 0.3
    yield from h.click(*h.xy_of((-0.2, 0, 1.0)))
    yield 0.5
    h.shot("3_box.png")
    size = sorted(bpy.context.object.hfx.size)
    h.check(np.allclose(size, [0.3, 0.5, 0.5], atol=0.03), f"a box of {size} m")

    take(h, "hfx.drag_wind")
    yield from h.drag(line(h.xy_of((-1.2, 0, 1.4)), h.xy_of((0.2, 0, 1.4))), step=0.05)
    yield 0.5
    h.shot("4_wind.png")
    wind = hands.effect("wind")
    h.check(wind.matrix_world.col[2].to_3d().normalized().x > 0.99, "wind blows along the drag")

    take(h, "hfx.drag_spot")
    yield from h.drag(line(h.xy_of((0.03, -0.1, 1.25)), h.xy_of((0.1, -0.1, 1.25))), step=0.05)
    yield 0.8
    h.shot("5_point.png")
    points = [obj for obj in effects() if obj.hfx.kind == "SPOT"]
    h.check(points, "a point on the skin")
    h.check(0.04 < points[0].hfx.radius < 0.1, f"with a radius of {points[0].hfx.radius:.3f} m")

    take(h, "builtin.select_box")
    bpy.context.view_layer.objects.active = wind
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("y")
    yield 0.8
    h.shot("6_pie.png")
    x, y = h.xy(h.region(), 0.3, 0.6)
    yield from h.click(x - 90, y)  # the item at the left
    yield 0.5
    h.check(wind.hfx.is_muted, "Mute is at the left of the pie menu")

    if bpy.app.version >= (5, 0):
        h.area().spaces.active.show_region_asset_shelf = True
        yield 3.0
        h.shot("7_shelf.png")
        shelf = h.region("ASSET_SHELF")
        h.check(shelf.height > 50, "the asset shelf is open")
        before = len(effects())
        x = shelf.x + 60
        y = h.window.height - shelf.y - shelf.height * 0.5
        place = h.xy_of((0.0, -0.1, 1.25))
        middle = (x + place[0]) / 2, (y + place[1]) / 2
        yield from h.drag([(x, y), (x + 8, y - 8), middle, place, place], step=0.4)
        yield 2.0
        h.shot("8_dropped.png")
        h.check(len(effects()) > before, "a sensation is dropped on the body")


def take(h: Any, tool: str) -> None:
    """Choose a tool of the toolbar."""
    with h.context():
        bpy.ops.wm.tool_set_by_id(name=tool)


def line(start: tuple[float, float], end: tuple[float, float]) -> list[tuple[float, float]]:
    return [tuple(point) for point in np.linspace(start, end, 9)]


def effects() -> list[bpy.types.Object]:
    return [obj for obj in bpy.context.scene.objects if obj.hfx.role == "EFFECT"]
