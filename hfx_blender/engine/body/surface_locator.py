# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on triangles, prepared for repeated queries on one mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..volume.mesh_distance import TriangleTree

_FLAT: Final = 1e-8  # sine of the angle at a corner; below, a triangle is degenerate


@dataclass(frozen=True, eq=False)
class NearestPlaces:
    """Nearest places on a mesh for the points within reach of the mesh."""

    point: I64  # (n,) indices of the points, ascending
    triangle: I64  # (n,)
    weights: F64  # (n, 3) barycentric, each in 0..1, sum 1
    place: F64  # (n, 3)
    distance: F64  # (n,)


class SurfaceLocator:
    """Search tree for nearest places on one mesh with triangle corners (F, 3, 3).

    Degenerate triangles are ignored. ``reach`` is the largest distance of a nearest place, in the
    unit of the coordinates.
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
        """Nearest places of points (N, 3); points beyond reach, and all without solid triangles,
        are left out."""
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
    """Barycentric coordinates (N, 3), in 0..1, of the nearest place to points (N, 3) on one
    triangle each (N, 3, 3); degenerate triangles count as edges."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    inside = _plane_weights(points, a, b, c)
    # Degenerate triangles have no interior: the nearest place is on an edge.
    is_flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) == 0.0
    smallest = np.where((inside >= 0.0).all(axis=1) & ~is_flat, 0.0, np.inf)
    weights = inside.copy()
    # Outside of the triangle the nearest place is on an edge or corner: the clipped projection.
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = corners[:, end] - corners[:, start]
        along = np.einsum("ij,ij->i", points - corners[:, start], edge)
        share = np.clip(along / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-30), 0.0, 1.0)
        on_edge = corners[:, start] + share[:, None] * edge
        distance = np.linalg.norm(points - on_edge, axis=1)
        nearer = distance < smallest
        smallest[nearer] = distance[nearer]
        weights[nearer] = 0.0
        weights[nearer, start] = 1.0 - share[nearer]
        weights[nearer, end] = share[nearer]
    return weights


def _plane_weights(points: F64, a: F64, b: F64, c: F64) -> F64:
    """Barycentric coordinates (N, 3) of points projected on triangle planes, negative outside."""
    edge_1, edge_2, offset = b - a, c - a, points - a
    d00, d01, d11 = (
        np.einsum("ij,ij->i", x, y)
        for x, y in ((edge_1, edge_1), (edge_1, edge_2), (edge_2, edge_2))
    )
    d20, d21 = (np.einsum("ij,ij->i", offset, x) for x in (edge_1, edge_2))
    scale = np.maximum(d00 * d11 - d01 * d01, 1e-40)
    v, w = (d11 * d20 - d01 * d21) / scale, (d00 * d21 - d01 * d20) / scale
    return np.column_stack((1.0 - v - w, v, w))
