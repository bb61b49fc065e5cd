# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on a triangle mesh."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64
from .mesh_edges import expand, triangle_normals

_CANDIDATES: Final = 8
"""Number of candidate triangles, enough for any mesh without slivers."""


def locate(
    points: F64, surface: F64, triangles: I64, candidates: int = _CANDIDATES
) -> tuple[I64, F64, F64]:
    """Nearest place on a surface, for points that are close to it.

    Parameters
    ----------
    points : (P, 3) float64
    surface : (V, 3) float64
    triangles : (F, 3) int64
    candidates : int
        Nearest vertices whose triangles are tried; three do on an even mesh.

    Returns
    -------
    triangle : (P,) int64
    weights : (P, 3) float64
        Barycentric, none negative, sum 1.
    offset_m : (P,) float64
        Distance along the triangle's normal.
    """
    from scipy.spatial import cKDTree

    used = np.unique(triangles)
    tries = min(candidates, len(used))
    _, near = cKDTree(surface[used]).query(points, k=tries)
    corners = triangles.ravel()
    order = np.argsort(corners, kind="stable")
    offsets = np.searchsorted(corners[order], np.arange(len(surface) + 1)).astype(np.int64)
    place, row = expand(offsets, used[near].ravel())
    point, triangle = row // tries, order[place] // 3
    weights = barycentric(points[point], surface[triangles[triangle]])
    nearest = np.einsum("ij,ijk->ik", weights, surface[triangles[triangle]])
    distance = np.linalg.norm(points[point] - nearest, axis=1)
    best = np.lexsort((triangle, distance, point))
    best = best[np.flatnonzero(np.diff(point[best], prepend=-1))]
    triangle, weights, nearest = triangle[best], weights[best], nearest[best]
    normal = triangle_normals(surface, triangles[triangle])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return triangle, weights, np.einsum("ij,ij->i", points - nearest, normal)


def barycentric(points: F64, corners: F64) -> F64:
    """Weights of the corners at the place of a triangle that is nearest to a point.

    Parameters
    ----------
    points : (N, 3) float64
    corners : (N, 3, 3) float64
        One triangle for each point.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    inside = _plane_weights(points, a, b, c)
    # A triangle without area has no inside: only its edges count.
    is_flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) == 0.0
    best = np.where((inside >= 0.0).all(axis=1) & ~is_flat, 0.0, np.inf)
    weights = inside.copy()
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = corners[:, end] - corners[:, start]
        along = np.einsum("ij,ij->i", points - corners[:, start], edge)
        share = np.clip(along / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-30), 0.0, 1.0)
        place = corners[:, start] + share[:, None] * edge
        distance = np.linalg.norm(points - place, axis=1)
        nearer = distance < best
        best[nearer] = distance[nearer]
        weights[nearer] = 0.0
        weights[nearer, start] = 1.0 - share[nearer]
        weights[nearer, end] = share[nearer]
    return weights


def _plane_weights(points: F64, a: F64, b: F64, c: F64) -> F64:
    one, other, offset = b - a, c - a, points - a
    d00, d01, d11 = (
        np.einsum("ij,ij->i", x, y) for x, y in ((one, one), (one, other), (other, other))
    )
    d20, d21 = (np.einsum("ij,ij->i", offset, x) for x in (one, other))
    scale = np.maximum(d00 * d11 - d01 * d01, 1e-40)
    v, w = (d11 * d20 - d01 * d21) / scale, (d00 * d21 - d01 * d20) / scale
    return np.column_stack((1.0 - v - w, v, w))
