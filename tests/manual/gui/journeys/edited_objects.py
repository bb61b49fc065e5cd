# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's own edits of a volume and of the avatar's skin: Apply Scale, and a moved skin."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE")
    volume = bpy.context.object
    volume.hfx.radius, volume.location, volume.scale = 0.3, (0.0, -0.2, 1.1), (0.5,) * 3
    h.undo_push()
    yield 2.0
    h.shot("1_scaled.png")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+a")
    yield 1.0
    yield from h.key("s")
    yield from h.until(lambda: tuple(bpy.context.object.scale) == (1.0,) * 3, "applied", 10)
    yield 2.0
    h.shot("2_applied.png")
    corner = bpy.context.object.bound_box[6]
    h.check(abs(corner[0] - 0.3) < 1e-3, f"the wire shows the radius that is felt: {corner[0]} m")
    yield from h.key("ctrl+z")
    yield 1.5
    h.check(abs(bpy.context.object.scale[0] - 0.5) < 1e-6, "one undo brings the scale back")

    body = next(obj for obj in bpy.data.objects if obj.hfx.role == "BODY")
    body.hfx.avatar.location.x = 1.0
    bpy.context.view_layer.objects.active = body.hfx.avatar
    h.undo_push()
    yield 3.0
    pixels = h.shot("3_moved_skin.png")
    x, y = (round(place) for place in h.xy_of((1.0, -0.1, 1.1)))
    red, green, _ = pixels[y, x].astype(int)
    h.check(abs(red - green) < 20, f"nothing is felt a metre from the volume: {red}, {green}")
