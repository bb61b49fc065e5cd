# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest points on a triangle mesh, and signed heights above it."""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64, expand
from hfx_blender.engine.volume.mesh_distance import barycentric

from .mesh_edges import triangle_normals

_CANDIDATES: Final = 8
"""Number of candidate triangles, enough for any mesh without slivers."""


def locate(
    points: F64, surface: F64, triangles: I64, candidates: int = _CANDIDATES
) -> tuple[I64, F64, F64]:
    """Find the nearest point on a surface for each point close to it.

    Parameters
    ----------
    points : (P, 3) float64
    surface : (V, 3) float64
    triangles : (F, 3) int64
    candidates : int
        Number of nearest vertices with tested triangles; three suffice on an even mesh.

    Returns
    -------
    triangle : (P,) int64
    weights : (P, 3) float64
        Barycentric, not negative, of sum 1.
    offset_m : (P,) float64
        Signed distance along the triangle's normal.
    """
    from scipy.spatial import cKDTree

    used = np.unique(triangles)
    tries = min(candidates, len(used))
    _, near = cKDTree(surface[used]).query(points, k=tries)
    corners = triangles.ravel()
    order = np.argsort(corners, kind="stable")
    offsets = np.searchsorted(corners[order], np.arange(len(surface) + 1)).astype(np.int64)
    position, row = expand(offsets, used[near].ravel())
    point, triangle = row // tries, order[position] // 3
    weights = barycentric(points[point], surface[triangles[triangle]])
    nearest = np.einsum("ij,ijk->ik", weights, surface[triangles[triangle]])
    distance = np.linalg.norm(points[point] - nearest, axis=1)
    best = np.lexsort((triangle, distance, point))
    best = best[np.flatnonzero(np.diff(point[best], prepend=-1))]
    triangle, weights, nearest = triangle[best], weights[best], nearest[best]
    normal = triangle_normals(surface, triangles[triangle])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return triangle, weights, np.einsum("ij,ij->i", points - nearest, normal)
