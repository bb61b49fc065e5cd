# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact distance from points to a set of triangles, by a tree of boxes."""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from ..native import mesh_search as native
from ..native.library import library

PAIRS_AT_ONCE: Final = 2**18
_FEW: Final = 4  # boxes that a first guess follows
_MANY: Final = 16  # the same deep inside, where many triangles are as far


class TriangleTree:
    """A balanced binary tree of boxes over triangles.

    Parameters
    ----------
    corners : (F, 3, 3) float64
        Triangle, corner, coordinate. A degenerate triangle counts as the segment that it is.
    order : (2^k,) int64, optional
        Triangles as leaves; for triangles that an affine map has only moved.

    Attributes
    ----------
    corners, order
        As given.
    compiled : NativeTree or None
        The same for the compiled searches, where there are any.
    """

    def __init__(self, corners: F64, order: I64 | None = None) -> None:
        self.corners = corners
        self.compiled = None
        if library() is not None:
            self.order = native.leaf_order(corners) if order is None else order
            self.compiled = native.NativeTree(corners, self.order)
        else:
            self.order = leaf_order(corners) if order is None else order

    @cached_property
    def levels(self) -> list[tuple[F64, F64]]:
        """Lowest and highest corners (3, 2^l) of the boxes, from the root to the leaves."""
        by_corner = np.ascontiguousarray(self.corners.transpose(1, 2, 0))
        low, high = by_corner.min(axis=0)[:, self.order], by_corner.max(axis=0)[:, self.order]
        levels = [(low, high)]
        while low.shape[1] > 1:
            low = np.minimum(low[:, ::2], low[:, 1::2])
            high = np.maximum(high[:, ::2], high[:, 1::2])
            levels.insert(0, (low, high))
        return levels

    @cached_property
    def _frames(self) -> F64:
        return _plane_frames(self.corners)

    def placed(self, linear: F64) -> TriangleTree:
        """The tree of the triangles under a linear map, (3, 3)."""
        return TriangleTree(self.corners @ linear.T, self.order)

    def distances(self, points: F64) -> F64:
        """Distance of each point of (3, N) to the nearest triangle, (N,)."""
        if self.compiled is not None:
            return self.compiled.nearest(points)[1]
        distances: F64 = np.sqrt(self._squared(points, self._first_guess(points, _FEW))[0])
        return distances

    def nearest(self, points: F64, reach: float) -> tuple[I64, F64]:
        """Triangle nearest to each point of (3, N) within ``reach``, and its distance, (N,) each.

        -1 and infinity where none is so near.
        """
        if self.compiled is not None:
            leaves, distances = self.compiled.nearest(points, reach)
        else:
            rounding = 1e-12 * float(np.abs(self.corners).max())  # of a place near its box
            bound = self._first_guess(points, _FEW) * (1.0 + 1e-12) + rounding**2
            squared, leaves = self._squared(points, np.minimum(bound, reach * reach))
            distances = np.where(leaves < 0, np.inf, np.sqrt(squared))
        return np.where(leaves < 0, -1, self.order[leaves]), distances

    def distances_beyond(self, points: F64, limit: float, slack: float) -> F64:
        """Approximation of :meth:`distances`, cheaper: too large by at most the share ``slack``.
        For points within ``limit`` the result only says that they are within it.
        """
        if self.compiled is not None:
            return self.compiled.distances_beyond(points, limit, slack, _MANY)
        squared = self._first_guess(points, _MANY)
        far = squared > limit * limit
        squared[far] = self._squared(points[:, far], squared[far], (1.0 + slack) ** -2)[0]
        return np.sqrt(squared)

    def _squared(self, points: F64, best: F64, share: float = 1.0) -> tuple[F64, I64]:
        """Squared distances, given upper bounds of them, and the leaves, -1 where the bound is
        less: pass over the tree level by level.

        Boxes beyond ``share`` of a bound are not entered.
        """
        count = points.shape[1]
        owners, nodes = np.arange(count), np.zeros(count, np.int64)
        for low, high in self.levels[1:]:
            owners, nodes = np.repeat(owners, 2), np.repeat(nodes, 2) * 2
            nodes[1::2] += 1
            place = points.take(owners, axis=1)
            gaps = np.maximum(low.take(nodes, axis=1) - place, place - high.take(nodes, axis=1))
            near = _squared_norm(np.maximum(gaps, 0.0)) <= share * best[owners]
            owners, nodes = owners[near], nodes[near]
            if len(owners) > PAIRS_AT_ONCE and count > 1:
                half = count // 2
                parts = (slice(half), slice(half, None))
                found = [self._squared(points[:, p], best[p], share) for p in parts]
                squared, leaves = (np.concatenate(each) for each in zip(*found, strict=True))
                return squared, leaves
        frames = self._frames.take(self.order[nodes], axis=1)
        squared = _to_triangles(points.take(owners, axis=1), frames)
        best, leaves = best.copy(), np.full(count, -1)
        by_distance = np.argsort(-squared, kind="stable")  # of those of one point the least is last
        by_distance = by_distance[squared[by_distance] <= best[owners[by_distance]]]
        best[owners[by_distance]] = squared[by_distance]
        leaves[owners[by_distance]] = nodes[by_distance]
        return best, leaves

    def _first_guess(self, points: F64, width: int) -> F64:
        """Squared distance to a triangle that is near: the ``width`` nearest boxes go on down."""
        nodes = np.zeros((1, points.shape[1]), np.int64)
        for low, high in self.levels[1:]:
            nodes = np.concatenate([2 * nodes, 2 * nodes + 1])
            flat = nodes.ravel()
            middles = 0.5 * (low.take(flat, axis=1) + high.take(flat, axis=1))
            away = _squared_norm(
                (points[:, None] - middles.reshape(3, *nodes.shape)).reshape(3, -1)
            ).reshape(nodes.shape)
            if len(nodes) > width:
                nearest = np.argsort(away, axis=0, kind="stable")[:width]
                nodes = np.take_along_axis(nodes, nearest, 0)
        triangles = self.order[nodes.ravel()]
        squared = _to_triangles(np.tile(points, len(nodes)), self._frames.take(triangles, axis=1))
        nearest_of_all: F64 = squared.reshape(nodes.shape).min(axis=0)
        return nearest_of_all


