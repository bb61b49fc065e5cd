# SPDX-License-Identifier: GPL-3.0-or-later
"""The HFX workspace out of the Window menu; the context menu of an effect; copy and paste."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

WINDOW_MENU = (184, 13)  # in the top bar
PASTE_ROW = -1  # of Add > Haptic
FPS = 24


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    yield from hands.add_avatar(h)
    yield from hands.add_haptic(h, hands.PAINTED_ROW, hands.MODALITIES.index("pressure"))
    yield from hands.fill_part(h, (1, 0))

    if bpy.context.object.mode != "OBJECT":
        yield from h.press_button("HFX_OT_paint_end")
        yield 0.8
    yield from h.click(*WINDOW_MENU)
    yield 0.6
    rows = yield from h.menu()
    h.shot("1_window_menu.png")
    yield from h.click(*rows[-1])
    yield from h.until(lambda: h.window.workspace.name == "HFX", "the workspace is shown", 20)
    yield from h.until(lambda: tab(h) == "HFX", "the HFX tab is open", 60)
    yield 0.5
    kinds = {area.type for area in h.window.screen.areas}
    shown = {"VIEW_3D", "NLA_EDITOR", "DOPESHEET_EDITOR", "FILE_BROWSER"}
    h.check(kinds == shown, f"viewport, clips, timeline and sensations: {sorted(kinds)}")
    viewport, editor = h.area(), h.area("NLA_EDITOR")
    h.check(editor.x + editor.width <= viewport.x + 4, "the clips are left of the viewport")
    h.check(viewport.height > 0.75 * h.window.height, "the viewport is high")
    h.check(h.region("UI").width > 150, "with the tab")
    yield from h.press_button("HFX_OT_add_clip")
    yield 0.5
    h.shot("2_workspace.png")
    yield from h.button(h.region("UI"), bpy.types.HFX_OT_paint_begin)
    _, y = yield from h.button(h.region("UI"), bpy.types.HFX_OT_add_clip)
    fields = yield from h.fields(h.region("UI"))
    h.check(sum(field[1] > y for field in fields) >= 2, "the clip's start and end are in view")
    yield from h.button(h.region("UI"), bpy.types.HFX_OT_export)
    region = h.region("WINDOW", "DOPESHEET_EDITOR")
    timeline_clips = hands.module("playback.timeline.timeline_clips")
    row = timeline_clips._MOST_ROW
    h.check(region.height >= timeline_clips._RULER + 5 * row, "five rows fit into the timeline")
    params = h.area("FILE_BROWSER").spaces.active.params
    h.check(params.asset_library_reference == "HFX Haptics", "the sensations are in view")

    effect = hands.effect("pressure")
    yield from h.move(*h.xy(h.region(), 0.3, 0.4))
    yield from h.click(*h.xy(h.region(), 0.3, 0.4), button=3)
    yield 0.6
    rows = yield from h.menu()
    entries = yield from h.submenu(rows[-1])
    h.shot("3_context_menu.png")
    copy = entries[-4]  # before Save Effects, Copy Address and Paste Effects
    yield from h.click(*copy)
    yield 0.6
    copied = bpy.context.window_manager.clipboard
    h.check('"hfx-effects"' in copied, "Copy Effects fills the clipboard")

    yield from hands.add_haptic(h, hands.AVATAR_ROW)
    second = bpy.context.object
    h.check(second.hfx.role == "BODY", "a second avatar is there")
    yield from hands.add_haptic(h, PASTE_ROW)
    pasted = bpy.context.object
    h.check(pasted.hfx.body == second, "Paste Effects puts them on the active body")
    h.check(len(hands.clips_of(pasted)) == 1, "with their clips")
    h.check(len(pasted["hfx_vertices"]) == len(effect["hfx_vertices"]), "and their area")
    h.shot("4_pasted.png")
    yield from h.move(*h.xy(h.region(), 0.3, 0.4))
    yield from h.key("ctrl+z")
    yield 0.8
    objects = [obj for obj in bpy.data.objects if obj.hfx.role == "EFFECT"]
    h.check(len(objects) == 1, "one Ctrl+Z takes them back")

    bpy.ops.screen.userpref_show("INVOKE_DEFAULT", section="ADDONS")
    yield 1.5
    window = bpy.context.window_manager.windows[-1]
    bpy.context.window_manager.addon_search = "HFX"
    module = bpy.types.HFX_OT_paint_begin.__module__.rpartition(".operators")[0]
    with bpy.context.temp_override(window=window, area=window.screen.areas[0]):
        bpy.ops.preferences.addon_expand(module=module)
    for area in window.screen.areas:
        area.tag_redraw()
    yield 1.0
    h.shot("5_preferences.png")


def tab(h: Any) -> str:
    """Tab of the viewport's sidebar; none while areas are arranged, and before the first drawing of
    the sidebar."""
    try:
        return str(h.region("UI").active_panel_category)
    except (AttributeError, ValueError):  # ValueError: no area is a viewport yet
        return ""
