# SPDX-License-Identifier: GPL-3.0-or-later
"""Self-intersections of a triangle mesh."""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64

from . import mesh_edges

_PAIRS_AT_ONCE: Final = 1_000_000


def crossings(points: F64, triangles: I64) -> I64:
    """Find all pairs of an edge and a triangle crossed by it.

    Candidate pairs come from bounding spheres.

    Parameters
    ----------
    points : (V, 3) float64
    triangles : (F, 3) int64

    Returns (N, 5) int64: ends of the edge, then corners of the triangle; no vertex is common to
    both.
    """
    from scipy.spatial import cKDTree

    ends = mesh_edges.edges_of(triangles, len(points)).ends
    middle = points[ends].mean(axis=1)
    half = 0.5 * np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    centres = points[triangles].mean(axis=1)
    radius = np.linalg.norm(points[triangles] - centres[:, None], axis=2).max(axis=1)
    size = np.floor(
        np.log2(np.maximum(radius, 1e-12))
    )  # classes of similar radius keep the search radius small
    rows = [np.zeros((0, 5), np.int64)]
    for class_ in np.unique(size):
        members = np.flatnonzero(size == class_)
        reach = half + radius[members].max()
        near = cKDTree(centres[members]).query_ball_point(middle, reach, return_sorted=True)
        count = np.array([len(row) for row in near])
        edge = np.repeat(np.arange(len(ends)), count)
        triangle = members[np.concatenate([np.array(row, np.int64) for row in near])]
        for start in range(0, len(edge), _PAIRS_AT_ONCE):
            block = slice(start, start + _PAIRS_AT_ONCE)
            rows.append(pierced(points, ends[edge[block]], triangles[triangle[block]]))
    return np.concatenate(rows)


def pierced(points: F64, ends: I64, corners: I64) -> I64:
    """Select intersecting edge-triangle pairs; pairs with a common vertex are dropped.

    Parameters
    ----------
    ends : (N, 2) int64
    corners : (N, 3) int64

    Returns (M, 5) int64: rows as in :func:`crossings`.
    """
    apart = (corners[:, :, None] != ends[:, None, :]).all(axis=(1, 2))
    ends, corners = ends[apart], corners[apart]
    start, end = points[ends[:, 0]], points[ends[:, 1]]
    a, b, c = (points[corners[:, k]] for k in range(3))
    # Signed volumes: the ends are on opposite sides of the plane, and the edge passes all three
    # sides of the triangle in one sense.
    through = _volume(start, a, b, c) * _volume(end, a, b, c) < 0.0
    sides = np.column_stack(
        [_volume(start, end, start_, end_) for start_, end_ in ((a, b), (b, c), (c, a))]
    )
    through &= (sides > 0.0).all(axis=1) | (sides < 0.0).all(axis=1)
    return np.column_stack((ends[through], corners[through]))


def _volume(a: F64, b: F64, c: F64, d: F64) -> F64:
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)


def depth_m(points: F64, crossing: I64) -> F64:
    """Smallest displacement that would end each crossing, (N,) metres.

    ``crossing`` (N, 5) int64: from :func:`crossings`.
    """
    start, end, a, b, c = (points[crossing[:, k]] for k in range(5))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    above, below = (np.einsum("ij,ij->i", position - a, normal) for position in (start, end))
    through = start + (above / (above - below))[:, None] * (end - start)
    least: F64 = np.minimum(np.abs(above), np.abs(below))
    for start_, end_ in ((a, b), (b, c), (c, a)):
        along = end_ - start_
        share = np.einsum("ij,ij->i", through - start_, along) / np.einsum("ij,ij->i", along, along)
        nearest = start_ + np.clip(share, 0.0, 1.0)[:, None] * along
        least = np.minimum(least, np.linalg.norm(through - nearest, axis=1))
    return least
