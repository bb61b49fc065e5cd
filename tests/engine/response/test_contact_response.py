# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses: every filter by arithmetic, ringing impacts, and division of time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from engine_synthetic import BONES, model
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.response_filters import envelope, filters
from hfx_blender.engine.response_filters.controls import (
    CONTROLS,
    WIDTH,
    About,
    Filter,
    FilterKind,
    Operation,
)
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.nearest_surface import distances_m
from hfx_blender.engine.volume.shape import Falloff

RATE = 100
COUNT = 60
RADIUS_M = 0.05
SPEED_M_S = 2.0
MODEL = replace(
    model(3),
    vertices=np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.0, 0.2, 0.0]], np.float32),
)
STILL = PoseBlock(
    np.ones(COUNT, bool),
    np.tile(np.eye(4), (COUNT, 1, 1)),
    np.tile(np.eye(4)[:3], (COUNT, len(BONES), 1, 1)),
)


def _filter(kind: FilterKind, **controls: float) -> tuple[Filter, list[float]]:
    static = {name: controls.pop(name) for name in ("operation", "about") if name in controls}
    values = [control.default for control in CONTROLS[kind]]
    values += [0.0] * (WIDTH - len(values))
    names = [control.name for control in CONTROLS[kind]]
    for name, value in controls.items():
        values[names.index(name)] = value
    return Filter(kind, **static), values  # type: ignore[arg-type]


def _there_and_back(start_m: float = 0.15) -> np.ndarray:
    """Return heights of a ball flying to the skin and back at constant speed."""
    times = np.arange(COUNT) / RATE
    return np.abs(start_m - SPEED_M_S * times) + 0.03


def _scene(stack: list[tuple[Filter, list[float]]]) -> SceneDescription:
    volume = HapticVolume(Falloff(), tuple(item for item, _ in stack))
    return SceneDescription(
        TimeBase(Fraction(RATE), Fraction(RATE), 0, 0, COUNT - 1),
        (BodyDescription("anna", "Anna", SkinBinding(BONES)),),
        (EffectDescription("ball", "Ball", "vibration", MODEL.id, volume),),
    )


def _block(
    stack: list[tuple[Filter, list[float]]], heights: np.ndarray, levels: Any = 1.0
) -> AnimationBlock:
    matrices = np.tile(np.diag([RADIUS_M] * 3 + [1.0]), (COUNT, 1, 1))
    matrices[:, 2, 3] = heights
    effect = EffectBlock(
        levels=np.broadcast_to(np.asarray(levels, float), COUNT).copy(),
        parameters=np.tile([10.0, 100.0], (COUNT, 1)),
        matrices=matrices,
        shapes=(Sphere(),),
        response=np.tile([values for _, values in stack], (COUNT, 1, 1)),
    )
    return AnimationBlock(np.arange(COUNT), (effect,), (STILL,))


def _part(block: AnimationBlock, first: int, stop: int) -> AnimationBlock:
    """Return some rows of a block, with neighbouring rows as from a reader."""
    history, future = min(first, 3), min(COUNT - stop, 2)
    rows = slice(first - history, stop + future)
    effect, pose = block.effects[0], block.poses[0]
    assert effect.matrices is not None and effect.response is not None and pose.bones is not None
    return AnimationBlock(
        block.indices[rows],
        (
            replace(
                effect,
                levels=effect.levels[rows],
                parameters=effect.parameters[rows],
                matrices=effect.matrices[rows],
                response=effect.response[rows],
            ),
        ),
        (PoseBlock(pose.valid[rows], pose.to_world[rows], pose.bones[rows]),),
        history,
        future=future,
    )


def _engine(stack: list[tuple[Filter, list[float]]]) -> Engine:
    return Engine(_scene(stack), models=lambda _: MODEL, tolerance=PAPER)


def _levels(runs: list[SampleRun]) -> np.ndarray:
    """Return the level at each sample; 0 without contact."""
    levels = np.zeros(COUNT)
    for run in runs:
        levels[run.indices] = run.levels
    return levels


def _runs(
    stack: list[tuple[Filter, list[float]]], heights: np.ndarray | None = None, levels: Any = 1.0
) -> list[SampleRun]:
    heights = _there_and_back() if heights is None else heights
    return _engine(stack).evaluate(_block(stack, heights, levels))


def _each(runs: list[SampleRun]) -> Iterator[tuple[int, dict[int, float]]]:
    for run in runs:
        for index, sample in zip(run.indices.tolist(), run, strict=True):
            weights = sample.weights.astype(float) * sample.level
            yield index, dict(zip(sample.vertices.tolist(), weights.tolist(), strict=True))


