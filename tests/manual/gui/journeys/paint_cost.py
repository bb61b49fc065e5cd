# SPDX-License-Identifier: GPL-3.0-or-later
"""A stroke of Weight Paint costs as much as on the same mesh without the add-on.

Processor time of Blender's main thread for the same strokes: while painting an effect, and on a
copy of the mesh after the add-on was disabled.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import addon_utils
import bpy
import hands
import numpy as np

MOST = 1.2
STROKES = 4
HEIGHT_M = 1.25  # of the chest
AFTER_S = 0.8  # work after a stroke counts as well


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    yield from hands.add_haptic(h, hands.PAINTED_ROW, hands.MODALITIES.index("pressure"))
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting begins", 20)
    yield 3.0
    with_addon = yield from strokes_s(h)
    h.shot("1_with.png")
    canvas = bpy.context.object
    copy = canvas.copy()
    copy.data = canvas.data.copy()
    del copy["hfx_painted_effect"]
    bpy.context.scene.collection.objects.link(copy)
    view = h.area().spaces.active.region_3d.view_matrix.copy()
    opacity = h.area().spaces.active.overlay.weight_paint_mode_opacity
    with h.context():
        bpy.ops.hfx.paint_end()
    yield 1.0
    addon_utils.disable(hands.package())
    yield 1.0
    for obj in bpy.context.view_layer.objects:
        obj.hide_set(obj != copy)
        obj.select_set(obj == copy)
    bpy.context.view_layer.objects.active = copy
    h.area().spaces.active.region_3d.view_matrix = view
    h.area().spaces.active.overlay.weight_paint_mode_opacity = opacity
    with h.context():
        bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    yield 3.0
    without_addon = yield from strokes_s(h)
    h.shot("2_without.png")
    ratio = np.median(with_addon) / np.median(without_addon)
    figures = f"{np.median(with_addon):.2f} s with, {np.median(without_addon):.2f} s without"
    h.check(ratio <= MOST, f"a stroke costs {ratio:.2f} times as much: {figures}")


def strokes_s(h: Any) -> Iterator[float]:
    """Processor seconds of each of some strokes across the chest, the first left out."""
    x, y = h.xy_of((0.0, -0.1, HEIGHT_M))
    durations_s, updated = [], set()

    def note(_scene: Any, graph: Any) -> None:
        updated.update(type(update.id).__name__ for update in graph.updates)

    handlers = bpy.app.handlers.depsgraph_update_post
    for _ in range(STROKES + 1):
        yield from h.move(x - 40, y)
        yield 0.5
        handlers.append(note)
        begun_s = time.thread_time()
        yield from h.drag([(x + step, y) for step in range(-40, 41, 4)])
        yield AFTER_S
        durations_s.append(time.thread_time() - begun_s)
        handlers.remove(note)
        yield from h.key("ctrl+z")
        yield 0.8
    h.check(updated <= {"Object", "Mesh", "Key"}, f"strokes change the mesh alone: {updated}")
    return durations_s[1:]
