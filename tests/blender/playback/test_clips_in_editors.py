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


STRIP, EMPTY = 13, 48  # colours of Blender's dark theme


def row(*filled: tuple[int, int], colour: int = STRIP) -> np.ndarray:
    pixels = np.full((400, 1), EMPTY, np.int32)
    for left, right in filled:
        pixels[left:right] = colour
    return pixels


def test_a_row_is_known_by_all_strips_of_the_track(effect: Any) -> None:
    mask, gap = nla_rows.strip_mask(REGION, effect.animation_data.nla_tracks[0]), row()
    assert nla_rows.fits(row((80, 120), (200, 280)), gap, mask)
    assert nla_rows.fits(row((78, 121), (202, 281)), gap, mask), "borders of strips"
    assert nla_rows.fits(row((80, 90), (92, 120), (200, 280)), gap, mask), "a mark in a strip"
    assert not nla_rows.fits(row((80, 120)), gap, mask), "a strip is missing"
    assert not nla_rows.fits(row((80, 120), (200, 280), (300, 310)), gap, mask), "a strip more"
    assert not nla_rows.fits(row((80, 120), (200, 300)), gap, mask), "a longer strip"
    assert not nla_rows.fits(row(), gap, mask)
    assert not nla_rows.fits(row((0, 400), colour=57), gap, mask), "a tinted row"


def test_borders_of_strips_in_the_gap_change_nothing(effect: Any) -> None:
    """Measured in a window: the border of the strip below had 11 of 255 in the gap, of a strip
    above 0."""
    mask = nla_rows.strip_mask(REGION, effect.animation_data.nla_tracks[0])
    gap = row((80, 120), (200, 280), colour=11)
    assert nla_rows.fits(row((80, 120), (200, 280)), gap, mask)
    assert not nla_rows.fits(row(), row((80, 120), (200, 280), colour=0), mask)


def test_a_strip_of_all_frames_of_the_scene_does_not_fit_a_header() -> None:
    """Blender draws these frames brighter than the others, in each row and gap."""
    mask = np.full(400, -1, np.int32)
    mask[77:123], mask[83:117] = 0, 1
    header = row((0, 80), (120, 400), colour=33)
    strip, border = header.copy(), header.copy()
    strip[80:120], border[80:120] = 140, 20
    assert nla_rows.fits(header, header, mask), "alone, the frames cannot be told from a strip"
    assert not nla_rows.fits(header, header, mask, header)
    assert nla_rows.fits(strip, header, mask, header)
    assert nla_rows.fits(strip, border, mask, header)


def test_strips_out_of_view_fit_no_row(effect: Any) -> None:
    for _, strip in clips.strips_of(effect)[::-1]:
        strip.frame_start_ui += 200
    mask = nla_rows.strip_mask(REGION, effect.animation_data.nla_tracks[0])
    assert not nla_rows.fits(row(), row(), mask)


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