# The ball's lowest point is above the skin until |0.15 - 2 t| <= 0.02: samples 7 and 8.
CONTACT = (7, 8)


def test_without_filters_a_ball_plays_during_contact() -> None:
    assert [index for index, _ in _each(_runs([]))] == list(CONTACT)


# The first touch is at |0.15 - 2 t| = 0.02, between samples 6 and 7.
ONSET_S = 0.065


def test_an_impact_rings_with_the_formula_of_a_leaky_integrator() -> None:
    decay, full = 0.1, 4.0
    stack = [_filter(FilterKind.IMPACT, decay_s=decay, full_m_s=full)]
    levels = _levels(_runs(stack))
    for k in range(COUNT):
        since = k / RATE - ONSET_S
        expected = SPEED_M_S / full * np.exp(-since / decay)
        # The duration is known: an impact ends after ln(1000) time constants.
        if since < 0.0 or since >= decay * np.log(1000.0):
            expected = 0.0
        elif k == CONTACT[0]:
            expected = SPEED_M_S / full  # the peak is in the next sample
        assert levels[k] == pytest.approx(expected, abs=1e-9)
    # The recursion of a leaky integrator, y[n] = a y[n-1], from the sample after on.
    np.testing.assert_allclose(levels[9:30] / levels[8:29], np.exp(-1.0 / (RATE * decay)))
    assert np.count_nonzero(levels) > 40


def test_an_impact_rings_at_its_vertices_until_decayed() -> None:
    actual = dict(_each(_runs([_filter(FilterKind.IMPACT, decay_s=0.1)])))
    assert all(set(actual[k]) == {0, 1} for k in actual if k != CONTACT[0])


def test_a_stiffer_object_dies_away_faster_and_an_attack_delays_the_peak() -> None:
    soft = _levels(_runs([_filter(FilterKind.IMPACT, decay_s=0.2)]))
    stiff = _levels(_runs([_filter(FilterKind.IMPACT, decay_s=0.05)]))
    assert (stiff[8:] <= soft[8:]).all() and stiff[12] < 0.6 * soft[12]
    slow = _levels(_runs([_filter(FilterKind.IMPACT, attack_s=0.05, decay_s=0.2)]))
    assert slow[CONTACT[0] - 1] == 0.0 and slow[CONTACT[0]] < 0.2
    peak = np.log(0.2 / 0.05) * 0.2 * 0.05 / 0.15  # of exp(-t / 0.2) - exp(-t / 0.05)
    # The whole peak is in the next sample.
    assert np.argmax(slow) == np.ceil((ONSET_S + peak) * RATE)
    assert slow.max() == pytest.approx(1.0, abs=1e-9)


def test_impacts_add_up_and_stay_within_full_strength() -> None:
    times = np.arange(COUNT) / RATE
    heights = np.where(times < 0.2, _there_and_back(), np.abs(0.3 - SPEED_M_S * (times - 0.1)))
    stack = [_filter(FilterKind.IMPACT, decay_s=0.3, full_m_s=4.0)]
    levels = _levels(_runs(stack, heights))
    once = _levels(_runs(stack))
    second = int(np.flatnonzero(np.diff(levels) > 0.1)[-1]) + 1
    assert second == 23
    began_s = 0.1 + (0.3 - 0.05) / SPEED_M_S  # 0.225 s: the ball's lowest point is on the skin
    assert levels[second] == pytest.approx(0.5 * np.exp(-(began_s - ONSET_S) / 0.3) + 0.5, abs=1e-4)
    after = 0.5 * np.exp(-(0.24 - began_s) / 0.3)
    assert levels[24] == pytest.approx(once[24] + after, abs=1e-4)


def test_vertices_inside_at_the_start_are_not_hit() -> None:
    levels = np.where(np.arange(COUNT) < 7, 0.0, 1.0)
    stack = [_filter(FilterKind.IMPACT)]
    assert not _runs(stack, levels=levels)


def test_vertices_touched_before_a_part_are_not_hit() -> None:
    stack = [_filter(FilterKind.IMPACT)]
    block = _block(stack, _there_and_back(0.155))
    assert _engine(stack).evaluate(_part(block, CONTACT[0] - 1, COUNT))  # a sample more
    assert not _engine(stack).evaluate(_part(block, CONTACT[1], COUNT))


