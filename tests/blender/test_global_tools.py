# SPDX-License-Identifier: GPL-3.0-or-later
"""Gain, frequency and modulation over many effects; rain that makes its drops."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips, effects, rain
from hfx_blender.engine.body.model import load_model


@pytest.fixture
def three(scene: Any) -> dict[str, Any]:
    scene.render.fps = 50
    bpy.ops.hfx.add_avatar()
    found = {}
    for modality in ("vibration", "pressure", "temperature"):
        bpy.ops.hfx.add_volume(modality=modality, shape="SPHERE", name=modality)
        found[modality] = bpy.context.object
    for effect in found.values():
        effect.select_set(True)
    return found


def test_gain_changes_strength_and_keyframes_of_the_selected(three: dict[str, Any]) -> None:
    vibration = three["vibration"]
    vibration.hfx.amplitude = 4.0
    vibration.keyframe_insert("hfx.amplitude", frame=0)
    vibration.hfx.amplitude = 8.0
    vibration.keyframe_insert("hfx.amplitude", frame=10)
    three["pressure"].select_set(False)
    three["temperature"].hfx.temperature = 30.0
    bpy.ops.hfx.scale_strength(factor=0.5)
    for frame, expected in ((0, 2.0), (10, 4.0)):
        bpy.context.scene.frame_set(frame)
        evaluated = vibration.evaluated_get(bpy.context.evaluated_depsgraph_get())
        assert evaluated.hfx.amplitude == pytest.approx(expected)
    assert three["pressure"].hfx.pressure == pytest.approx(5.0)  # the default
    assert three["temperature"].hfx.temperature == pytest.approx(27.0)  # half of +6 from 24


def test_gain_over_everything(three: dict[str, Any]) -> None:
    bpy.ops.object.select_all(action="DESELECT")
    with pytest.raises(RuntimeError, match="This scope has no effects"):
        bpy.ops.hfx.scale_strength(factor=2.0)
    bpy.ops.hfx.scale_strength(factor=2.0, scope="ALL")
    assert three["pressure"].hfx.pressure == pytest.approx(10.0)


def test_frequency_is_of_vibrations_only(three: dict[str, Any]) -> None:
    three["vibration"].hfx.frequency = 100.0
    bpy.ops.hfx.scale_frequency(factor=1.5)
    assert three["vibration"].hfx.frequency == pytest.approx(150.0)


def intensity(effect: Any, frame: float) -> float:
    bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
    return effect.evaluated_get(bpy.context.evaluated_depsgraph_get()).hfx.intensity


def test_modulation_swings_below_the_intensity_and_can_be_taken_away(
    three: dict[str, Any],
) -> None:
    effect = three["pressure"]
    effect.hfx.intensity = 0.8
    bpy.ops.hfx.modulate(rate=2.0, depth=0.5, scope="ALL")
    values = [intensity(effect, frame / 4) for frame in range(200)]
    assert max(values) == pytest.approx(0.8, abs=1e-3)
    assert min(values) == pytest.approx(0.4, abs=1e-3)
    middle = np.array(values) > 0.6
    falls = np.count_nonzero(~middle[1:] & middle[:-1])
    assert falls == 2  # 2 Hz over one second at 50 frames a second
    bpy.ops.hfx.modulate(rate=2.0, depth=0.0, scope="ALL")
    assert intensity(effect, 13.0) == pytest.approx(0.8)


def test_a_modulation_faster_than_frames_can_show_is_refused(three: dict[str, Any]) -> None:
    with pytest.raises(RuntimeError, match="up to 25 Hz"):
        bpy.ops.hfx.modulate(rate=80.0)


def test_rain_makes_the_drops_that_were_asked_for(three: dict[str, Any]) -> None:
    bpy.context.scene.frame_set(100)
    bpy.ops.hfx.add_rain(drops_per_second=10.0, duration=3.0, drop_size=30.0)
    drops = [e for e in effects.effects_of(bpy.context.scene) if rain.GENERATOR in e]
    strips = [strip for drop in drops for _, strip in clips.strips_of(drop)]
    assert len(strips) == 30
    assert min(s.frame_start for s in strips) >= 100
    assert max(s.frame_end for s in strips) <= 250 + 1e-3
    model = load_model("hfx-vibration-1")
    for drop in drops:
        vertices, _ = effects.area(drop)
        points = model.vertices[vertices]
        assert np.linalg.norm(points[:, None] - points[None], axis=2).max() <= 0.030 + 1e-6
        assert model.normals[vertices, 2].max() > 0.0, "rain falls from above"


def test_raining_again_replaces_the_shower_and_the_seed_decides(three: dict[str, Any]) -> None:
    def places() -> list[list[int]]:
        drops = [e for e in effects.effects_of(bpy.context.scene) if rain.GENERATOR in e]
        return [effects.area(drop)[0] for drop in drops]

    bpy.ops.hfx.add_rain(seed=1)
    first = places()
    bpy.ops.hfx.add_rain(seed=1)
    assert places() == first
    bpy.ops.hfx.add_rain(seed=2)
    assert places() != first and len(places()) == len(first)


def test_too_much_rain_is_refused(three: dict[str, Any]) -> None:
    with pytest.raises(RuntimeError, match="allowed are 1 to 5000"):
        bpy.ops.hfx.add_rain(drops_per_second=200.0, duration=60.0)


def test_showers_of_different_names_rain_side_by_side(scene: Any) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_rain(drops_per_second=2.0, duration=1.0)
    bpy.ops.hfx.add_rain(drops_per_second=3.0, duration=1.0, name="Shower")
    bpy.ops.hfx.add_rain(drops_per_second=4.0, duration=1.0)  # in place of the first
    names = [effect.name.rpartition(" ")[0] for effect in effects.effects_of(scene)]
    assert sorted(names) == ["Rain"] * 4 + ["Shower"] * 3
