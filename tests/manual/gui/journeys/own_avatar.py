# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's own avatar becomes a haptic body with one click; scipy comes from the extension."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import bpy


def steps(h: Any) -> Iterator[float]:
    for name in ("Cube", "Light", "Camera"):
        bpy.data.objects.remove(bpy.data.objects[name])
    with h.context():
        bpy.ops.hfx.add_avatar()
    rig = bpy.context.object
    rig.hfx.role, rig.hfx.avatar = "NONE", None  # now like any character without a haptic body
    rig.name = "Anna"
    rig.scale = 1.08, 1.08, 1.12  # and taller
    for obj in bpy.data.objects:
        obj.select_set(True)
    with h.context():
        bpy.ops.object.transform_apply(scale=True)
        bpy.ops.view3d.view_selected()
    for obj in bpy.data.objects:
        obj.select_set(obj == rig)
    bpy.context.view_layer.objects.active = rig
    h.undo_push()
    yield from h.sidebar("HFX")
    h.shot("1_before.png")

    buttons = yield from h.op_buttons(h.region("UI"))
    labels = [f"({x:.0f}, {y:.0f})" for x, y in buttons]
    h.check(buttons, f"buttons at {', '.join(labels)}")
    yield from h.click(*buttons[0])
    yield from h.until(lambda: rig.hfx.role == "BODY", "Anna is a haptic body", 120)
    yield 0.5
    h.shot("2_after.png")

    h.check("scipy" in sys.modules, "the models were fitted with scipy")
    import scipy

    where = bpy.utils.user_resource("EXTENSIONS")
    h.check(scipy.__file__.startswith(where), f"scipy {scipy.__version__} is the extension's own")
