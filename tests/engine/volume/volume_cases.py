# SPDX-License-Identifier: GPL-3.0-or-later
"""Placing matrices and meshes shared by the tests of volumes."""

import numpy as np
import trimesh

KINDS = ("plain", "mirrored", "sheared", "needle", "squashed", "tiny", "huge", "far", "mixed")


def rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def placing(kind, rng):
    """Return a (4, 4) placing matrix of one of KINDS."""
    turn = rotation(rng)
    linear = {
        "plain": turn * rng.uniform(0.1, 10.0),
        "mirrored": turn @ np.diag([1.0, -2.0, 0.5]),
        "sheared": turn @ np.array([[1.0, 1.5, -0.7], [0.0, 1.0, 2.0], [0.0, 0.0, 1.0]]),
        "needle": turn @ np.diag(rng.permutation([240.0, 1.0, 1.0])),
        "squashed": turn @ np.diag([240.0, 240.0, 1.0]) @ rotation(rng),
        "tiny": turn * 1e-6,
        "huge": turn @ np.diag([1e6, -1e6, 1e6]),
        "far": turn,
        "mixed": turn @ np.diag(rng.permutation([1e6, 1.0, 1e-6])),
    }[kind]
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = rng.normal(size=3) * (1e6 if kind == "far" else 1.0)
    return matrix


def points_in(bounds, count, rng):
    """Return random points of a box a little larger than ``bounds``, (3, count)."""
    low, high = bounds
    spread = 1.1 * (high - low)
    return np.ascontiguousarray((0.5 * (low + high) + (rng.random((count, 3)) - 0.5) * spread).T)


def _bumpy(subdivisions):
    mesh = trimesh.creation.icosphere(subdivisions)
    x, y, z = mesh.vertices.T
    radius = 1.0 + 0.45 * np.sin(7 * x) * np.cos(6 * y) + 0.3 * np.sin(9 * z)
    return mesh.vertices * radius[:, None], mesh.faces


def _needles(rng):
    mesh = trimesh.creation.icosphere(3)
    radius = np.where(rng.random(len(mesh.vertices)) < 0.5, 0.02, 3.0 * rng.random())
    return mesh.vertices * radius[:, None], mesh.faces


def _scribble(rng):
    mesh = trimesh.creation.icosphere(2)
    return rng.normal(size=mesh.vertices.shape), mesh.faces


def _parts(mesh):
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)


MESHES = {
    "cube, 12 triangles": lambda rng: _parts(trimesh.creation.box()),
    "cube, 768": lambda rng: _parts(trimesh.creation.box().subdivide().subdivide().subdivide()),
    "sphere, 5120": lambda rng: _parts(trimesh.creation.icosphere(4)),
    "bumpy, 20480": lambda rng: _bumpy(5),
    "torus, 27000": lambda rng: _parts(
        trimesh.creation.torus(1.0, 0.3, major_sections=150, minor_sections=90)
    ),
    "plate": lambda rng: _parts(trimesh.creation.box((1, 1, 1e-4)).subdivide().subdivide()),
    "rod": lambda rng: _parts(trimesh.creation.cylinder(1e-3, 2.0, sections=24)),
    "needles": _needles,
    "cuts through itself": _scribble,
}


def mesh(name, rng):
    """Return vertices (V, 3) float64 and triangles (F, 3) int32 of one of MESHES."""
    vertices, triangles = MESHES[name](rng)
    return np.array(vertices, np.float64), np.array(triangles, np.int32)
