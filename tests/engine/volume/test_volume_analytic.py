# SPDX-License-Identifier: GPL-3.0-or-later
"""Cuboid, sphere, cylinder and capsule against independent slow formulas."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from volume_cases import KINDS, placing, points_in, rotation

from hfx_blender.engine.reference import shapes as reference
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.shape import inverse_placement

SHAPES = {
    "cuboid": Cuboid(),
    "sphere": Sphere(),
    "cylinder": Cylinder(),
    "ball as capsule": Capsule(0.0),
    "capsule": Capsule(0.7),
    "long capsule": Capsule(30.0),
}


CAPS = [[(0, 0, z), (1, 0, z), (0, 1, z)] for z in (-1, 1)]
WALLS = [[p[k:] + p[:k] for p in face] for face in CAPS for k in (1, 2)]
FLAT_FACES = {Cuboid: CAPS + WALLS, Cylinder: CAPS}  # three points of each


def gauge(shape, x, y, z):
    """Return the signed distance of a point past the boundary, in shape space; plain Python."""
    if isinstance(shape, Cuboid):
        return max(abs(x), abs(y), abs(z)) - 1.0
    if isinstance(shape, Sphere):
        return math.dist((x, y, z), (0.0, 0.0, 0.0)) - 1.0
    if isinstance(shape, Cylinder):
        return max(math.hypot(x, y), abs(z)) - 1.0
    nearest = min(max(z, -shape.half_segment), shape.half_segment)
    return math.dist((x, y, z), (0.0, 0.0, nearest)) - 1.0


def support(shape, directions):
    """Return the support function in shape space for directions (n, 3), (n,)."""
    if isinstance(shape, Cuboid):
        return np.abs(directions).sum(axis=1)
    if isinstance(shape, Sphere):
        return np.linalg.norm(directions, axis=1)
    if isinstance(shape, Cylinder):
        return np.linalg.norm(directions[:, :2], axis=1) + np.abs(directions[:, 2])
    return np.linalg.norm(directions, axis=1) + shape.half_segment * np.abs(directions[:, 2])


def slow_depth(shape, linear, point, rng):
    """Depth in a convex solid: the nearest supporting plane, found by search.

    The plane with the unit normal n is at h(L^T n) from the centre, h the support function.
    Directions spread evenly in the world and in shape space, then the best are refined.
    """
    to_normal = np.linalg.inv(linear).T
    normals = np.concatenate([rng.normal(size=(8000, 3)), rng.normal(size=(8000, 3)) @ to_normal.T])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    depths = support(shape, normals @ linear) - normals @ (linear @ point)
    best = depths.min()

    def share(direction):
        normal = to_normal @ direction
        normal = normal / np.linalg.norm(normal)
        return (support(shape, (normal @ linear)[None])[0] - normal @ linear @ point) / best

    depth = best
    for k in np.argsort(depths)[:2]:
        start = normals[k] @ linear
        result = minimize(
            share,
            start / np.linalg.norm(start),
            method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 800},
        )
        depth = min(depth, result.fun * best)
    for face in FLAT_FACES.get(type(shape), ()):  # kinks of h, where a simplex may stick
        a, b, c = (linear @ corner for corner in np.array(face, np.float64))
        normal = np.cross((b - a) / np.linalg.norm(b - a), (c - a) / np.linalg.norm(c - a))
        depth = min(depth, abs(normal @ (linear @ point - a)) / np.linalg.norm(normal))
    return depth


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("kind", KINDS)
def test_inside_agrees_with_a_slow_formula_through_the_placing_matrix(name, kind, rng):
    shape = SHAPES[name]
    for _ in range(4):
        matrix = placing(kind, rng)
        local = points_in(shape.bounds, 400, rng)
        world = matrix[:3, :3] @ local + matrix[:3, 3:]
        (inverse,), (usable,) = inverse_placement(matrix[None])
        assert usable
        inside = shape.contains(inverse[:3, :3] @ world + inverse[:3, 3:])
        way = np.array([gauge(shape, *point) for point in local.T.tolist()])
        # A world coordinate is a multiple of 2^-53 of the coordinate's size, for any size of shape.
        smallest = np.linalg.svd(matrix[:3, :3], compute_uv=False)[2]
        unsure = 1e-9 + 4e-16 * np.abs(world).max() / smallest
        sure = np.abs(way) > unsure
        assert np.count_nonzero(sure) > 300
        np.testing.assert_array_equal(inside[sure], way[sure] < 0.0)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("kind", KINDS)
def test_depth_is_that_of_the_nearest_supporting_plane(name, kind, rng):
    shape = SHAPES[name]
    matrix = placing(kind, rng)
    local = points_in(shape.bounds, 200, rng)
    local[:, 0], local[:2, 1], local[2, 2] = (
        0.0,
        0.0,
        0.0,
    )  # centre, axis, middle plane
    local = local[:, shape.contains(local)][:, :6]
    expected = [slow_depth(shape, matrix[:3, :3], point, rng) for point in local.T]
    depths = shape.depth_m(local, matrix)
    # The search may stop early, never too low; noise grows with the ratio of the axes.
    noise, early = (1e-4, 1e-4) if kind == "mixed" else (1e-9, 1e-5)
    assert np.all(depths <= np.array(expected) * (1.0 + noise))
    np.testing.assert_allclose(depths, expected, rtol=early)


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(list(SHAPES)),
    kind=st.sampled_from(KINDS),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_ball_of_the_depth_fits_inside(name, kind, seed):
    rng = np.random.default_rng(seed)
    shape, matrix = SHAPES[name], placing(kind, rng)
    local = points_in(shape.bounds, 20, rng)
    local = local[:, shape.contains(local)]
    depths = shape.depth_m(local, matrix)
    assert np.all(depths > 0.0)
    directions = rng.normal(size=(3, 500))
    directions /= np.linalg.norm(directions, axis=0)
    steps = np.linalg.solve(matrix[:3, :3], directions)
    for point, depth in zip(local.T, depths, strict=True):
        assert np.all(shape.contains(point[:, None] + (1.0 - 1e-6) * depth * steps))


def diagonal(*scale):
    return np.diag([*scale, 1.0])


@pytest.mark.parametrize(
    ("shape", "matrix", "point", "depth"),
    [
        (Cuboid(), diagonal(2, 3, 4), (0, 0, 0), 2.0),
        (Cuboid(), diagonal(2, 3, 4), (0.5, 0, -0.9), 0.4),
        # A cuboid sheared by 45 degrees has walls at 1/sqrt(2) from the centre.
        (Cuboid(), np.array([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]),
         (0, 0, 0), math.sqrt(0.5)),
        (Sphere(), diagonal(2, 2, 2), (0.5, 0, 0), 1.0),
        (Sphere(), diagonal(5, 4, 3), (0, 0, 0), 3.0),
        (Sphere(), diagonal(5, 4, 3), (0, 0, 0.9), 0.3),
        # Ellipse a=2, b=1, at (1, 0): foot at x = 4/3, distance sqrt(1/9 + 5/9).
        (Sphere(), diagonal(2, 1, 1), (0.5, 0, 0), math.sqrt(6) / 3),
        # The end of the long axis beyond the centre of curvature, 2 - 1/2.
        (Sphere(), diagonal(2, 1, 1), (0.9, 0, 0), 0.2),
        (Cylinder(), diagonal(1, 1, 3), (0.25, 0, 0.9), 0.3),
        (Cylinder(), diagonal(1, 1, 3), (0.8, 0, 0.9), 0.2),
        (Cylinder(), diagonal(2, 1, 9), (0.5, 0, 0), math.sqrt(6) / 3),
        (Capsule(2.0), diagonal(0.5, 0.5, 0.5), (0.5, 0, 1.9), 0.25),
        (Capsule(2.0), diagonal(0.5, 0.5, 0.5), (0, 0, 2.75), 0.125),
        # Flattened along the axis: the cap above is nearest, not the side.
        (Capsule(1.0), diagonal(1, 1, 0.1), (0, 0, 0.5), 0.15),
    ],
)  # fmt: skip
def test_depth_by_hand(shape, matrix, point, depth):
    points = np.array(point, np.float64)[:, None]
    assert shape.depth_m(points, matrix)[0] == pytest.approx(depth, rel=1e-14)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e6])
def test_depth_scales_and_ignores_where_the_shape_stands(name, scale, rng):
    shape, matrix = SHAPES[name], placing("sheared", rng)
    local = points_in(shape.bounds, 100, rng)
    moved = matrix.copy()
    moved[:3, :3] = scale * rotation(rng) @ np.diag([1.0, -1.0, 1.0]) @ matrix[:3, :3]
    moved[:3, 3] = 1e6
    np.testing.assert_allclose(
        shape.depth_m(local, moved), scale * shape.depth_m(local, matrix), rtol=1e-9, atol=0
    )


def test_capsule_under_a_similarity_is_one_minus_the_distance_to_its_segment(rng):
    shape, matrix = Capsule(1.3), placing("plain", rng)
    local = points_in(shape.bounds, 500, rng)
    scale = np.linalg.norm(matrix[:3, 0])
    expected = [scale * max(-gauge(shape, *point), 0.0) for point in local.T.tolist()]
    np.testing.assert_allclose(shape.depth_m(local, matrix), expected, atol=1e-13 * scale)


def test_capsule_of_a_given_size():
    radius, height = 0.05, 0.4
    shape = Capsule(0.5 * height / radius - 1.0)
    tip, waist = np.array([0, 0, 0.5 * height]) / radius, np.array([radius, 0, 0.1]) / radius
    points = np.stack([tip, waist], axis=1)
    assert np.all(shape.contains(points * (1 - 1e-12)))
    assert not np.any(shape.contains(points * (1 + 1e-12)))
    placed = np.diag([radius, radius, radius, 1.0])
    assert shape.depth_m(np.zeros((3, 1)), placed)[0] == pytest.approx(radius, rel=1e-14)


@pytest.mark.parametrize("half", [-0.1, math.nan, math.inf])
def test_capsule_refuses_an_impossible_segment(half):
    with pytest.raises(ValueError, match="half_segment"):
        Capsule(half)


@pytest.mark.parametrize(
    ("shape", "point", "rise"),
    [
        (Cuboid(), (0, 0, 0), 1.0),
        (Cuboid(), (0.25, -0.5, 0.1), 0.5),
        (Cuboid(), (1, 0.3, -1), 0.0),
        (Sphere(), (0, 0, 0), 1.0),
        (Sphere(), (0.6, 0, 0.0), 0.4),
        (Sphere(), (0, 1, 0), 0.0),
        (Cylinder(), (0.3, 0.4, 0.1), 0.5),
        (Cylinder(), (0.3, 0.4, -0.75), 0.25),
        (Capsule(2.0), (0, 0, 2), 1.0),
        (Capsule(2.0), (0.5, 0, 1), 0.5),
        (Capsule(2.0), (0, 0, -2.75), 0.25),
        (Capsule(2.0), (0, 0, 4), 0.0),
    ],
)
def test_rise_by_hand(shape, point, rise):
    actual = reference.rise(shape, np.array(point, np.float64)[:, None])
    assert actual[0] == pytest.approx(rise, abs=1e-15)


@pytest.mark.parametrize("name", SHAPES)
def test_rise_is_positive_exactly_inside(name, rng):
    shape = SHAPES[name]
    points = points_in(shape.bounds, 2000, rng)
    rise = reference.rise(shape, points)
    np.testing.assert_array_equal(rise > 0.0, shape.contains(points))
    assert rise.max() <= 1.0
    low, high = shape.bounds
    inside = points[:, shape.contains(points)].T
    assert np.all((inside >= low) & (inside <= high))


@pytest.mark.parametrize("name", SHAPES)
def test_boundary_belongs_to_the_solid(name):
    shape = SHAPES[name]
    top = shape.bounds[1, 2]
    points = np.array([[1, 0, 0], [0, -1, 0], [0, 0, top], [0, 0, -top]], np.float64).T
    assert np.all(shape.contains(points))
    np.testing.assert_array_equal(reference.rise(shape, points), 0.0)
    np.testing.assert_allclose(shape.depth_m(points, np.eye(4)), 0.0, atol=1e-15)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", SHAPES)
def test_points_that_are_no_numbers_are_outside(name):
    shape = SHAPES[name]
    bad = [np.nan, np.inf, -np.inf, 1e300, -1e308]
    points = np.array(
        [[b if k == axis else 0.0 for k in range(3)] for b in bad for axis in range(3)]
    )
    points = np.concatenate([points, np.full((1, 3), np.nan), [[np.inf, -np.inf, np.nan]]]).T
    matrix = diagonal(1, 2, 3)
    assert not shape.contains(points).any()
    np.testing.assert_array_equal(shape.depth_m(points, matrix), 0.0)
    nothing = np.zeros((3, 0))
    for result in (shape.contains(nothing), shape.depth_m(nothing, matrix)):
        assert result.shape == (0,)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", SHAPES)
def test_depth_in_a_squashed_shape_is_zero(name, rng):
    shape = SHAPES[name]
    points = points_in(shape.bounds, 50, rng)
    for flat in (diagonal(0, 1, 1), diagonal(1, 1, 0), diagonal(0, 0, 0)):
        np.testing.assert_allclose(shape.depth_m(points, flat), 0.0, atol=1e-15)
