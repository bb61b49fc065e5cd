# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning by positions: barycentric on a flat layout, nearest actuator, Gaussian splatting.

Schneider et al., UIST 2015, for a tactile pad: Delaunay triangulation of the actuators, barycentric
coordinates of the virtual actuator in its triangle, and a law from coordinates to gains.
"""

from typing import Final

import numpy as np

from ...arrays import F64, I64
from ..device_config import Law
from .complex import ActuatorComplex, gain, merged_places

_FLATTEST: Final = 1e-6  # largest width over length of a layout that counts as a line
_JITTER: Final = 1e-6
"""Displacement of places for the triangulation of a closed layout, share of its extent."""

_ROWS_AT_ONCE: Final = 1 << 12

_TURNS: Final = (0, -1, 1)

_SPREAD: Final = 4.0  # cut-off of a Gaussian in standard deviations (3e-4 of its peak)


class PlanarPanning:
    """Panning between the actuators of a flat pad; beyond their hull its nearest point counts.

    ``positions`` (A, 2), m, are one or more, also in line or at one place. ``closed_m``: period of
    x for a layout around a cylinder, whose ends are neighbours; all positions and places are within
    one period.
    """

    def __init__(self, positions: F64, law: Law = "log", closed_m: float | None = None) -> None:
        self._law = law
        self._is_closed = closed_m is not None
        places, place_of = merged_places(np.asarray(positions, np.float64))
        if closed_m is None:
            self._complex = ActuatorComplex(_lifted(places), simplices_of(places), place_of)
        else:
            self._complex = _closed(places, place_of, closed_m)

    def gains(self, points: F64) -> F64:
        """Gains (n, A) for places (n, 2) on the pad, m; 0 for a non-finite place."""
        points = _lifted(np.asarray(points, np.float64))
        if not self._is_closed:
            return gain(self._complex.shares(points)[0], self._law)
        totals = np.zeros((len(points), len(self._complex.place_of) // len(_TURNS)))
        for first in range(0, len(points), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            # Copies of an actuator play together.
            shares = self._complex.shares(points[rows])[0]
            totals[rows] = shares.reshape(len(shares), len(_TURNS), -1).sum(axis=1)
        return gain(np.minimum(totals, 1.0), self._law)


def _lifted(points: F64) -> F64:
    """Points (n, 3): (n, 2) with z = 0."""
    return np.column_stack((points, np.zeros(len(points))))


def _closed(places: F64, place_of: I64, closed_m: float) -> ActuatorComplex:
    """Complex of places (P, 2) and copies at ``closed_m`` to either side, triangulated equally.
    Copies of the actuators, of ``place_of`` (A,), are separate actuators: (3 A,) in the result."""
    shifts = [np.array([turn * closed_m, 0.0]) for turn in _TURNS]
    every = np.concatenate([places + shift for shift in shifts])
    extent = float(np.linalg.norm(np.ptp(every, axis=0)))
    simplices = simplices_of(every)
    if np.any(simplices[:, 1] != simplices[:, 2]):
        # A square has two valid diagonals, and both ends need the same: a jitter common to all
        # copies decides. The jitter also creates slivers along the hull, which are dropped.
        moved = np.random.default_rng(0).uniform(-_JITTER, _JITTER, places.shape) * extent
        simplices = simplices_of(np.concatenate([places + moved + shift for shift in shifts]))
        corners = every[simplices]
        sides = np.roll(corners, -1, axis=1) - corners
        doubled = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        # Least height of a triangle: twice its area over its longest side.
        heights = doubled / np.linalg.norm(sides, axis=2).max(axis=1)
        simplices = simplices[heights > 10.0 * _JITTER * extent]
    of_each = np.concatenate([place_of + k * len(places) for k in range(len(_TURNS))])
    return ActuatorComplex(_lifted(every), simplices, of_each)


def simplices_of(places: F64) -> I64:
    """Delaunay triangles (S, 3) of distinct places (P, 2); edges of places in line, or a point.
    Edges and points repeat their last corner."""
    if len(places) == 1:
        return np.zeros((1, 3), np.int64)
    centred = places - places.mean(axis=0)
    _, extents, axes = np.linalg.svd(centred, full_matrices=False)
    # Places in line have no triangles: neighbours along the line are joined.
    if len(places) == 2 or extents[1] <= _FLATTEST * extents[0]:
        order = np.argsort(centred @ axes[0], kind="stable")
        return np.column_stack((order[:-1], order[1:], order[1:])).astype(np.int64)
    from scipy.spatial import Delaunay

    return np.asarray(Delaunay(centred / extents[0]).simplices.astype(np.int64))


class NearestPanning:
    """Panning to the nearest actuator alone: the first of equally near ``positions`` (A, D), m.
    Schneider et al., UIST 2015, for dense grids. Output jumps half way between two actuators, so
    glides need another scheme."""

    def __init__(self, positions: F64) -> None:
        self._positions = np.asarray(positions, np.float64)

    def gains(self, points: F64) -> F64:
        """Gains (n, A) for places (n, D), m: 1 at the nearest actuator; 0 if not finite."""
        distances = _distances(np.asarray(points, np.float64), self._positions)
        gains = np.zeros_like(distances)
        rows = np.flatnonzero(np.isfinite(distances).all(axis=1))
        gains[rows, np.argmin(distances[rows], axis=1)] = 1.0
        return gains


class GaussianSplatting:
    """Panning with gain exp(-d^2 / (2 sigma^2)) at distance d from ``positions`` (A, D), metres.

    Gains reach 0 smoothly at four standard deviations ``sigma_m``. ValueError unless it is positive
    and finite. After the Gaussian footprints of Westover ("Footprint evaluation for volume
    rendering", SIGGRAPH 1990).
    """

    def __init__(self, positions: F64, sigma_m: float) -> None:
        if not 0.0 < sigma_m < np.inf:
            raise ValueError(f"sigma_m: expected a positive number, got {sigma_m}")
        self._positions = np.asarray(positions, np.float64)
        self._sigma_m = sigma_m

    def gains(self, points: F64) -> F64:
        """Gains (n, A) for places (n, D), m, rescaled to 1 at an actuator, 0 from 4 sigma. 0 for a
        place that is not finite."""
        ratio = _distances(np.asarray(points, np.float64), self._positions) / self._sigma_m
        floor = np.exp(-0.5 * _SPREAD**2)
        with np.errstate(over="ignore"):
            gains = (np.exp(-0.5 * ratio * ratio) - floor) / (1.0 - floor)
        return np.maximum(np.nan_to_num(gains, nan=0.0), 0.0)


def _distances(points: F64, positions: F64) -> F64:
    """Distances (n, A) of points (n, D) from positions (A, D); NaN for a non-finite point."""
    with np.errstate(invalid="ignore", over="ignore"):
        # Axis by axis, without an array (n, A, D) of differences.
        axes = zip(points.T, positions.T, strict=True)
        distances: F64 = np.sqrt(sum((along[:, None] - centre) ** 2 for along, centre in axes))
    distances[~np.isfinite(points).all(axis=1)] = np.nan
    return distances
