# SPDX-License-Identifier: GPL-3.0-or-later
"""Impacts: ringing vertices, strengths and durations, against independent arithmetic.

The oracle is a ball on a flat patch of skin: the share of a vertex's cell inside the ball, the
strength, the time of contact, and the decay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from skin_plane import plane

from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.response.motion_estimate import MotionEstimate
from hfx_blender.engine.response_filters.controls import WIDTH, Filter, FilterKind, Operation
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
from hfx_blender.engine.tolerance import EXACT, PAPER, PREVIEW, STANDARD, Tolerance
from hfx_blender.engine.volume.analytic import Sphere
from hfx_blender.engine.volume.shape import Falloff

RADIUS_M = 0.03
DECAY_S = 0.15
SPACING_M = 0.02
SKIN = plane(SPACING_M)
MIDDLE = len(SKIN) // 2
RATES = (100, 200, 1000)
TOLERANCES = (PREVIEW, STANDARD, EXACT, PAPER)
Centre = Callable[[np.ndarray], np.ndarray]  # of the ball at times (T,), (T, 3)


# ---- the oracle -------------------------------------------------------------------------------


def oracle_weight(
    vertex: np.ndarray,
    centre: np.ndarray,
    *,
    falls: bool = False,
    by_vertex: bool = False,
    radius_m: float = RADIUS_M,
) -> float:
    """Weight of a vertex in a pattern of equal triangles: the mean over the hexagonal cell."""
    if by_vertex:
        offsets = np.zeros((1, 2))
    else:
        ticks = (np.arange(200) + 0.5) / 200.0 * 2.0 - 1.0
        offsets = SPACING_M * np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
        ways = np.radians(60.0 * np.arange(6))
        towards = offsets @ np.stack([np.cos(ways), np.sin(ways)])
        offsets = offsets[(towards <= SPACING_M / 2.0).all(axis=1)]
    places = vertex + np.concatenate([offsets, np.zeros((len(offsets), 1))], axis=1)
    gauge = np.linalg.norm(places - centre, axis=1) / radius_m
    strength = np.maximum(1.0 - gauge, 0.0) if falls else (gauge <= 1.0).astype(float)
    return float(strength.mean())


def oracle_ring(since_s: float, speed_m_s: float = 1.0) -> float:
    """Return the envelope of an impact without attack, full at 1 m/s."""
    return min(speed_m_s, 1.0) * float(np.exp(-since_s / DECAY_S)) * (since_s >= 0.0)


def oracle_strongest(
    centre: Centre,
    times: np.ndarray,
    began_s: float,
    speed_m_s: float = 1.0,
    *,
    vertex: int = MIDDLE,
    decay_s: float = DECAY_S,
    by_vertex: bool = False,
) -> float:
    """Return the largest product of envelope and weight at some times (T,)."""
    places = centre(times)
    weights = [
        oracle_weight(SKIN.vertices[vertex], place_, by_vertex=by_vertex) for place_ in places
    ]
    ring = min(speed_m_s, 1.0) * np.exp(-(times - began_s) / decay_s) * (times >= began_s)
    return float((ring * np.maximum.accumulate(weights)).max())


# ---- the engine -------------------------------------------------------------------------------


def bounce(deepest_s: float, depth_m: float, speed_m_s: float = 1.0, at: float = 0.0) -> Centre:
    """Return a ball falling on the middle vertex and rising again at constant speed."""

    def centre(times: np.ndarray) -> np.ndarray:
        height = RADIUS_M - depth_m + speed_m_s * np.abs(times - deepest_s)
        return np.stack([at + 0.0 * times, 0.0 * times, height], axis=1)

    return centre


def levels_of(
    centre: Centre,
    rate_hz: int,
    tolerance: Tolerance = STANDARD,
    *,
    falls: bool = False,
    seconds: float = 0.7,
    stack: tuple[tuple[FilterKind, Operation, tuple[float, ...]], ...] = (
        (FilterKind.IMPACT, Operation.MULTIPLY, (1.0, 0.0, DECAY_S, 1.0)),
    ),
    levels: Callable[[np.ndarray], np.ndarray] = np.ones_like,
    moves_body: bool = False,
    is_computed: bool = False,
    is_live: bool = False,
) -> np.ndarray:
    """Return level times weight of all vertices at all samples, (T, V).

    With ``is_computed`` the engine can evaluate the ball's motion between samples.
    """
    count = int(seconds * rate_hz) + 1
    times = np.arange(count) / rate_hz

    def placements(indices: np.ndarray) -> np.ndarray:
        balls = np.tile(np.diag([RADIUS_M] * 3 + [1.0]), (len(indices), 1, 1))
        if not moves_body:
            balls[:, :3, 3] = centre(indices / rate_hz)
        return balls

    matrices = placements(np.arange(count))
    to_world = np.tile(np.eye(4), (count, 1, 1))
    if moves_body:
        to_world[:, :3, 3] = -centre(times)
    controls = np.zeros((count, len(stack), WIDTH))
    for k, (_, _, values) in enumerate(stack):
        controls[:, k, : len(values)] = values
    effect = EffectBlock(
        levels(times), np.tile([10.0, 150.0], (count, 1)), matrices, (Sphere(),), response=controls
    )
    if is_computed:
        effect = replace(effect, matrices_at=placements)
    volume = HapticVolume(
        Falloff("linear", 1.0) if falls else Falloff(),
        tuple(Filter(kind, operation, rings_s=2.0) for kind, operation, _ in stack),
    )
    scene = SceneDescription(
        TimeBase(Fraction(rate_hz), Fraction(rate_hz), 0, 0, count - 1),
        (BodyDescription("anna", "Anna", SkinBinding(SKIN.bone_names)),),
        (EffectDescription("ball", "Ball", "vibration", SKIN.id, volume),),
    )
    bones = np.tile(np.eye(4)[:3], (count, len(SKIN.bone_names), 1, 1))
    pose = PoseBlock(np.ones(count, bool), to_world, bones)
    engine = Engine(scene, models=lambda _: SKIN, tolerance=tolerance)
    live_s = times if is_live else None
    block = AnimationBlock(np.arange(count), (effect,), (pose,), live_s=live_s)
    levels_by_vertex = np.zeros((count, len(SKIN)))
    for run in engine.evaluate(block):
        for index, sample in zip(run.indices.tolist(), run, strict=True):
            levels_by_vertex[index, sample.vertices] = sample.weights * sample.level
    return levels_by_vertex


# ---- rates, depths, tolerances -----------------------------------------------------------------


@pytest.mark.parametrize("tolerance", TOLERANCES, ids=lambda each: each.name)
@pytest.mark.parametrize("falls", [False, True], ids=["even", "falloff"])
@pytest.mark.parametrize("depth_m", [0.001, 0.010, 0.025])
def test_an_impact_keeps_its_depth_at_every_rate(
    depth_m: float, falls: bool, tolerance: Tolerance
) -> None:
    by_vertex = tolerance in (PAPER, PREVIEW)
    edge_m = min(tolerance.edge_m(SPACING_M), 0.0 if by_vertex else 0.005)  # the promised bound
    for share in (0.0, 0.77):  # time of the deepest point, in samples at 100 Hz
        deepest_s = 0.25 + 0.01 * share
        deepest = bounce(deepest_s, depth_m)(np.array([deepest_s]))[0]
        low, high = (
            oracle_weight(
                np.zeros(3),
                deepest,
                falls=falls,
                by_vertex=by_vertex,
                radius_m=RADIUS_M + way * edge_m,
            )
            * oracle_ring(0.3 - (deepest_s - depth_m - way * edge_m))
            for way in (-1.0, 1.0)
        )
        low, high = min(low, high), max(low, high)
        actual = [
            levels_of(bounce(deepest_s, depth_m), rate, tolerance, falls=falls, seconds=0.31)[
                round(0.3 * rate), MIDDLE
            ]
            for rate in RATES
        ]
        assert min(actual) >= 0.97 * max(actual)
        # Between samples within a tenth; the finest cells are 1 % off, and weights have 1/500.
        off = 0.02 if share == 0.0 else 0.1
        assert (
            low * (1.0 - off) - 0.002 <= min(actual) and max(actual) <= high * (1.0 + off) + 0.002
        )


def test_the_ring_is_as_strong_however_the_ball_leaves() -> None:
    """From a bug report: 4.8 m/s2 at 100 Hz, 0.09 at 200, 1.9 at 500, set by the last graze."""
    for rate in RATES:
        actual = levels_of(bounce(0.25, 0.025), rate, EXACT)[:, MIDDLE]
        times = np.arange(len(actual)) / rate
        after = times > 0.3
        np.testing.assert_allclose(
            actual[after], [oracle_ring(time - 0.225) for time in times[after]], rtol=0.01
        )


def going_in(times: np.ndarray) -> np.ndarray:
    """Contact starts at 0.2034 s, goes 11.96 mm deep at 0.4 m/s, and ends at the same speed."""
    height = RADIUS_M - 0.01196 + 0.4 * np.abs(times - 0.2333)
    return np.stack([0.004 + 0.0 * times, 0.0 * times, height], axis=1)


@pytest.mark.parametrize("decay_s", [0.003, 0.02, 0.11])
@pytest.mark.parametrize("tolerance", TOLERANCES, ids=lambda each: each.name)
def test_later_covered_vertices_peak_between_samples(tolerance: Tolerance, decay_s: float) -> None:
    """The weight rises while the envelope falls, so the strongest moment is between both ends.

    The next sample has that maximum, also at 333 Hz, for each vertex separately.
    """
    stack = ((FilterKind.IMPACT, Operation.MULTIPLY, (1.0, 0.0, decay_s, 1.0)),)
    tops = np.array(
        [
            levels_of(going_in, rate, tolerance, stack=stack, seconds=0.3).max(axis=0)
            for rate in (100, 125, 200, 333, 1000)
        ]
    )
    strong = tops.max(axis=0) > 0.02
    assert strong[MIDDLE] and (np.count_nonzero(strong) >= 3 or decay_s < 0.01)
    least, largest = tops[:, strong].min(axis=0), tops[:, strong].max(axis=0)
    assert (least >= 0.97 * largest).all()
    if tolerance in (EXACT, PAPER):
        by_vertex = tolerance is PAPER
        # The ball's lowest point touches first; the nearest vertex is 4 mm away.
        late_m = RADIUS_M - np.sqrt(RADIUS_M**2 - 0.004**2) if by_vertex else 0.0
        began_s = 0.2333 - (0.01196 - late_m) / 0.4
        times = began_s + np.linspace(0.0, min(0.033, 5.0 * decay_s), 80)
        for vertex in (MIDDLE, MIDDLE + 1):
            expected = oracle_strongest(
                *(going_in, times, began_s, 0.4),
                vertex=vertex,
                decay_s=decay_s,
                by_vertex=by_vertex,
            )
            assert tops[:, vertex] == pytest.approx(expected, rel=0.05, abs=0.003)


@pytest.mark.parametrize("start_s", [0.2353, 0.2388])
def test_skin_passed_within_a_sample_is_weighed_at_one_moment(start_s: float) -> None:
    """A ball with a falloff goes over five cells in a sample at 100 Hz. At no moment are all places
    of a cell as deep as each of them is once."""

    def passing_through(times: np.ndarray) -> np.ndarray:
        since = times - start_s
        return np.stack([10.0 * since - 0.1, 0.0 * times, RADIUS_M - since], axis=1)

    stack = ((FilterKind.IMPACT, Operation.MULTIPLY, (1.0, 0.0, 0.012, 1.0)),)
    tops = np.array(
        [
            levels_of(passing_through, rate, EXACT, falls=True, stack=stack, seconds=0.3).max(
                axis=0
            )
            for rate in RATES
        ]
    )
    # On the ball's way; cells at the edge of the patch are cut.
    x, y, _ = SKIN.vertices.T
    strong = np.flatnonzero((tops.max(axis=0) > 0.3 * tops.max()) & (y == 0.0) & (x < 0.19))
    assert len(strong) > 10
    times = start_s + np.linspace(0.0, 0.04, 160)
    for vertex in strong[::2].tolist():
        vertex_m = SKIN.vertices[vertex]
        weights = [oracle_weight(vertex_m, place, falls=True) for place in passing_through(times)]
        ring = np.exp(-(times - start_s) / 0.012)
        expected = (ring * np.maximum.accumulate(weights)).max()
        assert tops[:, vertex] == pytest.approx(expected, rel=0.02)


def test_a_touch_within_a_sample_after_a_pause_of_8_ms_is_no_new_impact() -> None:
    """Touches of 0.21 to 0.2527 s and of 0.261 to 0.269 s, 0.5 m/s each way. At 100 Hz the second
    touch has no sample, and only a search finds the end of the first touch."""

    def touching_twice(times: np.ndarray) -> np.ndarray:
        height = 0.5 * np.minimum(np.abs(times - 0.23135) - 0.02135, np.abs(times - 0.265) - 0.004)
        return np.stack([0.0 * times, 0.0 * times, RADIUS_M + height], axis=1)

    for rate in RATES:
        felt = levels_of(touching_twice, rate, PAPER, is_computed=True)[round(0.3 * rate), MIDDLE]
        assert felt == pytest.approx(oracle_ring(0.3 - 0.21, 0.5), rel=0.03)


@pytest.mark.parametrize("tolerance", [PAPER, EXACT], ids=lambda each: each.name)
def test_a_ball_in_the_skin_from_the_beginning_may_leave_it_for_a_moment(
    tolerance: Tolerance,
) -> None:
    """Away from 0.2547 to 0.2615 s: at 100 Hz only the sample at 0.26 s is untouched, and samples
    alone would have a pause of more than 10 ms."""

    def leaving(times: np.ndarray) -> np.ndarray:
        height = 0.5 * (0.0034 - np.abs(times - 0.2581))
        return np.stack([0.0 * times, 0.0 * times, RADIUS_M + np.maximum(height, -0.01)], axis=1)

    for rate in RATES:
        assert not levels_of(leaving, rate, tolerance, is_computed=True, seconds=0.3).any()


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.9])
@pytest.mark.parametrize(("pause_s", "count"), [(0.006, 1), (0.05, 2)])
def test_a_touch_that_pauses_for_less_than_10_ms_is_one_impact(
    share: float, pause_s: float, count: int
) -> None:
    away_s = 0.2505 + 0.01 * share  # end of the first contact, 30 ms after the start

    def pausing(times: np.ndarray) -> np.ndarray:
        inside = np.minimum(
            np.abs(times - away_s + 0.015), np.abs(times - away_s - pause_s - 0.015)
        )
        return np.stack([0.0 * times, 0.0 * times, RADIUS_M + 0.5 * (inside - 0.015)], axis=1)

    began = [away_s - 0.03, away_s + pause_s][:count]
    for rate in (100, 200, 333, 1000):
        actual = levels_of(pausing, rate, PAPER)[round(0.45 * rate), MIDDLE]
        expected = sum(oracle_ring(round(0.45 * rate) / rate - item, 0.5) for item in began)
        assert actual == pytest.approx(expected, rel=0.03)


def test_a_graze_between_two_samples_is_in_the_next_sample() -> None:
    # 0.505 s lies between two samples; at both, the ball is 2 mm away.
    for tolerance in TOLERANCES:
        actual = levels_of(bounce(0.505, 0.003), 100, tolerance)[:, MIDDLE]
        assert not actual[:51].any() and actual[51] > 0.4
        assert actual[60] == pytest.approx(actual[51] * oracle_ring(0.6 - 0.502), rel=0.02)
    late = bounce(0.505, -0.0005)  # turns back half a millimetre away
    assert not levels_of(late, 100, EXACT).any()


def test_a_ball_that_passes_within_a_sample_rings_from_then_on() -> None:
    def passing(times: np.ndarray) -> np.ndarray:  # 20 m/s, sideways into the plane at 0.2533 s
        return np.stack([0.0 * times, 0.0 * times, 20.0 * (0.2533 - times)], axis=1)

    entered_s = 0.2533 - RADIUS_M / 20.0
    for rate in RATES:
        actual = levels_of(passing, rate, STANDARD)[round(0.3 * rate) :, MIDDLE]
        assert actual[0] == pytest.approx(oracle_ring(0.3 - entered_s), rel=0.01)


def test_the_speed_is_that_at_the_beginning() -> None:
    def falling(times: np.ndarray) -> np.ndarray:  # 5 m/s2, from rest; contact at 0.5 m/s
        height = RADIUS_M + 0.025 - 2.5 * np.square(times - 0.1)
        return np.stack([0.0 * times, 0.0 * times, height], axis=1)

    for rate in RATES:
        actual = levels_of(falling, rate, EXACT, seconds=0.24)[round(0.21 * rate), MIDDLE]
        # The peak is 6 ms after the start: between samples at 100 Hz, at a sample for other rates.
        times = np.linspace(0.2, 0.21, 21) if rate == 100 else np.array([0.21])
        assert actual == pytest.approx(oracle_strongest(falling, times, 0.2, 0.5), rel=0.03)


# ---- places ------------------------------------------------------------------------------------


def test_two_impacts_ring_at_their_vertices() -> None:
    apart_m = 3 * SPACING_M
    far_vertex = int(np.argmin(np.linalg.norm(SKIN.vertices - [apart_m, 0.0, 0.0], axis=1)))

    def twice(times: np.ndarray) -> np.ndarray:
        first, second = bounce(0.2, 0.01)(times), bounce(0.4, 0.02, at=apart_m)(times)
        return np.where((times < 0.3)[:, None], first, second)

    for rate in (100, 1000):
        actual = levels_of(twice, rate, EXACT)[round(0.5 * rate)]
        first, second = oracle_ring(0.5 - 0.19), oracle_ring(0.5 - 0.38)
        assert actual[MIDDLE] == pytest.approx(first, rel=0.02)
        assert actual[far_vertex] == pytest.approx(first + second, rel=0.02)  # both impacts


def test_vertices_keep_peaks_of_their_own() -> None:
    def sliding(times: np.ndarray) -> np.ndarray:
        """Down at the middle vertex, 40 mm along the skin while rising, and off."""
        height = RADIUS_M - 0.012 + 0.03 * np.abs(np.clip((times - 0.2) / 0.03, -9.0, 9.0))
        height = np.where(times > 0.2, RADIUS_M - 0.012 + 0.1 * (times - 0.2), height)
        return np.stack([np.clip(times - 0.2, 0.0, 0.3) * 0.4, 0.0 * times, height], axis=1)

    times = np.arange(0.19, 0.36, 0.0002)
    expected = [
        max(oracle_weight(SKIN.vertices[v], item, falls=True, by_vertex=True)
            for item in sliding(times))
        for v in (MIDDLE, MIDDLE + 1, MIDDLE + 2)
    ]  # fmt: skip
    for rate in RATES:
        actual = levels_of(sliding, rate, PAPER, falls=True)[round(0.5 * rate)]
        ring = oracle_ring(0.5 - 0.188)
        assert actual[[MIDDLE, MIDDLE + 1, MIDDLE + 2]] / ring == pytest.approx(
            expected, rel=0.03, abs=0.003
        )


def test_a_ball_that_stays_rings_as_one_that_leaves() -> None:
    def staying(times: np.ndarray) -> np.ndarray:
        return bounce(0.25, 0.01)(np.minimum(times, 0.25))

    for rate in RATES:
        actual, left = levels_of(staying, rate, EXACT), levels_of(bounce(0.25, 0.01), rate, EXACT)
        np.testing.assert_allclose(actual[:, MIDDLE], left[:, MIDDLE], atol=0.01)


def test_skin_that_was_left_rings_on_and_does_not_stay_touched() -> None:
    """An impact added to a plain touch: half of the strength at full speed."""
    stack = (
        (FilterKind.SPEED, Operation.MULTIPLY, (0.6, 0.0, 100.0)),  # 0.4 where touched
        (FilterKind.IMPACT, Operation.ADD, (0.5, 0.0, DECAY_S, 1.0)),
    )

    def along(times: np.ndarray) -> np.ndarray:
        x = 0.3 * np.maximum(times - 0.22, 0.0)
        height = bounce(0.21, 0.01)(np.minimum(times, 0.21))[:, 2]
        return np.stack([x, 0.0 * x, height], axis=1)

    actual = levels_of(along, 100, EXACT, stack=stack)
    at = int(
        np.argmin(np.linalg.norm(SKIN.vertices - along(np.array([0.6]))[0] * [1, 0, 0], axis=1))
    )
    ring = 0.5 * oracle_ring(0.6 - 0.2)
    assert actual[60, MIDDLE] == pytest.approx(ring, rel=0.03)
    assert actual[60, at] == pytest.approx(0.4 + ring, rel=0.03)


def test_impacts_keep_the_proximity_of_their_time() -> None:
    stack = (
        (FilterKind.IMPACT, Operation.MULTIPLY, (1.0, 0.0, DECAY_S, 1.0)),
        (FilterKind.PROXIMITY, Operation.MAXIMUM, (0.3, 0.05, 1.0)),
    )
    actual = levels_of(bounce(0.2, 0.01), 100, EXACT, stack=stack)
    gone = actual[40:]  # 0.19 m away
    assert gone[0, MIDDLE] == pytest.approx(oracle_ring(0.4 - 0.19), rel=0.02)
    held = gone[0] / gone[0, MIDDLE]
    # At the deepest point, the ball is 0 m from vertices inside; else strength falls over 50 mm.
    for v in (MIDDLE, MIDDLE + 1, MIDDLE + 2):
        away_m = np.hypot(float(SKIN.vertices[v, 0]), RADIUS_M - 0.01) - RADIUS_M
        assert held[v] >= 1.0 - max(away_m, 0.0) / 0.05 - 0.01
    assert held[MIDDLE + 4] == 0.0  # 80 mm away: near only during approach and departure


def test_the_level_at_the_current_time_scales_ringing() -> None:
    def fading(times: np.ndarray) -> np.ndarray:
        return np.clip(1.0 - times, 0.0, 1.0)

    actual = levels_of(bounce(0.25, 0.025), 200, EXACT, levels=fading)
    for row in (70, 100, 120):
        since = row / 200 - 0.225
        assert actual[row, MIDDLE] == pytest.approx(
            oracle_ring(since) * (1.0 - row / 200), rel=0.01
        )


@pytest.mark.parametrize("tolerance", (STANDARD, PAPER), ids=lambda each: each.name)
def test_a_body_that_hits_a_volume_is_hit_as_well(tolerance: Tolerance) -> None:
    still = levels_of(bounce(0.2577, 0.004), 100, tolerance)
    moving = levels_of(bounce(0.2577, 0.004), 100, tolerance, moves_body=True)
    assert still.any()
    np.testing.assert_allclose(moving, still, atol=1e-3)


def test_live_only_the_beginning_is_found_between_updates() -> None:
    actual = levels_of(bounce(0.25, 0.025), 100, PAPER, is_live=True)[:, MIDDLE]
    assert actual[40] == pytest.approx(oracle_ring(0.4 - 0.225), rel=1e-3)
    # At the neighbouring updates the ball is 2 mm away; live, later updates are unknown.
    assert not levels_of(bounce(0.505, 0.003), 100, PAPER, is_live=True).any()


# ---- paths -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    [
        lambda t: 0.01 * np.abs(t - 0.5),  # a bounce at even speed
        lambda t: 0.01 * np.abs(t - 0.03),
        lambda t: 0.01 * np.abs(t - 1.0),
        lambda t: 0.01 * np.abs(t - 1.5),  # outside the interval
        lambda t: 0.01 * np.abs(t + 1.2),
        lambda t: 0.0005 * np.square(t - 0.4),  # accelerated
        lambda t: 0.01 * np.abs(t - 0.6) - 0.0005 * np.square(t - 0.6),  # a bounce in gravity
        lambda t: np.minimum(0.01 * t, 0.004),  # a stop
        lambda t: np.where(t < 0.3, 0.01 * (0.3 - t), 0.002 * (t - 0.3)),
    ],
)
def test_a_path_between_two_samples(path: Callable[[np.ndarray], np.ndarray]) -> None:
    shares = np.linspace(0.0, 1.0, 21)
    before = [path(np.array([[item]], float)) for item in (0.0, -1.0, -2.0)]
    after = [path(np.array([[value]], float)) for value in (1.0, 2.0, 3.0)]
    actual = MotionEstimate(before, after).at(shares)[:, 0, 0]
    np.testing.assert_allclose(actual, path(shares), atol=1e-9)


def test_a_path_over_a_jump_or_without_neighbours_is_straight() -> None:
    shares = np.linspace(0.0, 1.0, 5)
    at = (
        [np.array([[value]]) for value in (0.0, 0.0, 0.0)],
        [np.array([[item]]) for item in (1.0,) * 3],
    )
    for count in (1, 3):
        actual = MotionEstimate(at[0][:count], at[1][:count]).at(shares)[:, 0, 0]
        assert actual.min() >= 0.0 and actual.max() <= 1.0
    np.testing.assert_allclose(MotionEstimate(at[0][:1], at[1][:1]).at(shares)[:, 0, 0], shares)


def test_an_impact_where_no_skin_is_near_enough_to_the_centre() -> None:
    """Contact at 20 to 30 mm of the ball's centre; the filter ends at 1 mm."""
    stack = (
        (FilterKind.DISTANCE, Operation.MULTIPLY, (1.0, 0.0, 0.001, 1.0, 0.0)),
        (FilterKind.IMPACT, Operation.MULTIPLY, (1.0, 0.0, DECAY_S, 1.0)),
    )
    for rate in RATES:
        assert (levels_of(bounce(0.2037, 0.01), rate, stack=stack) == 0.0).all()
