# SPDX-License-Identifier: GPL-3.0-or-later
"""Barycentric rendering on a flat layout: the phantom sensation of a tactile pad.

Schneider et al., UIST 2015: Delaunay triangulation of the actuators, the virtual actuator's
barycentric coordinates in its triangle, and a law from these to gains.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ...arrays import F64, I64
from ..device_config import Law
from .complex import ActuatorComplex, gain, merged_places

_FLATTEST: Final = 1e-6
"""Width over length of a layout that counts as a line."""

_JITTER: Final = 1e-6
"""Share of a closed layout's extent by which places are moved, for the triangulation alone."""

_ROWS_AT_ONCE: Final = 1 << 12

_TURNS: Final = (0, -1, 1)


class PlanarPanning:
    """Panning between the actuators of a flat pad; beyond their hull, its nearest place is
    rendered.

    Parameters
    ----------
    positions : (A, 2) float64
        Metres. One actuator, two, actuators on a line or at one place will do.
    law : {"linear", "log", "power"}
    closed_m : float, optional
        After this length x begins again, as round a cylinder, and both ends of the layout are
        neighbours. All positions and places are within one such length.
    """

    def __init__(self, positions: F64, law: Law = "log", closed_m: float | None = None) -> None:
        self._law = law
        self._is_closed = closed_m is not None
        positions = np.asarray(positions, np.float64)
        self._complex = (
            _triangulated(positions) if closed_m is None else _closed(positions, closed_m)
        )

    def gains(self, points: F64) -> F64:
        """Gains of the actuators, (n, A), for places on the pad, (n, 2) metres."""
        points = _lifted(np.asarray(points, np.float64))
        if not self._is_closed:
            return gain(self._complex.shares(points)[0], self._law)
        found = np.zeros((len(points), len(self._complex.place_of) // len(_TURNS)))
        for first in range(0, len(points), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            shares = self._complex.shares(points[rows])[0]
            found[rows] = shares.reshape(len(shares), len(_TURNS), -1).sum(axis=1)
        return gain(np.minimum(found, 1.0), self._law)


def _lifted(points: F64) -> F64:
    return np.column_stack((points, np.zeros(len(points))))


def _triangulated(positions: F64) -> ActuatorComplex:
    places, place_of = merged_places(positions)
    return ActuatorComplex(_lifted(places), simplices_of(places), place_of)


def _closed(positions: F64, closed_m: float) -> ActuatorComplex:
    """Layout with copies of itself on either side: joined, and equal at both ends."""
    places, place_of = merged_places(positions)
    shifts = [np.array([turn * closed_m, 0.0]) for turn in _TURNS]
    every = np.concatenate([places + shift for shift in shifts])
    extent = float(np.linalg.norm(np.ptp(every, axis=0)))
    simplices = simplices_of(every)
    if np.any(simplices[:, 1] != simplices[:, 2]):
        # Of a square, either diagonal will do, but it has to be the same one at both ends.
        moved = np.random.default_rng(0).uniform(-_JITTER, _JITTER, places.shape) * extent
        simplices = simplices_of(np.concatenate([places + moved + shift for shift in shifts]))
        simplices = simplices[_heights(every[simplices]) > 10.0 * _JITTER * extent]
    of_each = np.concatenate([place_of + k * len(places) for k in range(len(_TURNS))])
    return ActuatorComplex(_lifted(every), simplices, of_each)


def _heights(corners: F64) -> F64:
    """Least heights (S,) of flat triangles (S, 3, 2)."""
    sides = np.roll(corners, -1, axis=1) - corners
    doubled = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    return np.asarray(doubled / np.linalg.norm(sides, axis=2).max(axis=1))


def simplices_of(places: F64) -> I64:
    """Triangles of distinct flat places (P, 2); edges along a line, or one point, as (S, 3)."""
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
