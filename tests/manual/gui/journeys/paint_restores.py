# SPDX-License-Identifier: GPL-3.0-or-later
"""*Paint in 2D* ends with its Image Editor; undo back into painting keeps the view."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    yield from hands.add_haptic(h, hands.PAINTED_ROW, hands.MODALITIES.index("pressure"))
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting has begun", 60)
    yield 1.0
    h.shot("1_painting.png")
    areas = len(h.window.screen.areas)
    yield from h.press_button("HFX_OT_area_atlas")
    yield 1.5
    h.shot("2_picture.png")
    h.check(len(h.window.screen.areas) == areas + 1, "Paint in 2D splits the viewport")
    yield from h.press_button("HFX_OT_paint_end")
    yield from h.until(lambda: bpy.context.mode == "OBJECT", "painting has ended", 60)
    yield 1.0
    h.shot("3_finished.png")
    h.check(len(h.window.screen.areas) == areas, "Finish Painting closes the Image Editor")

    yield from hands.zoom_out(h, 4)
    view = h.area().spaces.active.region_3d
    before = view.view_distance, tuple(view.view_location)
    yield from h.key("ctrl+z")
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "undo resumes painting", 60)
    yield 1.5
    h.shot("4_undone.png")
    view = h.area().spaces.active.region_3d
    after = view.view_distance, tuple(view.view_location)
    h.check(after == before, f"undo keeps the view: {before} {after}")
