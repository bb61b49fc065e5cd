# SPDX-License-Identifier: GPL-3.0-or-later
"""Contacts agree with exact fractions: far away, tiny, huge, stretched, sheared, mirrored."""

from __future__ import annotations

import numpy as np
import pytest
from extreme_cases import SHAPES, exact_ways, feel, moved, person, still, volume
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.volume.shape import Falloff, FalloffKind

EPS = np.finfo(np.float64).eps


def turn(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def affine(linear: np.ndarray, centre: np.ndarray | tuple[float, ...] = (0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = centre
    return matrix


def assert_exact(name, matrix, to_world, model, least_judged=0.9):
    """Check contacts of a body placed by ``to_world`` against rational arithmetic.

    Vertices with world coordinates within float64 rounding of the boundary are not judged.
    """
    shape = SHAPES[name]
    samples = feel(model, volume(matrix[None], shape), moved(still(1), to_world))
    ways = exact_ways(shape, matrix, to_world, model.vertices)
    smallest = np.linalg.svd(matrix[:3, :3], compute_uv=False)[2]
    size = np.abs(matrix[:3]).max() + np.abs(to_world[:3]).max() * (
        1 + np.abs(model.vertices).max()
    )
    band = 64 * EPS * size / smallest + 1e-12
    sure = np.abs(ways) > band * (1 + np.abs(ways))
    assert np.mean(sure) >= least_judged
    is_inside = samples.weights[0, 0] > 0.0
    np.testing.assert_array_equal(is_inside[sure], ways[sure] < 0.0)
    is_point = not np.any(to_world[:3, :3])
    assert len(samples.warnings) == is_point, "a body of no size is told of, and nothing else"
    return is_inside


@pytest.mark.parametrize("distance_m", [1e-6, 1e-3, 1.0, 1e3, 1e5, 1e6, 1e7])
@pytest.mark.parametrize("name", SHAPES)
def test_contacts_at_any_distance_from_the_origin(name, distance_m, rng):
    model = person(rng)
    away = distance_m * turn(rng)[0]
    spin = turn(rng)
    to_world = affine(spin, away)
    around = affine(turn(rng) @ np.diag([0.3, 0.4, 0.5]), away + spin @ (0.0, 0.0, 0.9))
    samples = assert_exact(name, around, to_world, model)
    assert 8 < np.count_nonzero(samples) < len(samples)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("name", SHAPES)
def test_objects_of_any_scale(name, scale, rng):
    """Body and volume have the same scale, as below a common parent."""
    model = person(rng)
    to_world = affine(scale * turn(rng), scale * rng.normal(size=3))
    around = to_world @ affine(turn(rng) * 0.5, (0.0, 0.0, 0.9))
    samples = assert_exact(name, around, to_world, model)
    assert 8 < np.count_nonzero(samples) < len(samples)


@pytest.mark.parametrize("scale", [1e-6, 1e-4, 1e4, 1e6])
@pytest.mark.parametrize("name", SHAPES)
def test_volumes_of_any_scale_on_a_person(name, scale, rng):
    """A speck on a vertex touches only that vertex; a world-sized volume touches the whole body."""
    model = person(rng)
    centre = model.vertices[7].astype(np.float64) if scale < 1.0 else np.zeros(3)
    samples = assert_exact(name, affine(turn(rng) * scale, centre), np.eye(4), model)
    expected = [7] if scale < 1.0 else list(range(len(model)))
    assert np.flatnonzero(samples).tolist() == expected


KINDS = {
    "sheared": lambda rng: np.array([[1.0, 1.5, -0.7], [0.0, 1.0, 2.0], [0.0, 0.0, 1.0]]),
    "mirrored": lambda rng: np.diag([-1.0, 1.0, 1.0]),
    "turned inside out": lambda rng: -np.eye(3),
    "240 to 1": lambda rng: np.diag(rng.permutation([24.0, 0.1, 0.1])),
    "1 to 240": lambda rng: np.diag(rng.permutation([24.0, 24.0, 0.1])),
    "stretched by a turned parent": lambda rng: np.diag([24.0, 0.1, 1.0]) @ turn(rng),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SHAPES)
def test_stretched_sheared_and_mirrored_volumes(name, kind, rng):
    model = person(rng)
    linear = turn(rng) @ KINDS[kind](rng) * 0.4
    samples = assert_exact(name, affine(linear, (0.0, 0.0, 0.9)), np.eye(4), model)
    assert samples.any() and not samples.all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SHAPES)
def test_stretched_sheared_and_mirrored_bodies(name, kind, rng):
    model = person(rng)
    to_world = affine(turn(rng) @ KINDS[kind](rng), rng.normal(size=3))
    middle = to_world[:3, :3] @ (0.0, 0.0, 0.9) + to_world[:3, 3]
    samples = assert_exact(name, affine(0.4 * turn(rng), middle), to_world, model)
    assert not samples.all()


FLAT = {
    "zero": np.zeros((3, 3)),
    "a plane": np.diag([1.0, 1.0, 0.0]),
    "a line": np.diag([0.0, 1.0, 0.0]),
    "axes in one plane": np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]]),
    "axes nearly in one plane": np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1e-9]]),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", FLAT)
