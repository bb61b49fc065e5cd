# SPDX-License-Identifier: GPL-3.0-or-later
"""Activation of effects: every way to state activation in a timeline, end to end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.blender import compat
from hfx_blender.reading import scene_reader
from hfx_blender.reading.description import activation
from hfx_blender.reading.description.activation import ActivationSource

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

FRAMES = range(1, 31)


@pytest.fixture
def effect(scene: Any) -> Any:
    """An effect on the head in a scene of thirty frames."""
    scene.frame_start, scene.frame_end = FRAMES[0], FRAMES[-1]
    scene.render.fps = 24
    return oracle.add_painted("Felt", "temperature", oracle.add_avatar(), part="head")


def levels(effect: Any) -> np.ndarray:
    """The level at each frame, 0 where nothing was felt."""
    evaluation = oracle.evaluate(bpy.context.scene, rate_hz=24)
    actual = np.zeros(len(FRAMES))
    for index, level in evaluation.levels(effect.name).items():
        actual[index] = level
    return actual


def trapezoid(start: float, end: float, fade_in: float = 0.0, fade_out: float = 0.0) -> np.ndarray:
    """A clip's level at each frame, by the definition of a fade."""
    frames = np.array(FRAMES, float)
    rise = (frames - start) / fade_in if fade_in else np.ones(len(frames))
    fall = (end - frames) / fade_out if fade_out else np.ones(len(frames))
    inside = (frames >= start) & (frames <= end)
    return np.where(inside, np.clip(np.minimum(rise, fall), 0.0, 1.0), 0.0)


def test_without_animation_it_is_on(effect: Any) -> None:
    assert effect.hfx.activation == 0.0
    assert activation.activation_of(effect).source is ActivationSource.ALWAYS_ON
    assert levels(effect).tolist() == [1.0] * 30


def test_animation_of_something_else_does_not_switch_it_off(effect: Any) -> None:
    oracle.key(effect, "hfx.temperature", [(1, 20.0), (30, 40.0)])
    assert activation.activation_of(effect).source is ActivationSource.ALWAYS_ON
    assert levels(effect).tolist() == [1.0] * 30


@pytest.mark.parametrize("lost", ["action", "slot"])
@pytest.mark.parametrize("has_other", [False, True])
def test_a_clip_that_lost_its_action_is_off_and_named(
    effect: Any, lost: str, has_other: bool
) -> None:
    oracle.add_clip(effect, 5, 17)
    strip = effect.animation_data.nla_tracks[0].strips[0]
    strip.name = "Breath"
    if has_other:
        oracle.add_clip(effect, 20, 25)
    if lost == "action":
        bpy.data.actions.remove(strip.action)
    elif hasattr(strip, "action_slot"):
        strip.action_slot = None
    else:
        pytest.skip("Blender 4.4 and later")
    expected = trapezoid(20, 25) if has_other else np.zeros(len(FRAMES))
    assert np.allclose(levels(effect), expected, atol=1e-6)
    warnings = scene_reader.SceneReader(bpy.context.scene).description.warnings
    assert [text for text in warnings if "Breath" in text] == [
        "effect 'Felt': nothing is played of clips without keyframes: Breath"
    ]


@pytest.mark.parametrize("fades", [(0, 0), (4, 0), (0, 5), (4, 5), (6, 6)])
def test_a_clip_with_fades(effect: Any, fades: tuple[float, float]) -> None:
    oracle.add_clip(effect, 5, 17, fade_in=fades[0], fade_out=fades[1])
    assert np.allclose(levels(effect), trapezoid(5, 17, *fades), atol=1e-6)


def test_fades_at_sub_frames(effect: Any) -> None:
    oracle.add_clip(effect, 5, 17, fade_in=4)
    evaluation = oracle.evaluate(bpy.context.scene, rate_hz=100)
    actual = evaluation.levels("Felt")
    time = evaluation.reader.time
    for index in range(time.sample_count):
        frame = float(time.frame(index))
        expected = min((frame - 5) / 4, 1.0) if 5 <= frame <= 17 else 0.0
        assert actual.get(index, 0.0) == pytest.approx(expected, abs=1e-5)


def test_two_clips_and_the_gap_between(effect: Any) -> None:
    oracle.add_clip(effect, 3, 8)
    oracle.add_clip(effect, 15, 20, fade_in=2)
    state = activation.activation_of(effect)
    assert state.spans == ((3.0, 8.0), (15.0, 20.0))
    assert [clip.frame_start for clip in state.clips] == [3.0, 15.0]
    assert np.allclose(levels(effect), trapezoid(3, 8) + trapezoid(15, 20, 2), atol=1e-6)


def test_overlapping_tracks(effect: Any) -> None:
    oracle.add_clip(effect, 3, 12)
    oracle.add_clip(effect, 8, 20)
    assert len(effect.animation_data.nla_tracks) == 2
    assert np.allclose(levels(effect), trapezoid(3, 20), atol=1e-6)


