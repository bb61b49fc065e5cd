# SPDX-License-Identifier: GPL-3.0-or-later
"""Undo and redo of strokes on the atlas and on the body: one stroke each, on both sides."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands
import numpy as np
from paint_tools import image_of, texels, weights


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    yield from hands.add_haptic(h, hands.PAINTED_ROW, hands.MODALITIES.index("pressure"))
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting begins", 20)
    yield 1.5
    yield from h.press_button("HFX_OT_area_atlas")
    yield 2.5
    cells, (width, height) = hands.module("engine.body.atlas").texels("hfx-pressure-1")
    model, parts = hands.model_of(bpy.context.object["hfx_painted_effect"])
    states = [weights() > 0.5]
    missed = (free_place(cells, width, height), "beside"), ((0.4, -0.04), "below")
    for place, name in missed:
        for click in range(1, 6):
            region = h.region("WINDOW", "IMAGE_EDITOR")
            x, y = region.view2d.view_to_region(*place, clip=False)
            yield from h.click(region.x + x + 4 * click, h.window.height - (region.y + y))
            yield 1.2
            editors = [area.type for area in h.window.screen.areas]
            free = np.array(image_of().pixels[:])[3::4].reshape(height, width)
            free[cells[:, 1], cells[:, 0]] = 0.0
            h.check(
                "IMAGE_EDITOR" in editors and bpy.context.mode == "PAINT_WEIGHT" and not free.any(),
                f"click {click} {name} the charts takes only itself back: {editors}",
            )
    h.shot("0_missed.png")

    def is_linked() -> bool:
        return np.array_equal(texels(image_of(), cells) > 0.5, weights() > 0.5)

    def is_longer() -> bool:
        return is_linked() and (weights() > 0.5).sum() > states[-1].sum()

    for stroke in ("head", "body", "foot_sole", "torso"):
        if stroke == "body":
            yield from h.drag([h.xy_of((0.01 * step, -0.1, 1.05)) for step in range(-6, 7, 3)])
        else:
            column, row = np.median(cells[model.part == parts.index(stroke)], axis=0)
            region = h.region("WINDOW", "IMAGE_EDITOR")
            x, y = region.view2d.view_to_region(column / width, row / height)
            place = region.x + x, h.window.height - (region.y + y)
            yield from h.drag([(place[0] + step, place[1]) for step in range(-6, 7, 3)])
        yield from h.until(is_longer, f"a stroke on {stroke} is on both sides", 20)
        yield 1.0
        states.append(weights() > 0.5)
        h.shot(f"{len(states)}_{stroke}.png")
    yield from h.move(*h.xy_of((0.3, -0.1, 1.7)))
    for way, counts in (("ctrl+z", (3, 2, 1, 0)), ("ctrl+shift+z", (1, 2, 3, 4))):
        for count in counts:
            yield from h.key(way)
            yield 1.5
            h.shot(f"{way}_{count}.png")
            found = np.count_nonzero(weights() > 0.5)
            h.check(
                is_linked() and np.array_equal(weights() > 0.5, states[count]),
                f"{way}: {count} strokes on both sides, {found} vertices",
            )
    for place, name in missed:
        region = h.region("WINDOW", "IMAGE_EDITOR")
        x, y = region.view2d.view_to_region(*place, clip=False)
        x, y = region.x + x, h.window.height - (region.y + y)
        yield from h.drag([(x + step, y) for step in range(-4, 5, 2)])
        yield 1.5
        h.shot(f"{name}.png")  # a message under the picture
        free = np.array(image_of().pixels[:])[3::4].reshape(height, width)
        free[cells[:, 1], cells[:, 0]] = 0.0
        h.check(
            is_linked() and np.array_equal(weights() > 0.5, states[-1]) and not free.any(),
            f"a stroke {name} changes nothing, and leaves no paint",
        )
    yield from h.click(x, y)
    yield 1.5
    yield from h.move(*h.xy_of((0.3, -0.1, 1.7)))
    for way, count in (("ctrl+z", 3), ("ctrl+shift+z", 4)):
        yield from h.key(way)
        yield 1.5
        h.check(
            is_linked() and np.array_equal(weights() > 0.5, states[count]),
            f"{way} after the strokes beside the charts: {count} strokes",
        )
    calf = cells[model.part == parts.index("lower_leg")]
    region = h.region("WINDOW", "IMAGE_EDITOR")
    dabs = []
    for column, row in (calf.min(axis=0) + 8, calf.max(axis=0) - 8):
        x, y = region.view2d.view_to_region(column / width, row / height)
        dabs.append((region.x + x, h.window.height - (region.y + y)))
    yield from h.input.dabs(dabs)
    yield from h.until(is_longer, "two quick dabs are on both sides", 20)
    yield 1.0
    h.shot("dabs.png")
    yield from h.move(*h.xy_of((0.3, -0.1, 1.7)))
    yield from h.key("ctrl+z")
    yield 1.5
    h.shot("dabs_undone.png")
    h.check(
        is_linked() and np.array_equal(weights() > 0.5, states[-1]),
        "one Ctrl+Z takes both dabs back, on both sides",
    )
    pictures = hands.module("authoring.atlas_pictures").pictures
    for _ in range(len(states) + 2):
        if pictures():
            yield from h.key("ctrl+z")
            yield 1.5
    h.shot("before_picture.png")
    editors = [area.type for area in h.window.screen.areas]
    h.check(
        not pictures() and "IMAGE_EDITOR" not in editors,
        f"Ctrl+Z of Paint in 2D gives the editor back: {editors}",
    )


def free_place(cells: np.ndarray, width: int, height: int) -> tuple[float, float]:
    """Place on an atlas, (0, 0) to (1, 1), that is farthest from all charts and edges."""
    columns, rows = np.meshgrid(np.arange(0, width, 4), np.arange(0, height, 4))
    grid = np.column_stack([columns.ravel(), rows.ravel()])
    apart = np.array([np.abs(cells - at).max(axis=1).min() for at in grid])
    edge = np.minimum(grid, (width, height) - grid).min(axis=1)
    column, row = grid[np.argmax(np.minimum(apart, edge))]
    return (column + 0.5) / width, (row + 0.5) / height
