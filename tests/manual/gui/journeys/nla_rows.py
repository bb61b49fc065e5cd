# SPDX-License-Identifier: GPL-3.0-or-later
"""Strips of effects in the NLA Editor have colour and envelope at each resolution scale, below
folded effects, and with rows out of view."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

CLIPS = {"vibration": 10.0, "pressure": 10.0, "temperature": 40.0, "wind": 70.0}  # start frames


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    bpy.context.scene.frame_end = 120
    with h.context():
        bpy.ops.hfx.add_avatar()
        for modality, start in CLIPS.items():
            bpy.ops.hfx.add_volume(modality=modality, shape="SPHERE", name=modality.title())
            bpy.ops.hfx.add_clip(start=start, duration=1.0, fade_in=0.5)
    area = h.area()
    area.ui_type = "NLA_EDITOR"
    yield 1.0
    area.spaces.active.show_region_ui = False
    region = next(region for region in area.regions if region.type == "WINDOW")
    nla_rows = hands.module("playback.timeline.nla_rows")
    finding, drawn = nla_rows.rows_of_tracks, []

    def recorded(context: bpy.types.Context) -> list[Any]:
        drawn[:] = list(finding(context))
        return drawn

    nla_rows.rows_of_tracks = recorded
    view = bpy.context.preferences.view
    faults = []
    try:
        for scale in (1.0, 1.25, 1.5, 2.0):
            view.ui_scale = scale
            yield 1.0
            with bpy.context.temp_override(window=h.window, area=area, region=region):
                bpy.ops.nla.view_all()
            yield 1.0
            h.shot(f"scale_{scale:g}.png")
            names = [effect.name for effect, *_ in drawn]
            expected = sorted(modality.title() for modality in CLIPS)
            least = min(fitting(region, scale), len(expected))
            if len(names) < least or names != expected[: len(names)]:
                faults.append(f"{scale:g}: {names}")
        view.ui_scale = 1.0
        with h.context("NLA_EDITOR"):
            for number in range(40):  # more rows than fit, in Blender's order of numbers
                bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE", name=f"A {number}")
                bpy.ops.hfx.add_clip(start=10.0, duration=1.0)
        yield 2.0
        h.shot("many.png")
        names = [effect.name for effect, *_ in drawn]
        expected = [f"A {number}" for number in range(40)][: len(names)]
        if len(names) < fitting(region) or names != expected:
            faults.append(f"cut off: {names}")
        with bpy.context.temp_override(window=h.window, area=area, region=region):
            bpy.ops.view2d.pan(deltax=0, deltay=-200)
        yield 1.0
        h.shot("scrolled.png")
        first = drawn[0][0].name if drawn else ""
        if first != "A 2":  # three rows of 27 pixels each
            faults.append(f"scrolled: {first}")
        with bpy.context.temp_override(window=h.window, area=area, region=region):
            bpy.ops.view2d.pan(deltax=0, deltay=200)
            bpy.ops.anim.channels_collapse(all=True)
        yield 1.0
        h.shot("folded.png")
        if drawn:
            faults.append(f"folded: {[effect.name for effect, *_ in drawn]}")
    finally:
        nla_rows.rows_of_tracks = finding
        view.ui_scale = 1.0
    yield 1.0
    h.check(not faults, f"every strip has its colour at each scale {faults}")


def fitting(region: bpy.types.Region, scale: float = 1.0) -> int:
    """Number of effects whose strips fit below the ruler: three rows of 27 pixels each."""
    return int(region.height / (3 * 27 * scale)) - 1
