# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Export > Haptics: written files are reported, and a long export can be cancelled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

FILE_MENU = (42, 13)  # in the top bar
EXPORT = -6  # of the File menu: before Export All Collections, External Data, ... Quit


def steps(h: Any) -> Iterator[float]:
    h.show_files_inside()
    yield from hands.empty_scene(h)
    scene = bpy.context.scene
    scene.frame_end = 12
    scene.hfx.devices.add().name = "back_pad"
    yield from hands.add_avatar(h)
    vibration = hands.MODALITIES.index("vibration")
    yield from hands.add_haptic(h, hands.PAINTED_ROW, vibration)
    yield from hands.fill_part(h, (0, 0))

    scene.frame_end = 13  # the last edit
    h.undo_push("Edit")
    yield from h.click(*FILE_MENU)
    yield 0.6
    rows = yield from h.menu()
    entries = yield from h.submenu(rows[EXPORT])
    h.shot("1_menu.png")
    yield from h.click(*entries[-1])  # the extension's is the last
    yield from h.until(lambda: browser(h) is not None, "a file browser opens", 20)
    operator = browser(h).spaces.active.active_operator
    h.check(operator.bl_idname == "HFX_OT_export", "the entry of the menu opens the export")
    purposes = yield from h.radios()
    left = max(x for x, _ in purposes)
    column = sorted((y, x) for x, y in purposes if abs(x - left) < 40)
    y, x = column[-3]  # My Own Hardware; the pad's form fits bHaptics, too
    yield from h.click(x, y)
    yield 1.0
    h.shot("2_browser.png")
    h.check(operator.properties.formats == {"track", "csv"}, "track and CSV are chosen")
    track = h.out / "back.hfxtrack"
    yield from h.save_as(track)
    yield from h.until(track.exists, "the track is written", 120)
    yield 0.5
    files = sorted(path.name for path in h.out.iterdir() if path.name.startswith("back"))
    h.check(any(name.endswith(".csv") for name in files), f"and what the device plays: {files}")
    h.shot("3_written.png")
    yield from h.key("Escape")  # the popup takes every click and key
    yield from reported(h)
    messages = bpy.context.window_manager.clipboard
    h.check("Wrote back.hfxtrack" in messages, "the message says what was written")
    h.check(str(h.out) in messages, "and where")
    h.shot("4_told.png")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 1.5
    h.check(bpy.context.scene.frame_end == 12, "Ctrl+Z after the export undoes the last edit")
    yield from given_up(h)


def given_up(h: Any) -> Iterator[float]:
    """Esc ends a long export: no file of the export is left."""
    scene = bpy.context.scene
    scene.frame_end = 100_000
    before = sorted(path.name for path in h.out.iterdir())
    yield from h.press_button("HFX_OT_export")
    track = h.out / "long.hfxtrack"
    yield from h.save_as(track)
    yield from h.until(lambda: is_exporting(h), "the export has begun", 60)
    yield 3.0
    h.check(is_exporting(h), "and goes on while the window is drawn")
    h.shot("5_progress.png")
    yield from h.key("Escape")
    yield from h.until(lambda: not is_exporting(h), "Esc ends it", 30)
    yield 1.0
    h.shot("6_cancelled.png")
    left = {path.name for path in h.out.iterdir() if path.suffix != ".png"} - set(before)
    h.check(not left, f"nothing is left of it {sorted(left)}")
    h.check(len(bpy.data.scenes) == 1, "no scene of its own is left")


def is_exporting(h: Any) -> bool:
    return any(
        modal_operator.bl_idname == "HFX_OT_export" for modal_operator in h.window.modal_operators
    )


def browser(h: Any) -> bpy.types.Area | None:
    areas = h.window.screen.areas
    return next((area for area in areas if area.type == "FILE_BROWSER"), None)


def reported(h: Any) -> Iterator[float]:
    """Copy the reports of Blender's Info editor to the clipboard."""
    area = hands.timeline(h)
    area.ui_type = "INFO"
    yield 0.8
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=h.window, area=area, region=region):
        bpy.ops.info.select_all(action="SELECT")
        bpy.ops.info.report_copy()
    yield 0.3
