# SPDX-License-Identifier: GPL-3.0-or-later
"""A technical artist lets a plane be felt as corduroy, and strokes it with the mouse."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.mesh.primitive_plane_add(size=0.2)
    plane = bpy.context.object
    plane.hfx.surface.resolution = 128
    h.undo_push()
    yield from h.move(*h.xy(h.region(), 0.5, 0.5))
    yield from h.key("KP_7", "KP_Decimal")
    yield 1.0
    with h.context():
        # A material's own picture would be rendered by EEVEE: minutes without a graphics card.
        bpy.ops.hfx.add_surface(source="PROCEDURAL", procedural="fabric-corduroy")
    yield 1.0
    settings = bpy.context.object.hfx.surface
    h.check(settings.relief_image is not None and not settings.is_faulty, "its maps are made")
    h.shot("2_panel.png")
    h.document("surface_panel.png", left=0.78)

    before = settings.layers_of
    settings.blur_mm = 0.4
    yield from h.until(lambda: settings.layers_of not in ("", before), "the map follows", 10)

    yield from h.press_button("HFX_OT_bake_surface")
    yield 0.5
    h.check(not settings.is_faulty, "Make Maps makes them again")
    yield from h.press_button("HFX_OT_stroke_pad")
    yield 0.5
    region = h.region()
    view, pad = hands.module("ui.stroke_pad_view"), hands.module("operators.stroke_pad")
    place = view.PadPlace(region.width, region.height)
    low = h.window.height - (region.y + place.bottom)
    x = region.x + place.left + place.side / 2
    way = [(x, low - 20 - 24 * k) for k in range((place.side - 40) // 24)]  # across the ribs
    yield from stroke(h, way)
    h.check(pad.last_take is not None, "a stroke was taken")
    h.check(pad.last_take.signal.amplitude_m_s2.max() > 0.0, "and it was felt")
    yield from h.key("2")
    yield from stroke(h, way[::-1])
    yield 0.5
    h.shot("4_pad.png")
    yield from h.key("Escape")
    yield 0.5
    h.shot("5_closed.png")
    yield from h.move(*h.xy(h.region(), 0.5, 0.5))
    yield from h.key("ctrl+z", "ctrl+z")
    yield 0.5
    h.check(True, "undo does no harm")


def stroke(h: Any, way: list[tuple[float, float]]) -> Iterator[float]:
    """Drag along a way, with a picture on it."""
    yield from h.move(*way[0])
    yield from h.input.press(1)
    for number, point in enumerate(way[1:]):
        yield 0.01
        yield from h.input.move(*point)
        if number == 2 * len(way) // 3:
            h.shot("3_stroke.png")
            h.document("surface_pad.png", left=0.0)
    yield from h.input.release(1)
    yield 0.3
