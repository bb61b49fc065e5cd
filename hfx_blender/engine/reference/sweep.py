# SPDX-License-Identifier: GPL-3.0-or-later
"""Times at which moving points are inside a volume.

Points move straight at constant speed. A convex shape is an intersection or a union of slabs and
balls, and a straight path meets each of these in one time interval (Kay and Kajiya, "Ray tracing
complex scenes", 1986). A mesh is entered and left at the triangles; between the first and the last
moment inside, a point counts as inside.
"""

import numpy as np

from ..arrays import F64, Bool
from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.mesh import MeshVolume
from ..volume.shape import Shape
from .shapes import contains

Interval = tuple[F64, F64]
"""First and last time (N,) each; (inf, -inf) if empty."""


def passage(shape: Shape, path: F64) -> Interval:
    """First and last time (N,) at which points are inside, on paths (steps + 1, 3, N) in shape
    space of even steps: from 0 at the start to 1 at the end; (inf, -inf) if never inside."""
    steps = len(path) - 1
    interval: Interval = np.full(path.shape[2], np.inf), np.full(path.shape[2], -np.inf)
    for k in range(steps):
        first, last = _passage(shape, path[k], path[k + 1])
        interval = _union(interval, ((k + first) / steps, (k + last) / steps))
    return interval


def along(path: F64, share: F64) -> tuple[F64, F64]:
    """Positions (3, N) on paths (steps + 1, 3, N) at fractions (N,) of the time, and velocities (3,
    N) per whole time."""
    steps, which = len(path) - 1, np.arange(path.shape[2])
    step = np.clip((share * steps).astype(np.int64), 0, steps - 1)
    start: F64 = path[step, :, which].T
    way: F64 = path[step + 1, :, which].T - start
    return start + (share * steps - step) * way, way * steps


def _passage(shape: Shape, start: F64, end: F64) -> Interval:
    """First and last time (N,), 0 to 1, inside during one straight step from ``start`` to ``end``
    (3, N), shape space; (inf, -inf) if never inside. Gaps of a mesh in between count as inside."""
    way = end - start
    with np.errstate(all="ignore"):  # a way along a plane divides by 0
        if isinstance(shape, Cuboid):
            interval = _in_slabs(start, way, 1.0)
        elif isinstance(shape, Sphere):
            interval = _in_ball(start, way)
        elif isinstance(shape, Cylinder):
            interval = _both(_in_ball(start[:2], way[:2]), _in_slabs(start[2:], way[2:], 1.0))
        elif isinstance(shape, Capsule):
            half = shape.half_segment
            interval = _both(_in_ball(start[:2], way[:2]), _in_slabs(start[2:], way[2:], half))
            for centre in (half, -half):
                interval = _union(
                    interval, _in_ball(start - np.array([[0.0], [0.0], [centre]]), way)
                )
        else:
            assert isinstance(shape, MeshVolume)
            # A mesh counts as one interval, from the first to the last crossing or inside end.
            interval = _through_triangles(shape.corners, start, way)
            interval = _union(interval, _at(contains(shape, start), 0.0))
            interval = _union(interval, _at(contains(shape, end), 1.0))
    first, last = np.maximum(interval[0], 0.0), np.minimum(interval[1], 1.0)
    return _unless_empty(first, last)


def _unless_empty(first: F64, last: F64) -> Interval:
    """Interval ``first`` to ``last``, or (inf, -inf) where first > last or either is NaN."""
    is_some = first <= last  # False for what is not a number
    return np.where(is_some, first, np.inf), np.where(is_some, last, -np.inf)


def _both(first: Interval, second: Interval) -> Interval:
    """Intersection of intervals."""
    return _unless_empty(np.maximum(first[0], second[0]), np.minimum(first[1], second[1]))


def _union(first: Interval, second: Interval) -> Interval:
    """Smallest interval with both intervals, the gap between included; empty only if both are."""
    return np.minimum(first[0], second[0]), np.maximum(first[1], second[1])


def _at(is_inside: Bool, time: float) -> Interval:
    """Interval of the single ``time``, empty where not ``is_inside`` (N,)."""
    return np.where(is_inside, time, np.inf), np.where(is_inside, time, -np.inf)


def _in_slabs(start: F64, way: F64, half: float) -> Interval:
    """Time interval (N,) with all coordinates between -half and half, on lines start + t * way (K,
    N); not limited to 0..1, infinite at rest inside."""
    to_low, to_high = (-half - start) / way, (half - start) / way
    # A point at rest along an axis is inside the slab always or never.
    rests = np.where(np.abs(start) <= half, -np.inf, np.inf)
    first = np.where(way == 0.0, rests, np.minimum(to_low, to_high)).max(axis=0)
    last = np.where(way == 0.0, -rests, np.maximum(to_low, to_high)).min(axis=0)
    return _unless_empty(first, last)


def _in_ball(start: F64, way: F64) -> Interval:
    """Time interval (N,) with a norm of at most 1 on lines start + t * way (K, N): half a chord
    around the nearest moment, not limited to 0..1, infinite at rest inside."""
    squared = (way * way).sum(axis=0)
    rests = np.where((start * start).sum(axis=0) <= 1.0, -np.inf, np.inf)
    nearest = -(start * way).sum(axis=0) / squared
    aside = start + nearest * way
    half = np.sqrt((1.0 - (aside * aside).sum(axis=0)) / squared)
    first, last = nearest - half, nearest + half
    is_still = squared == 0.0
    return _unless_empty(np.where(is_still, rests, first), np.where(is_still, -rests, last))


def _through_triangles(corners: F64, start: F64, way: F64) -> Interval:
    """First and last time (N,) of crossing triangles (F, 3, 3) on ways ``start`` to ``start +
    way``, (3, N) each; 0 to 1, with 1e-9 beyond ends and edges; (inf, -inf) without a crossing.
    Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997."""
    interval = np.full(start.shape[1], np.inf), np.full(start.shape[1], -np.inf)
    grain = 1e-9
    for a, b, c in corners:
        across = np.cross(way, c - a, axisa=0, axisb=0).T
        # Signed volume of way and edges: 0 for a way within the plane, which then misses.
        volume = (b - a) @ across
        offset = start - a[:, None]
        u = (offset * across).sum(axis=0) / volume
        turned = np.cross(offset, b - a, axisa=0, axisb=0).T
        v = (way * turned).sum(axis=0) / volume
        time = (c - a) @ turned / volume
        hit = (u >= -grain) & (v >= -grain) & (u + v <= 1.0 + grain)
        hit &= (time >= -grain) & (time <= 1.0 + grain)
        interval = _union(interval, (np.where(hit, time, np.inf), np.where(hit, time, -np.inf)))
    return interval
