# SPDX-License-Identifier: GPL-3.0-or-later
"""Cuboid, sphere, cylinder and capsule: unit shapes with a formula.

Size, stretch and shear are in the placing matrix.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import F64, Bool
from .ellipsoid import Ellipsoid


def _squared_norm(points: F64) -> F64:
    """Squared lengths of vectors (n, N), (N,); infinity on overflow, without a warning."""
    # einsum is faster than np.linalg.norm, and silent on overflow; infinity counts as outside.
    squared: F64 = np.einsum("ij,ij->j", points, points)
    return squared


def _half_widths(linear: F64) -> F64:
    """Distances from a parallelepiped's centre to its three pairs of faces, (3,).

    ``linear`` (3, 3) has the half edges as columns. Edges are scaled to length 1 first, so that no
    scale overflows or underflows; a flat parallelepiped has a width of 0.
    """
    lengths = np.max(np.abs(linear), axis=0)
    edges = linear / np.where(lengths > 0.0, lengths, 1.0)
    normals = np.cross(np.roll(edges, -1, axis=1), np.roll(edges, -2, axis=1), axis=0)
    norms = np.sqrt(_squared_norm(normals))
    widths: F64 = np.abs(np.sum(normals * edges, axis=0)) * lengths
    widths /= np.where(norms > 0.0, norms, np.inf)
    return widths


def _across(linear: F64) -> Ellipsoid:
    """Cross-section, across its world axis, of the Z cylinder under a linear map (3, 3)."""
    scale = np.max(np.abs(linear[:, 2]))
    axis = linear[:, 2] / scale if scale > 0.0 else linear[:, 2]
    axis = axis / max(float(np.sqrt(axis @ axis)), 1e-300)
    sides = linear[:, :2]
    return Ellipsoid.of_map(sides - np.outer(axis, axis @ sides))


class _Convex:
    """Base of shapes that are the unit ball of a gauge function."""

    @property
    def bounds(self) -> F64:
        return np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])

    def _squared(self, points: F64) -> F64:
        """Squared gauge of points (3, N), (N,): 0 at the core, 1 on the boundary."""
        raise NotImplementedError

    def contains(self, points: F64) -> Bool:
        return self._squared(points) <= 1.0


@dataclass(frozen=True)
class Cuboid(_Convex):
    """Cuboid |x|, |y|, |z| <= 1."""

    def _squared(self, points: F64) -> F64:
        with np.errstate(over="ignore"):
            squared: F64 = np.max(np.abs(points), axis=0) ** 2
        return squared

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """Least distance to the six planes; see :meth:`Shape.depth_m`."""
        widths = _half_widths(to_world[:3, :3])
        rises = np.fmax(1.0 - np.abs(points), 0.0)
        depths: F64 = np.min(rises * widths[:, None], axis=0)
        return depths


@dataclass(frozen=True)
class Sphere(_Convex):
    """Ball x^2 + y^2 + z^2 <= 1; an ellipsoid in the world."""

    def _squared(self, points: F64) -> F64:
        return _squared_norm(points)

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """Distance to the ellipsoid; see :meth:`Shape.depth_m`."""
        depths = np.zeros(points.shape[1])
        inside = self.contains(points)
        depths[inside] = Ellipsoid.of_map(to_world[:3, :3]).depth(points[:, inside])
        return depths


@dataclass(frozen=True)
class Cylinder(_Convex):
    """Cylinder x^2 + y^2 <= 1, |z| <= 1."""

    def _squared(self, points: F64) -> F64:
        return np.maximum(_squared_norm(points[:2]), _squared_norm(points[2:]))

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """Distance to caps and side; see :meth:`Shape.depth_m`.

        A ball inside each of two convex sets is inside their intersection, so the depth
        is the smaller of the depths between the cap planes and in the infinite cylinder.
        """
        linear = to_world[:3, :3]
        depths = np.zeros(points.shape[1])
        inside = self.contains(points)
        within = points[:, inside]
        caps = (1.0 - np.abs(within[2])) * _half_widths(linear)[2]
        depths[inside] = np.minimum(caps, _across(linear).depth(within[:2]))
        return depths


@dataclass(frozen=True)
class Capsule(_Convex):
    """Points within 1 of the segment from -half_segment to +half_segment on Z.

    The radius is 1: the placing matrix contains a uniform scale by the real radius.
    """

    half_segment: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.half_segment) and self.half_segment >= 0.0):
            raise ValueError(f"half_segment: expected 0 or more, got {self.half_segment}")

    @property
    def bounds(self) -> F64:
        box: F64 = super().bounds * np.array([1.0, 1.0, 1.0 + self.half_segment])
        return box

    def _squared(self, points: F64) -> F64:
        """Squared distance to the segment, (N,)."""
        beyond = np.maximum(np.abs(points[2]) - self.half_segment, 0.0)
        with np.errstate(over="ignore"):
            squared: F64 = _squared_norm(points[:2]) + beyond * beyond
        return squared

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """Distance to side and caps; see :meth:`Shape.depth_m`.

        An affine capsule is an ellipsoid swept along a segment. The nearest boundary point is
        either on the side, where the infinite cylinder has the same depth, or on the outer half of
        an end's ellipsoid, a local minimum of the distance.
        """
        linear = to_world[:3, :3]
        depths = np.zeros(points.shape[1])
        inside = self.contains(points)
        within = points[:, inside]
        ellipsoid = Ellipsoid.of_map(linear)
        if ellipsoid.semi_axes[-1] == 0.0:
            return depths
        least = _across(linear).depth(within[:2])
        for end in (1.0, -1.0):
            from_end = within - np.array([[0.0], [0.0], [end * self.half_segment]])
            for feet, distances in ellipsoid.local_feet(from_end):
                # Feet on the inner half are inside the capsule, and bound nothing.
                outer = end * feet[2] >= 0.0
                least = np.where(outer, np.minimum(least, distances), least)
        depths[inside] = least
        return depths
