# SPDX-License-Identifier: GPL-3.0-or-later
"""Inverses of placing matrices in exact fractions, and bounding boxes."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from volume_cases import KINDS, mesh, placing, points_in, rotation

from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import inverse_placement, world_bounds


def exact_inverse(matrix):
    """Return the inverse by Gauss-Jordan in fractions, (4, 4)."""
    rows = [
        [Fraction(x) for x in row] + [Fraction(int(i == j)) for j in range(4)]
        for i, row in enumerate(matrix.tolist())
    ]
    for k in range(4):
        pivot = next(i for i in range(k, 4) if rows[i][k] != 0)
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(4):
            if i != k:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return np.array([[float(x) for x in row[4:]] for row in rows])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", KINDS)
def test_inverse_is_the_exact_one(kind, rng):
    matrices = np.stack([placing(kind, rng) for _ in range(20)])
    inverses, usable = inverse_placement(matrices)
    assert usable.all()
    for matrix, inverse in zip(matrices, inverses, strict=True):
        exact = exact_inverse(matrix)
        # Row by row: shape coordinates are independent, with a unit each.
        error = np.abs(inverse - exact)
        scale = np.abs(exact[:3]).max(axis=1)
        assert np.all(error[:3] <= 1e-11 * scale[:, None])
        np.testing.assert_array_equal(inverse[3], [0, 0, 0, 1])


@settings(max_examples=200, deadline=None)
@given(
    exponents=st.tuples(*[st.floats(-6.0, 6.0)] * 3),
    mirrored=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_object_scales_from_1e_minus_6_to_1e6_are_usable(exponents, mirrored, seed):
    rng = np.random.default_rng(seed)
    scale = 10.0 ** np.array(exponents) * [-1.0 if mirrored else 1.0, 1.0, 1.0]
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(rng) * scale
    matrix[:3, 3] = rng.normal(size=3) * 1e6
    (inverse,), (usable,) = inverse_placement(matrix[None])
    assert usable
    product = inverse[:3, :3] @ matrix[:3, :3] * scale[:, None] / scale
    np.testing.assert_allclose(product, np.eye(3), atol=1e-12)


def test_stretch_by_parents_is_usable_along_any_axes(rng):
    for _ in range(50):
        in_world = np.diag(rng.permutation([1e6, 1.0, 1e-6])) @ rotation(rng)
        askew = rotation(rng) @ np.diag([1e5, 1.0, 1e5]) @ rotation(rng)
        matrices = np.stack([np.eye(4)] * 2)
        matrices[:, :3, :3] = in_world, askew
        inverses, usable = inverse_placement(matrices)
        assert usable.all()
        for matrix, inverse in zip(matrices, inverses, strict=True):
            exact = exact_inverse(matrix)
            np.testing.assert_allclose(inverse, exact, rtol=0, atol=1e-9 * np.abs(exact).max())


def flat(kind, rng):
    matrix = placing("plain", rng)
    linear = matrix[:3, :3]
    turn = rotation(rng)
    matrix[:3, :3] = {
        "zero": np.zeros((3, 3)),
        "no height": linear @ np.diag([1.0, 1.0, 0.0]),
        "flattened by a parent": turn @ np.diag([1.0, 1.0, 0.0]) @ linear,
        "a line": np.outer(linear[:, 0], [1.0, 2.0, 3.0]),
        "in one plane": np.stack([linear[0], linear[1], linear[0] + linear[1]]),
        "nearly in one plane": turn @ np.diag([1.0, 1.0, 1e-8]) @ linear,
    }[kind]
    return matrix


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    "kind",
    ["zero", "no height", "flattened by a parent", "a line", "in one plane", "nearly in one plane"],
)
def test_flat_matrices_are_not_usable(kind, dtype, rng):
    matrices = np.stack([flat(kind, rng).astype(dtype).astype(np.float64) for _ in range(50)])
    inverses, usable = inverse_placement(matrices)
    assert not usable.any()
    points = rng.normal(size=(3, 10))
    for inverse in inverses:
        assert not Cuboid().contains(inverse[:3, :3] @ points + inverse[:3, 3:]).any()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_bad_row_does_not_harm_the_others(bad, rng):
    matrices = np.stack([placing("plain", rng) for _ in range(12)])
    for k in range(12):
        if k % 4 != 3:
            matrices[k, k % 3, k // 3] = bad
    inverses, usable = inverse_placement(matrices)
    np.testing.assert_array_equal(usable, np.arange(12) % 4 == 3)
    assert np.isnan(inverses[~usable]).all() and np.isfinite(inverses[usable]).all()
    bounds = world_bounds(Cuboid(), matrices)
    assert np.isnan(bounds[~usable]).all() and np.isfinite(bounds[usable]).all()


@pytest.mark.filterwarnings("error")
def test_scales_at_the_ends_of_float64():
    matrices = np.stack([np.diag([s, s, s, 1.0]) for s in (1e-300, 1e300, 5e-324)])
    matrices[:, :3, 3] = 1.0
    inverses, usable = inverse_placement(matrices)
    np.testing.assert_array_equal(usable, [True, True, False])  # the last inverse overflows
    np.testing.assert_allclose(inverses[0, :3, :3], 1e300 * np.eye(3))


def test_nothing_to_invert():
    inverses, usable = inverse_placement(np.zeros((0, 4, 4)))
    assert inverses.shape == (0, 4, 4) and usable.shape == (0,)
    assert world_bounds(Sphere(), np.zeros((0, 4, 4))).shape == (0, 2, 3)


@pytest.mark.parametrize("kind", KINDS)
def test_world_bounds_hold_the_shape_and_not_much_more(kind, rng):
    shapes = [Cuboid(), Sphere(), Cylinder(), Capsule(2.0), MeshVolume(*mesh("plate", rng), "P")]
    matrices = np.stack([placing(kind, rng) for _ in range(5)])
    for shape in shapes:
        low, high = shape.bounds
        signs = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1)
        corners = np.where(signs == 1, high[:, None], low[:, None])
        local = points_in(shape.bounds, 500, rng)
        local = np.concatenate([local[:, shape.contains(local)], corners], axis=1)
        for matrix, (least, most) in zip(matrices, world_bounds(shape, matrices), strict=True):
            world = (matrix[:3, :3] @ local + matrix[:3, 3:]).T
            assert np.all(world >= least) and np.all(world <= most)
            np.testing.assert_allclose(world.min(axis=0), least, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(world.max(axis=0), most, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_world_bounds_hold_the_exact_corners(kind, rng):
    for _ in range(10):
        matrix = placing(kind, rng)
        rows = [[Fraction(x) for x in row] for row in matrix[:3].tolist()]
        ((least, most),) = world_bounds(Cuboid(), matrix[None])
        for (x, y, z, offset), low, high in zip(rows, least, most, strict=True):
            reach = abs(x) + abs(y) + abs(z)
            assert Fraction(low) <= offset - reach and offset + reach <= Fraction(high)
