# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplicial complex of actuators, and laws from shares to gains.

The shares of a place are the barycentric coordinates of the nearest point of the complex. They are
continuous wherever this point is: in the plane for the Delaunay triangulation of a convex hull, and
around a convex body.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from ...arrays import F64, I64
from ...volume.mesh_distance import barycentric
from ..device_config import LAWS, Law

_PAIRS_AT_ONCE: Final = 1 << 17  # of a point and a simplex

_ON_IT_M: Final = 1e-12

FARTHEST_M: Final = 1e6
"""Largest coordinate, metres, to which points are clipped; larger squares may overflow."""

SAME_PLACE: Final = 1e-9
"""Share of the layout's extent within which actuators count as at one place."""


@dataclass(frozen=True, eq=False)
class ActuatorComplex:
    """Triangles between places of actuators; edges and points repeat their last corner."""

    places: F64  # (P, 3) metres
    simplices: I64  # (S, 3) indices of places
    place_of: I64  # (A,) place of each actuator; may be shared

    def shares(self, points: F64, blend: float = 0.0) -> tuple[F64, F64]:
        """Shares (n, A) of the actuators at the complex's nearest point; distances (n,), m.

        Shares sum to 1; 0, at distance infinity, for a point that is not finite. Actuators at one
        place share equally. ``blend``: relative distance beyond the nearest within which further
        simplices take part, the less the farther. The nearest point of a complex that is not convex
        jumps where two are equally near; blending makes a crossfade. Points on the complex are
        unaffected.
        """
        points = np.asarray(points, np.float64)
        finite = np.flatnonzero(np.isfinite(points).all(axis=1))
        points = np.clip(points, -FARTHEST_M, FARTHEST_M)
        of_places = np.zeros((len(points), len(self.places)))
        distances = np.full(len(points), np.inf)
        step = max(1, _PAIRS_AT_ONCE // len(self.simplices))
        for first in range(0, len(finite), step):
            rows = finite[first : first + step]
            row, simplex, weights, distances[rows] = self._nearest(points[rows], blend)
            np.add.at(of_places, (rows[row][:, None], self.simplices[simplex]), weights)
        if np.array_equal(self.place_of, np.arange(len(self.places))):
            return of_places, distances
        # Actuators at one place divide its share.
        crowd = np.bincount(self.place_of, minlength=len(self.places))
        return (of_places / np.maximum(crowd, 1))[:, self.place_of], distances

    def _nearest(self, points: F64, blend: float) -> tuple[I64, I64, F64, F64]:
        """Nearest simplices: point rows, simplices, corner weights (m, 3); distances (n,). A pair
        per point; with ``blend`` also farther simplices, weights summing to 1 per point."""
        # Candidates by bounding balls. The complex reaches the centre of a ball, so the nearest
        # centre is an upper bound, and a ball beginning farther away cannot hold the nearest point.
        middles, radii_m = self._balls
        squares = sum((points[:, axis, None] - middles[None, :, axis]) ** 2 for axis in range(3))
        away_m = np.sqrt(squares)
        nearest_m = away_m.min(axis=1, keepdims=True)
        slack_m = blend * nearest_m + 1e-9 * (1.0 + nearest_m)
        row, simplex = np.nonzero(away_m - radii_m <= nearest_m + slack_m)
        corners = self.places[self.simplices[simplex]]
        weights = barycentric(points[row], corners)
        feet = np.einsum("ij,ijk->ik", weights, corners)
        distances = np.linalg.norm(points[row] - feet, axis=1)
        firsts = np.searchsorted(row, np.arange(len(points)))
        least = np.minimum.reduceat(distances, firsts)
        nearest = np.flatnonzero(distances == least[row])
        best = nearest[np.diff(row[nearest], prepend=-1) != 0]  # first of equals
        if not blend:
            return row[best], simplex[best], weights[best], least
        width = blend * least[row]
        # Blending weights fall linearly from 1 at the least distance to 0 at 1 + blend times it.
        counts = np.divide(least[row] - distances, width, out=np.zeros_like(width), where=width > 0)
        counts = np.maximum(1.0 + counts, 0.0)
        # Points on the complex keep their exact shares.
        on_it = least[row] <= _ON_IT_M
        counts[on_it] = 0.0
        counts[best[least <= _ON_IT_M]] = 1.0
        counts /= np.add.reduceat(counts, firsts)[row]
        used = np.flatnonzero(counts)
        return row[used], simplex[used], weights[used] * counts[used, None], least

    @cached_property
    def _balls(self) -> tuple[F64, F64]:
        """Bounding balls of the simplices: centres (S, 3) and radii (S,)."""
        corners = self.places[self.simplices]
        middles = corners.mean(axis=1)
        return middles, np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)


def merged_places(positions: F64) -> tuple[F64, I64]:
    """Merge equal positions (A, D): places (P, D), and the place of each actuator, (A,). Equal: in
    one cell of a grid of 1e-9 of the extent. Places are in the order of their first actuator.
    Raises ValueError for no or non-finite positions."""
    positions = np.asarray(positions, np.float64)
    if positions.ndim != 2 or not len(positions) or not np.isfinite(positions).all():
        raise ValueError(f"expected finite positions (A, D), A > 0, got {positions.shape}")
    grid = SAME_PLACE * max(float(np.ptp(positions, axis=0).max()), 1e-300)
    keys = np.round((positions - positions.min(axis=0)) / grid)
    _, first, place_of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    # np.unique sorts by position; rank restores the order of the first occurrence.
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return positions[first[order]], rank[place_of.ravel()].astype(np.int64)


def gain(shares: F64, law: Law) -> F64:
    """Gains (n, A) of shares (n, A), 0..1, by a law; ValueError for an unknown law.

    ``linear`` preserves the sum of gains, ``power`` the sum of their squares; ``log`` is log2(1 +
    share). Schneider et al., UIST 2015 ("Tactile Animation by Direct Manipulation of Grid
    Displays"): linear, logarithmic and power (Pacinian) barycentric rendering, the logarithmic
    formula not printed there.
    """
    if law == "linear":
        return shares
    if law == "log":
        above_one = 1.0 + shares
        return np.log2(above_one, out=above_one)
    if law == "power":
        return np.sqrt(shares)
    raise ValueError(f"law: expected one of {', '.join(LAWS)}, got '{law}'")
