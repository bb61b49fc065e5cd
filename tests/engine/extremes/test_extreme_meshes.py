# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of points, planes, needles and slivers; doubled, inside out, empty, or huge."""

from __future__ import annotations

import igl
import numpy as np
import pytest
import trimesh
from extreme_cases import body_of, feel, moved, still, volume

from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.errors import InputError

CUBE = trimesh.creation.box(bounds=[(0, 0, 0), (1, 1, 1)])
BALL = trimesh.creation.icosphere(3)


def mesh(vertices, triangles) -> MeshVolume:
    return MeshVolume(np.asarray(vertices, float), np.asarray(triangles, np.int32), "Mesh")


def joined(*parts) -> tuple[np.ndarray, np.ndarray]:
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([triangles + n for (_, triangles), n in zip(parts, counts, strict=False)]),
    )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("vertices", "triangles", "words"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), "no faces"),
        (CUBE.vertices, np.zeros((0, 3)), "no faces"),
        (np.zeros((1, 3)), [[0, 0, 0]], "flat"),
        (np.ones((3, 3)), [[0, 1, 2]], "flat"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "flat"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "flat"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]], "flat"),
        (CUBE.vertices * (1, 1, 0), CUBE.faces, "flat"),
        (CUBE.vertices * (1, 1, 1e-13), CUBE.faces, "flat"),
        (np.full((8, 3), np.nan), CUBE.faces, "not finite"),
        (np.full((8, 3), -np.inf), CUBE.faces, "not finite"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2]], "flat"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 1], [0, 0, 1]], [[0, 1, 2], [0, 2, 3]], "not closed"),
    ],
)
def test_meshes_without_an_inside_are_refused_by_name(vertices, triangles, words):
    with pytest.raises(InputError, match=rf"^'Mesh' .*{words}"):
        mesh(vertices, np.reshape(triangles, (-1, 3)))


@pytest.mark.parametrize("flatness", [1e-2, 1e-5, 1e-8, 1e-11])
@pytest.mark.parametrize("kind", ["needle", "sheet"])
def test_needles_and_sheets_keep_their_thickness(kind, flatness, rng):
    """Points are given as shares of the thickness; half of the points are inside."""
    stretch = np.array([1.0, flatness, flatness] if kind == "needle" else [1.0, 1.0, flatness])
    thin = mesh(CUBE.vertices * stretch, CUBE.faces)
    share = rng.uniform(-0.5, 1.5, (20_000, 3))
    inside = np.all((share > 0.0) & (share < 1.0), axis=1)
    sure = np.abs(share - np.round(share)).min(axis=1) > 1e-9 + 1e-14 / flatness
    assert np.mean(sure) > 0.95
    samples = thin.contains(np.ascontiguousarray((share * stretch).T))
    np.testing.assert_array_equal(samples[sure], inside[sure])


def test_slivers_do_not_leak(rng):
    """Faces of a ball are cut into slivers of width 1e-9, around a point near an edge."""
    vertices, faces = BALL.vertices, BALL.faces
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    apex = (a + b) / 2 + 1e-9 * (c - (a + b) / 2)
    count = len(vertices)
    middle = count + np.arange(len(faces))
    cut = [
        np.stack([faces[:, i], faces[:, j], middle], axis=1) for i, j in ((0, 1), (1, 2), (2, 0))
    ]
    slivers = mesh(np.concatenate([vertices, apex]), np.concatenate(cut))
    points = rng.uniform(-1.1, 1.1, (3, 20_000))
    plain = mesh(vertices, faces).contains(points)
    near = np.abs(np.linalg.norm(points, axis=0) - 1.0) < 1e-7
    np.testing.assert_array_equal(slivers.contains(points)[~near], plain[~near])


def test_doubled_overlapping_and_inside_out_meshes(rng):
    points = rng.uniform(-1.3, 2.3, (3, 20_000))
    ball = (BALL.vertices, BALL.faces)
    beside = (BALL.vertices + np.array([0.9, 0.0, 0.0]), BALL.faces)
    first, second = (mesh(*part).contains(points) for part in (ball, beside))
    for parts, expected in (
        ((ball, ball), first),
        ((ball, ball, ball), first),
        ((ball, beside), first | second),
        ((ball, (BALL.vertices, BALL.faces[:, ::-1])), np.zeros_like(first)),
        (((BALL.vertices, BALL.faces[:, ::-1]),), first),
        (((-BALL.vertices, BALL.faces),), mesh(-BALL.vertices, BALL.faces).contains(points)),
    ):
        np.testing.assert_array_equal(mesh(*joined(*parts)).contains(points), expected)


@pytest.mark.parametrize("name", ["ball", "crumpled", "cuts through itself"])
def test_inside_is_the_exact_winding_number(name, rng):
    """A million points are covered by ``hfx bench volumes``."""
    vertices = np.array(BALL.vertices)
    if name == "crumpled":
        vertices *= rng.uniform(0.2, 1.0, (len(vertices), 1))
    elif name != "ball":
        vertices = rng.normal(size=vertices.shape)
    faces = np.asarray(BALL.faces, np.int64)
    points = rng.uniform(vertices.min(axis=0), vertices.max(axis=0), (4000, 3))
    winding = igl.winding_number(vertices, faces, points)
    far = igl.point_mesh_squared_distance(points, vertices, faces)[0] > 1e-18
    samples = mesh(vertices, faces).contains(np.ascontiguousarray(points.T))
    np.testing.assert_array_equal(samples[far], np.abs(winding[far]) > 0.5)
    assert far.mean() > 0.99


def torus(around: int, across: int) -> MeshVolume:
    """Return a ring of radius 1 and thickness 0.3, with two triangles per pair of angles."""
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    ring = 1.0 + 0.3 * np.cos(b)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), 0.3 * np.sin(b)], axis=-1)

    def at(i, j):
        return (u + i) % around * across + (v + j) % across

    corners = [(at(0, 0), at(1, 0), at(1, 1)), (at(0, 0), at(1, 1), at(0, 1))]
    triangles = np.concatenate([np.stack(c, axis=-1).reshape(-1, 3) for c in corners])
    return mesh(vertices.reshape(-1, 3), triangles)


def test_a_million_triangles(rng):
    ring = torus(1000, 500)
    assert len(ring.triangles) == 1_000_000
    points = rng.uniform(-1.3, 1.3, (3, 50_000)) * np.array([[1.0], [1.0], [0.3]])
    way = np.hypot(np.hypot(points[0], points[1]) - 1.0, points[2]) - 0.3
    sure = np.abs(way) > 1e-5  # the facets' own height
    samples = ring.contains(points)
    np.testing.assert_array_equal(samples[sure], way[sure] < 0.0)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_mesh_volume_in_the_engine_at_any_scale(scale, mirrored, rng):
    model = body_of(rng.uniform(-1.2, 1.2, (500, 3)))
    matrix = np.diag([-scale if mirrored else scale, scale, scale, 1.0])
    flip = np.array([-1.0 if mirrored else 1.0, 1.0, 1.0])
    crumpled = BALL.vertices * rng.uniform(0.3, 1.0, (len(BALL.vertices), 1))
    shape = mesh(crumpled, BALL.faces)
    expected = shape.contains(np.ascontiguousarray((model.vertices * flip).T.astype(float)))
    grown = moved(still(1), np.diag([scale, scale, scale, 1.0]))
    samples = feel(model, volume(matrix[None], shape), grown)
    np.testing.assert_array_equal(samples.weights[0, 0] > 0, expected)
    assert 30 < np.count_nonzero(expected) < 400
