# SPDX-License-Identifier: GPL-3.0-or-later
"""Times of moving points inside, against dense sampling of the paths."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.reference import sweep as reference
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.nearest_surface import nearest_surface
from hfx_blender.engine.volume.shape import Shape
from hfx_tools.bench.volumes import clearances, passages

MOMENTS = 400


def _torus(around: int = 24, across: int = 12) -> MeshVolume:
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    alpha, beta = 2 * np.pi * u / around, 2 * np.pi * v / across
    radius = 0.7 + 0.25 * np.cos(beta)
    places = np.stack([radius * np.cos(alpha), radius * np.sin(alpha), 0.25 * np.sin(beta)], -1)
    at = np.arange(around * across).reshape(around, across)
    first, second = np.roll(at, -1, 0), np.roll(at, -1, 1)
    both = np.roll(first, -1, 1)
    quads = [np.stack([at, first, both], -1), np.stack([at, both, second], -1)]
    triangles = np.concatenate([quad.reshape(-1, 3) for quad in quads]).astype(np.int32)
    return MeshVolume(places.reshape(-1, 3), triangles, "torus")


def _plate(thickness: float) -> MeshVolume:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    corners[:, 2] *= thickness / 2
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [[a, b, c] for a, b, c, _ in faces] + [[a, c, d] for a, _, c, d in faces]
    return MeshVolume(corners, np.array(triangles, np.int32), "plate")


SHAPES: dict[str, Shape] = {
    "cuboid": Cuboid(),
    "sphere": Sphere(),
    "cylinder": Cylinder(),
    "capsule": Capsule(0.6),
    "ball": Capsule(0.0),
    "torus": _torus(),
}


def passage(shape: Shape, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times by the library for meshes, by the reference for formulas."""
    if isinstance(shape, MeshVolume):
        return passages(shape, starts, ends)
    return reference.passage(shape, np.stack([starts, ends]))


def _ways(seed: int, count: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """Return paths through and past the unit shapes, some along an axis, some of zero length."""
    rng = np.random.default_rng(seed)
    starts, ends = rng.uniform(-1.7, 1.7, (2, 3, count))
    ends[2, :200] = starts[2, :200]
    ends[:2, 200:400] = starts[:2, 200:400]
    ends[:, 400:450] = starts[:, 400:450]
    return starts, ends


@pytest.mark.parametrize("name", SHAPES)
def test_a_passage_agrees_with_dense_sampling(name: str) -> None:
    shape = SHAPES[name]
    starts, ends = _ways(1)
    first, last = passage(shape, starts, ends)
    shares = np.linspace(0.0, 1.0, MOMENTS + 1)
    inside = np.stack([shape.contains(starts + share * (ends - starts)) for share in shares])
    seen = inside.any(axis=0)
    assert 300 < np.count_nonzero(seen) < 1300
    assert np.isfinite(first[seen]).all(), "nothing that is seen inside is missed"
    step = 1.0 / MOMENTS
    begin, end = shares[inside.argmax(axis=0)], shares[MOMENTS - inside[::-1].argmax(axis=0)]
    for actual, expected, early in ((first, begin, 1), (last, end, -1)):
        late = early * (expected - actual)[seen]
        assert (late > -1e-9).all() and (late < step + 1e-9).all()
    unseen = np.isfinite(first) & ~seen
    if not isinstance(shape, MeshVolume):
        assert ((last - first)[unseen] < step).all()
    assert (np.isinf(first) == np.isinf(last)).all()


def test_clearance_holds_on_all_sides() -> None:
    shape, rng = _torus(), np.random.default_rng(2)
    points = rng.uniform(-2.0, 2.0, (3, 2000))
    clear = clearances(shape, points)
    directions = rng.normal(size=points.shape)
    directions /= np.linalg.norm(directions, axis=0)
    known = clear != 0.0
    others = points + 0.999 * np.abs(clear) * directions
    assert (shape.contains(points) == shape.contains(others))[known].all()
    assert ((clear < 0.0) == shape.contains(points))[known].all()
    assert np.count_nonzero(known) > 1000


def test_no_plate_is_too_thin() -> None:
    rng = np.random.default_rng(3)
    starts, ends = rng.uniform(-0.9, 0.9, (2, 3, 500))
    starts[2], ends[2] = rng.uniform(0.1, 5.0, 500), -rng.uniform(0.1, 5.0, 500)
    crossing = starts[2] / (starts[2] - ends[2])
    for shape, thickness in ((_plate(1e-6), 1e-6), (_plate(0.01), 0.01)):
        first, last = passage(shape, starts, ends)
        assert np.abs(0.5 * (first + last) - crossing).max() < 1e-9
        expected = thickness / (starts[2] - ends[2])
        assert np.abs(last - first - expected).max() < 1e-9


def test_ways_along_an_edge_do_not_slip_between_two_triangles() -> None:
    """Vertical paths hit shared edges and corners of a mesh's faces."""
    torus = _torus()
    tops = torus.vertices[np.abs(torus.vertices[:, 2] - 0.25) < 1e-9].T
    middles = 0.5 * (tops + np.roll(tops, 1, axis=1))
    for points in (tops, middles):
        up = np.array([[0.0], [0.0], [2.0]])
        assert np.isfinite(passage(torus, points + up, points - up)[0]).all()


@pytest.mark.parametrize("name", SHAPES)
def test_nan_is_never_inside(name: str) -> None:
    starts, ends = np.zeros((3, 4)), np.zeros((3, 4))
    starts[0, 0] = ends[1, 1] = starts[2, 2] = np.nan
    ends[:, 2] = np.nan
    starts[0, 3] = 9.0
    ends[0, 3] = 9.0
    first, last = passage(SHAPES[name], starts, ends)
    assert np.isinf(first).all() and np.isinf(last).all()


@pytest.mark.parametrize("name", SHAPES)
def test_the_nearest_surface_point_is_at_the_depth(name: str) -> None:
    shape, rng = SHAPES[name], np.random.default_rng(4)
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag([0.5, 0.8, -0.3])
    matrix[:3, 3] = (3.0, -2.0, 1.0)
    points = rng.uniform(-1.0, 1.0, (3, 800))
    points = points[:, shape.contains(points)][:, :150]
    depths = shape.depth_m(points, matrix)
    places, normals = nearest_surface(shape, points, matrix)
    world = matrix[:3, :3] @ points + matrix[:3, 3:]
    assert np.abs(np.linalg.norm(places - world, axis=0) - depths).max() < 1e-9
    assert np.abs(np.linalg.norm(normals, axis=0) - 1.0).max() < 1e-6
    back = np.linalg.inv(matrix[:3, :3])
    for sign, inside in ((-1.0, True), (1.0, False)):
        probe = back @ (places + sign * 1e-4 * normals - matrix[:3, 3:])
        # For two equally near points, the slope of the depth is in between.
        assert (shape.contains(probe) == inside).mean() > 0.95
