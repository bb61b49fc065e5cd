# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on a triangle mesh, prepared for repeated queries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..volume.mesh_distance import TriangleTree
from .nearest import barycentric

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
