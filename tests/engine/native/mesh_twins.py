# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh volumes in pairs, with and without the compiled library."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

import numpy as np
import pytest
import trimesh

from hfx_blender.engine.native.library import library
from hfx_blender.engine.volume import mesh_distance, mesh_inside
from hfx_blender.engine.volume.mesh import MeshVolume

needs_library = pytest.mark.skipif(library() is None, reason="no library was built")


@contextmanager
def without_library() -> Iterator[None]:
    """Disable the library for mesh volumes made and first used in the context."""
    modules = (mesh_distance, mesh_inside)
    patches = [mock.patch.object(module, "library", lambda: None) for module in modules]
    with patches[0], patches[1]:
        yield


def twins(vertices: np.ndarray, triangles: np.ndarray) -> tuple[MeshVolume, MeshVolume]:
    """Return the volume with and without the library, both with all lookup structures."""
    compiled = MeshVolume(vertices, triangles, "compiled")
    assert compiled.grid.compiled is not None and compiled.tree.compiled is not None
    with without_library():
        plain = MeshVolume(vertices, triangles, "plain")
        assert plain.grid.compiled is None and plain.tree.compiled is None
    return compiled, plain


def _parts(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    return np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int32)


def _joined(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    triangles = [faces + count for (_, faces), count in zip(parts, counts, strict=False)]
    return np.concatenate([part[0] for part in parts]), np.concatenate(triangles).astype(np.int32)


def meshes() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return simple and difficult meshes, always the same."""
    rng = np.random.default_rng(11)
    ball, box = _parts(trimesh.creation.icosphere(3)), _parts(trimesh.creation.box())
    rough = ball[0] * rng.uniform(0.4, 1.6, (len(ball[0]), 1))
    scribble = _parts(trimesh.creation.icosphere(2))
    torus = _parts(trimesh.creation.torus(1.0, 0.3, major_sections=30, minor_sections=16))
    thin = np.array([1.0, 1e-6, 1e-6])
    few = _parts(trimesh.creation.icosphere(2))
    inner = (0.5 * few[0], few[1][:, ::-1])
    slivers = _parts(trimesh.creation.cylinder(0.5, 1e-4, sections=100))
    return {
        "a box": box,
        "four triangles": (
            np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
            np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32),
        ),
        "a torus": torus,
        "rough": (rough, ball[1]),
        "cuts through itself": (rng.normal(size=scribble[0].shape), scribble[1]),
        "overlaps": _joined(ball, (few[0] + 0.7, few[1])),
        "doubled": _joined(few, few),
        "inside out": (few[0], few[1][:, ::-1]),
        "mirrored": (torus[0] * [-1, 1, 1], torus[1]),
        "hollow": _joined(few, inner),
        "open": (ball[0], ball[1][5:]),
        "a needle": (few[0] * thin, few[1]),
        "a sheet": (few[0] * [1.0, 1.0, 1e-6], few[1]),
        "slivers": slivers,
        "tiny": (1e-6 * torus[0], torus[1]),
        "huge and far": (1e6 * rough + 1e7, ball[1]),
        "far": (rough + 1e6, ball[1]),
    }


MESHES = meshes()


def probes(vertices: np.ndarray, triangles: np.ndarray, count: int = 700) -> np.ndarray:
    """Return points (3, N): random, on and above the mesh, on the box, and NaN."""
    rng = np.random.default_rng(12)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    anywhere = low + (high - low) * (1.2 * rng.random((count, 3)) - 0.1)
    corners = vertices[triangles[rng.integers(len(triangles), size=count)]]
    shares = rng.dirichlet(np.ones(3), count)
    shares[: count // 3, 2] = 0.0  # on edges
    shares[: count // 3] /= shares[: count // 3].sum(axis=1, keepdims=True)
    on_faces = np.einsum("nk,nki->ni", shares, corners)
    above = np.where(np.arange(3) == rng.integers(3, size=count)[:, None], anywhere, corners[:, 0])
    near = on_faces + 1e-7 * (high - low) * rng.normal(size=on_faces.shape)
    on_box = np.where(rng.random((count, 3)) < 0.4, np.where(anywhere > on_faces, high, low), above)
    odd = np.array([[np.nan, 0, 0], [0, np.inf, 0], [0, 0, -np.inf], [1e300, 0, 0], [np.nan] * 3])
    parts = [anywhere, corners[:, 1], on_faces, above, near, on_box, odd, anywhere[:7]]
    return np.ascontiguousarray(np.concatenate(parts).T)
