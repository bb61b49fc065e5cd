# SPDX-License-Identifier: GPL-3.0-or-later
"""From Blender's start-up file to a painted, timed, exported effect, in eight actions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import hands

FILE_MENU = (41, 13)  # in the top bar
MOST_ACTIONS = 8


def steps(h: Any) -> Iterator[float]:
    h.show_files_inside()
    yield from h.click(*FILE_MENU)
    yield 0.8
    rows = yield from h.menu()
    entries = yield from h.submenu(rows[0])
    h.shot("1_new.png")
    yield from h.click(*entries[-1])
    is_made = lambda: h.window.workspace.name == "HFX" and bpy.context.object  # noqa: E731
    yield from h.until(is_made, "the avatar stands in the HFX workspace", 120)
    counts = set()

    def is_open() -> bool:
        counts.add(len(h.window.screen.areas))
        return h.region("UI").width > 150 if "VIEW_3D" in kinds(h) else False

    yield from h.until(is_open, "the sidebar is open", 60)
    h.check(1 not in counts, f"areas are arranged without a window of one area: {sorted(counts)}")
    yield 2.0
    h.shot("2_avatar.png")

    menus = yield from h.choices(h.region("UI"))
    yield from h.click(*menus[1])  # Paint an Effect, after the palette
    yield 0.8
    rows = yield from h.menu_rows()
    h.shot("3_modalities.png")
    yield from h.click(*rows[hands.MODALITIES.index("pressure")])
    is_painting = lambda: bpy.context.mode == "PAINT_WEIGHT"  # noqa: E731
    yield from h.until(is_painting, "the body can be painted", 60)
    yield 2.0
    h.shot("4_paint.png")

    x, y = h.xy_of((0.0, -0.1, 1.25))  # the chest
    yield from h.drag([(x + step, y) for step in range(-30, 31, 6)], step=0.1)
    yield 1.0
    h.shot("5_stroke.png")
    yield from h.press_button("HFX_OT_add_clip")
    yield 1.0
    effect = hands.effect("pressure")
    h.check(bpy.context.mode == "OBJECT", "the clip ends painting")
    h.check(len(effect["hfx_vertices"]) > 10, f"{len(effect['hfx_vertices'])} vertices are painted")
    h.check(len(hands.clips_of(effect)) == 1, "the effect has a clip")
    h.shot("6_clip.png")

    bpy.context.scene.frame_end = 24  # a short export, because cost is not the subject
    yield from h.press_button("HFX_OT_export")
    yield 1.0
    track = Path(h.out, "minutes.hfxtrack")
    h.shot("8_export.png")
    yield from h.save_as(track)
    yield from h.until(track.exists, "the track is written", 180)
    yield 1.0
    h.shot("9_exported.png")
    h.check(h.actions <= MOST_ACTIONS, f"{h.actions} actions, at most {MOST_ACTIONS}")


def kinds(h: Any) -> set[str]:
    return {area.type for area in h.window.screen.areas}