def test_near_vertices_without_contact_have_no_speed() -> None:
    near = _filter(FilterKind.PROXIMITY, range_m=0.1, influence=0.4, operation=Operation.MAXIMUM)
    speed = _filter(FilterKind.SPEED, full_m_s=4.0, operation=Operation.ADD)
    slow, fast = _levels(_runs([near])), _levels(_runs([near, speed]))
    np.testing.assert_array_equal(fast[CONTACT[1] + 1 :], slow[CONTACT[1] + 1 :])
    assert slow[CONTACT[1] + 1] > 0.0


def test_nearness_rises_before_contact_and_holds() -> None:
    stack = [
        _filter(FilterKind.PROXIMITY, range_m=0.1, influence=0.4, operation=Operation.MAXIMUM),
    ]
    felt_value = dict(_each(_runs(stack, np.linspace(0.2, 0.06, COUNT))))
    heights = np.linspace(0.2, 0.06, COUNT)
    for k in range(COUNT):
        for vertex in (0, 1):
            distance = np.hypot(MODEL.vertices[vertex, 0], heights[k]) - RADIUS_M
            expected = 0.4 * max(0.0, 1.0 - distance / 0.1)
            assert felt_value.get(k, {}).get(vertex, 0.0) == pytest.approx(expected, abs=1e-6)


def test_nearness_does_not_jump_where_contact_begins() -> None:
    heights = np.linspace(0.08, 0.02, COUNT)
    stack = [
        _filter(FilterKind.IMPACT, decay_s=0.1, attack_s=0.1, full_m_s=1e2),
        _filter(FilterKind.PROXIMITY, range_m=0.1, influence=0.5, operation=Operation.MAXIMUM),
    ]
    felt_value = dict(_each(_runs(stack, heights)))
    strengths = np.array([felt_value[k][0] for k in range(COUNT)])
    assert np.abs(np.diff(strengths)).max() < 1.05 * 0.5 * (heights[0] - heights[1]) / 0.1
    assert strengths[-1] == pytest.approx(0.5)


def test_the_relative_speed_scales_a_touch() -> None:
    stack = [_filter(FilterKind.SPEED, still_m_s=1.0, full_m_s=3.0)]
    levels = _levels(_runs(stack))
    assert levels[CONTACT[0]] == pytest.approx((SPEED_M_S - 1.0) / 2.0)
    standing = np.full(COUNT, 0.03)
    assert not _runs(stack, standing)
    halved = [_filter(FilterKind.SPEED, still_m_s=1.0, full_m_s=3.0, influence=0.5)]
    assert _levels(_runs(halved, standing))[5] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("about", "expected"), [(About.CENTRE, (0.03, 0.0009**0.5 * 2**0.5)), (About.AXIS, (0.0, 0.03))]
)
def test_the_distance_from_the_centre_or_axis_weakens_each_vertex(
    about: About, expected: tuple[float, float]
) -> None:
    stack = [_filter(FilterKind.DISTANCE, far_m=0.1, about=about)]
    actual = dict(_each(_runs(stack, np.full(COUNT, 0.03))))[10]
    for vertex, distance in enumerate(expected):
        assert actual[vertex] == pytest.approx(1.0 - distance / 0.1, abs=1e-6)


def test_a_sine_in_time_runs_with_the_scene_and_one_in_space_with_the_place() -> None:
    still = np.full(COUNT, 0.03)
    levels = _levels(
        _runs([_filter(FilterKind.SINE, about=About.TIME, cycles=5.0, depth=0.8)], still)
    )
    times = np.arange(COUNT) / RATE
    expected = 1.0 - 0.4 * (1.0 - np.sin(2.0 * np.pi * 5.0 * times))
    np.testing.assert_allclose(levels, expected, atol=1e-9)
    stack = [_filter(FilterKind.SINE, about=About.AXIS, cycles=0.04, depth=1.0, phase=0.25)]
    actual = dict(_each(_runs(stack, still)))[3]
    assert actual[0] == pytest.approx(1.0)
    assert actual[1] == pytest.approx(
        0.5 + 0.5 * np.sin(2 * np.pi * (0.03 / 0.04 + 0.25)), abs=1e-6
    )


