# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose an installed set of body models: an area moves to it, and one Undo takes all back.

Needs a folder of sets (see ``hfx body build --install``): ``--arg=FOLDER``. Without a folder
nothing is checked.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    if not h.args:
        h.check(True, "no folder of sets is given")
        return
    os.environ["HFX_BODY_MODELS"] = h.args[0]
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.add_painted(modality="pressure")
        bpy.ops.hfx.fill_part(part="torso", side="both")
    painted = len(hands.effect("pressure")["hfx_vertices"])
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    body().select_set(True)
    bpy.context.view_layer.objects.active = body()
    h.undo_push()
    yield 1.5
    h.shot("1_body.png")
    *_, models, _add_device = yield from h.choices(h.region("UI"))
    yield from h.click(*models)
    yield 1.0
    h.shot("2_menu.png")
    _default, *sets = yield from h.menu_rows()
    h.check(sets, "the menu has the installed set")
    yield from h.click(*sets[0])
    yield from h.until(lambda: body().hfx.body_models, "the set is chosen", 120)
    yield 1.5
    h.shot("3_chosen.png")
    ids = body().hfx.body_models.split()
    h.check(hands.effect("pressure").hfx.model_id in ids, "the effect is felt on the set")
    moved = len(hands.effect("pressure")["hfx_vertices"])
    h.check(0 < moved != painted, f"its area moved from {painted} to {moved} vertices")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield from h.until(lambda: not body().hfx.body_models, "Ctrl+Z restores the models", 20)
    again = len(hands.effect("pressure")["hfx_vertices"])
    h.check(again == painted, "and the area")
    yield 1.0
    h.shot("4_undone.png")


def body() -> bpy.types.Object:
    """The scene's body; call again after each undo."""
    return next(obj for obj in bpy.data.objects if obj.hfx.role == "BODY")
