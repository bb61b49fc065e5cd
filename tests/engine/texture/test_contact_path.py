# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of contacts: nearest points, seams, tiles, moving and deforming meshes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.texture.contact_path import ContactFollower, ContactPaths, SurfaceMesh
from hfx_blender.engine.volume.mesh_distance import SurfaceLocator


def _sheet(count: int = 8, size: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """Return a square in the plane z = 0 about the origin: vertices and triangles."""
    steps = np.linspace(-0.5 * size, 0.5 * size, count + 1)
    x, y = np.meshgrid(steps, steps)
    vertices = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    a, b, c, d = first, first + 1, first + count + 2, first + count + 1
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return vertices, triangles.astype(np.int32)


def _pieces(paths: ContactPaths) -> np.ndarray:
    """Return path pieces, (n, 2, 2, 2): piece, begin and end, coordinate."""
    return paths.ends_m.transpose(2, 0, 1).reshape(-1, 2, 2, 2)


def _follow(
    mesh: SurfaceMesh,
    vertices: np.ndarray,
    points: np.ndarray,
    matrices: np.ndarray | None = None,
    reach_m: float = 0.004,
) -> ContactPaths:
    """Follow points (T, n, 3) over all times at once."""
    times, count = points.shape[:2]
    matrices = np.tile(np.eye(4), (times, 1, 1)) if matrices is None else matrices
    vertices = vertices if vertices.ndim == 3 else vertices[None]
    return ContactFollower(mesh, reach_m).follow(
        matrices,
        vertices,
        np.repeat(np.arange(times), count),
        np.tile(np.arange(count), times),
        points.reshape(-1, 3),
        np.arange(times) > 0,
    )


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1_000_000))
def test_the_nearest_place_is_that_of_trimesh(seed: int) -> None:
    import trimesh

    rng = np.random.default_rng(seed)
    mesh = trimesh.Trimesh(*_sheet(4), process=False)
    mesh.vertices += rng.normal(0.0, 0.02, mesh.vertices.shape)
    points = rng.uniform(-0.12, 0.12, (30, 3))
    expected, distances, _ = trimesh.proximity.closest_point_naive(mesh, points)
    reach = 0.03
    actual = SurfaceLocator(np.array(mesh.triangles), reach).nearest(points)
    sure = np.abs(distances - reach) > 1e-9
    np.testing.assert_array_equal(
        np.isin(np.arange(30), actual.point)[sure], (distances < reach)[sure]
    )
    np.testing.assert_allclose(actual.distance, distances[actual.point], atol=1e-9)
    np.testing.assert_allclose(actual.place, expected[actual.point], atol=1e-7)
    corners = np.array(mesh.triangles)[actual.triangle]
    np.testing.assert_allclose(
        np.einsum("nk,nkc->nc", actual.weights, corners), actual.place, atol=1e-9
    )


@pytest.mark.parametrize(
    "corners",
    [np.zeros((0, 3, 3)), np.zeros((2, 3, 3)), np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]])],
)
def test_a_mesh_without_area_has_no_nearest_place(corners: np.ndarray) -> None:
    actual = SurfaceLocator(corners.astype(float), 0.1).nearest(np.zeros((3, 3)))
    assert len(actual.point) == 0


def test_the_way_on_a_plane_is_the_way_of_the_skin() -> None:
    vertices, triangles = _sheet()
    mesh = SurfaceMesh(triangles, vertices[triangles][..., :2])
    rng = np.random.default_rng(0)
    points = np.zeros((30, 5, 3))
    points[..., :2] = rng.uniform(-0.05, 0.05, (5, 2)) + np.cumsum(
        rng.normal(0.0, 2e-3, (30, 5, 2)), axis=0
    )
    points[..., 2] = rng.uniform(-0.003, 0.003, (30, 5))
    paths = _follow(mesh, vertices, points)
    assert len(paths) == 150
    np.testing.assert_allclose(paths.coordinates_m.reshape(30, 5, 2), points[..., :2], atol=1e-12)
    pieces = _pieces(paths).reshape(30, 5, 2, 2, 2)[1:]
    np.testing.assert_allclose(pieces[:, :, 0, 0], points[:-1, :, :2], atol=1e-12)
    np.testing.assert_allclose(pieces[:, :, 1, 1], points[1:, :, :2], atol=1e-12)
    steps = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=-1)
    np.testing.assert_allclose(paths.length_m.reshape(30, 5)[1:], steps, atol=1e-12)
    moved = np.linalg.norm(paths.moved_m, axis=1)
    np.testing.assert_allclose(moved.reshape(30, 5)[1:], steps, atol=1e-11)
    assert not paths.length_m[:5].any()