def test_filters_are_folded_from_top_to_bottom() -> None:
    stack = tuple(
        Filter(FilterKind.SPEED, operation)
        for operation in (Operation.MULTIPLY, Operation.ADD, Operation.MAXIMUM)
    )
    values, influences = np.array([[0.5, 0.25, 1.0]]), np.array([[0.5, 1.0, 0.2]])
    # (1 * 0.75 + 0.25) = 1.0, at least 0.2.
    assert filters.folded(stack, np.ones(1), values, influences)[0] == pytest.approx(1.0)
    assert filters.folded(stack[1:], np.zeros(1), values[:, 1:], influences[:, 1:])[0] == 0.25
    assert filters.folded(stack[2:], np.zeros(1), values[:, 2:], influences[:, 2:])[0] == 0.2


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.floats(0.0, 5.0), st.floats(1e-3, 5.0))
def test_an_envelope_is_at_most_one_and_ends_in_time(attack: float, decay: float) -> None:
    since = np.concatenate([[0.0], np.geomspace(1e-4, 20.0, 300)])
    values = envelope.kernel(since, attack, decay)
    assert ((values >= 0.0) & (values <= 1.0 + 1e-6)).all()
    ends = envelope.duration_s(attack, decay)
    assert (envelope.kernel(ends + since, attack, decay) <= 1.05 * envelope.SILENCE).all()
    assert ends <= envelope.longest_s(1.1 * attack, 1.1 * decay)


STACK = [
    _filter(FilterKind.IMPACT, decay_s=0.1, attack_s=0.02),
    _filter(FilterKind.SPEED, full_m_s=3.0, influence=0.7),
    _filter(FilterKind.PROXIMITY, range_m=0.05, influence=0.3, operation=Operation.MAXIMUM),
    _filter(FilterKind.SINE, about=About.CENTRE, cycles=0.1, depth=0.5),
]


def _columns(runs: list[SampleRun]) -> tuple[bytes, ...]:
    """Return all sample data as bytes, independent of the division into blocks."""
    samples = [(run.indices[k], item) for run in runs for k, item in enumerate(run)]
    return (
        np.array([index for index, _ in samples]).tobytes(),
        np.array([item.level for _, item in samples]).tobytes(),
        b"".join(item.vertices.tobytes() for _, item in samples),
        b"".join(item.weights.tobytes() for _, item in samples),
    )


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.integers(1, COUNT - 1), unique=True, max_size=6))
def test_splitting_time_gives_the_same_bytes(cuts: list[int]) -> None:
    block = _block(STACK, _there_and_back())
    whole = _columns(_engine(STACK).evaluate(block))
    engine, runs = _engine(STACK), []
    for first, stop in pairwise([0, *sorted(cuts), COUNT]):
        runs += engine.evaluate(_part(block, first, stop))
    assert _columns(runs) == whole
    assert len(whole[0]) > 8 * 20


def test_responses_provide_all_optional_track_columns() -> None:
    engine = Engine(
        _scene(STACK), models=lambda _: MODEL, tolerance=PAPER, record=("positions", "depth")
    )
    (run,) = engine.evaluate(_block(STACK, _there_and_back()))
    assert run.sets is None and run.positions is not None and run.depth_m is not None
    assert len(run.positions) == len(run.vertices) == len(run.depth_m)
    at = run.indices.tolist().index(CONTACT[0])
    touched = run.depth_m[run.offsets[at] : run.offsets[at + 1]]
    # The ball's centre is 0.04 above the first vertex: 0.01 deep.
    assert touched[0] == pytest.approx(RADIUS_M - _there_and_back()[CONTACT[0]], abs=1e-6)


def _outside(shape: Any, points: np.ndarray, position: np.ndarray) -> np.ndarray:
    return distances_m(shape, points[:, None], position[None])[0]


def test_the_distance_to_a_volume_from_outside() -> None:
    to_world = np.diag([2.0, 2.0, 2.0, 1.0])
    points = np.array([[3.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 3.0], [0.1, 0.2, 0.3]]).T
    np.testing.assert_allclose(_outside(Cuboid(), points, to_world), [4.0, 8**0.5, 4.0, 0.0])
    round_ = [4.0, 2 * (8**0.5 - 1), 4.0, 0.0]
    np.testing.assert_allclose(_outside(Sphere(), points, to_world), round_)
    np.testing.assert_allclose(_outside(Cylinder(), points, to_world), round_)
    np.testing.assert_allclose(
        _outside(Capsule(1.0), points, to_world), [4.0, 2 * (8**0.5 - 1), 2.0, 0.0]
    )


def test_the_distance_to_a_mesh_from_outside_is_that_to_its_surface() -> None:
    from hfx_blender.engine.volume.mesh import MeshVolume

    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    points = np.array([[1.0, 1.0, 1.0], [0.1, 0.1, 0.1], [0.2, 0.2, -0.5]]).T
    actual = _outside(MeshVolume(corners, faces, "tip"), points, np.eye(4))
    np.testing.assert_allclose(actual, [2.0 / 3.0**0.5, 0.0, 0.5], atol=1e-12)
