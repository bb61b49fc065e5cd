# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh distances, surface crossings and clearance: compiled code, numpy and libigl agree."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_twins import MESHES, needs_library, probes, twins
from triangle_frames import exact_distances

from hfx_blender.engine.reference import sweep as reference
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.mesh_distance import TriangleTree
from hfx_tools.bench.volumes import clearances, passages

pytestmark = needs_library


def finite(points: np.ndarray) -> np.ndarray:
    largest = np.abs(points[:, :100]).max()
    return points[:, np.isfinite(points).all(axis=0) & (np.abs(points) <= 2 * largest).all(axis=0)]


@pytest.mark.parametrize("name", MESHES)
def test_the_distances_are_those_of_a_comparison_with_all_triangles(name: str) -> None:
    vertices, triangles = MESHES[name]
    compiled, plain = twins(vertices, triangles)
    points = finite(probes(vertices, triangles, 100))
    size = np.ptp(vertices, axis=0).max()
    linear = np.array([[1.0, 0.5, 0.0], [0.0, -2.0, 0.3], [0.1, 0.0, 0.7]])
    middle = compiled.bounds.mean(axis=0)
    for matrix in (np.eye(3), linear):
        corners = (compiled.corners - middle) @ matrix.T
        expected = exact_distances(corners, matrix @ (points - middle[:, None]))
        actual = compiled.surface_distance_m(points, matrix)
        np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-15 * size)
        # Without the library, barycentric coordinates of slivers lose half of the digits.
        actual = plain.surface_distance_m(points, matrix)
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=2e-7 * size)
    np.testing.assert_allclose(compiled.core_radius, plain.core_radius, rtol=5e-3, atol=2e-8 * size)
    assert compiled.core_radius > 0.0


@pytest.mark.parametrize("name", ["a torus", "rough", "cuts through itself", "slivers", "a box"])
def test_libigl_finds_the_same_distances(name: str) -> None:
    vertices, triangles = MESHES[name]
    compiled, _ = twins(vertices, triangles)
    points = finite(probes(vertices, triangles))
    squared = igl.point_mesh_squared_distance(points.T, vertices, triangles.astype(np.int64))[0]
    distance_m = compiled.surface_distance_m(points, np.eye(3))
    np.testing.assert_allclose(distance_m, np.sqrt(squared), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 9])
def test_trees_of_a_few_triangles(count: int) -> None:
    rng = np.random.default_rng(count)
    corners = rng.normal(size=(count, 3, 3))
    corners[0, 2] = corners[0, 1]  # a segment
    tree = TriangleTree(corners)
    assert tree.order is not None
    np.testing.assert_array_equal(np.unique(tree.order), np.arange(count))
    points = rng.normal(size=(3, 200))
    faces = np.arange(3 * count, dtype=np.int64).reshape(-1, 3)
    squared = igl.point_mesh_squared_distance(points.T, corners.reshape(-1, 3), faces)[0]
    np.testing.assert_allclose(tree.distances(points), np.sqrt(squared), rtol=1e-9, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    step=st.sampled_from([1e-6, 1e-2, 0.3, 3.0]),
)
def test_a_bound_of_distances_is_never_more_and_never_far_less(seed, step) -> None:
    """Random walks, as the bound of a point starts from the point before."""
    rng = np.random.default_rng(seed)
    shape = MeshVolume(*MESHES["rough"], "rough")
    points = np.cumsum(step * rng.normal(size=(3, 400)), axis=1)
    points[:, rng.integers(400, size=5)] = np.nan
    exact, actual = (
        shape.surface_distance_m(points, np.eye(3)),
        np.abs(clearances(shape, points)),
    )
    np.testing.assert_array_equal(np.isnan(actual), np.isnan(points[0]))
    low, high = shape.bounds[:, :, None]
    near = ((points > low) & (points < high)).all(axis=0)
    assert (actual[near] <= exact[near] * (1 + 1e-12)).all()
    assert (actual[near] >= 0.4 * exact[near] - 1e-8).all()