def _squared_norm(vectors: F64) -> F64:
    squared: F64 = np.einsum("ij,ij->j", vectors, vectors)
    return squared


def leaf_order(corners: F64) -> I64:
    """Triangles halved at the median of the longest axis, again and again; some come twice."""
    count = len(corners)
    size = 1 << (count - 1).bit_length()
    order = np.arange(size) * count // size
    middles = corners.mean(axis=1)
    while size > 1:
        groups = middles[order].reshape(-1, size, 3)
        longest = np.argmax(np.ptp(groups, axis=1), axis=1)
        keys = np.take_along_axis(groups, longest[:, None, None], 2)[:, :, 0]
        ranks = np.argsort(keys, axis=1, kind="stable")
        order = np.take_along_axis(order.reshape(-1, size), ranks, 1).ravel()
        size //= 2
    return order


def _plane_frames(corners: F64) -> F64:
    """Frame of each triangle in its own plane, (15, F).

    The x axis is the longest edge, from the origin; the apex is above it. Rows: origin (3), the
    axes x, y, z in world coordinates (9), length of the longest edge, apex x, apex y. However
    thin the triangle, its frame is orthonormal and its corners are right to rounding.
    """
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.argmax(np.sum(edges**2, axis=2), axis=1)
    rows = np.arange(len(corners))
    origin, base = corners[rows, longest], edges[rows, longest]
    apex = corners[rows, (longest + 2) % 3] - origin
    length = np.sqrt(np.sum(base**2, axis=1))
    axis_x = base / np.where(length > 0.0, length, 1.0)[:, None]
    axis_y = apex
    for _ in range(2):  # once more: for a thin triangle the first difference is mostly rounding
        axis_y = axis_y - np.sum(axis_y * axis_x, axis=1)[:, None] * axis_x
    width = np.sqrt(np.sum(axis_y**2, axis=1))
    some = np.eye(3)[np.argmin(np.abs(axis_x), axis=1)]
    some = np.cross(axis_x, some)
    some /= np.maximum(np.sqrt(np.sum(some**2, axis=1)), 1e-300)[:, None]
    thin = width <= 1e-15 * length
    axis_y = np.where(thin[:, None], some, axis_y / np.where(thin, 1.0, width)[:, None])
    apex_xy = [np.sum(apex * axis, axis=1)[:, None] for axis in (axis_x, axis_y)]
    parts = [origin, axis_x, axis_y, np.cross(axis_x, axis_y), length[:, None], *apex_xy]
    return np.ascontiguousarray(np.concatenate(parts, axis=1).T)


def _to_triangles(points: F64, frames: F64) -> F64:
    """Squared distances of points (3, n) to triangles given by their frames (15, n)."""
    offset = points - frames[:3]
    x, y, z = (np.einsum("ij,ij->j", offset, frames[k : k + 3]) for k in (3, 6, 9))
    length, apex_x, apex_y = frames[12:]

    # The angles at both ends of the longest edge are acute: below it, it is the nearest.
    beside = x - np.clip(x, 0.0, length)
    to_base = beside * beside + y * y
    left, left_of = _to_side(x, y, apex_x, apex_y)
    right, right_of = _to_side(length - x, y, length - apex_x, apex_y)
    to_sides = np.where(left_of | right_of, np.minimum(left, right), 0.0)
    in_plane = np.where(y > 0.0, to_sides, to_base)
    squared: F64 = in_plane + z * z
    return squared


def _to_side(x: F64, y: F64, end_x: F64, end_y: F64) -> tuple[F64, Bool]:
    """Squared distance to the segment from the origin to an end above it; whether left of it."""
    square = end_x * end_x + end_y * end_y
    share = (x * end_x + y * end_y) / np.where(square > 0.0, square, 1.0)
    share = np.clip(share, 0.0, 1.0)
    return (x - share * end_x) ** 2 + (y - share * end_y) ** 2, x * end_y < y * end_x
