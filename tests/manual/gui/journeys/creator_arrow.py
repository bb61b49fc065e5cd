# SPDX-License-Identifier: GPL-3.0-or-later
"""A creator paints an arrow on the back, to the wearer's right: pressure, half a second.

From 2.5 s to 3.0 s; with the mouse in Weight Paint, and a clip of the timeline.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import bpy
import hands
import numpy as np

FPS = 24
HEIGHT = 1.30  # of the arrow, metres
TAIL, TIP, WING = 0.09, -0.09, 0.06  # along X; the wearer's left is +X
SHAFT = [(TAIL, HEIGHT), (TIP, HEIGHT)]
HEAD = [(TIP + WING, HEIGHT + WING), (TIP, HEIGHT), (TIP + WING, HEIGHT - WING)]


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    yield from hands.add_avatar(h)
    pressure = hands.MODALITIES.index("pressure")
    yield from hands.add_haptic(h, hands.PAINTED_ROW, pressure, shot="1_painted_effect.png")
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting begins at once", 20)
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+KP_1")
    yield 1.0
    yield from h.move(*h.xy_of((0.0, 0.0, HEIGHT)))
    yield 0.8
    h.shot("2_body_part.png")  # the name of the body part is in the status bar

    fitted = brush_size()
    for way, comparison in ((12, "larger"), (-12, "as before")):
        x, y = h.xy_of((0.0, 0.0, HEIGHT))
        yield from h.move(x, y)
        yield 0.2
        yield from h.key("f")  # the brush's radius follows the mouse
        yield from h.click(x + way, y)
        yield 0.5
        change = brush_size() / fitted
        holds = change > 1.2 if way > 0 else abs(change - 1.0) < 0.1
        h.check(holds, f"F makes the fitted brush {comparison}, {change:.2f} times the size")
    yield from h.drag(stroke(h, SHAFT))
    yield 0.8
    h.check(count(), "a stroke paints")
    yield from h.key("ctrl+z")
    yield 0.8
    h.check(not count(), "Ctrl+Z takes the stroke back")
    yield from h.key("ctrl+shift+z")
    yield 0.8
    h.check(count(), "and Shift+Ctrl+Z brings it back")
    yield from h.drag(stroke(h, HEAD))
    yield 0.8
    h.shot("3_arrow.png")
    h.document("editor_paint.png")

    position = yield from h.button(h.region("HEADER"), bpy.types.HFX_OT_paint_end)
    yield from h.click(*position)
    yield from h.until(lambda: bpy.context.mode == "OBJECT", "Finish Painting ends it", 20)
    h.check(canvas() is None, "the mesh that was painted on is gone")
    h.check(bpy.context.object == hands.effect("pressure"), "the effect is selected again")
    turn = h.area().spaces.active.region_3d.view_rotation
    yield 0.5
    h.shot("3_finished.png")
    h.check(abs(turn.z) > 0.6, f"the back stays in view: {tuple(turn)}")
    check_arrow(h)

    yield from hands.go_to(h, round(2.5 * FPS))
    frame = bpy.context.scene.frame_current
    yield from h.press_button("HFX_OT_add_clip")
    yield from hands.adjust(h, {1: "12"}, shot="4_clip.png")
    (strip,) = hands.clips_of(hands.effect("pressure"))
    span = strip.frame_start, strip.frame_end
    h.check(span == (frame, frame + FPS / 2), f"one clip of half a second {span}")

    yield from hands.go_to(h, frame - 3)
    h.check(not is_green(h, h.shot("5_before.png")), "before it, nothing is felt")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("space")
    scene = bpy.context.scene
    yield from h.until(lambda: frame + 2 < scene.frame_current < frame + 10, "Space plays", 60)
    pixels = h.shot("6_playing.png")
    yield from h.key("space")
    h.document("editor_clip.png")
    h.check(is_green(h, pixels), "while it plays, the arrow on the back is green")


def stroke(h: Any, line: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Places in the window along a broken line on the back (X and Z of the scene)."""
    corners = [np.array(h.xy_of((x, 0.1, z))) for x, z in line]
    actual = [tuple(corners[0])]
    for start, end in pairwise(corners):
        actual += [tuple(start + (end - start) * share) for share in np.linspace(0, 1, 9)[1:]]
    return actual


def brush_size() -> float:
    tools = bpy.context.tool_settings
    own = getattr(tools.weight_paint, "unified_paint_settings", None)  # since Blender 5.0
    return float((own or tools.unified_paint_settings).size)


def canvas() -> bpy.types.Object | None:
    """Mesh in Weight Paint mode."""
    return next((obj for obj in bpy.data.objects if obj.get("hfx_painted_effect")), None)


def count() -> int:
    """Number of painted vertices."""
    mesh = canvas()
    group = mesh.vertex_groups[0].index
    return sum(any(g.group == group and g.weight for g in v.groups) for v in mesh.data.vertices)


def check_arrow(h: Any) -> None:
    effect = hands.effect("pressure")
    h.check(hands.painted_parts(effect) == {"torso"}, "it is painted on the torso alone")
    model, _ = hands.model_of(effect)
    weights = np.array(effect["hfx_weights"])
    places = model.vertices[np.array(effect["hfx_vertices"])]  # metres, facing -Y
    h.check((places[:, 1] > 0).all(), "on the back")
    x, z = places[:, 0], places[:, 2]
    left, right = (np.ptp(z[(weights > 0.5) & side]) for side in (x > 0.03, x < -0.03))
    h.check(right > 1.5 * left, f"the wide end is the wearer's right: {right:.3f}, {left:.3f} m")


def is_green(h: Any, pixels: np.ndarray) -> bool:
    red, green, blue = hands.tint(pixels, h.xy_of((0.0, 0.1, HEIGHT)), 2)
    return bool(green > 1.3 * red and green > 1.3 * blue)
