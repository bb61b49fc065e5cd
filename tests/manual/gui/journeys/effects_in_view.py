# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects in the viewport: the wind's arrow and handle, dimmed volumes, wires, the legend."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands
import numpy as np

FPS = 24
FROM_MESH_ROW = 5  # of Add > Haptic


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    yield from hands.add_avatar(h)
    yield from hands.zoom_out(h, 3)
    palette = bpy.context.scene.hfx.palette
    h.check(palette == "WARM_COLD", "Warm and Cold are the colours of a new scene")

    wind = hands.MODALITIES.index("wind")
    yield from hands.add_haptic(h, hands.VOLUME_ROW + hands.SHAPES.index("CUBOID"), wind)
    h.shot("1_wind.png")
    tip = (0.0, 0.0, 0.5 * 1.25)  # a box of 1 m at the origin
    pixels = h.shot("2_arrow.png")
    x, y = (round(item) for item in h.xy_of((0.0, 0.0, 0.58)))
    colours = pixels[y - 2 : y + 3, x - 12 : x + 13].reshape(-1, 3).astype(int)
    h.check((colours[:, 2] - colours[:, 0]).max() > 40, "the wind's arrow is drawn")
    here, side = h.xy_of(tip), h.xy_of((0.6, 0.0, 0.0))
    yield from h.drag([here, *(np.linspace(here, side, 8)[1:].tolist())], step=0.05)
    yield 0.5
    blows = hands.effect("wind").matrix_world.col[2].to_3d().normalized()
    h.check(blows.x > 0.99, f"its handle turns the wind {tuple(round(v, 2) for v in blows)}")
    h.shot("3_turned.png")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 0.8
    blows = hands.effect("wind").matrix_world.col[2].to_3d().normalized()
    h.check(blows.z > 0.99, "one Ctrl+Z turns it back")

    corner = (-0.35, -0.5, 0.5)  # on an edge of the box
    h.shot("4_on.png")
    bright = wire_light(h, corner)
    yield from hands.go_to(h, 48)
    yield from h.press_button("HFX_OT_add_clip")
    yield from hands.go_to(h, 12)
    yield 0.5
    h.shot("5_off.png")
    dim = wire_light(h, corner)
    h.check(dim < 0.7 * bright, f"outside of its clip the volume is dimmed: {bright} to {dim}")
    yield from hands.go_to(h, 49)
    yield 0.5
    h.check(wire_light(h, corner) > 1.4 * dim, "and not within the clip")

    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.4, location=(0.0, 0.0, 1.2))
    source, name = bpy.context.object, bpy.context.object.name
    h.undo_push()
    warmth = hands.MODALITIES.index("temperature")
    yield from hands.add_haptic(h, FROM_MESH_ROW, warmth)
    h.check(bpy.context.object.parent == source, "a volume from the selected mesh")
    h.check(source.display_type == "WIRE", "the mesh is shown as a wire")
    yield 0.8
    pixels = h.shot("6_from_mesh.png")
    red, _, blue = hands.tint(pixels, h.xy_of((0.03, -0.1, 1.3)), 5)
    h.check(red > 1.2 * blue, "30 degrees are a warm colour")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 0.8
    shape = bpy.data.objects[name].display_type
    h.check(shape == "TEXTURED", "Ctrl+Z shows the mesh as before")


def wire_light(h: Any, place: tuple[float, float, float]) -> int:
    """Light of the wire around a place of the scene: largest channels above the background, summed,
    as a smoothed line may lie on one row of pixels or between two."""
    pixels = h.shot("wire.png")
    x, y = (round(item) for item in h.xy_of(place))
    around = pixels[y - 4 : y + 5, x - 4 : x + 5].max(axis=2).astype(int)
    return int((around - np.median(around)).clip(0).sum())
