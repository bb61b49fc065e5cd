# SPDX-License-Identifier: GPL-3.0-or-later
"""Shift+A > Haptic: an avatar and a sphere; the export from the HFX tab."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    h.show_files_inside()
    for name in ("Cube", "Light", "Camera"):
        bpy.data.objects.remove(bpy.data.objects[name])
    h.undo_push()
    yield from h.sidebar("HFX")
    h.shot("1_empty_scene.png")

    yield from hands.add_haptic(h, hands.AVATAR_ROW, shot="2_add_haptic.png")
    h.check(bpy.context.object and bpy.context.object.hfx.role == "BODY", "an avatar is added")
    with h.context():
        bpy.ops.view3d.view_selected()
    yield 0.8
    h.shot("3_avatar.png")

    yield from hands.add_haptic(
        h, hands.VOLUME_ROW + hands.SHAPES.index("SPHERE"), 0, shot="4_add_sphere.png"
    )
    effect = bpy.context.object.hfx
    h.check(effect.role == "EFFECT" and effect.shape == "SPHERE", "a sphere is added")
    h.shot("5_sphere.png")

    bpy.context.scene.frame_end = 5  # a short recording
    position = yield from h.button(h.region("UI"), bpy.types.HFX_OT_export)
    below = h.window.height - h.region("UI").y - position[1]
    h.check(
        below > 12, f"Export Haptics is seen without scrolling, {below:.0f} pixels above the end"
    )
    yield from h.click(*position)
    yield 1.0
    h.shot("6_file_browser.png")
    track = h.out / "first.hfxtrack"
    yield from h.save_as(track)
    yield from h.until(track.exists, "the track is written", 120)
    yield 0.5
    h.shot("7_exported.png")
    yield from h.key("Escape")  # the popup of the export takes every key

    for _ in range(2):
        yield from h.key("ctrl+z")
        yield 0.3
    h.check(effect_names() == [], "Ctrl+Z takes the sphere back")


def effect_names() -> list[str]:
    return [obj.name for obj in bpy.data.objects if obj.hfx.role == "EFFECT"]
