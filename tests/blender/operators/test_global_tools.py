# SPDX-License-Identifier: GPL-3.0-or-later
"""Gain, frequency and modulation over many effects; rain with generated drops."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effect_exchange, effects, rain
from hfx_blender.authoring.paths import paths
from hfx_blender.engine.areas.spot import places_on
from hfx_blender.engine.body.model import load_model


@pytest.fixture
def three(scene: Any) -> dict[str, Any]:
    scene.render.fps = 50
    bpy.ops.hfx.add_avatar()
    actual = {}
    for modality in ("vibration", "pressure", "temperature"):
        bpy.ops.hfx.add_volume(modality=modality, shape="SPHERE", name=modality)
        actual[modality] = bpy.context.object
    for effect in actual.values():
        effect.select_set(True)
    return actual


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
    assert falls == 2  # 2 Hz over 1 s at 50 frames a second
    bpy.ops.hfx.modulate(rate=2.0, depth=0.0, scope="ALL")
    assert intensity(effect, 13.0) == pytest.approx(0.8)


def test_a_modulation_faster_than_frames_can_show_is_refused(three: dict[str, Any]) -> None:
    with pytest.raises(RuntimeError, match="up to 25 Hz"):
        bpy.ops.hfx.modulate(rate=80.0)


def drops_of(shower: list[Any]) -> list[tuple[float, float]]:
    """Starts of drops, frames, and their shares of the path, by time."""
    strips = [strip for effect in shower for _, strip in clips.strips_of(effect)]
    assert len(strips) == len(shower), "one clip each"
    return sorted(key for strip in strips for key in clips.keys_in(strip, paths.POSITION)[::2])


def rained(name: str = "Rain") -> list[Any]:
    actual = effects.effects_of(bpy.context.scene)
    return [effect for effect in actual if effect.get(rain.GENERATOR) == name]


def test_rain_is_one_effect_with_the_drops_that_were_asked_for(three: dict[str, Any]) -> None:
    bpy.context.scene.frame_set(100)
    bpy.ops.hfx.add_rain(drops_per_second=10.0, duration=3.0, drop_size=30.0)
    (effect,) = rained()
    drops = drops_of([effect])
    starts = np.array([frame for frame, _ in drops])
    assert len(drops) == 30 and effect.hfx.radius == pytest.approx(0.015)
    assert starts.min() >= 100.0 and starts.max() + 0.06 * 50 <= 250.0 + 1e-3
    assert np.diff(starts).min() >= 0.06 * 50 - 1e-3, "no drop falls before the last one ends"
    model = load_model("hfx-vibration-1")
    for position in places_on(paths.path_of(effect), np.array([share for _, share in drops])):
        nearest = np.linalg.norm(model.vertices - position, axis=1).argmin()
        assert model.normals[nearest, 2] > 0.0, "rain falls from above"
    (track,) = effect.animation_data.nla_tracks
    bpy.context.scene.frame_set(int(starts[3]) + 1)  # a drop lasts for three frames
    evaluated = effect.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert evaluated.hfx.activation > 0.1
    assert evaluated.hfx.path_position == pytest.approx(drops[3][1], abs=1e-5)
    track.strips[0].frame_start_ui += 7.0
    assert drops_of([effect])[3] == pytest.approx((starts[3] + 7.0, drops[3][1]))


def test_drops_that_would_overlap_are_divided_among_effects(three: dict[str, Any]) -> None:
    bpy.ops.hfx.add_rain(drops_per_second=30.0, duration=2.0)
    assert len(rained()) == 3  # 60 drops of 65 ms, in each at most 21: 0.7 of 2 s
    assert len(drops_of(rained())) == 60
    assert all(len(e.animation_data.nla_tracks) == 1 for e in rained())


def test_a_saved_shower_rains_the_same(three: dict[str, Any]) -> None:
    bpy.ops.hfx.add_rain(duration=1.0)
    saved = effect_exchange.sensation_of(bpy.context.scene, rained(), "Shower")
    before = drops_of(rained())
    ((start, _), *_) = clips.keys_in(clips.strips_of(rained()[0])[0][1], clips.DATA_PATH)
    motion = saved.effects[0].where.path.motion
    assert [(start + time * 50.0, share) for time, share in motion[::2]] == [
        pytest.approx(item, abs=1e-4) for item in before
    ]


def test_raining_again_replaces_the_shower_and_the_seed_decides(three: dict[str, Any]) -> None:
    bpy.ops.hfx.add_rain(seed=1)
    first = drops_of(rained())
    bpy.ops.hfx.add_rain(seed=1)
    assert drops_of(rained()) == first
    bpy.ops.hfx.add_rain(seed=2)
    assert drops_of(rained()) != first and len(drops_of(rained())) == len(first)


def test_too_much_rain_is_refused(three: dict[str, Any]) -> None:
    with pytest.raises(RuntimeError, match="allowed are 1 to 5000"):
        bpy.ops.hfx.add_rain(drops_per_second=200.0, duration=60.0)


def test_showers_of_different_names_rain_side_by_side(scene: Any) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_rain(drops_per_second=2.0, duration=1.0)
    bpy.ops.hfx.add_rain(drops_per_second=3.0, duration=1.0, name="Shower")
    bpy.ops.hfx.add_rain(drops_per_second=4.0, duration=1.0)  # in place of the first
    assert sorted(e.name for e in effects.effects_of(scene)) == ["Rain", "Shower"]
    assert [len(drops_of(rained(name))) for name in ("Rain", "Shower")] == [4, 3]