def _motion(times: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    angles = np.cumsum(rng.normal(0.0, 0.05, times))
    matrices = np.tile(np.eye(4), (times, 1, 1))
    matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(angles)
    matrices[:, 0, 1], matrices[:, 1, 0] = -np.sin(angles), np.sin(angles)
    matrices[:, :3, 3] = np.cumsum(rng.normal(0.0, 0.3, (times, 3)), axis=0)
    return matrices


def test_a_finger_resting_on_a_moving_object_has_no_path() -> None:
    vertices, triangles = _sheet()
    mesh = SurfaceMesh(triangles, vertices[triangles][..., :2])
    matrices = _motion(20, 1)
    local = np.array([0.01, -0.02, 0.001, 1.0])
    points = (matrices @ local)[:, None, :3]
    paths = _follow(mesh, vertices, points, matrices)
    assert len(paths) == 20
    assert paths.length_m.max() < 1e-12


def test_ways_are_the_same_on_an_object_that_carries_the_skin_along() -> None:
    vertices, triangles = _sheet()
    mesh = SurfaceMesh(triangles, vertices[triangles][..., :2])
    stroke = np.zeros((20, 1, 3))
    stroke[:, 0, 0] = np.linspace(-0.05, 0.05, 20)
    still = _follow(mesh, vertices, stroke)
    matrices = _motion(20, 2)
    carried = np.einsum("tij,tnj->tni", matrices[:, :3, :3], stroke) + matrices[:, None, :3, 3]
    np.testing.assert_allclose(
        _pieces(_follow(mesh, vertices, carried, matrices)), _pieces(still), atol=1e-9
    )
    grown = matrices.copy()
    grown[:, :3, :3] *= np.linspace(1.0, 1.5, 20)[:, None, None]  # no longer only moved
    carried = np.einsum("tij,tnj->tni", grown[:, :3, :3], stroke) + grown[:, None, :3, 3]
    np.testing.assert_allclose(
        _pieces(_follow(mesh, vertices, carried, grown)), _pieces(still), atol=1e-9
    )


def test_paths_on_a_deforming_mesh_exclude_its_motion() -> None:
    vertices, triangles = _sheet()
    mesh = SurfaceMesh(triangles, vertices[triangles][..., :2])
    times = 20
    bent = np.tile(vertices, (times, 1, 1))
    bend = np.linspace(0.0, 2.0, times)[:, None]
    bent[:, :, 2] = bend * vertices[None, :, 0] ** 2
    corner = triangles[17]
    rest = bent[:, corner].mean(axis=1)
    column = (vertices[:, 1] == vertices[40, 1]) & (vertices[:, 0] >= -0.06)
    line = bent[:, np.flatnonzero(column)]
    moving = np.stack(
        [
            [np.interp(k / times * 0.1 - 0.05, line[k, :, 0], line[k, :, c]) for c in range(3)]
            for k in range(times)
        ]
    )
    paths = _follow(mesh, bent, np.stack([rest, moving], axis=1))
    assert len(paths) == 2 * times
    assert paths.length_m[0::2].max() < 1e-12
    assert np.linalg.norm(paths.moved_m[0::2], axis=1).max() < 1e-11
    np.testing.assert_allclose(np.diff(paths.coordinates_m[1::2, 0]), 0.1 / times, atol=1e-9)
    np.testing.assert_allclose(paths.length_m[3::2], 0.1 / times, atol=1e-9)


def _tube(segments: int = 48, radius: float = 0.05) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a tube about z, with unrolled coordinates cut at angle 0: one seam."""
    k = np.arange(segments)
    ring = np.stack([np.cos(2 * np.pi * k / segments), np.sin(2 * np.pi * k / segments)], 1)
    vertices = np.concatenate([np.c_[radius * ring, np.full(segments, z)] for z in (-0.05, 0.05)])
    after = (k + 1) % segments
    triangles = np.concatenate(
        [
            np.stack([k, after, segments + after], 1),
            np.stack([k, segments + after, segments + k], 1),
        ]
    )
    side = 2.0 * radius * np.sin(np.pi / segments)
    u0, u1 = k * side, (k + 1) * side
    low, high = np.zeros(segments), np.full(segments, 0.1)
    coordinates = np.concatenate(
        [
            np.stack([np.c_[u0, low], np.c_[u1, low], np.c_[u1, high]], 1),
            np.stack([np.c_[u0, low], np.c_[u1, high], np.c_[u0, high]], 1),
        ]
    )
    return vertices, triangles.astype(np.int32), coordinates


def test_across_a_seam_the_way_goes_on_on_the_other_side() -> None:
    vertices, triangles, coordinates = _tube()
    mesh = SurfaceMesh(triangles, coordinates)
    angles = np.linspace(-1.0, 1.0, 80)
    points = 0.05 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], 1)[:, None]
    paths = _follow(mesh, vertices, points)
    # No step is longer than the covered chord, though coordinates jump by a whole turn.
    chord = 2.0 * 0.05 * np.sin(0.5 * (angles[1] - angles[0]))
    assert np.abs(np.diff(paths.coordinates_m[:, 0])).max() > 0.3
    assert paths.length_m[1:].max() <= chord * 1.01
    assert paths.length_m.sum() == pytest.approx(0.05 * 2.0, rel=0.01)
    seam = int(np.argmax(np.abs(np.diff(paths.coordinates_m[:, 0])))) + 1
    first, second = _pieces(paths)[seam]
    assert first[1, 0] > first[0, 0] > 0.3 and second[0, 0] < second[1, 0] < 0.01


def test_splitting_time_changes_nothing() -> None:
    vertices, triangles, coordinates = _tube()
    mesh = SurfaceMesh(triangles, coordinates)
    angles = np.linspace(-1.0, 1.0, 30)
    points = 0.0505 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], 1)
    whole = _follow(mesh, vertices, points[:, None])
    follower = ContactFollower(mesh, 0.004)
    ways, moved = [], []
    for first in range(0, 30, 7):
        part = points[first : first + 7]
        n = len(part)
        paths = follower.follow(
            np.tile(np.eye(4), (n, 1, 1)),
            vertices[None],
            np.arange(n),
            np.zeros(n, np.int64),
            part,
            np.arange(n) + first > 0,
        )
        ways.append(_pieces(paths)[paths.carried :])
        moved.append(paths.moved_m[paths.carried :])
    np.testing.assert_allclose(np.concatenate(ways), _pieces(whole), atol=1e-12)
    np.testing.assert_allclose(np.concatenate(moved), whole.moved_m, atol=1e-12)


def test_a_mesh_that_deforms_from_call_to_call_is_followed_too() -> None:
    vertices, triangles = _sheet()
    mesh = SurfaceMesh(triangles, vertices[triangles][..., :2])
    follower = ContactFollower(mesh, 0.004)
    ways = []
    for k in range(6):
        bent = vertices.copy()
        bent[:, 2] = 0.5 * k * vertices[:, 0] ** 2
        rest = bent[triangles[17]].mean(axis=0)
        column = np.flatnonzero((vertices[:, 1] == vertices[40, 1]) & (vertices[:, 0] >= -0.06))
        x_m = 0.01 * k - 0.025
        moving = [np.interp(x_m, bent[column, 0], bent[column, c]) for c in range(3)]
        paths = follower.follow(
            np.eye(4)[None],
            bent[None],
            np.zeros(2, np.int64),
            np.arange(2),
            np.array([rest, moving]),
            np.array([k > 0]),
        )
        ways.append(paths.length_m[paths.carried :])
    np.testing.assert_allclose(np.array(ways)[1:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.array(ways)[1:, 1], 0.01, atol=1e-6)


def test_a_returning_contact_starts_a_new_path() -> None:
    vertices, triangles = _sheet()
    mesh = SurfaceMesh(triangles, vertices[triangles][..., :2])
    points = np.zeros((6, 1, 3))
    points[:, 0, 0] = np.linspace(0.0, 0.05, 6)
    points[2:4, 0, 2] = 0.1
    paths = _follow(mesh, vertices, points)
    np.testing.assert_array_equal(paths.time, [0, 1, 4, 5])
    np.testing.assert_allclose(paths.length_m, [0.0, 0.01, 0.0, 0.01], atol=1e-12)


def test_fingertips_come_first_when_too_much_touches() -> None:
    vertices, triangles = _sheet()
    mesh = SurfaceMesh(triangles, vertices[triangles][..., :2])
    first = np.array([False, True, False, True, False])
    follower = ContactFollower(mesh, 0.01, 3, first)
    points = np.zeros((5, 3))
    points[:, 0] = 0.01 * np.arange(5)
    points[:, 2] = [0.001, 0.005, 0.002, 0.006, 0.003]
    zeros = np.zeros(5, np.int64)
    paths = follower.follow(
        np.eye(4)[None], vertices[None], zeros, np.arange(5), points, np.zeros(1, bool)
    )
    np.testing.assert_array_equal(paths.ids, [0, 1, 3])
