# SPDX-License-Identifier: GPL-3.0-or-later
"""Feet of normals against the roots of Eberly's polynomial, including singular cases."""

import itertools

import numpy as np
import pytest
from volume_cases import rotation

from hfx_blender.engine.volume.analytic import Ellipsoid


def all_feet(semi_axes, point):
    """Feet of all normals from ``point``, in the principal frame: a polynomial's roots.

    sum_i (s_i y_i)^2 prod_{j != i} (t + s_j^2)^2 = prod_j (t + s_j^2)^2
    """
    squares = semi_axes**2
    factors = [np.poly1d([1.0, square]) ** 2 for square in squares]
    whole = np.poly1d([1.0])
    for factor in factors:
        whole = whole * factor
    for i, (square, y) in enumerate(zip(squares, point, strict=True)):
        part = np.poly1d([square * y * y])
        for j, factor in enumerate(factors):
            if j != i:
                part = part * factor
        whole = whole - part
    real = [root.real for root in whole.roots if abs(root.imag) < 1e-7 * (1 + abs(root))]
    return np.array([squares * point / (t + squares) for t in real])


@pytest.mark.parametrize(
    "semi_axes", [(2.0, 1.0), (5.0, 4.0, 3.0), (3.0, 1.1, 1.0), (9.0, 8.0, 1.0)]
)
def test_depth_is_the_least_of_all_feet(semi_axes, rng):
    semi_axes = np.array(semi_axes)
    ball = rng.normal(size=(len(semi_axes), 300))
    ball *= rng.random(300) / np.linalg.norm(ball, axis=0)
    ellipsoid = Ellipsoid.of_map(np.diag(semi_axes))
    expected = []
    for point in ball.T:
        surface_point = semi_axes * point
        expected.append(
            np.linalg.norm(all_feet(semi_axes, surface_point) - surface_point, axis=1).min()
        )
    np.testing.assert_allclose(ellipsoid.depth(ball), expected, rtol=1e-6)


@pytest.mark.parametrize("semi_axes", [(5.0, 4.0, 3.0), (3.0, 1.1, 1.0), (9.0, 8.0, 1.0)])
def test_local_feet_are_all_local_minima(semi_axes, rng):
    """A foot is a local minimum if every curvature is flatter than the circle around the point."""
    semi_axes = np.array(semi_axes)
    ball = rng.normal(size=(3, 200))
    ball *= 1.3 * rng.random(200) / np.linalg.norm(ball, axis=0)  # some outside
    linear = rotation(rng) @ np.diag(semi_axes) @ rotation(rng)
    ellipsoid = Ellipsoid.of_map(linear)
    (first, near), (second, far) = ellipsoid.local_feet(ball)
    assert np.isfinite(near).all() and np.isfinite(far).any() and not np.isfinite(far).all()
    assert np.all(near <= far * (1 + 1e-12))
    for feet, distances in ((first, near), (second, far)):
        actual = np.isfinite(distances)
        reach = linear @ (feet - ball)
        np.testing.assert_allclose(np.linalg.norm(feet, axis=0)[actual], 1.0, rtol=1e-9)
        np.testing.assert_allclose(
            np.linalg.norm(reach, axis=0)[actual], distances[actual], rtol=1e-9, atol=1e-12
        )
        # A small move of the foot along the sphere never shortens the distance.
        for _ in range(40):
            moved = feet + 1e-4 * rng.normal(size=feet.shape)
            moved /= np.linalg.norm(moved, axis=0)
            away = np.linalg.norm(linear @ (moved - ball), axis=0)
            assert np.all(away[actual] >= distances[actual] * (1 - 1e-9))


def test_points_on_axes_and_planes_of_symmetry():
    semi_axes = np.array([3.0, 2.0, 1.0])
    ellipsoid = Ellipsoid.of_map(np.diag(semi_axes))
    shares = (0.0, 1e-300, 1e-12, 0.3, 8 / 9, 0.95, 1.0)
    points = np.array([p for p in itertools.product(shares, repeat=3) if np.dot(p, p) <= 1.0]).T
    depths = ellipsoid.depth(points)
    # Twin: the nearest of many points of the octant, too far by at most a step squared.
    u, v = np.meshgrid(np.linspace(0, 1, 700), np.linspace(0, np.pi / 2, 700))
    surface = np.stack([np.sqrt(1 - u * u) * np.cos(v), np.sqrt(1 - u * u) * np.sin(v), u])
    surface = semi_axes[:, None] * surface.reshape(3, -1)
    places = semi_axes[:, None] * points
    for point, depth in zip(places.T, depths, strict=True):
        nearest = np.sqrt(np.min(np.sum((surface - point[:, None]) ** 2, axis=0)))
        assert nearest - 0.005 < depth <= nearest + 1e-12


@pytest.mark.parametrize("ratio", [1.0, 1 + 1e-15, 1 + 1e-9, 240.0, 1e6])
def test_degenerate_ratios(ratio, rng):
    ellipsoid = Ellipsoid.of_map(np.diag([ratio, ratio, 1.0]))
    assert ellipsoid.depth(np.zeros((3, 1)))[0] == pytest.approx(1.0, rel=1e-12)
    heights = np.array([0.0, 1e-9, 0.5, 0.999, 1.0])
    points = np.stack([np.zeros(5), np.zeros(5), heights])
    np.testing.assert_allclose(ellipsoid.depth(points), 1.0 - heights, atol=1e-12)
