# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a point is from a volume's boundary, and when a moving point is inside."""

from __future__ import annotations

from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from .analytic import Capsule, Cuboid, Cylinder, Sphere
from .mesh import MeshVolume
from .mesh_distance import _leaf_order as leaf_order
from .shape import Shape

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]


def clearance(shape: Shape, points: F64) -> F64:
    """A bound of the distance to the boundary, in shape space.

    Within less than its absolute value all points are on the same side of the boundary: it is
    positive outside, negative inside, and 0 where no such bound is known without looking.

    Parameters
    ----------
    shape : Shape
    points : (3, N) float64
        Shape space.

    Returns
    -------
    (N,) float64
        NaN for NaN points.
    """
    if isinstance(shape, Cuboid):
        return np.asarray(np.abs(points).max(axis=0) - 1.0)
    if isinstance(shape, Sphere):
        return np.asarray(np.sqrt(np.einsum("ij,ij->j", points, points)) - 1.0)
    if isinstance(shape, Cylinder):
        around = np.sqrt(np.einsum("ij,ij->j", points[:2], points[:2]))
        return np.asarray(np.maximum(around, np.abs(points[2])) - 1.0)
    if isinstance(shape, Capsule):
        beyond = np.maximum(np.abs(points[2]) - shape.half_segment, 0.0)
        with np.errstate(over="ignore"):
            squared = np.einsum("ij,ij->j", points[:2], points[:2]) + beyond * beyond
        return np.asarray(np.sqrt(squared) - 1.0)
    low, high = shape.bounds
    outside = np.maximum(low[:, None] - points, points - high[:, None]).max(axis=0)
    return np.asarray(np.maximum(outside, 0.0))


def passage(shape: Shape, starts: F64, ends: F64) -> tuple[F64, F64]:
    """When points that move straight, at an even speed, are inside.

    Exact for convex shapes, however thin. Between the first and the last moment inside a mesh
    a point may leave it for a while.

    Parameters
    ----------
    shape : Shape
    starts, ends : (3, N) float64
        Shape space.

    Returns
    -------
    first, last : (N,) float64
        From 0 at the start to 1 at the end; ``first`` is infinite, and ``last`` minus
        infinity, where a point is never inside.
    """
    way = ends - starts
    # Infinite and missing numbers are the rule here: a way that is parallel to a plane.
    with np.errstate(all="ignore"):
        if isinstance(shape, Cuboid):
            first, last = _within_planes(starts, way, 1.0)
        elif isinstance(shape, Sphere):
            first, last = _within_ball(starts, way)
        elif isinstance(shape, Cylinder):
            first, last = _both(
                _within_ball(starts[:2], way[:2]), _within_planes(starts[2:], way[2:], 1.0)
            )
        elif isinstance(shape, Capsule):
            half = shape.half_segment
            first, last = _both(
                _within_ball(starts[:2], way[:2]), _within_planes(starts[2:], way[2:], half)
            )
            first, last = _unless_empty(first, last)
            for end in (half, -half):
                centre = np.array([[0.0], [0.0], [end]])
                one, other = _unless_empty(*_within_ball(starts - centre, way))
                first, last = np.minimum(first, one), np.maximum(last, other)
        else:
            first, last = _through_mesh(shape, starts, ends)
    first, last = np.maximum(first, 0.0), np.minimum(last, 1.0)
    return _unless_empty(first, last)


def _both(one: tuple[F64, F64], other: tuple[F64, F64]) -> tuple[F64, F64]:
    return np.maximum(one[0], other[0]), np.minimum(one[1], other[1])


def _unless_empty(first: F64, last: F64) -> tuple[F64, F64]:
    empty = ~(first <= last)
    return np.where(empty, np.inf, first), np.where(empty, -np.inf, last)


def _within_planes(starts: F64, way: F64, half: float) -> tuple[F64, F64]:
    """When all coordinates are between -half and half."""
    one, other = (-half - starts) / way, (half - starts) / way
    still = way == 0.0
    outside = still & (np.abs(starts) > half)
    first = np.where(still, np.where(outside, np.inf, -np.inf), np.minimum(one, other))
    last = np.where(still, np.where(outside, -np.inf, np.inf), np.maximum(one, other))
    return first.max(axis=0), last.min(axis=0)


def _within_ball(starts: F64, way: F64) -> tuple[F64, F64]:
    """When the norm is at most 1."""
    speed = np.sqrt(np.einsum("ij,ij->j", way, way))
    still = speed == 0.0
    direction = way / np.where(still, 1.0, speed)
    along = np.einsum("ij,ij->j", starts, direction)
    aside = starts - along * direction
    left = 1.0 - np.einsum("ij,ij->j", aside, aside)
    half = np.sqrt(np.maximum(left, 0.0))
    first, last = (-along - half) / speed, (-along + half) / speed
    first = np.where(still, -np.inf, first)
    last = np.where(still, np.inf, last)
    missed = ~(left >= 0.0)
    return np.where(missed, np.inf, first), np.where(missed, -np.inf, last)


