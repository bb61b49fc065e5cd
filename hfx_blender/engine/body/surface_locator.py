# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on triangles; prepared for repeated queries on one mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..volume.mesh_distance import TriangleTree

_FLAT: Final = 1e-8  # sine of the angle at a corner below which a triangle has no area


@dataclass(frozen=True, eq=False)
class NearestPlaces:
    """Nearest places on a mesh, for the points that have one within reach."""

    point: I64  # (n,) which points have one, ascending
    triangle: I64  # (n,)
    weights: F64  # (n, 3) barycentric, each in 0..1, sum 1
    place: F64  # (n, 3)
    distance: F64  # (n,)


class SurfaceLocator:
    """Prepared search for the nearest places on one mesh.

    Parameters
    ----------
    corners : (F, 3, 3) float64
        Triangle, corner, coordinate. Triangles without area are never the nearest.
    reach : float
        Points farther away have no nearest place.
    """

    def __init__(self, corners: F64, reach: float = np.inf) -> None:
        self.reach = reach
        edge_1, edge_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normals = np.cross(edge_1, edge_2)
        area, *squares = (np.einsum("fi,fi->f", a, a) for a in (normals, edge_1, edge_2))
        self._solid = np.flatnonzero(area > _FLAT**2 * np.maximum(*squares) ** 2)
        self._corners = np.ascontiguousarray(corners[self._solid])
        self._tree = TriangleTree(self._corners) if len(self._solid) else None

    def nearest(self, points: F64) -> NearestPlaces:
        """The nearest place within reach of points (N, 3)."""
        triangle, distance = np.full(len(points), -1), np.full(len(points), np.inf)
        if self._tree is not None:
            triangle, distance = self._tree.nearest(points.T, self.reach)
        near = np.flatnonzero(triangle >= 0)
        triangle = triangle[near]
        corners = self._corners[triangle]
        weights = np.maximum(barycentric(points[near], corners), 0.0)
        weights /= weights.sum(axis=1, keepdims=True)
        place = np.einsum("nk,nkc->nc", weights, corners)
        return NearestPlaces(near, self._solid[triangle], weights, place, distance[near])


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
