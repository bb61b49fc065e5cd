# SPDX-License-Identifier: GPL-3.0-or-later
"""Barycentric rendering on a flat layout: the phantom sensation of a tactile pad.

Schneider et al., UIST 2015: Delaunay triangulation of the actuators, barycentric coordinates of the
virtual actuator in its triangle, and a law from coordinates to gains.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ...arrays import F64, I64
from ..device_config import Law
from .complex import ActuatorComplex, gain, merged_places

_FLATTEST: Final = 1e-6
"""Largest width over length of a layout that counts as a line."""

_JITTER: Final = 1e-6
"""Displacement of places for the triangulation of a closed layout, share of its extent."""

_ROWS_AT_ONCE: Final = 1 << 12

_TURNS: Final = (0, -1, 1)


class PlanarPanning:
    """Panning between the actuators of a flat pad; beyond their hull its nearest point counts.

    ``positions`` (A, 2), m, are one or more, also in line or at one place. ``closed_m``: period of
    x for a layout around a cylinder, whose ends are neighbours; all positions and places are within
    one period.
    """

    def __init__(self, positions: F64, law: Law = "log", closed_m: float | None = None) -> None:
        self._law = law
        self._is_closed = closed_m is not None
        positions = np.asarray(positions, np.float64)
        self._complex = (
            _triangulated(positions) if closed_m is None else _closed(positions, closed_m)
        )

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


def _triangulated(positions: F64) -> ActuatorComplex:
    places, place_of = merged_places(positions)
    return ActuatorComplex(_lifted(places), simplices_of(places), place_of)


def _closed(positions: F64, closed_m: float) -> ActuatorComplex:
    """Complex of a layout and a copy at each side in x, triangulated equally in each period.

    Copies are separate actuators: (3 A,) in ``place_of``.
    """
    places, place_of = merged_places(positions)
    shifts = [np.array([turn * closed_m, 0.0]) for turn in _TURNS]
    every = np.concatenate([places + shift for shift in shifts])
    extent = float(np.linalg.norm(np.ptp(every, axis=0)))
    simplices = simplices_of(every)
    if np.any(simplices[:, 1] != simplices[:, 2]):
        # A square has two valid diagonals, and both ends need the same; a jitter common to all
        # copies decides. Slivers along the hull created by the jitter are dropped.
        moved = np.random.default_rng(0).uniform(-_JITTER, _JITTER, places.shape) * extent
        simplices = simplices_of(np.concatenate([places + moved + shift for shift in shifts]))
        simplices = simplices[_heights(every[simplices]) > 10.0 * _JITTER * extent]
    of_each = np.concatenate([place_of + k * len(places) for k in range(len(_TURNS))])
    return ActuatorComplex(_lifted(every), simplices, of_each)


def _heights(corners: F64) -> F64:
    """Least height (S,) of each triangle (S, 3, 2), across its longest side."""
    sides = np.roll(corners, -1, axis=1) - corners
    doubled = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    return np.asarray(doubled / np.linalg.norm(sides, axis=2).max(axis=1))


def simplices_of(places: F64) -> I64:
    """Delaunay triangles (S, 3) of distinct places (P, 2); edges of places in line, or a point.

    Edges and points repeat their last corner.
    """
    if len(places) == 1:
        return np.zeros((1, 3), np.int64)
    centred = places - places.mean(axis=0)
    _, extents, axes = np.linalg.svd(centred, full_matrices=False)
    if len(places) == 2 or extents[1] <= _FLATTEST * extents[0]:
        order = np.argsort(centred @ axes[0], kind="stable")
        return np.column_stack((order[:-1], order[1:], order[1:])).astype(np.int64)
    from scipy.spatial import Delaunay

    triangles: I64 = Delaunay(centred / extents[0]).simplices.astype(np.int64)
    return triangles
