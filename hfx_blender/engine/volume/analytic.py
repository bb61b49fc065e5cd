# SPDX-License-Identifier: GPL-3.0-or-later
"""Cuboid, sphere, cylinder and capsule: unit shapes with a formula.

Size, stretch and shear are in the placing matrix.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import F64, Bool

_OFF_AXIS = 1e-100  # replaces 0 along the shortest axis, so that no 0/0 arises
_ITERATIONS = 64  # Newton needs 4 to 8; a double root is approached linearly
_ARRIVED = 1e-10  # relative step after which the next step is below rounding


def _squared_norm(points: F64) -> F64:
    """Squared lengths of vectors (n, N), (N,); infinity on overflow, without a warning."""
    # einsum is faster than np.linalg.norm, and silent on overflow; infinity counts as outside.
    return np.asarray(np.einsum("ij,ij->j", points, points))


def _half_widths(linear: F64) -> F64:
    """Distances from a parallelepiped's centre to its three pairs of faces, (3,). ``linear`` (3, 3)
    has the half edges as columns. Edges are scaled to length 1 first, so that no scale overflows or
    underflows; a flat parallelepiped has a width of 0."""
    lengths = np.max(np.abs(linear), axis=0)
    edges = linear / np.where(lengths > 0.0, lengths, 1.0)
    normals = np.cross(np.roll(edges, -1, axis=1), np.roll(edges, -2, axis=1), axis=0)
    norms = np.sqrt(_squared_norm(normals))
    widths: F64 = np.abs(np.sum(normals * edges, axis=0)) * lengths
    widths /= np.where(norms > 0.0, norms, np.inf)
    return widths


def _across(linear: F64) -> "Ellipsoid":
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
        """Squared gauge (N,) of points (3, N), shape space: 0 in the core, 1 on the boundary, above
        outside."""
        raise NotImplementedError

    def _inner_depth_m(self, points: F64, linear: F64) -> F64:
        """World depth (N,), m, of inner points (3, N) by the linear part (3, 3) of a placement."""
        raise NotImplementedError

    def contains(self, points: F64) -> Bool:
        return self._squared(points) <= 1.0

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """Distance (N,) of inner points to the boundary, 0 outside; see :meth:`Shape.depth_m`."""
        depths = np.zeros(points.shape[1])
        inside = self.contains(points)
        depths[inside] = self._inner_depth_m(points[:, inside], to_world[:3, :3])
        return depths


@dataclass(frozen=True)
class Cuboid(_Convex):
    """Cuboid |x|, |y|, |z| <= 1."""

    def _squared(self, points: F64) -> F64:
        with np.errstate(over="ignore"):
            squared: F64 = np.max(np.abs(points), axis=0) ** 2
        return squared

    def _inner_depth_m(self, points: F64, linear: F64) -> F64:
        """Least distance (N,) to the six planes, metres."""
        return np.asarray(np.min((1.0 - np.abs(points)) * _half_widths(linear)[:, None], axis=0))


@dataclass(frozen=True)
class Sphere(_Convex):
    """Ball x^2 + y^2 + z^2 <= 1; an ellipsoid in the world."""

    def _squared(self, points: F64) -> F64:
        return _squared_norm(points)

    def _inner_depth_m(self, points: F64, linear: F64) -> F64:
        """Distance (N,) to the ellipsoid, metres."""
        return Ellipsoid.of_map(linear).depth(points)


@dataclass(frozen=True)
class Cylinder(_Convex):
    """Cylinder x^2 + y^2 <= 1, |z| <= 1."""

    def _squared(self, points: F64) -> F64:
        return np.maximum(_squared_norm(points[:2]), _squared_norm(points[2:]))

    def _inner_depth_m(self, points: F64, linear: F64) -> F64:
        """Distance (N,) to caps and side, metres. A ball inside each of two convex sets is inside
        their intersection, so the depth is the smaller of the depths between the cap planes and in
        the infinite cylinder."""
        caps = (1.0 - np.abs(points[2])) * _half_widths(linear)[2]
        return np.minimum(caps, _across(linear).depth(points[:2]))


@dataclass(frozen=True)
class Capsule(_Convex):
    """Points within 1 of the segment from -half_segment to +half_segment on Z. The radius is 1: the
    placing matrix contains a uniform scale by the real radius."""

    half_segment: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.half_segment) and self.half_segment >= 0.0):
            raise ValueError(f"half_segment: expected 0 or more, got {self.half_segment}")

    @property
    def bounds(self) -> F64:
        return np.asarray(super().bounds * np.array([1.0, 1.0, 1.0 + self.half_segment]))

    def _squared(self, points: F64) -> F64:
        """Squared distance (N,) of points (3, N) to the segment; 1 on the boundary."""
        beyond = np.maximum(np.abs(points[2]) - self.half_segment, 0.0)
        with np.errstate(over="ignore"):
            squared: F64 = _squared_norm(points[:2]) + beyond * beyond
        return squared

    def _inner_depth_m(self, points: F64, linear: F64) -> F64:
        """Distance (N,) to side and caps, metres, 0 if flat.

        An affine capsule is an ellipsoid swept along a segment. The nearest boundary point is
        either on the side, where the infinite cylinder has the same depth, or on the outer half of
        an end's ellipsoid, a local minimum of the distance.
        """
        ellipsoid = Ellipsoid.of_map(linear)
        if ellipsoid.semi_axes[-1] == 0.0:
            return np.zeros(points.shape[1])
        least = _across(linear).depth(points[:2])
        for end in (1.0, -1.0):
            from_end = points - np.array([[0.0], [0.0], [end * self.half_segment]])
            for feet, distances in ellipsoid.local_feet(from_end):
                # Feet on the inner half are inside the capsule, and bound nothing.
                outer = end * feet[2] >= 0.0
                least = np.where(outer, np.minimum(least, distances), least)
        return least


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """Image of the unit ball (or disc) under a linear map, in its principal frame.

    The foot ``x`` of a normal from ``y`` solves ``x_i = s_i^2 y_i / (t + s_i^2)`` with ``sum (x_i /
    s_i)^2 = 1`` (Eberly, "Distance from a point to an ellipse, an ellipsoid, or a hyperellipsoid",
    2013). Newton's method finds ``tau = 1 + t / s_min^2`` as a root of ``1 / |x / s| - 1``. This
    function is concave between poles (Cauchy-Schwarz; Reinsch, "Smoothing by spline functions II",
    1971), so that Newton from the pole's side never overshoots, and nearly straight, so that few
    steps suffice.
    """

    semi_axes: F64  # (n,) descending, world units
    axes: F64  # (n, n) rows: principal directions in the ball's own space

    @classmethod
    def of_map(cls, linear: F64) -> "Ellipsoid":
        """Image of the unit ball under ``linear``, (m, n) with m >= n."""
        _, semi_axes, axes = np.linalg.svd(linear, full_matrices=False)
        return cls(semi_axes, axes)

    def depth(self, points: F64) -> F64:
        """Distance (N,) to the surface of points (n, N) in the unit ball, world units. 0 for a flat
        ellipsoid."""
        if self.semi_axes[-1] == 0.0:
            return np.zeros(points.shape[1])
        along = self.axes @ points
        tau = self._solve(along, nearest=True)
        return self._distance(along, tau)

    def local_feet(self, points: F64) -> list[tuple[F64, F64]]:
        """Feet at which the distance from a point (n, N) of the unit ball has a local minimum.

        Two entries (feet (n, N) on the unit sphere, distances (N,) in world units): nearest foot,
        then second minimum, at infinity where none exists. At most two exist: the nearest surface
        point, and a foot beyond the plane across the shortest axis (Martinez, "Local minimizers of
        quadratic functions on Euclidean balls and spheres", SIAM J. Optim. 4, 1994). The ellipsoid
        must not be flat.
        """
        along = self.axes @ points
        minima = []
        for nearest in (True, False):
            tau = self._solve(along, nearest=nearest)
            shares = self._shares(along, tau)
            norm = np.sqrt(np.sum(shares**2, axis=0))
            distances = self._distance(along, tau)
            distances[~(np.abs(norm - 1.0) < 1e-9)] = np.inf
            minima.append((self.axes.T @ shares, distances))
        return minima

    @property
    def _poles(self) -> F64:
        """Poles (s_i / s_min)^2 - 1, (n, 1): added to tau in the denominators."""
        least = self.semi_axes[-1]
        ratio = self.semi_axes / least
        poles: F64 = ((self.semi_axes - least) / least) * (ratio + 1.0)
        return poles[:, None]

    def _numerators(self, along: F64) -> F64:
        """Numerators of ``x_i / s_i``, (n, N), for points in the principal frame."""
        numerators: F64 = (self._poles + 1.0) * along
        last = along[-1]
        numerators[-1] = np.where(np.abs(last) < _OFF_AXIS, _OFF_AXIS, last)
        return numerators

    def _shares(self, along: F64, tau: F64) -> F64:
        """Coordinates ``x_i / s_i`` of the foot for ``tau``, (n, N)."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            shares: F64 = self._numerators(along) / (tau + self._poles)
        return shares

    def _distance(self, along: F64, tau: F64) -> F64:
        """Distance (N,) of the foot for ``tau`` from its point, world units."""
        # x - y = (1 - tau) (x / s) s / (s / s_min)^2 avoids differences of near-equal coordinates.
        gaps = self._shares(along, tau) * self.semi_axes[:, None] / (self._poles + 1.0)
        return np.asarray(np.abs(1.0 - tau) * np.sqrt(np.sum(gaps**2, axis=0)))

    def _solve(self, along: F64, nearest: bool) -> F64:
        """Solve for ``tau`` (N,) of the nearest foot or else of the second minimum; NaN without.
        ``along`` (n, N) are points in the principal frame."""
        numerators, poles = self._numerators(along), self._poles
        size = np.abs(numerators)
        if nearest:
            # No coordinate x_i / s_i exceeds 1; the tightest of these bounds is left of the root.
            tau: F64 = np.max(size - poles, axis=0)
        else:
            tau = -size[-1]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(_ITERATIONS):
                below = tau + poles
                squares = (numerators / below) ** 2
                total = np.sum(squares, axis=0)
                # Newton step for 1 / |x / s| - 1.
                step = total * (np.sqrt(total) - 1.0) / np.sum(squares / below, axis=0)
                moved = tau + step
                if not nearest:
                    # A step back or past the next pole: this branch has no root.
                    lost = (step > _ARRIVED * np.abs(tau)) | (moved <= -poles[-2])
                    moved = np.where(lost, np.nan, moved)
                tau = moved
                if not np.any(np.abs(step) > _ARRIVED * np.abs(tau)):
                    break
        return tau
