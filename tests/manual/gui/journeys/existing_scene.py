# SPDX-License-Identifier: GPL-3.0-or-later
"""An existing scene: painting begins in Edit Mode of the avatar; the HFX workspace frames body and
short clips, also as part of a start-up file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

WINDOW_MENU = (184, 13)  # in the top bar
SIDE_VIEW = "KP_3"


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE")
        bpy.ops.hfx.add_clip(start=10.0, duration=0.02)  # half a frame
        wind = bpy.context.object
    skin = next(obj for obj in bpy.data.objects if obj.type == "MESH" and obj.parent)
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    skin.select_set(True)
    bpy.context.view_layer.objects.active = skin
    h.undo_push()
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("Tab")
    yield from h.until(lambda: bpy.context.mode == "EDIT_MESH", "the skin is in Edit Mode", 30)
    yield 1.0
    h.shot("1_edit_mode.png")
    with h.context():
        bpy.ops.hfx.add_painted("INVOKE_DEFAULT", modality="pressure", paint=True)
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting begins", 60)
    painted = hands.effect("pressure").name
    yield from h.until(lambda: painted in rows(), f"the list shows '{painted}'", 10)
    yield 1.5
    h.shot("2_painting.png")
    yield from h.press_button("HFX_OT_paint_end")
    yield from h.until(lambda: bpy.context.mode == "OBJECT", "painting has ended", 60)

    with h.context():
        bpy.ops.hfx.remove_effects()
        bpy.context.view_layer.objects.active = wind
        wind.select_set(True)
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key(SIDE_VIEW)
    yield 1.0
    yield from h.click(*WINDOW_MENU)
    yield 0.8
    menu = yield from h.menu()
    h.shot("3_window_menu.png")
    yield from h.click(*menu[-1])
    yield from h.until(lambda: h.window.workspace.name == "HFX", "the workspace is shown", 30)
    h.shot("4_arranging.png")
    kinds = lambda: {area.type for area in h.window.screen.areas}  # noqa: E731
    yield from h.until(lambda: {"VIEW_3D", "NLA_EDITOR"} <= kinds(), "the areas are arranged", 60)
    yield from h.until(lambda: h.region("UI").width > 150, "the sidebar is open", 60)
    yield 3.0
    h.shot("5_workspace.png")
    h.check(is_from_the_front(h), "the body is seen from the front")
    region = h.region("WINDOW", "NLA_EDITOR")
    first, last = (region.view2d.region_to_view(x, 0)[0] for x in (0, region.width))
    h.check(first < 10 and last > 10.5, f"the clip is in view: frames {first:.1f} to {last:.1f}")
    h.check(last - first > 20, "with the ruler's numbers")

    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key(SIDE_VIEW)
    yield 1.0
    h.check(not is_from_the_front(h), "a start-up file with the HFX workspace, seen from the side")
    with h.context():
        bpy.ops.wm.save_homefile()
        bpy.ops.hfx.new_file()
    bodies = lambda: [obj for obj in bpy.data.objects if obj.hfx.role == "BODY"]  # noqa: E731
    yield from h.until(bodies, "New > Haptics adds the avatar", 60)
    yield from h.until(lambda: is_from_the_front(h), "and shows the avatar from the front", 20)
    yield 1.0
    h.shot("6_new_file.png")


def is_from_the_front(h: Any) -> bool:
    turn = h.area().spaces.active.region_3d.view_rotation
    expected = hands.module("operators.workspace")._FROM_THE_FRONT
    return bool(turn.rotation_difference(expected).angle < 0.01)


def rows() -> list[str]:
    return [row.name for row in bpy.context.window_manager.hfx_rows]