def test_a_muted_strip(effect: Any) -> None:
    oracle.add_clip(effect, 3, 8)
    oracle.add_clip(effect, 15, 20).mute = True
    assert np.allclose(levels(effect), trapezoid(3, 8), atol=1e-6)


def _mute_the_strip(data: Any) -> None:
    data.nla_tracks[0].strips[0].mute = True


def _mute_the_track(data: Any) -> None:
    data.nla_tracks[0].mute = True


def _nla_off(data: Any) -> None:
    data.use_nla = False


def _solo_another(data: Any) -> None:
    data.nla_tracks.new().is_solo = True


@pytest.mark.parametrize("silence", [_mute_the_strip, _mute_the_track, _nla_off, _solo_another])
def test_silenced_while_on_it_is_off(effect: Any, silence: Any) -> None:
    """Nothing writes the property then: the stored value has no meaning."""
    oracle.add_clip(effect, 3, 20)
    silence(effect.animation_data)
    effect.hfx.activation = 1.0  # stale value, as left behind in most of the cases below
    assert activation.activation_of(effect).source is ActivationSource.OFF
    assert oracle.evaluate(bpy.context.scene).reader.sample_indices.tolist() == []
    assert not levels(effect).any()


def test_clips_grouped_in_a_meta_strip(effect: Any) -> None:
    oracle.add_clip(effect, 3, 8)
    oracle.add_clip(effect, 15, 20)
    bpy.context.view_layer.objects.active = effect
    effect.select_set(True)
    area = bpy.context.window_manager.windows[0].screen.areas[0]
    was, area.type = area.type, "NLA_EDITOR"
    region = next(region for region in area.regions if region.type == "WINDOW")
    try:
        window = bpy.context.window_manager.windows[0]
        with bpy.context.temp_override(window=window, area=area, region=region):
            bpy.ops.nla.select_all(action="SELECT")
            bpy.ops.nla.meta_add()
    finally:
        area.type = was
    [strip] = effect.animation_data.nla_tracks[0].strips
    assert strip.type == "META"
    assert levels(effect)[0] == levels(effect)[-1] == 1.0  # Blender's own choice: HOLD
    strip.extrapolation = "NOTHING"
    expected = trapezoid(3, 8) + trapezoid(15, 20)
    assert np.allclose(levels(effect), expected, atol=1e-6)
    strip.mute = True
    assert not levels(effect).any()


def test_solo(effect: Any) -> None:
    oracle.add_clip(effect, 3, 12)
    oracle.add_clip(effect, 8, 20)
    effect.animation_data.nla_tracks[1].is_solo = True
    assert np.allclose(levels(effect), trapezoid(8, 20), atol=1e-6)


def test_the_last_strip_removed_while_on(effect: Any) -> None:
    strip = oracle.add_clip(effect, 3, 20)
    bpy.context.scene.frame_set(10)
    effect.animation_data.nla_tracks[0].strips.remove(strip)
    assert activation.activation_of(effect).source is ActivationSource.ALWAYS_ON
    assert levels(effect).tolist() == [1.0] * 30


def test_a_curve_on_the_activation(effect: Any) -> None:
    oracle.key(effect, "hfx.activation", [(5, 0.0), (15, 1.0)])
    (curve,) = compat.fcurves(effect)
    for point in curve.keyframe_points:
        point.interpolation = "LINEAR"
    expected = np.clip((np.array(FRAMES) - 5) / 10, 0, 1)
    assert np.allclose(levels(effect), expected, atol=1e-6)


def test_a_driver_on_the_activation(effect: Any) -> None:
    source = oracle.empty(bpy.context.scene)
    oracle.key(source, "location", [(1, (0, 0, -1.0)), (30, (0, 0, 1.9))])
    for curve in compat.fcurves(source):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    driver = effect.driver_add("hfx.activation").driver
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.type = "TRANSFORMS"
    variable.targets[0].id, variable.targets[0].transform_type = source, "LOC_Z"
    expected = np.clip(-1 + 0.1 * (np.array(FRAMES) - 1), 0, 1)  # the property's own limits
    assert np.allclose(levels(effect), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("extrapolation", "expected"),
    [("NOTHING", trapezoid(5, 10)), ("HOLD", np.ones(30)), ("HOLD_FORWARD", trapezoid(5, 99))],
)
def test_extrapolation(effect: Any, extrapolation: str, expected: np.ndarray) -> None:
    strip = oracle.add_clip(effect, 5, 10)
    assert strip.extrapolation == "NOTHING"
    strip.extrapolation = extrapolation
    assert np.allclose(levels(effect), expected, atol=1e-6)


def test_a_repeated_profile(effect: Any) -> None:
    """A sawtooth of eight frames, three times."""
    clips.add_clip(effect, 3, 27, profile=((0.0, 0.0), (4.0, 1.0), (8.0, 0.0)), repeat=3)
    phase = (np.array(FRAMES) - 3) % 8
    expected = np.where(trapezoid(3, 27) > 0, 1 - np.abs(phase - 4) / 4, 0.0)
    assert np.allclose(levels(effect), expected, atol=1e-6)