@pytest.mark.parametrize("name", SHAPES)
def test_a_flat_volume_is_silent_with_one_counted_warning(name, kind, rng):
    model = person(rng)
    matrices = np.tile(affine(turn(rng) @ FLAT[kind], (0.0, 0.0, 0.9)), (5, 1, 1))
    matrices[3] = affine(np.eye(3) * 0.5, (0.0, 0.0, 0.9))
    samples = feel(model, volume(matrices, SHAPES[name]))
    is_touched = samples.weights[0].any(axis=1)
    assert is_touched.tolist() == [False, False, False, True, False]
    assert list(samples.warnings.values()) == [4]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", FLAT)
@pytest.mark.parametrize("name", SHAPES)
def test_a_flat_body_has_contacts_at_its_vertices(name, kind, rng):
    """A body squashed into a plane has well-defined positions."""
    model = person(rng, 150)
    to_world = affine(turn(rng) @ FLAT[kind], (0.5, -0.25, 2.0))
    around = affine(turn(rng) * 0.7, to_world[:3, :3] @ (0.0, 0.0, 0.9) + to_world[:3, 3])
    assert_exact(name, around, to_world, model)


@settings(max_examples=40, deadline=None)
@given(
    name=st.sampled_from(list(SHAPES)),
    distance=st.floats(-6.0, 7.0),
    scale=st.floats(-6.0, 6.0),
    stretch=st.floats(0.0, 2.38),  # up to 240 : 1
    shear=st.floats(-2.0, 2.0),
    mirrored=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_combination(name, distance, scale, stretch, shear, mirrored, seed):
    rng = np.random.default_rng(seed)
    model = person(rng, 60)
    linear = np.diag([10.0**stretch, -1.0 if mirrored else 1.0, 1.0])
    linear[0, 1] = shear
    unit = 10.0**scale
    away = 10.0**distance * turn(rng)[0]
    to_world = affine(unit * turn(rng), away)
    middle = to_world[:3, :3] @ model.vertices[0].astype(np.float64) + away
    around = affine(unit * 0.3 * turn(rng) @ linear @ turn(rng), middle)
    # For a body smaller than the rounding of the position, no vertex is judged.
    assert_exact(name, around, to_world, model, least_judged=0.0)


@pytest.mark.parametrize("distance_m", [1e-6, 1.0, 1e4, 1e7])
def test_falloff_does_not_depend_on_the_place(distance_m, rng):
    model = person(rng)
    falloff = Falloff(FalloffKind.SMOOTH, 0.8)
    away = distance_m * turn(rng)[0]
    for name, shape in SHAPES.items():
        around = affine(np.diag([0.4, 0.3, 0.6]), (0.0, 0.0, 0.9))
        here = feel(model, volume(around[None], shape), falloff=falloff)
        there = affine(np.eye(3), away)
        samples = feel(
            model, volume((there @ around)[None], shape), moved(still(1), there), falloff=falloff
        )
        band = 1e-6 + 40 * EPS * distance_m
        assert np.abs(samples.weights - here.weights).max() < band, name
