# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of an NLA Editor, found by the strips that Blender has drawn."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.playback.timeline import nla_rows

# 400 pixels wide, 4 pixels a frame, from frame -10 on.
REGION = SimpleNamespace(
    width=400,
    view2d=SimpleNamespace(view_to_region=lambda frame, y, clip: (4.0 * (frame + 10.0), y)),
)


@pytest.fixture
def effect(scene: Any) -> Any:
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", name="Ball")
    effect = bpy.context.object
    clips.add_clip(effect, 10, 20)  # pixels 80 to 120
    clips.add_clip(effect, 40, 60)  # pixels 200 to 280
    return effect


def row(*filled: tuple[int, int]) -> np.ndarray:
    pixels = np.zeros(400, bool)
    for left, right in filled:
        pixels[left:right] = True
    return pixels


def test_a_row_is_known_by_all_strips_of_the_track(effect: Any) -> None:
    mask = nla_rows.strip_mask(REGION, effect.animation_data.nla_tracks[0])
    assert nla_rows.fits(row((80, 120), (200, 280)), mask)
    assert nla_rows.fits(row((78, 121), (202, 281)), mask), "borders of strips"
    assert nla_rows.fits(row((80, 90), (92, 120), (200, 280)), mask), "a mark in a strip"
    assert not nla_rows.fits(row((80, 120)), mask), "a strip is missing"
    assert not nla_rows.fits(row((80, 120), (200, 280), (300, 310)), mask), "a strip more"
    assert not nla_rows.fits(row((80, 120), (200, 300)), mask), "a longer strip"
    assert not nla_rows.fits(row(), mask)


def test_strips_out_of_view_fit_no_row(effect: Any) -> None:
    for _, strip in clips.strips_of(effect)[::-1]:
        strip.frame_start_ui += 200
    mask = nla_rows.strip_mask(REGION, effect.animation_data.nla_tracks[0])
    assert not nla_rows.fits(row(), mask)


def test_tracks_are_in_the_order_of_the_editor(effect: Any) -> None:
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE", name="air")
    air = bpy.context.object
    clips.add_clip(air, 10, 20)
    clips.add_clip(air, 15, 25)  # needs a second track, shown above the first
    filters = SimpleNamespace(
        show_only_selected=False,
        show_hidden=False,
        use_datablock_sort=True,
        show_missing_nla=False,
    )
    editor = SimpleNamespace(dopesheet=filters)
    context = SimpleNamespace(view_layer=bpy.context.view_layer, space_data=editor)
    pairs, blocks = nla_rows._channels(context)
    shown = [(e.name, t.strips[0].frame_start) for e, t in pairs]
    assert shown == [("air", 15.0), ("air", 10.0), ("Ball", 10.0)]
    assert blocks == [("air", [0, 1]), ("Ball", [2])]
    filters.show_missing_nla = True  # adds a row for the missing action of each object
    assert nla_rows._channels(context)[1] == [("air", [-1, 0, 1]), ("Ball", [-1, 2])]
    filters.show_only_selected = True
    assert nla_rows._channels(context)[1] == [("air", [-1, 0, 1])]
