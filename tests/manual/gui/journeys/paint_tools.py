# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting with the fill tool, in the colour of the effect, and in 2D on the atlas, both ways."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands
import numpy as np

BELLY = (0.0, -0.1, 1.05)
CHEST = (0.0, -0.1, 1.3)


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    pressure = hands.MODALITIES.index("pressure")
    yield from hands.add_haptic(h, hands.PAINTED_ROW, pressure)
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting begins", 20)
    yield 1.5
    with h.context():
        bpy.ops.wm.tool_set_by_id(name="hfx.fill_part_tool")
    yield 0.5
    yield from h.click(*h.xy_of(BELLY))
    yield 1.0
    pixels = h.shot("1_filled.png")
    filled = weights()
    h.check(np.count_nonzero(filled) > 50, "a click fills the belly")
    red, green, blue = hands.tint(pixels, h.xy_of((0.05, -0.1, 1.05)), 2)
    h.check(green > 1.2 * red and green > 1.2 * blue, f"in green: {red, green, blue}")

    yield from h.click(*h.xy_of((0.6, 0.0, 1.7)))
    yield 0.3
    h.shot("1_beside.png")  # a message, and the tool's hint in the status bar
    h.check(np.array_equal(weights(), filled), "a click beside the body changes nothing")
    yield from h.input.hold("ctrl")
    yield from h.click(*h.xy_of(BELLY))
    yield from h.input.let_go("ctrl")
    yield 0.5
    h.shot("1_cleared.png")
    h.check(not weights().any(), "Ctrl and a click clear the belly")
    yield from h.click(*h.xy_of(BELLY))
    yield 0.5

    yield from h.press_button("HFX_OT_area_atlas")
    yield 2.5
    h.shot("2_atlas.png")
    shelves = [part for part in h.area("IMAGE_EDITOR").regions if part.type == "ASSET_SHELF"]
    h.check(all(part.height <= 1 for part in shelves), "no shelf of brushes covers the atlas")
    (image,) = (image for image in bpy.data.images if image.get("hfx_atlas_effect"))
    atlas = hands.module("engine.body.atlas")
    cells, (width, height) = atlas.texels("hfx-pressure-1")
    shown = texels(image, cells)
    h.check(np.array_equal(shown > 0.5, filled > 0.5), "the atlas shows the filled belly")

    model, parts = hands.model_of(bpy.context.object["hfx_painted_effect"])
    face = (model.part == parts.index("head")) & (model.normals[:, 1] < -0.8)
    column, row = np.median(cells[face], axis=0)
    region = h.region("WINDOW", "IMAGE_EDITOR")
    x, y = region.view2d.view_to_region(column / width, row / height)
    place = region.x + x, h.window.height - (region.y + y)
    yield from h.move(*place)
    yield 0.5
    h.shot("2_named.png")  # the part under the mouse, in the status bar
    yield from h.drag([(place[0] + step, place[1]) for step in range(-6, 7, 3)])
    yield from h.until(lambda: weights()[face].any(), "a stroke on the atlas paints the face", 20)
    yield 1.0
    h.shot("3_stroke.png")
    painted = np.flatnonzero(weights() > filled)
    near = np.abs(cells[painted] - (column, row)).max(axis=1)
    if bpy.app.version >= (5, 0):  # before, the brush has the size of that of the body
        h.check(near.max() < 10, f"the brush is small on the atlas: {near.max():.0f} texels")
    yield from h.move(*h.xy_of(CHEST))
    yield from h.key("ctrl+z")
    yield 1.5
    h.shot("4_undone.png")
    h.check(np.array_equal(weights() > 0.5, filled > 0.5), "Ctrl+Z takes the stroke back")
    h.check(np.array_equal(texels(image_of(), cells) > 0.5, weights() > 0.5), "on both sides")

    yield from h.click(*h.xy_of(CHEST))
    agree = lambda: np.array_equal(texels(image_of(), cells) > 0.5, weights() > 0.5)  # noqa: E731
    yield 1.0
    h.check(np.count_nonzero(weights()) > np.count_nonzero(filled), "a click fills the chest")
    yield from h.until(agree, "the atlas follows", 10)
    h.shot("5_chest.png")
    yield from h.press_button("HFX_OT_paint_end")
    yield 1.0
    h.check(not bpy.context.preferences.view.use_weight_color_range, "Blender's colours return")
    h.shot("6_finished.png")


def image_of() -> bpy.types.Image:
    return next(image for image in bpy.data.images if image.get("hfx_atlas_effect"))


def texels(image: bpy.types.Image, cells: np.ndarray) -> np.ndarray:
    """Brightest channel of each vertex's texel."""
    pixels = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)
    return pixels[cells[:, 1], cells[:, 0], :3].max(axis=1)


def weights() -> np.ndarray:
    """Painted weights of the mesh in Weight Paint."""
    mesh = bpy.context.object
    group = mesh.vertex_groups[0].index
    return np.array(
        [sum(g.weight for g in v.groups if g.group == group) for v in mesh.data.vertices]
    )
