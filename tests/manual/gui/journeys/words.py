# SPDX-License-Identifier: GPL-3.0-or-later
"""A designer makes materials from words, removes a material, takes a second, and strokes it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

PLACE = 1  # of the panel: below the effects
# Pixels from the right edge of the sidebar; the X is too small to be searched for.
CANCEL_BESIDE = 49


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.mesh.primitive_plane_add(size=0.2)
    plane = bpy.context.object
    hfx_generation = bpy.context.window_manager.hfx_generation
    hfx_generation.words, hfx_generation.resolution = "worn red corduroy", 128
    module = hands.module("operators.surfaces.generation_operators")
    h.undo_push()
    yield from h.move(*h.xy(h.region(), 0.5, 0.5))
    yield from h.key("KP_7", "KP_Decimal")
    yield from h.sidebar("HFX")
    yield 1.0
    headers = yield from h.panels(h.region("UI"))
    yield from h.click(*headers[PLACE])
    yield 0.5
    h.shot("1_panel.png")
    yield from h.press_button("HFX_OT_generate_surface")
    yield from h.until(lambda: module.results, "materials are made", 120)
    yield 1.0
    plane = bpy.context.object
    h.check(len(module.results) == 4 and module.running is None, "there are four variations")
    h.check(plane.hfx.surface.source == "GENERATED", "the first is felt on the plane")
    yield from h.move(*h.xy(h.region(), 0.3, 0.5))  # no mouse in the picture
    yield 0.5
    h.shot("2_previews.png")
    h.document("generation_panel.png", left=0.78)
    first = plane.active_material.name
    yield from h.press_button("HFX_OT_use_generated", which=2)
    yield 1.0
    h.check(bpy.context.object.active_material.name != first, "another one is chosen")
    yield from h.move(*h.xy(h.region(), 0.5, 0.5))
    yield from h.key("ctrl+z")
    yield 1.0
    plane = bpy.context.object
    h.check(plane.active_material.name == first, "undo brings the first back")
    yield from h.key("ctrl+z")
    yield 1.0
    plane = bpy.context.object
    h.check(plane.active_material is None and plane.hfx.role == "NONE", "and then takes it away")
    yield from h.key("ctrl+shift+z")
    yield 1.0
    h.check(bpy.context.object.hfx.surface.source == "GENERATED", "redo gives it again")

    hfx_generation.resolution, hfx_generation.variations = 2048, 8
    _, height = yield from h.button(h.region("UI"), bpy.types.HFX_OT_generate_surface)
    yield from h.press_button("HFX_OT_generate_surface")
    yield 0.5
    h.check(module.running is not None, "more are being made")
    h.shot("3_progress.png")
    region = h.region("UI")
    yield from h.click(region.x + region.width - CANCEL_BESIDE, height)
    yield from h.until(lambda: module.running is None, "until they are cancelled", 10)
    h.check(len(module.results) == 4, "the earlier ones are still there")

    yield from h.press_button("HFX_OT_stroke_pad")
    yield 0.5
    h.shot("4_pad.png")
    pad = h.region()
    yield from h.drag([h.xy(pad, 0.3 + 0.02 * step, 0.5) for step in range(20)], step=0.1)
    h.shot("5_stroked.png")
    yield from h.key("Escape")
