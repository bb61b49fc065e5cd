# SPDX-License-Identifier: GPL-3.0-or-later
"""Passage of moving points through a volume."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..arrays import F64
from ..ways import Ways
from .analytic import Capsule, Cuboid, Cylinder, Sphere
from .mesh import MeshVolume
from .shape import Shape


def passage(shape: Shape, starts: F64, ends: F64) -> tuple[F64, F64]:
    """First and last time at which points in straight, even motion are inside.

    Exact for convex shapes, however thin. Between the first and the last moment inside a mesh
    a point may leave it for a while.

    Parameters
    ----------
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
            first, last = _through_mesh(shape, Ways.straight(starts, ends))
    first, last = np.maximum(first, 0.0), np.minimum(last, 1.0)
    return _unless_empty(first, last)


def passage_along(shape: Shape, ways: Ways) -> tuple[F64, F64]:
    """:func:`passage` for paths that may have several steps."""
    if isinstance(shape, MeshVolume):
        with np.errstate(all="ignore"):  # as in passage
            return _unless_empty(*_through_mesh(shape, ways))
    first = np.full(len(ways.intervals), np.inf)
    last = -first
    for k, (start, end) in enumerate(pairwise(ways.path())):
        enter, leave = passage(shape, start, end)
        first = np.minimum(first, (k + enter) / ways.steps)
        last = np.maximum(last, (k + leave) / ways.steps)
    return first, last


def _both(one: tuple[F64, F64], other: tuple[F64, F64]) -> tuple[F64, F64]:
    return np.maximum(one[0], other[0]), np.minimum(one[1], other[1])


def _unless_empty(first: F64, last: F64) -> tuple[F64, F64]:
    empty = ~(first <= last)
    return np.where(empty, np.inf, first), np.where(empty, -np.inf, last)


def _within_planes(starts: F64, way: F64, half: float) -> tuple[F64, F64]:
    """Times at which all coordinates are between -half and half, first and last (N,)."""
    one, other = (-half - starts) / way, (half - starts) / way
    still = way == 0.0
    outside = still & (np.abs(starts) > half)
    first = np.where(still, np.where(outside, np.inf, -np.inf), np.minimum(one, other))
    last = np.where(still, np.where(outside, -np.inf, np.inf), np.maximum(one, other))
    return first.max(axis=0), last.min(axis=0)


def _within_ball(starts: F64, way: F64) -> tuple[F64, F64]:
    """Times at which the norm is at most 1, first and last (N,)."""
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


def _through_mesh(shape: Shape, ways: Ways) -> tuple[F64, F64]:
    assert isinstance(shape, MeshVolume)
    first, last = shape.crossings(ways)
    first = np.where(shape.contains(ways.before), 0.0, first)
    last = np.where(shape.contains(ways.after), 1.0, last)
    return first, last
