# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth in ellipsoids: feet of the normals from a point to the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import F64

_OFF_AXIS = 1e-100  # replaces 0 along the shortest axis, so that no 0/0 arises
_ITERATIONS = 64  # Newton needs 4 to 8; a double root is approached linearly
_ARRIVED = 1e-10  # relative step after which the next step is below rounding


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
    def of_map(cls, linear: F64) -> Ellipsoid:
        """Image of the unit ball under ``linear``, (m, n) with m >= n."""
        _, semi_axes, axes = np.linalg.svd(linear, full_matrices=False)
        return cls(semi_axes, axes)

    def depth(self, points: F64) -> F64:
        """Distance to the surface of points (n, N) of the unit ball, (N,), world units.

        0 for a flat ellipsoid.
        """
        if self.semi_axes[-1] == 0.0:
            return np.zeros(points.shape[1])
        along = self.axes @ points
        tau = self._solve(along, nearest=True)
        return self._distance(along, tau)

    def local_feet(self, points: F64) -> list[tuple[F64, F64]]:
        """Feet at which the distance from a point has a local minimum.

        At most two exist: the nearest surface point, and a foot beyond the plane across the
        shortest axis (Martinez, "Local minimizers of quadratic functions on Euclidean balls and
        spheres", SIAM J. Optim. 4, 1994).

        Parameters
        ----------
        points : (n, N) float64
            In the space of the unit ball; the ellipsoid must not be flat.

        Returns
        -------
        list of (feet (n, N), distances (N,))
            Two entries: nearest foot, then second minimum. Feet on the unit sphere; distances in
            world units, infinity where no such foot exists.
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
        distances: F64 = np.abs(1.0 - tau) * np.sqrt(np.sum(gaps**2, axis=0))
        return distances

    def _solve(self, along: F64, nearest: bool) -> F64:
        """Solve for ``tau`` (N,) of the nearest foot or of the second minimum; NaN without."""
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
                # Newton step for 1 /
                # x / s
                #  - 1.
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