def test_a_stretched_strip(effect: Any) -> None:
    strip = clips.add_clip(effect, 3, 11, profile=((0.0, 0.0), (4.0, 1.0), (8.0, 0.0)))
    strip.scale = 2.0
    assert strip.frame_end == 19
    expected = np.clip(1 - np.abs(np.array(FRAMES) - 11) / 8, 0, 1)
    assert np.allclose(levels(effect), expected, atol=1e-6)


def test_intensity_multiplies(effect: Any) -> None:
    oracle.add_clip(effect, 5, 17, fade_in=4)
    oracle.key(effect, "hfx.intensity", [(1, 0.0), (30, 0.58)])
    for curve in compat.fcurves(effect):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    expected = trapezoid(5, 17, 4) * 0.02 * (np.array(FRAMES) - 1)
    assert np.allclose(levels(effect), expected, atol=1e-5)


def test_values_that_a_script_has_just_set(effect: Any) -> None:
    """Blender does not copy the values to the evaluated copies automatically."""
    levels(effect)
    effect.hfx.intensity = 0.25
    assert levels(effect).tolist() == [0.25] * 30
    effect.hfx.temperature = 41.0
    evaluation = oracle.evaluate(bpy.context.scene)
    assert evaluation.of("Felt", 0).parameters.tolist() == [41.0]
    assert evaluation.reader.stepping_note == "sampled F-curves, stepped no scene"


def test_copies_have_clips_and_ids_of_their_own(effect: Any) -> None:
    oracle.add_clip(effect, 3, 8)
    copy = effect.copy()
    copy.name = "Copy"
    bpy.context.scene.collection.objects.link(copy)
    copy.animation_data.nla_tracks[0].strips[0].frame_start_ui = 13
    evaluation = oracle.evaluate(bpy.context.scene, rate_hz=24)
    assert len({item.id for item in evaluation.reader.description.effects}) == 2
    assert sorted(evaluation.levels("Felt")) == list(range(2, 8))
    assert sorted(evaluation.levels("Copy")) == list(range(12, 18))


@pytest.mark.parametrize(
    ("fps", "rate_hz", "start", "end"),
    # In all but the last, index * (fps / rate) in floats misses the clip's first or last frame.
    [(25, 97, 26, 40), (29, 100, 30, 40), (60, 13, 61, 70), (29, 7, 10, 30), (24, 100, 7, 20)],
)
def test_samples_on_the_edge_of_a_clip_are_in_it(
    effect: Any, fps: int, rate_hz: int, start: int, end: int
) -> None:
    scene = bpy.context.scene
    scene.render.fps = fps
    scene.frame_end = end + 5
    oracle.add_clip(effect, start, end)
    reader = scene_reader.SceneReader(scene, rate_hz=oracle.Fraction(rate_hz))
    expected = [
        index
        for index in range(reader.time.sample_count)
        if start <= reader.time.frame(index) <= end
    ]
    assert reader.sample_indices.tolist() == expected


@pytest.mark.parametrize(
    ("keys", "kind", "spans"),
    [
        ([(5, 0.0), (9, 0.0)], "BEZIER", ()),
        ([(5, 0.0), (9, 1.0), (12, 0.0), (20, 0.0)], "LINEAR", ((5.0, 9.0), (9.0, 12.0))),
        (
            [(5, 1.0), (9, 0.0), (12, 1.0)],
            "LINEAR",
            ((-np.inf, 5.0), (5, 9), (9, 12), (12, np.inf)),
        ),
        ([(5, 1.0), (9, 0.0)], "SINE", ((-np.inf, np.inf),)),
    ],
)
def test_spans_of_a_curve(effect: Any, keys: Any, kind: str, spans: Any) -> None:
    oracle.key(effect, "hfx.activation", keys)
    for point in compat.fcurves(effect)[0].keyframe_points:
        point.interpolation = kind
    assert activation.activation_of(effect).spans == spans


def test_a_curve_that_overshoots_between_zeros(effect: Any) -> None:
    oracle.key(effect, "hfx.activation", [(5, 0.0), (15, 0.0)])
    first = compat.fcurves(effect)[0].keyframe_points[0]
    first.handle_right_type, first.handle_right = "FREE", (8, 1.0)
    assert activation.activation_of(effect).spans == ((5.0, 15.0),)
    assert levels(effect)[7] > 0.1


def test_spans_are_certain() -> None:
    on = activation.Activation(ActivationSource.ANIMATED, ((2.0, 4.0), (6.0, 6.5)))
    frames = np.array([1.999, 2.0, 3.0, 4.0, 4.001, 6.25, 7.0])
    assert on.may_be_on(frames).tolist() == [False, True, True, True, False, True, False]
    assert activation.Activation(ActivationSource.ALWAYS_ON).may_be_on(frames).all()
    assert not activation.Activation(ActivationSource.OFF).may_be_on(frames).any()
