# SPDX-License-Identifier: GPL-3.0-or-later
"""Micro-collisions: no texel of the path is skipped, and salient collisions come first."""

from __future__ import annotations

import numpy as np
import pytest
from gratings import uneven
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.texture import stroke as strokes
from hfx_blender.engine.texture.haptic_map import HapticMap
from hfx_blender.engine.texture.lookup import (
    crossed_texels,
    strongest_crossed,
    strongest_in_steps,
)
from hfx_blender.engine.texture.stroke import Stroke
from hfx_tools.bench.surfaces.collisions import Collisions, collisions, most_salient, trace


def _map(intensity: np.ndarray, texel: tuple[float, float] = (1e-3, 1e-3)) -> HapticMap:
    layer = np.asarray(intensity, np.float32)
    return HapticMap(layer, np.linspace(0, 1, layer.size, dtype="f4").reshape(layer.shape), texel)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 1_000_000), st.booleans())
def test_every_texel_that_a_fine_walk_meets_is_crossed(seed: int, tiles: bool) -> None:
    rng = np.random.default_rng(seed)
    shape, texel = (5, 7), (1.1, 0.6)
    ends = rng.uniform(-9.0, 9.0, (2, 4, 2))
    actual = crossed_texels(ends[0], ends[1], shape, texel, tiles)
    for k in range(4):
        share = np.linspace(0.0, 1.0, 5000)[:, None]
        walk = np.floor((ends[0, k] + share * (ends[1, k] - ends[0, k])) / texel).astype(int)
        if tiles:
            walk = walk % (7, 5)
        else:
            walk = np.clip(walk, 0, (6, 4))
        met = set((walk[:, 1] * 7 + walk[:, 0]).tolist())
        crossed = set(actual.texel[actual.segment == k].tolist())
        assert met <= crossed
        assert len(crossed - met) <= 1  # a corner stepped over by the walk
        assert np.isclose(actual.share[actual.segment == k].min(), 0.0)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 1_000_000))
def test_a_texel_is_entered_on_a_line_between_texels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape, texel = (64, 64), (1.1, 0.6)
    starts, ends = rng.uniform(1.0, 35.0, (2, 4, 2))
    actual = crossed_texels(starts, ends, shape, texel)
    way = (ends - starts)[actual.segment]
    places = (starts[actual.segment] + actual.share[:, None] * way) / texel
    to_line = np.abs(places - np.rint(places)).min(axis=1)
    np.testing.assert_allclose(to_line[actual.share > 0.0], 0.0, atol=1e-9)
    # A little farther on, the walk is inside the named texel.
    column, row = np.floor(places + 1e-9 * way / texel).astype(int).T % 64
    np.testing.assert_array_equal(actual.texel, row * 64 + column)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 1_000_000))
def test_the_strongest_on_the_way_is_the_strongest_of_all_that_are_crossed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    map_ = _map(rng.integers(0, 4, (12, 9)) / 4.0, (1.1, 0.6))  # many are equally strong
    ends = rng.uniform(-20.0, 20.0, (2, 2, 6))
    ends[1, :, 0] = ends[0, :, 0]  # a path of zero length
    level, texel = strongest_crossed(ends[0], ends[1], map_)
    actual = crossed_texels(ends[0].T, ends[1].T, (12, 9), map_.texel_m)
    for k in range(6):
        crossed = actual.texel[actual.segment == k]
        levels = map_.intensity.ravel()[crossed]
        assert level[k] == levels.max()
        assert texel[k] == crossed[levels == levels.max()].min()


def test_one_sharp_texel_between_two_pointer_samples_plays() -> None:
    intensity = np.zeros((1, 1000))
    intensity[0, 437] = 1.0
    map_ = _map(intensity, (1e-4, 1e-4))
    stroke = Stroke(np.array([0.0, 0.05]), np.array([[0.0, 5e-5], [0.0999, 5e-5]]))  # 2 m/s
    samples, sharpness = strongest_in_steps(map_, stroke, 0.01, 5)
    np.testing.assert_allclose(samples, [0.0, 0.0, 1.0, 0.0, 0.0])
    assert sharpness[2] == pytest.approx(437 / 999, abs=1e-6)


def test_steps_hold_the_strongest_texel_of_their_time() -> None:
    rng = np.random.default_rng(0)
    map_ = _map(rng.uniform(size=(20, 20)))
    stroke = uneven(strokes.line((0.0, 0.0), 0.5, 0.1, 0.1), rng, (0.01, 0.05))
    texels = trace(map_, stroke)
    samples, _ = strongest_in_steps(map_, stroke, 0.05, 20)
    for k in range(20):
        inside = (texels.times_s >= 0.05 * k) & (texels.times_s < 0.05 * (k + 1))
        entered_before = np.flatnonzero(texels.times_s < 0.05 * k)[-1:]
        expected = np.concatenate([texels.intensity[inside], texels.intensity[entered_before]])
        assert samples[k] == pytest.approx(expected.max())


def test_collisions_are_the_peaks_on_the_way() -> None:
    map_ = _map([[0.1, 0.6, 0.6, 0.2, 0.9, 0.0, 0.0, 0.3]])
    actual = collisions(
        map_, Stroke(np.array([0.0, 0.8]), np.array([[0.0, 5e-4], [7.99e-3, 5e-4]]))
    )
    np.testing.assert_allclose(actual.intensity, [0.6, 0.9, 0.3], atol=1e-6)
    assert (np.diff(actual.times_s) > 0.0).all()


def test_a_way_without_texels_has_no_collisions() -> None:
    rest = Stroke(np.array([0.0, 1.0]), np.zeros((2, 2)))
    assert len(collisions(_map(np.ones((2, 2))), rest)) == 0


def test_the_most_salient_come_first() -> None:
    times = np.array([0.0, 0.02, 0.04, 0.1, 0.12])
    actual = Collisions(times, np.array([0.5, 0.9, 0.6, 0.2, 0.3]), np.zeros(5))
    peaks = most_salient(actual, 0.05)
    np.testing.assert_array_equal(peaks.times_s, [0.02, 0.12])
    assert len(most_salient(actual, 0.0)) == 5


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40), st.floats(0.001, 0.5))
def test_dropped_collisions_are_near_a_stronger_collision(levels: list[float], gap: float) -> None:
    rng = np.random.default_rng(len(levels))
    times = np.sort(rng.uniform(0.0, 1.0, len(levels)))
    actual = Collisions(times, np.array(levels), np.zeros(len(levels)))
    peaks = most_salient(actual, gap)
    assert (np.diff(peaks.times_s) >= gap * (1.0 - 1e-6)).all()
    for t, level in zip(times, levels, strict=True):
        near = np.abs(peaks.times_s - t) < gap
        assert peaks.intensity[near].max() >= level
