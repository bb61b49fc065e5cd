# SPDX-License-Identifier: GPL-3.0-or-later
"""Collapses, flips and splits: valid meshes, and termination."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_tools.body_building.meshes import mesh_edges, mesh_edit
from hfx_tools.body_building.meshes.nearest_places import locate


def cloud(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random points in a plane and a Delaunay triangulation."""
    from scipy.spatial import Delaunay

    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2))
    triangles = Delaunay(points).simplices.astype(np.int64)
    flat = np.column_stack((points, np.zeros(count)))
    upside = mesh_edges.triangle_normals(flat, triangles)[:, 2] < 0.0
    triangles[upside] = triangles[upside][:, ::-1]
    return flat, triangles


def characteristic(triangles: np.ndarray, count: int) -> tuple[int, int]:
    """Return the Euler characteristic and the number of border edges."""
    edges = mesh_edges.edges_of(triangles, count)
    used = len(np.unique(triangles))
    return used - len(edges.ends) + len(triangles), int(edges.is_border.sum())


def assert_oriented_manifold(triangles: np.ndarray) -> None:
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed)


def sorted_rows(triangles: np.ndarray) -> set[tuple[int, ...]]:
    return {tuple(row) for row in np.sort(triangles, axis=1).tolist()}


@given(st.integers(0, 10_000), st.integers(6, 60))
@settings(max_examples=40, deadline=None)
def test_flips_lead_back_to_delaunay(seed: int, count: int) -> None:
    points, expected = cloud(seed, count)
    triangles = expected
    none = np.zeros(count, bool)
    for turn in range(4):  # make the mesh worse
        edges = mesh_edges.edges_of(triangles, count)
        inner = np.flatnonzero(~edges.is_border)
        triangles, _ = mesh_edit.flip(points, triangles, edges, inner[turn::3], none, seed)
    assert_oriented_manifold(triangles)
    assert characteristic(triangles, count) == characteristic(expected, count)
    actual = mesh_edit.flip_to_delaunay(points, triangles, none, rounds=500)
    assert sorted_rows(actual) == sorted_rows(expected)


@given(st.integers(0, 10_000), st.integers(8, 60))
@settings(max_examples=40, deadline=None)
def test_collapses_keep_a_disc_a_disc(seed: int, count: int) -> None:
    points, triangles = cloud(seed, count)
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    for turn in range(6):
        edges = mesh_edges.edges_of(triangles, count)
        on_border = np.zeros(count, bool)
        on_border[edges.ends[edges.is_border].ravel()] = True
        first, second = edges.ends[~on_border[edges.ends[:, 0]]].T
        good = mesh_edit.collapsible(points, up, triangles, edges, first, second, 0.2)
        first, second = first[good], second[good]
        rank = mesh_edit.scatter_ranks(len(first), turn)
        chosen = mesh_edit.independent(edges, first, second, rank)
        before = characteristic(triangles, count)
        triangles = mesh_edit.collapse(triangles, first[chosen], second[chosen], count)
        assert_oriented_manifold(triangles)
        assert characteristic(triangles, count) == before
        assert (mesh_edges.triangle_normals(points, triangles)[:, 2] > 0.0).all()


def test_a_collapse_that_would_pinch_is_refused() -> None:
    # A tube of three: the ring 0 1 2 is no face, so merging two of the ring's vertices would cut
    # the tube.
    triangles = np.array([[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4], [2, 0, 5], [0, 3, 5]])
    points = np.array(
        [[1.0, 0, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0], [1, 0, 1], [-0.5, 0.9, 1], [-0.5, -0.9, 1]]
    )
    edges = mesh_edges.edges_of(triangles, 6)
    allowed = mesh_edit.collapsible(
        points, points * (1, 1, 0), triangles, edges, np.array([0]), np.array([1]), -1.0
    )
    assert not allowed[0]


@given(st.integers(0, 10_000), st.integers(5, 40))
@settings(max_examples=40, deadline=None)
def test_splits_keep_area_topology_and_orientation(seed: int, count: int) -> None:
    points, triangles = cloud(seed, count)
    edges = mesh_edges.edges_of(triangles, count)
    order = mesh_edit.scatter_ranks(len(edges.ends), seed)
    finer, done = mesh_edit.split(triangles, edges, order)
    assert len(done) > 0
    middle = points[edges.ends[done]].mean(axis=1)
    all_points = np.concatenate((points, middle))
    assert_oriented_manifold(finer)
    assert characteristic(finer, len(all_points))[0] == characteristic(triangles, count)[0]
    area = mesh_edges.triangle_normals(all_points, finer)[:, 2]
    assert (area > 0.0).all()
    assert area.sum() == pytest.approx(mesh_edges.triangle_normals(points, triangles)[:, 2].sum())


def test_the_nearest_place_is_found_as_by_trying_everything() -> None:
    points, triangles = cloud(3, 40)
    surface = points + np.random.default_rng(4).normal(scale=0.02, size=points.shape)
    queries = np.random.default_rng(5).uniform(-0.8, 0.8, (200, 3)) * (1, 1, 0.05)
    triangle, weights, _ = locate(queries, surface, triangles)
    products = np.einsum("ij,ijk->ik", weights, surface[triangles[triangle]])
    assert weights.min() >= 0.0 and weights.sum(axis=1) == pytest.approx(1.0)
    shares = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12.0
    everywhere = np.einsum("sk,tkd->tsd", shares, surface[triangles]).reshape(-1, 3)
    for point, answer in zip(queries, products, strict=True):
        best = np.linalg.norm(everywhere - point, axis=1).min()
        assert np.linalg.norm(answer - point) <= best + 1e-9
