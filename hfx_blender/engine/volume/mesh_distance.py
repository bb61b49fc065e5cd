# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact distances from points to a set of triangles, and nearest places on triangles."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..native.library import library, loaded, structure

PAIRS_AT_ONCE: Final = 2**20
"""Pairs of a point and a triangle that are compared at a time without the library."""

_BOX: Final = 6  # lowest and highest corner
_FRAME: Final = 16
_WIDTH: Final = 16  # boxes followed at each level for a first upper bound
_FLAT: Final = 1e-8  # sine of the angle at a corner; below, a triangle is degenerate


class TriangleTree:
    """Triangles prepared for searches of the nearest; without the library all are compared.

    ``corners`` (F, 3, 3) are by triangle, corner, axis; a degenerate triangle counts as a segment.
    ``order`` (2^k,) is the triangle of each leaf, taken from the tree of the same triangles before
    a linear map, if given; ``compiled`` is ``hfx_tree``. Both are None without the library.
    """

    def __init__(self, corners: F64, order: I64 | None = None) -> None:
        self.corners, self.order, self.compiled = corners, order, None
        if library() is None:
            return
        if order is None:
            # Leaves of a balanced tree: groups of triangles are halved at the median centroid along
            # their longest axis; some triangles occur twice, to fill the leaves.
            count = len(corners)
            size = 1 << (count - 1).bit_length()
            order, spare = np.empty(size, np.int64), np.empty(size, np.int64)
            room = np.empty((count, 3)), np.empty(size), np.empty(size), spare
            loaded().hfx_mesh_leaf_order(corners, count, size, order, *room)
        # Boxes belong to nodes: 1 is the root, 2 n and 2 n + 1 are the children of n, the leaves
        # are last. Frames belong to the leaves' triangles.
        boxes, frames = np.zeros((2 * len(order), _BOX)), np.empty((len(order), _FRAME))
        loaded().hfx_mesh_boxes(corners, order, len(order), boxes)
        loaded().hfx_mesh_frames(corners, order, len(order), frames)
        self.compiled = structure("hfx_tree")(boxes, order, corners, frames, len(order))
        self.order = order

    def placed(self, linear: F64) -> "TriangleTree":
        """Tree of the triangles under a linear map (3, 3)."""
        return TriangleTree(self.corners @ linear.T, self.order)

    def distances(self, points: F64) -> F64:
        """Distance of each point of (3, N) to the nearest triangle, (N,); NaN if not finite."""
        return self.nearest(points, np.inf)[1]

    def nearest(self, points: F64, reach: float | F64) -> tuple[I64, F64]:
        """Nearest triangle of each point of (3, N) within ``reach``, and the distance, (N,) each.
        -1 and infinity beyond; -1 and NaN for points that are not finite. ``reach`` is of all or of
        each point, (N,)."""
        if self.order is None:
            triangles, distances = self._compare(points)
            triangles[distances > reach], distances[distances > reach] = -1, np.inf
            return triangles, distances
        count = points.shape[1]
        leaves, distances = np.empty(count, np.int64), np.full(count, reach)
        loaded().hfx_mesh_nearest(self.compiled, points, count, leaves, distances)
        return np.where(leaves < 0, -1, self.order[leaves]), distances

    def distances_beyond(self, points: F64, limit: float, slack: float) -> F64:
        """Approximate :meth:`distances` of finite points: too large by at most share ``slack``. A
        point nearer than ``limit`` gets any distance up to the limit. Exact without the library."""
        if self.order is None:
            return self.distances(points)
        count, distances = points.shape[1], np.empty(points.shape[1])
        nodes, away = np.empty(2 * _WIDTH, np.int64), np.empty(2 * _WIDTH)
        loaded().hfx_mesh_distances_beyond(
            *(self.compiled, points, count, limit, slack, _WIDTH, nodes, away, distances)
        )
        return distances

    def _compare(self, points: F64) -> tuple[I64, F64]:
        """Nearest triangle (-1 if not finite) and distance (NaN), (N,) each, without a tree."""
        centres = self.corners.mean(axis=1)
        radii = np.linalg.norm(self.corners - centres[:, None], axis=2).max(axis=1)
        rounding = 1e-12 * float(np.abs(self.corners).max())
        nearest, distances = np.full(points.shape[1], -1), np.full(points.shape[1], np.nan)
        step = max(1, PAIRS_AT_ONCE // len(centres))
        for first in range(0, points.shape[1], step):
            part = points[:, first : first + step]
            away = np.linalg.norm(part.T[:, None] - centres, axis=2)
            # The nearest triangle is no farther than the far side of any bounding sphere.
            bound = (away + radii).min(axis=1)[:, None] * (1.0 + 1e-12) + rounding
            owners, triangles = np.nonzero(away - radii <= bound)
            corners = self.corners[triangles]
            places = np.einsum("nk,nkc->nc", barycentric(part.T[owners], corners), corners)
            off = np.linalg.norm(part.T[owners] - places, axis=1)
            order = np.lexsort((off, owners))
            best = order[np.flatnonzero(np.diff(owners[order], prepend=-1))]
            nearest[first + owners[best]] = triangles[best]
            distances[first + owners[best]] = off[best]
        return nearest, distances


@dataclass(frozen=True, eq=False)
class NearestPlaces:
    """Nearest places on a mesh for the points within reach of the mesh."""

    point: I64  # (n,) indices of the points, ascending
    triangle: I64  # (n,)
    weights: F64  # (n, 3) barycentric, each in 0..1, sum 1
    place: F64  # (n, 3)
    distance: F64  # (n,)


class SurfaceLocator:
    """Search tree for nearest places on one mesh with triangle corners (F, 3, 3). Degenerate
    triangles are ignored. ``reach`` is the largest distance of a nearest place, in the unit of the
    coordinates."""

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
    inside = plane_weights(points, a, b, c)
    # Degenerate triangles have no interior: the nearest place is on an edge.
    is_flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) == 0.0
    smallest = np.where((inside >= 0.0).all(axis=1) & ~is_flat, 0.0, np.inf)
    weights = inside.copy()
    # Outside of the triangle the nearest place is on an edge or corner: the clipped projection.
    outside = np.flatnonzero(smallest)
    points, corners, smallest = points[outside], corners[outside], smallest[outside]
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = corners[:, end] - corners[:, start]
        along = np.einsum("ij,ij->i", points - corners[:, start], edge)
        share = np.clip(along / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-30), 0.0, 1.0)
        on_edge = corners[:, start] + share[:, None] * edge
        distance = np.linalg.norm(points - on_edge, axis=1)
        nearer = distance < smallest
        smallest[nearer] = distance[nearer]
        rows = outside[nearer]
        weights[rows] = 0.0
        weights[rows, start] = 1.0 - share[nearer]
        weights[rows, end] = share[nearer]
    return weights


def plane_weights(points: F64, a: F64, b: F64, c: F64) -> F64:
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