def _crossed(actual: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Check times of first and last crossings, (2, N); return the mask of crossings, (N,)."""
    met = np.isfinite(expected)
    np.testing.assert_array_equal(np.isfinite(actual), met)
    np.testing.assert_allclose(actual[met], expected[met], rtol=1e-9, atol=1e-12)
    assert 20 < np.count_nonzero(met[0]) < len(met[0]) - 3
    return met[0]


@pytest.mark.parametrize("name", MESHES)
def test_crossings_agree_with_the_reference(name: str) -> None:
    vertices, triangles = MESHES[name]
    shape = MeshVolume(vertices, triangles, name)
    ends = finite(probes(vertices, triangles, 50))
    starts = np.roll(ends, 111, axis=1)
    starts[:, :15] = ends[:, :15]  # stands still
    starts[:2, 15:45] = ends[:2, 15:45]  # along an axis
    for one, second in ((starts, ends), (ends, starts)):
        with np.errstate(all="ignore"):
            first, last = reference._through_triangles(shape.corners, one, second - one)
        # Whether an end on the surface is inside is up to rounding.
        sure = ~np.isclose([first, last], [[[0.0]], [[1.0]]], rtol=0, atol=1e-9).any(axis=(0, 1))
        first[shape.contains(one)], last[shape.contains(second)] = 0.0, 1.0
        expected = np.where(first <= last, [first, last], [[np.inf], [-np.inf]])
        _crossed(np.stack(passages(shape, one, second))[:, sure], expected[:, sure])


def test_a_path_along_the_face_of_a_tree_box_is_inside() -> None:
    """Points on the plane of a face divide 0 by 0."""
    shape = MeshVolume(*MESHES["a box"], "box")
    for side in (-0.5, 0.5):
        starts, ends = np.array([[side], [-1.0], [0.2]]), np.array([[side], [1.0], [0.2]])
        first, last = passages(shape, starts, ends)
        np.testing.assert_allclose([first[0], last[0]], [0.25, 0.75], rtol=1e-12)


@pytest.mark.parametrize("name", MESHES)
def test_clearance_is_no_more_than_the_distance_to_the_surface(name: str) -> None:
    vertices, triangles = MESHES[name]
    compiled, plain = twins(vertices, triangles)
    points = probes(vertices, triangles)
    clear = clearances(compiled, points)
    np.testing.assert_array_equal(np.isnan(clear), np.isnan(points).any(axis=0))
    finite_points = finite(points)
    clear, exact = (
        clearances(compiled, finite_points),
        plain.surface_distance_m(finite_points, np.eye(3)),
    )
    assert (np.abs(clear) <= exact * (1 + 1e-12)).all()  # the distance to a box is exact
    inside = plain.contains(finite_points)
    assert (clear[inside] <= 0.0).all() and (clear[~inside] >= 0.0).all()
    # Inside the box, the bound is useful.
    size = np.ptp(vertices, axis=0).max()
    low, high = vertices.min(axis=0)[:, None], vertices.max(axis=0)[:, None]
    deep = (
        (exact > 1e-3 * size)
        & (finite_points > low).all(axis=0)
        & (finite_points < high).all(axis=0)
    )
    assert (np.abs(clear[deep]) >= 0.39 * exact[deep]).all()
    assert deep.any() or name in ("a needle", "a sheet", "slivers")


def test_non_finite_points_have_no_distance_and_no_crossing() -> None:
    compiled, _ = twins(*MESHES["a torus"])
    points = np.array([[np.nan, np.inf, 0.0], [0.0, 0.0, -np.inf], [0.0, 0.0, 0.0]])
    assert np.isnan(compiled.tree.distances(points)).all()
    first, last = passages(compiled, points, np.zeros((3, 3)))
    assert np.isinf(first).all() and np.isinf(last).all()
    nothing = np.zeros((3, 0))
    for actual in (
        compiled.tree.distances(nothing),
        *passages(compiled, nothing, nothing),
    ):
        assert actual.shape == (0,)


def test_a_tree_of_a_million_triangles() -> None:
    """A hilly square with known nearest points: straight below points above the hilltops."""
    count = 708
    x, y = np.meshgrid(np.linspace(0, 1, count + 1), np.linspace(0, 1, count + 1), indexing="ij")
    flat = np.stack([x, y, np.zeros_like(x)], axis=-1)
    a, b, c, d = flat[:-1, :-1], flat[1:, :-1], flat[1:, 1:], flat[:-1, 1:]
    corners = np.concatenate(
        [np.stack(item, axis=2).reshape(-1, 3, 3) for item in ((a, b, c), (a, c, d))]
    )
    assert len(corners) > 1_000_000
    tree = TriangleTree(corners)
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.5, 1.5, (3, 2000))
    beside = np.abs(points[:2] - np.clip(points[:2], 0.0, 1.0))
    expected = np.sqrt(np.square(beside).sum(axis=0) + points[2] ** 2)
    np.testing.assert_allclose(tree.distances(points), expected, rtol=1e-12)
