# SPDX-License-Identifier: GPL-3.0-or-later
"""A technical artist makes a plane feel like corduroy, and strokes the plane with the mouse."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import bpy
import hands

PLOTS = ("height", "amplitude", "frequency", "waveform")
LEVELS = ("amplitude", "frequency")


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
    yield 2.5
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
    h.show_files_inside()
    yield from h.press_button("HFX_OT_stroke_pad")
    yield 0.5
    region = h.region()
    view, pad = (
        hands.module("operators.surfaces.stroke_pad_view"),
        hands.module("operators.surfaces.stroke_pad_operators"),
    )
    pad_place = view.PadPlace(region.width, region.height)
    low = h.window.height - (region.y + pad_place.bottom)
    x = region.x + pad_place.left + pad_place.side / 2
    way = [(x, low - 20 - 8 * k) for k in range((pad_place.side - 40) // 8)]  # across the ribs
    yield from stroke(h, way, "3_stroke.png")
    yield from h.until(lambda: pad.last_take is not None, "a stroke was taken", 20)
    slow = pad.last_take
    check_felt(h, slow)
    length = slow.stroke.length_m
    expected = (len(way) - 1) * 8 / 200 * 0.02
    h.check(abs(length / expected - 1) < 0.05, f"{1000 * length:.1f} mm at 2 cm/s for 200 px/s")
    yield from h.key("2")
    yield from stroke(h, way[::-1], "4_pad.png")
    yield from h.until(lambda: pad.last_take is not slow, "another one, at 10 cm/s", 20)
    check_felt(h, pad.last_take)
    h.check(
        abs(pad.last_take.stroke.length_m / (5 * expected) - 1) < 0.05,
        "the same way of the mouse is five times as long",
    )

    yield from h.key("e")
    written = h.out / "stroke.ahap"
    yield from h.save_as(written)
    yield from h.until(written.exists, "E writes the stroke", 30)
    yield from h.move(*h.xy(h.region(), 0.5, 0.5))
    yield from h.key("Escape")
    yield 0.5
    h.shot("5_closed.png")
    h.check(
        not any(op.bl_idname == "HFX_OT_stroke_pad" for op in h.window.modal_operators),
        "Escape closes the pad",
    )
    yield from h.key("ctrl+z", "ctrl+z")
    yield 0.5
    h.check(True, "undo does no harm")


def check_felt(h: Any, take: Any) -> None:
    """Ribs across the way: felt nearly all the way, and not evenly."""
    amplitude, frequency = take.signal.amplitude_m_s2, take.signal.frequency_hz
    moving = take.stroke.speed_at(take.signal.times_s + take.signal.step_s / 2) > 1e-3
    share = float((amplitude[moving] > 0.0).mean())
    h.check(share > 0.9, f"it is felt while it moves ({share:.0%} of {moving.sum()} steps)")
    samples = amplitude > 0.0
    h.check(amplitude[samples].std() > 0.0, f"amplitude up to {amplitude.max():.2f} m/s2")
    h.check((frequency[samples] >= 50.0).all(), f"frequency up to {frequency.max():.0f} Hz")


def stroke(h: Any, way: list[tuple[float, float]], shot: str) -> Iterator[float]:
    """Drag along a way at 200 pixels a second; a picture while the mouse still moves."""
    seconds = len(way) * 8 / 200
    pixels = None
    yield from h.move(*way[0])
    yield from h.input.press(1)
    begin = time.monotonic()
    for pause in h.input.glide(way[1:], seconds):
        if pixels is None and time.monotonic() - begin > 0.6 * seconds:
            pixels = h.shot(shot)
            h.document("surface_pad.png", left=0.0)
        yield pause
    yield from h.input.release(1)
    yield 0.3
    h.check(pixels is not None, "a picture was taken on the way")
    for row, name in enumerate(PLOTS):
        up, down = reach(h, pixels, row)
        if name in LEVELS:  # from zero at the plot's lower edge; the curve may be even
            h.check(up > 5, f"the plot of the {name} reaches {up} pixels up")
        else:
            h.check(up - down > 20, f"the plot of the {name} goes over {up - down} pixels")


def reach(h: Any, pixels: Any, row: int) -> tuple[int, int]:
    """Highest and lowest pixel of a curve, from the plot's lower edge."""
    region = h.region()
    view = hands.module("operators.surfaces.stroke_pad_view")
    pad_place = view.PadPlace(region.width, region.height)
    wide, high = view.PLOT_PX
    left = region.x + pad_place.left + pad_place.side + 16
    low = pad_place.bottom + (len(PLOTS) - 1 - row) * (high + 26)
    top = h.window.height - (region.y + low + high)
    part = pixels[top : top + high, left : left + wide].astype(int)
    red, green, blue = part[..., 0], part[..., 1], part[..., 2]
    orange = (red > 150) & (red > green + 50) & (green > blue + 20)
    rows = orange.any(axis=1).nonzero()[0]
    return (int(high - rows[0]), int(high - rows[-1])) if len(rows) else (0, 0)
