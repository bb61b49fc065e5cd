# SPDX-License-Identifier: GPL-3.0-or-later
"""A linked effect is greyed out in list and panels, until *Make Editable*."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    path = h.out / "touch.blend"
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.add_painted(modality="pressure", name="Touch")
        bpy.ops.hfx.fill_part(part="chest")
        bpy.ops.hfx.add_clip(start=5.0)
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
        bpy.ops.hfx.remove_effects()
        collection = bpy.data.collections["HFX Effects"]
        bpy.data.collections.remove(collection)
        with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
            wanted.collections = ["HFX Effects"]
        bpy.context.scene.collection.children.link(wanted.collections[0])
        linked = next(iter(wanted.collections[0].objects))
        bpy.context.view_layer.objects.active = linked
        linked.select_set(True)
    h.undo_push()
    rows = bpy.context.window_manager.hfx_rows
    yield from h.until(lambda: [row.effect for row in rows] == ["Touch"], "the list shows it", 20)
    yield 1.0
    h.shot("1_linked.png")
    yield from h.click(*(yield from hands.icon(h, 0, 1)))
    yield 0.5
    h.check(not linked.hfx.is_muted, "the loudspeaker of a linked effect is greyed out")
    yield from h.press_button("HFX_OT_make_editable")
    yield 1.0
    ours = bpy.context.object
    h.check(ours.library is None, "Make Editable replaces it by an override")
    h.shot("2_editable.png")
    yield from h.click(*(yield from hands.icon(h, 0, 1)))
    yield 0.5
    h.check(ours.hfx.is_muted, "which can be muted")
    paint = bpy.types.HFX_OT_paint_begin
    requires, paint.requires = paint.requires, ()  # a greyed button is not found
    x, y = yield from h.button(h.region("UI"), paint)
    paint.requires = requires
    yield from h.move(x, y)
    yield 2.0
    h.shot("3_why_greyed.png")
    h.check(not bpy.ops.hfx.paint_begin.poll(), "but not painted")
