# SPDX-License-Identifier: GPL-3.0-or-later
"""A point on the skin is slid over a posed body with G and by the handle, keyed, and sized."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import bpy
import hands
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

FPS = 24
FIRST, SECOND, THIRD = (0.10, 1.36), (-0.09, 1.34), (0.0, 1.15)  # X and Z on the back, metres
FRAMES = (24, 48, 72)
LEAN_RAD = 0.35
RADIUS = 0.08  # metres: wide enough for visible colour around the handle


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    bpy.context.scene.frame_end = 96
    yield from hands.add_avatar(h)
    body = bpy.context.object
    body.name = "Anna"
    lean(body)
    h.undo_push()
    vibration = hands.MODALITIES.index("vibration")
    yield from hands.add_haptic(h, hands.POINT_ROW, vibration)
    point().hfx.radius = RADIUS
    h.undo_push()
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+KP_1")
    yield 1.0
    h.shot("1_handles.png")
    start = place()

    # G, as for any object; Esc reverts the move.
    yield from h.move(*seen(h))
    yield from h.key("g")
    yield from h.move(*target(h, FIRST))
    yield 0.5
    pixels = h.shot("2_sliding.png")
    h.document("editor_point_slide.png")
    h.check(is_red(h, pixels, target(h, FIRST)), "it is felt under the mouse while it is slid")
    yield from h.key("Escape")
    yield 0.5
    h.check(np.abs(place() - start).max() < 1e-6, "Esc takes it back")
    h.check("hfx_path_own" not in point(), "and leaves nothing")

    yield from h.move(*seen(h))
    yield from h.key("g")
    yield from h.move(*target(h, FIRST))
    yield from h.click(*target(h, FIRST))
    yield 0.5
    h.check(beside(h, FIRST) < 6, f"G puts it where was clicked, {beside(h, FIRST):.1f} pixels off")
    yield from h.key("ctrl+z")
    yield 0.8
    h.check(np.abs(place() - start).max() < 1e-6, "one Ctrl+Z takes it back")

    # The handle, with Auto Keying; from 5.0 on, only properties with a key are keyed by default.
    yield from hands.go_to(h, FRAMES[0])
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("i")
    yield 0.5
    h.check(len(keys()) == 1, f"I keys the place where it is {keys()}")
    bpy.context.tool_settings.use_keyframe_insert_auto = True
    h.undo_push()
    for frame, goal in zip(FRAMES, (FIRST, SECOND, THIRD), strict=True):
        yield from hands.go_to(h, frame)
        yield 0.5
        yield from h.drag(line(seen(h), target(h, goal)), step=0.05)
        yield 0.8
        h.shot(f"3_keyed_{frame}.png")
        off = beside(h, goal)
        h.check(off < 8, f"the handle takes it to {goal}, {off:.1f} pixels beside the mouse")
    keyed = keys()
    h.check(
        len(keyed) == 3 and max(abs(a - b) for a, b in zip(keyed, FRAMES, strict=True)) <= 1,
        f"Auto Keying keys each frame: {keyed}",
    )
    for frame, goal in zip(keyed, (FIRST, SECOND, THIRD), strict=True):
        bpy.context.scene.frame_set(round(frame))
        yield 1.0
        h.check(beside(h, goal) < 8, f"at frame {frame} it is at {goal} again")
        h.check(is_red(h, h.shot(f"4_frame_{frame}.png"), target(h, goal)), "and felt there")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    bpy.context.scene.frame_set(FRAMES[2])
    yield from h.key("ctrl+z")
    yield 0.8
    h.check(len(keys()) == 2, f"Ctrl+Z takes the last key back {keys()}")

    # By hand: not keyed until I is pressed.
    bpy.context.tool_settings.use_keyframe_insert_auto = False
    h.undo_push()
    yield from hands.go_to(h, FRAMES[2])
    yield from h.drag(line(seen(h), target(h, THIRD)), step=0.05)
    yield 0.5
    h.check(len(keys()) == 2, "without Auto Keying nothing is keyed")
    h.check(beside(h, THIRD) < 8, "it is where it was dragged to")
    h.shot("5_loose.png")
    yield from h.key("i")
    yield 0.8
    h.check(len(keys()) == 3, f"I keys its place {keys()}")
    yield from hands.go_to(h, FRAMES[0])
    yield from hands.go_to(h, FRAMES[2])
    yield 0.8
    h.check(beside(h, THIRD) < 8, "where it stays")

    # The ring around the handle sizes the disc.
    radius = point().hfx.radius
    x, y = seen(h)
    reach = ring_pixels(h)
    yield from h.move(x + reach, y)
    yield 0.5
    h.shot("6_ring.png")
    yield from h.drag(line((x + reach, y), (x + 2 * reach, y)), step=0.05)
    yield 0.5
    h.shot("7_wider.png")
    grown = point().hfx.radius / radius
    h.check(1.7 < grown < 2.3, f"dragged to twice the distance, the disc is {grown:.2f} times wide")
    yield from h.key("ctrl+z")
    yield 0.8
    h.check(abs(point().hfx.radius - radius) < 1e-6, "one Ctrl+Z takes that back")
    yield from h.move(x + 40, y)
    yield from h.key("s")
    yield from h.move(x + 80, y)
    yield 0.3
    h.shot("8_sizing.png")
    yield from h.key("Return")
    yield 0.5
    grown = point().hfx.radius / radius
    h.check(1.7 < grown < 2.3, f"S does so, too: {grown:.2f}")

    # G, G: along the path.
    before = list(point()["hfx_path"])
    yield from h.move(*seen(h))
    yield from h.key("g", "g")
    yield from h.move(*target(h, (0.0, 1.3)))
    yield 0.5
    h.shot("9_along.png")
    yield from h.key("Return")
    yield 0.5
    h.check(list(point()["hfx_path"]) == before, "G, G slides it along its path")
    h.check(0.0 < point().hfx.path_position < 1.0, f"to {point().hfx.path_position:.2f}")


def lean(body: bpy.types.Object) -> None:
    """Lean the avatar forward, so that the skin leaves the rest pose."""
    bone = next(b for b in body.pose.bones if b.name.startswith("spine03"))
    bone.rotation_mode = "XYZ"
    bone.rotation_euler.x = LEAN_RAD


def point() -> bpy.types.Object:
    return hands.effect("vibration")


def keys() -> list[int]:
    curve = hands.module("authoring.paths.paths").motion_of(point())
    return [] if curve is None else [round(key.co[0]) for key in curve.keyframe_points]


def place() -> np.ndarray:
    """Place of the point, in the rest space of the canonical body."""
    return np.asarray(hands.module("authoring.paths.spot_placing").place_of(point()))


def seen(h: Any) -> tuple[float, float]:
    """Position of the point in the window."""
    return on_screen(h, place())


def target(h: Any, goal: tuple[float, float]) -> tuple[float, float]:
    """Window position of a point of the back, on the leaning body."""
    return on_screen(h, on_back(*goal))


@cache
def on_back(x: float, z: float) -> np.ndarray:
    """Skin location under a window position seen from behind, in rest space."""
    model = hands.module("engine.body.model").load_model("hfx-pressure-1")
    tree = BVHTree.FromPolygons(model.vertices.tolist(), model.triangles.tolist())
    position, *_ = tree.ray_cast(Vector((x, 1.0, z)), Vector((0.0, -1.0, 0.0)))
    return np.array(position)


def on_screen(h: Any, where: np.ndarray) -> tuple[float, float]:
    module = hands.module("authoring.paths.skin_picking")
    anchors = module.Anchors.of(where[None])
    world = anchors.posed_on(point().hfx.body, bpy.context.evaluated_depsgraph_get())[0][0]
    return h.xy_of(Vector(world.tolist()))  # type: ignore[no-any-return]


def beside(h: Any, goal: tuple[float, float]) -> float:
    """Pixels between the point and a place of the back."""
    return float(np.hypot(*np.subtract(seen(h), target(h, goal))))


def line(first: tuple[float, float], last: tuple[float, float]) -> list[tuple[float, float]]:
    a, b = np.array(first), np.array(last)
    return [tuple(a + (b - a) * share) for share in np.linspace(0.0, 1.0, 6)]


def ring_pixels(h: Any) -> float:
    """Distance of the ring from the point in the window."""
    radius = point().hfx.radius
    world = Vector(on_world(radius))
    x, y = h.xy_of(world)
    return float(np.hypot(x - seen(h)[0], y - seen(h)[1]))


def on_world(radius: float) -> list[float]:
    module = hands.module("authoring.paths.skin_picking")
    anchors = module.Anchors.of(place()[None])
    world = anchors.posed_on(point().hfx.body, bpy.context.evaluated_depsgraph_get())[0][0]
    return [float(world[0]) + radius, float(world[1]), float(world[2])]


def is_red(h: Any, pixels: np.ndarray, at: tuple[float, float]) -> bool:
    red, green, blue = hands.tint(pixels, (at[0] + 16, at[1]), 3)  # next to the handle
    return bool(red > 1.2 * green and red > 1.2 * blue)
