# SPDX-License-Identifier: GPL-3.0-or-later
"""Fades drawn as a curve stay with their clip through every edit of the clip."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender.authoring import clips, drawn_fades
from hfx_blender.authoring.effects import effect_exchange, effect_file


@pytest.fixture
def effect(scene: Any) -> Any:
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", name="Ball")
    return bpy.context.object


@pytest.fixture
def strip(effect: Any) -> Any:
    created = clips.add_clip(effect, 10, 50, fade_in=10, fade_out=20, name="Clip")
    bpy.ops.hfx.draw_fades(name="Clip")
    return created


def keys(strip: Any) -> list[tuple[float, float]]:
    bpy.context.view_layer.update()
    return [
        (round(point.co[0], 3), round(point.co[1], 3))
        for point in drawn_fades.curve_of(strip).keyframe_points
    ]


def test_a_curve_moves_with_its_clip(effect: Any, strip: Any) -> None:
    strip.frame_start_ui = 30
    assert keys(strip) == [(30, 0), (40, 1), (50, 1), (70, 0)]
    strip.frame_start_ui = 10
    assert keys(strip) == [(10, 0), (20, 1), (30, 1), (50, 0)]


def test_a_curve_is_as_long_as_its_clip(effect: Any, strip: Any) -> None:
    strip.frame_end_ui = 90  # twice as long
    assert keys(strip) == [(10, 0), (30, 1), (50, 1), (90, 0)]
    strip.frame_end_ui = 50
    assert keys(strip) == [(10, 0), (20, 1), (30, 1), (50, 0)]


def test_the_parts_of_a_clip_that_was_cut_keep_the_curve_in_place(effect: Any, strip: Any) -> None:
    track = effect.animation_data.nla_tracks[0]
    strip.frame_end = 30
    second = track.strips.new("Clip.001", 30, strip.action)
    second.frame_end = 50
    second.use_animated_influence = True
    effect.update_tag()
    assert keys(strip) == [(10, 0), (20, 1), (30, 1), (50, 0)]


def test_drawing_again_keeps_what_was_drawn(effect: Any, strip: Any) -> None:
    drawn_fades.curve_of(strip).keyframe_points.insert(40, 0.25)
    before = keys(strip)
    bpy.ops.hfx.draw_fades(name="Clip")
    assert keys(strip) == before and (40, 0.25) in before


def test_a_copied_effect_has_a_curve_of_its_own(effect: Any, strip: Any) -> None:
    bpy.ops.object.duplicate()
    (copied,) = bpy.context.object.animation_data.nla_tracks[0].strips
    copied.frame_start_ui = 100
    assert keys(copied) == [(100, 0), (110, 1), (120, 1), (140, 0)]
    assert keys(strip) == [(10, 0), (20, 1), (30, 1), (50, 0)]


def test_copied_clips_bring_their_curves(effect: Any, strip: Any) -> None:
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE", name="Other")
    alternative = bpy.context.object
    effect.select_set(True)
    bpy.context.view_layer.objects.active = effect
    bpy.ops.hfx.copy_clips()
    ((_, copied),) = clips.strips_of(alternative)
    for frame in (12, 20, 25, 37, 44):
        mine = drawn_fades.curve_of(copied).evaluate(frame)
        assert mine == pytest.approx(drawn_fades.curve_of(strip).evaluate(frame), abs=1e-5)
    copied.frame_start_ui = 60
    assert keys(copied)[0] == (60, 0) and keys(strip)[0] == (10, 0)


def test_a_file_of_effects_keeps_drawn_fades(effect: Any, strip: Any, tmp_path: Path) -> None:
    sensation = effect_exchange.sensation_of(bpy.context.scene, [effect], "Saved")
    path = tmp_path / "saved.hfxeffect"
    effect_file.save(sensation, path)
    bpy.context.scene.frame_set(101)
    bpy.ops.hfx.load_effects(filepath=str(path))
    ((_, loaded),) = clips.strips_of(bpy.context.object)
    assert (loaded.frame_start, loaded.frame_end) == (101, 141)
    for frame in (0, 2, 10, 15, 27, 34, 40):
        there = drawn_fades.curve_of(strip).evaluate(10 + frame)
        here = drawn_fades.curve_of(loaded).evaluate(101 + frame)
        assert here == pytest.approx(there, abs=1e-3)


def test_straight_fades_again_forget_the_curve(effect: Any, strip: Any) -> None:
    strip.use_animated_influence = False
    effect.update_tag()
    bpy.context.view_layer.update()
    assert not drawn_fades.has_drawn_fades(effect)
