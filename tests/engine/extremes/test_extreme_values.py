# SPDX-License-Identifier: GPL-3.0-or-later
"""Non-finite and huge input values: silence at the affected places, correct results elsewhere."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from extreme_cases import SHAPES, body_of, feel, person, still, volume
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body.model import SkinWeights
from hfx_blender.engine.scene import PoseBlock, SurfaceAnchors, SurfaceBinding
from hfx_blender.engine.volume.shape import Falloff, FalloffKind

TIMES = 6
BONES = ("root", "arm")
LARGEST = float(np.finfo(np.float32).max)  # all numbers of Blender's are of 32 bits
BAD = (np.nan, np.inf, -np.inf, LARGEST, -LARGEST)
FALLOFFS = (Falloff(), Falloff(FalloffKind.SMOOTH, 0.5))


def two_boned() -> object:
    rng = np.random.default_rng(5)
    points = rng.uniform((-0.3, -0.15, 0.0), (0.3, 0.15, 1.8), (200, 3))
    weights = SkinWeights(
        np.arange(0, 401, 2, dtype=np.int32),
        np.tile(np.array([0, 1], np.int32), 200),
        np.tile(np.array([0.75, 0.25], np.float32), 200),
    )
    return body_of(points, BONES, weights)


MODEL = two_boned()


def placed() -> np.ndarray:
    matrices = np.tile(np.diag([0.4, 0.4, 0.4, 1.0]), (TIMES, 1, 1))
    matrices[:, 2, 3] = 0.9
    return matrices


def animated(where: str) -> tuple[object, object, np.ndarray]:
    """Return valid values, and the array to be broken."""
    effect, pose = volume(placed(), SHAPES["sphere"]), still(TIMES, 2)
    owner = pose if where in ("to_world", "bones") else effect
    return effect, pose, getattr(owner, where)


ALL = ("positions", "velocities", "depth")


@pytest.mark.parametrize("record", [(), ALL])
@pytest.mark.parametrize("where", ["levels", "parameters", "matrices", "to_world", "bones"])
@settings(max_examples=12, deadline=None)
@given(
    value=st.sampled_from(BAD),
    row=st.integers(0, TIMES - 1),
    position=st.integers(0, 10**6),
    falloff=st.sampled_from(FALLOFFS),
)
def test_one_value_that_is_no_number(where, record, value, row, position, falloff):
    """Affects only the sample's own time: no NaN in the result, and one warning at most."""
    sound = feel(MODEL, *animated(where)[:2], falloff=falloff, record=record)
    effect, pose, array = animated(where)
    entries = array[row].size
    if where in ("matrices", "to_world"):
        entries = 12  # the last row is 0, 0, 0, 1 by definition
    array.reshape(TIMES, -1)[row, position % entries] = value
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        samples = feel(MODEL, effect, pose, falloff=falloff, record=record)
    others = np.arange(TIMES) != row
    np.testing.assert_array_equal(samples.weights[0, others], sound.weights[0, others])
    assert sound.weights[0].any()
    for run in samples.runs:
        for column in (run.positions, run.depth_m, run.levels, run.parameters, run.weights):
            assert column is None or np.isfinite(column).all()
    assert len(samples.warnings) <= 1 + ("bones" in where)
    if not np.isfinite(value):
        assert not samples.weights[0, row].any()
        assert list(samples.warnings.values()) == [1]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize("where", ["levels", "parameters", "matrices", "to_world", "bones"])
def test_nothing_but_values_that_are_no_numbers(where, value):
    effect, pose, array = animated(where)
    array[...] = value
    samples = feel(MODEL, effect, pose)
    assert np.isfinite(samples.weights).all()
    if not np.isfinite(value):
        assert samples.runs == [] and list(samples.warnings.values()) == [TIMES]


@pytest.mark.filterwarnings("error")
def test_rows_that_are_off_may_hold_anything():
    effect, pose, _ = animated("levels")
    effect.levels[[1, 4]] = 0.0
    for array in (effect.parameters, effect.matrices, pose.to_world, pose.bones):
        array[[1, 4]] = np.nan
    pose = replace(pose, valid=np.array([True, False, True, True, False, True]))
    samples = feel(MODEL, effect, pose)
    assert samples.warnings in (
        {},
        {"effect 'v0': a value is not a finite number; it is silent there": 2},
    )
    assert samples.weights[0].any(axis=1).tolist() == [True, False, True, True, False, True]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("level", [1e-300, 5e-324, 1e308, np.finfo(float).max])
def test_levels_of_any_size(level):
    effect, pose, _ = animated("levels")
    effect.levels[:] = level
    samples = feel(MODEL, effect, pose)
    assert all(0.0 < run.levels.min() and run.levels.max() <= 1.0 for run in samples.runs)


@pytest.mark.filterwarnings("error")
def test_each_broken_volume_is_reported_once(rng):
    model = person(rng, 100)
    effects = []
    for k in range(40):
        matrices = placed()
        matrices[k % TIMES, k % 3, k % 4] = BAD[k % 3]
        effects.append(volume(matrices, SHAPES["cuboid"]))
    samples = feel(model, effects)
    assert list(samples.warnings.values()) == [1] * 40
    assert np.count_nonzero(samples.weights.any(axis=2)) == 40 * (TIMES - 1)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_surface_with_a_vertex_that_is_nowhere(value):
    """A body bound to an avatar's mesh, with a degenerate triangle."""
    corners = np.array([[0, 1, 2], [0, 2, 3], [3, 3, 3]], np.int32)
    anchors = SurfaceAnchors(corners, np.full((3, 3), 1 / 3), np.array([0.01, 0.0, 0.5]))
    surface = np.tile(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32), (4, 1, 1))
    surface[2, 1, 0] = value
    pose = PoseBlock(np.ones(4, bool), np.tile(np.eye(4), (4, 1, 1)), surface=surface)
    everywhere = np.tile(np.diag([9.0, 9.0, 9.0, 1.0]), (4, 1, 1))
    samples = feel(
        body_of(np.zeros((3, 3))),
        volume(everywhere, SHAPES["sphere"]),
        pose,
        binding=SurfaceBinding({"extreme": anchors}, "a test"),
        record=("positions", "velocities", "depth"),
    )
    assert samples.weights[0].all(axis=1).tolist() == [True, True, False, True]
    assert list(samples.warnings.values()) == [1]
    for run in samples.runs:
        assert np.isfinite(run.positions).all() and np.isfinite(run.velocities).all()
