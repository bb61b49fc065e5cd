# SPDX-License-Identifier: GPL-3.0-or-later
"""Actuators joined to triangles, edges and lone points, and the nearest place on these.

The shares of a place are the barycentric coordinates of the nearest place on the complex, so
they are continuous wherever the nearest place is: on all of the plane for the Delaunay
triangulation of its convex hull, and around a convex body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ...body.nearest import barycentric

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

_PAIRS_AT_ONCE: Final = 1 << 17

SAME_PLACE: Final = 1e-9
"""Actuators closer than this share of the layout's extent stand at one place."""


@dataclass(frozen=True, eq=False)
class ActuatorComplex:
    """Triangles between places of actuators; an edge or a point repeats its last corner."""

    places: F64  # (P, 3) metres
    simplices: I64  # (S, 3) indices of places
    place_of: I64  # (A,) of each actuator; several may stand at one place

    def shares(self, points: F64) -> tuple[F64, F64]:
        """Shares of the actuators at the nearest place of the complex.

        Actuators at one place share it equally.

        Parameters
        ----------
        points : (n, 3) float64

        Returns
        -------
        shares : (n, A) float64
            Sum 1; all 0 for a point that is not finite.
        distances : (n,) float64
            To that place, metres; infinite for a point that is not finite.
        """
        points = np.asarray(points, np.float64)
        finite = np.flatnonzero(np.isfinite(points).all(axis=1))
        of_places = np.zeros((len(points), len(self.places)))
        distances = np.full(len(points), np.inf)
        step = max(1, _PAIRS_AT_ONCE // len(self.simplices))
        for first in range(0, len(finite), step):
            rows = finite[first : first + step]
            simplex, weights, distances[rows] = self._nearest(points[rows])
            np.add.at(of_places, (rows[:, None], self.simplices[simplex]), weights)
        crowd = np.bincount(self.place_of, minlength=len(self.places))
        return (of_places / np.maximum(crowd, 1))[:, self.place_of], distances

    def _nearest(self, points: F64) -> tuple[I64, F64, F64]:
        count = len(self.simplices)
        corners = np.tile(self.places[self.simplices], (len(points), 1, 1))
        repeated = np.repeat(points, count, axis=0)
        weights = barycentric(repeated, corners)
        found = np.einsum("ij,ijk->ik", weights, corners)
        distances = np.linalg.norm(repeated - found, axis=1).reshape(-1, count)
        best = np.argmin(distances, axis=1)
        rows = np.arange(len(points))
        return best, weights.reshape(-1, count, 3)[rows, best], distances[rows, best]


def merged_places(positions: F64) -> tuple[F64, I64]:
    """Places (P, D) of actuators (A, D), and the place of each; equal positions are one place."""
    positions = np.asarray(positions, np.float64)
    if positions.ndim != 2 or not len(positions) or not np.isfinite(positions).all():
        raise ValueError(f"expected finite positions (A, D), A > 0, got {positions.shape}")
    grid = SAME_PLACE * max(float(np.ptp(positions, axis=0).max()), 1e-300)
    keys = np.round((positions - positions.min(axis=0)) / grid)
    _, first, place_of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # in the order of the actuators, so that results do not shuffle
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return positions[first[order]], rank[place_of.ravel()].astype(np.int64)
