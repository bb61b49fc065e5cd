# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside of volumes, and the strength there.

All shapes have unit size in shape space; the placing matrix holds position, size, stretch and
shear. The boundary is inside.
"""

from typing import Final

import numpy as np

from ..arrays import F64, Bool
from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.mesh import MeshVolume
from ..volume.shape import Falloff, FalloffKind, Shape

_PAIRS_AT_ONCE: Final = 1 << 20  # (point, triangle) pairs


def strength(shape: Shape, falloff: Falloff, points: F64) -> F64:
    """Strength (N,) at points (3, N) in shape space: 0 outside; 1 inside without a falloff.

    A falloff (kind not NONE, share above 0) starts at 0 on the boundary and reaches 1 where
    :func:`rise`, 1 in the core (centre, axis or deepest point), equals its share: linearly, or
    smoothly by ``3 t^2 - 2 t^3``.
    """
    inside = contains(shape, points)
    if falloff.kind is FalloffKind.NONE or falloff.share <= 0.0:
        return inside.astype(np.float64)
    strengths = np.zeros(points.shape[1])
    t = np.minimum(rise(shape, points[:, inside]) / falloff.share, 1.0)
    strengths[inside] = t if falloff.kind is FalloffKind.LINEAR else 3.0 * t**2 - 2.0 * t**3
    return strengths


def contains(shape: Shape, points: F64) -> Bool:
    """Mask (N,) of points inside or on the boundary; NaN is outside."""
    if isinstance(shape, MeshVolume):
        return np.abs(winding_numbers(shape.corners, points)) > 0.5
    inside: Bool = gauge(shape, points) <= 1.0
    return inside


def rise(shape: Shape, points: F64) -> F64:
    """Fraction (N,) of the way from the boundary to the core, for points (3, N) inside.

    Linear along straight lines from the boundary to the centre of a cuboid or an ellipsoid, to the
    axis of a capsule. For a mesh: depth in shape space over the radius of the largest inscribed
    ball, at most 1.
    """
    if isinstance(shape, MeshVolume):
        core = shape.core_radius
        depths = np.sqrt(nearest_on_triangles(shape.corners, points)[1])
        return np.minimum(depths / core, 1.0) if core > 0.0 else np.zeros(points.shape[1])
    return np.maximum(1.0 - gauge(shape, points), 0.0)


def gauge(shape: Shape, points: F64) -> F64:
    """Minkowski functional (N,) of a convex shape at points (3, N), shape space: below 1 inside, 1
    on the boundary.

    For a capsule the distance from the segment of its axis. Meshes have none.
    """
    if isinstance(shape, Cuboid):
        return np.asarray(np.abs(points).max(axis=0))
    if isinstance(shape, Cylinder):
        return np.maximum(np.hypot(points[0], points[1]), np.abs(points[2]))
    assert isinstance(shape, Sphere | Capsule)
    half = shape.half_segment if isinstance(shape, Capsule) else 0.0
    away = points.copy()
    away[2] -= np.clip(points[2], -half, half)
    return np.asarray(np.linalg.norm(away, axis=0))


def winding_numbers(corners: F64, points: F64) -> F64:
    """Winding number (N,) of a closed triangle mesh (F, 3, 3) around points (3, N); 0 outside its
    box.

    The sum of the triangles' solid angles over 4 pi (Jacobson et al., "Robust inside-outside
    segmentation using generalized winding numbers", 2013), each by Van Oosterom and Strackee, "The
    solid angle of a plane triangle", 1983.
    """
    numbers = np.zeros(points.shape[1])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    near = np.flatnonzero(((points.T >= low) & (points.T <= high)).all(axis=1))
    # Points in parts, so that the arrays of point and triangle pairs stay small.
    size = max(1, _PAIRS_AT_ONCE // len(corners))
    for part in (near[first : first + size] for first in range(0, len(near), size)):
        a, b, c = (corners[:, k, :, None] - points[:, part] for k in range(3))  # (F, 3, n)
        la, lb, lc = (np.sqrt(np.einsum("fin,fin->fn", side, side)) for side in (a, b, c))
        volume = np.einsum("fin,fin->fn", a, np.cross(b, c, axis=1))
        ab, bc, ca = (np.einsum("fin,fin->fn", *pair) for pair in ((a, b), (b, c), (c, a)))
        half = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        numbers[part] = half.sum(axis=0) / (2.0 * np.pi)
    return numbers


def nearest_on_triangles(corners: F64, points: F64) -> tuple[F64, F64]:
    """Nearest points (3, N) of triangles (F, 3, 3) to points (3, N), and squared distances
    (N,).

    The perpendicular's foot if inside a triangle, else the nearest point of an edge.
    """
    places, least = np.zeros_like(points), np.full(points.shape[1], np.inf)
    for a, b, c in corners:
        normal = np.cross(b - a, c - a)
        squared = normal @ normal
        # A degenerate triangle has no plane, only edges.
        if squared > 0.0:
            foot = points - np.outer(normal, normal @ (points - a[:, None])) / squared
            inside = np.ones(points.shape[1], np.bool_)
            for start, end in ((a, b), (b, c), (c, a)):
                inside &= np.cross(normal, end - start) @ (foot - start[:, None]) >= 0.0
            _keep_nearer(points, np.where(inside, foot, np.inf), places, least)
        for start, end in ((a, b), (b, c), (c, a)):
            length = (end - start) @ (end - start)
            share = (end - start) @ (points - start[:, None]) / (length if length > 0.0 else 1.0)
            foot = start[:, None] + np.outer(end - start, np.clip(share, 0.0, 1.0))
            _keep_nearer(points, foot, places, least)
    return places, least


def _keep_nearer(points: F64, feet: F64, places: F64, least: F64) -> None:
    """Replace nearest points ``places`` (3, N) and squared distances ``least`` (N,) where ``feet``
    (3, N) are nearer to points, in place; infinite feet never win."""
    away = feet - points
    squared = np.einsum("in,in->n", away, away)
    nearer = squared < least
    places[:, nearer], least[nearer] = feet[:, nearer], squared[nearer]
