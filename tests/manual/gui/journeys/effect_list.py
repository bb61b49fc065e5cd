# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of effects: several rows, groups with gain and start, deletion; an export by purpose."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    h.show_files_inside()
    yield from hands.empty_scene(h)
    bpy.context.scene.frame_end = 24
    yield from hands.add_avatar(h)
    for modality in ("vibration", "pressure", "temperature", "pressure"):
        yield from hands.add_haptic(h, hands.VOLUME_ROW + 1, hands.MODALITIES.index(modality))
    names = [row.name for row in rows()]
    h.check(len(names) == 4, f"four rows: {names}")

    yield from h.click(*(yield from row_at(h, 0)))
    h.check(selected() == names[:1], f"a click selects an effect: {selected()}")
    x, y = yield from row_at(h, 2)
    yield from h.input.hold("shift")
    yield from h.click(x, y)
    yield from h.input.let_go("shift")
    yield 0.8
    h.check(selected() == names[:3], f"Shift and a click select up to it: {selected()}")
    h.shot("1_selected.png")
    icons = h.region("UI").x + 34
    (_, first), (_, last) = (yield from row_at(h, 0)), (yield from row_at(h, 1))
    yield from h.drag([(icons, first), (icons, 0.5 * (first + last)), (icons, last)], step=0.2)
    yield 0.8
    h.check(selected() == names[2:3], f"dragging over icons deselects: {selected()}")
    yield from h.drag([(icons, first), (icons, 0.5 * (first + last)), (icons, last)], step=0.2)
    yield 0.8
    h.check(selected() == names[:3], f"and selects again: {selected()}")

    yield from h.move(*(yield from row_at(h, 0)))
    yield 0.5
    yield from h.key("m")
    yield 1.0
    h.shot("2_key.png")
    yield from h.key("Return")  # New Group is under the mouse
    yield 1.0
    groups = [bpy.data.objects[name].hfx.group for name in names]
    h.check(groups == ["Group"] * 3 + [""], f"M over the list moves to a new group: {groups}")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 1.5
    h.check(len(rows()) == 4, "one undo takes the group back")
    yield from h.click(*(yield from row_at(h, 0)), button=3)
    yield 1.0
    h.shot("2_context_menu.png")
    yield from h.key("Escape")
    yield 0.5

    yield from list_menu(h)
    h.shot("2_menu.png")
    move, *_ = yield from h.menu_rows()
    yield from h.move(*move)
    yield 1.0
    opened = yield from h.menu_rows()
    groups = [place for place in opened if place[0] < move[0] - 40]  # opens to the left here
    h.shot("3_groups.png")
    yield from h.click(*groups[0])
    yield 1.0
    grouped = [bpy.data.objects[name].hfx for name in names[:3]]
    h.check([hfx.group for hfx in grouped] == ["Group"] * 3, "the effects are a group")
    h.check(len(rows()) == 5, "the group has a row")
    h.shot("4_group.png")
    x, y = yield from row_at(h, 5)  # below the closed list of three rows at least
    yield from h.move(x, y)
    h.shot("5_gain.png")
    bpy.context.window_manager.hfx_group_gain = 0.5
    yield 1.0
    h.check([hfx.group_gain for hfx in grouped] == [0.5] * 3, "a common gain")

    yield from h.press_button("HFX_OT_remove_effects")
    yield 1.0
    h.check([row.name for row in rows()] == names[3:], "the minus deletes the selected effects")
    h.shot("6_deleted.png")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 1.5
    h.check(len(rows()) == 5, "one undo brings them back")
    yield from export(h)


def export(h: Any) -> Iterator[float]:
    """Choose a purpose, add the proposed device, and read the popup and the report."""
    yield from h.press_button("HFX_OT_export")
    yield from h.until(lambda: browser(h) is not None, "a file browser opens", 20)
    yield 1.0
    h.shot("7_purposes.png")
    operator = browser(h).spaces.active.active_operator
    operator.purpose = "BHAPTICS"
    browser(h).tag_redraw()
    yield 1.0
    h.check(operator.formats == {"tact"}, "a purpose selects the formats")
    h.shot("8_missing.png")
    sidebar = h.region("TOOL_PROPS", "FILE_BROWSER")
    yield from h.click(*(yield from h.button(sidebar, bpy.types.HFX_OT_live_add)))
    yield 1.0
    h.check(len(bpy.context.scene.hfx.devices) == 1, "the proposed device is added")
    h.shot("9_device.png")
    yield from h.save_as(h.out / "list.hfxtrack")
    yield from h.until(lambda: list(h.out.glob("list*.tact")), "the project is written", 120)
    yield 1.0
    h.shot("10_popup.png")
    windows = len(bpy.context.window_manager.windows)
    buttons = yield from h.op_buttons(None)
    x, y = h.mouse
    first = next((at for at in buttons if abs(at[1] - y) < 8 and abs(at[0] - x) < 200), None)
    h.check(first and x - first[0] > 120, f"the mouse lies beside the first button: {first}, {x}")
    yield from h.click(first[0], first[1] + hands.LIST_ROW)  # Show Report
    yield 2.0
    h.check(len(bpy.context.window_manager.windows) == windows + 1, "Show Report opens a window")
    text = bpy.context.window_manager.windows[-1].screen.areas[0].spaces.active.text.as_string()
    h.check("Wrote" in text or "wrote" in text, "with the report")


def rows() -> list[Any]:
    return list(bpy.context.window_manager.hfx_rows)


def selected() -> list[str]:
    return sorted(obj.name for obj in bpy.context.selected_objects)


def row_at(h: Any, row: int) -> Iterator[float]:
    """Place of the name in a row of the list."""
    x, y = yield from hands.icon(h, row, 0)
    return x - 100, y


def list_menu(h: Any) -> Iterator[float]:
    """Open the menu below the minus beside the list."""
    x, y = yield from h.button(h.region("UI"), bpy.types.HFX_OT_remove_effects)
    yield from h.click(x, y + hands.LIST_ROW)
    yield 0.8


def browser(h: Any) -> bpy.types.Area | None:
    areas = h.window.screen.areas
    return next((area for area in areas if area.type == "FILE_BROWSER"), None)