_GRAZE: Final = 1e-9
"""How far beyond a triangle's edge a crossing counts, as a share: no way slips between two."""

_PAIRS_AT_ONCE: Final = 1 << 18

_TREES: WeakKeyDictionary[Shape, _SegmentTree] = WeakKeyDictionary()


def _through_mesh(shape: Shape, starts: F64, ends: F64) -> tuple[F64, F64]:
    assert isinstance(shape, MeshVolume)
    if shape not in _TREES:
        _TREES[shape] = _SegmentTree(shape)
    first, last = _TREES[shape].crossings(starts, ends)
    first = np.where(shape.contains(starts), 0.0, first)
    last = np.where(shape.contains(ends), 1.0, last)
    return first, last


class _SegmentTree:
    """Boxes over a mesh's triangles, for what a segment crosses."""

    def __init__(self, mesh: MeshVolume) -> None:
        corners = np.asarray(mesh.vertices, np.float64)[mesh.triangles]
        self._middle = corners.reshape(-1, 3).mean(axis=0)[:, None]
        corners = corners - self._middle[:, 0]
        order = leaf_order(corners)
        low, high = corners.min(axis=1).T[:, order], corners.max(axis=1).T[:, order]
        slack = 1e-12 * float(np.abs(corners).max())
        low, high = low - slack, high + slack
        self._levels = [(low, high)]
        while low.shape[1] > 1:
            low = np.minimum(low[:, ::2], low[:, 1::2])
            high = np.maximum(high[:, ::2], high[:, 1::2])
            self._levels.insert(0, (low, high))
        self._corners = corners[order].transpose(1, 2, 0)  # (3 corners, 3, leaves)

    def crossings(self, starts: F64, ends: F64) -> tuple[F64, F64]:
        """Where segments first and last cross the surface; infinite where they do not."""
        first = np.full(starts.shape[1], np.inf)
        last = -first
        usable = np.flatnonzero(np.isfinite(starts + ends).all(axis=0))
        self._cross(starts - self._middle, (ends - starts), usable, first, last)
        return first, last

    def _cross(self, starts: F64, way: F64, asked: I64, first: F64, last: F64) -> None:
        owners, nodes = asked, np.zeros(len(asked), np.int64)
        for level, (low, high) in enumerate(self._levels):
            if level:
                owners, nodes = np.repeat(owners, 2), np.repeat(nodes, 2) * 2
                nodes[1::2] += 1
            start, step = starts.take(owners, axis=1), way.take(owners, axis=1)
            one, other = (low[:, nodes] - start) / step, (high[:, nodes] - start) / step
            # A step of 0 divides to +-inf outside the slab or on both sides within; 0 / 0 is
            # a point on a face, which fmin and fmax take as within.
            enter = np.fmin(one, other).max(axis=0, initial=0.0, where=~np.isnan(one))
            leave = np.fmax(one, other).min(axis=0, initial=1.0, where=~np.isnan(other))
            met = enter <= leave + _GRAZE
            owners, nodes = owners[met], nodes[met]
            if len(owners) > _PAIRS_AT_ONCE and len(asked) > 1:
                half = len(asked) // 2
                self._cross(starts, way, asked[:half], first, last)
                self._cross(starts, way, asked[half:], first, last)
                return
        at, hit = self._hits(starts.take(owners, axis=1), way.take(owners, axis=1), nodes)
        np.minimum.at(first, owners[hit], at[hit])
        np.maximum.at(last, owners[hit], at[hit])

    def _hits(self, starts: F64, way: F64, leaves: I64) -> tuple[F64, Bool]:
        """Where segments meet the planes of triangles, and whether within the triangle.

        Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.
        """
        corner = self._corners[0][:, leaves]
        one = self._corners[1][:, leaves] - corner
        other = self._corners[2][:, leaves] - corner
        across = np.cross(way, other, axis=0)
        volume = np.einsum("ij,ij->j", one, across)
        offset = starts - corner
        u = np.einsum("ij,ij->j", offset, across) / volume
        turned = np.cross(offset, one, axis=0)
        v = np.einsum("ij,ij->j", way, turned) / volume
        at = np.einsum("ij,ij->j", other, turned) / volume
        within = (u >= -_GRAZE) & (v >= -_GRAZE) & (u + v <= 1.0 + _GRAZE)
        return at, within & (at >= -_GRAZE) & (at <= 1.0 + _GRAZE)
