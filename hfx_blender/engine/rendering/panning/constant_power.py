# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning at constant power: around a belt, along a strip, and over any directions.

Politis, Pugliese, Takala: an audio-tactile belt, and vector-base amplitude panning (Pulkki 1997)
over any layout of loudspeakers, proposed for touch, too. A direction is a linear combination of the
unit vectors of two or three neighbours; the coefficients, normalised to constant power, are gains.
"""

from typing import Final

import numpy as np

from ...arrays import F64, I64
from .complex import merged_places
from .positional import simplices_of

_ROUNDING: Final = 1e-9

_PAIRS_AT_ONCE: Final = 1 << 17  # pairs of a direction and a base that are solved at a time


class VectorBasePanning:
    """Panning of directions over A sources around a listener or a limb.

    ``directions``: (A, 2) or (A, 3) towards the sources, of any length but 0. In space at least
    three, not coplanar with the centre; pass a flat layout as (A, 2). Neighbours in the plane that
    are half a circle or more apart share power by the angle. Raises ValueError for unusable
    directions.
    """

    def __init__(self, directions: F64) -> None:
        directions = np.asarray(directions, np.float64)
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        if not (np.isfinite(directions).all() and (lengths > 0.0).all()):
            raise ValueError("directions: expected finite vectors that are not 0")
        self._units, self._place_of = merged_places(directions / lengths)
        self._crowd = np.sqrt(np.bincount(self._place_of))  # sources at one place share power
        self._is_flat = directions.shape[1] == 2
        if self._is_flat:
            self._bases = _pairs(self._units)
            self._arcs = RingPanning(np.arctan2(self._units[:, 1], self._units[:, 0]))
        else:
            self._bases, self._rim = _triplets(self._units)
        self._inverses = np.linalg.inv(self._units[self._bases])  # (S, D, D)

    def gains(self, points: F64) -> F64:
        """Gains (n, A) of the sources for directions (n, D) of any length. The squares sum to 1;
        all 0 for a zero or non-finite direction."""
        points = np.asarray(points, np.float64)
        lengths = np.linalg.norm(points, axis=1)
        rows = np.flatnonzero(np.isfinite(points).all(axis=1) & (lengths > 0.0))
        gains = np.zeros((len(points), len(self._units)))
        step = max(1, _PAIRS_AT_ONCE // max(len(self._bases), 1))
        for first in range(0, len(rows), step):
            batch = rows[first : first + step]
            gains[batch] = self._of_units(points[batch] / lengths[batch, None])
        return np.asarray((gains / self._crowd)[:, self._place_of])

    def _of_units(self, units: F64) -> F64:
        """Gains (n, P) of the distinct places for unit vectors (n, D), squares summing to 1. A
        vector outside all bases gets those of the nearest arc, in the plane of the adjacent
        places."""
        gains = np.zeros((len(units), len(self._units)))
        is_known = np.zeros(len(units), np.bool_)
        if len(self._bases):
            # Solve p = sum of g_i l_i for every base; only a base around p has no negative factor,
            # so the base whose least factor is largest is the right one.
            factors = np.einsum("nd,sde->nse", units, self._inverses)
            best = np.argmax(factors.min(axis=2), axis=1)
            rows = np.arange(len(units))
            chosen = factors[rows, best]
            is_known = chosen.min(axis=1) >= -_ROUNDING
            gains[rows[:, None], self._bases[best]] = np.maximum(chosen, 0.0)
        # Outside all bases: by angle in the plane, in space at the rim of the open hull.
        beyond = np.flatnonzero(~is_known)
        if len(beyond) and self._is_flat:
            angles = np.arctan2(units[beyond, 1], units[beyond, 0])
            gains[beyond] = self._arcs.gains(angles[:, None])
        elif len(beyond):
            gains[beyond] = _on_rim(units[beyond], self._units, self._rim)
        norms = np.linalg.norm(gains, axis=1, keepdims=True)
        return np.divide(gains, norms, out=np.zeros_like(gains), where=norms > 0.0)


def _pairs(units: F64) -> I64:
    """Pairs (S, 2) of angular neighbours among units (P, 2), less than half a circle apart; a
    single unit has no pair, (0, 2)."""
    if len(units) == 1:
        return np.zeros((0, 2), np.int64)
    angles = np.arctan2(units[:, 1], units[:, 0])
    order = np.argsort(angles, kind="stable")
    following = np.roll(order, -1)
    gaps = np.mod(angles[following] - angles[order], 2.0 * np.pi)
    is_base = (gaps > _ROUNDING) & (gaps < np.pi - 1e-6)
    return np.column_stack((order, following))[is_base].astype(np.int64)


def _triplets(units: F64) -> tuple[I64, I64]:
    """Hull triangles that face away from the centre, (S, 3), and edges of their rim, (E, 2). Raises
    ValueError without such a triangle."""
    triangles = _hull(units)
    corners = units[triangles]
    # A triangle in a plane with the centre has no volume and is no base: its matrix is singular.
    volumes = np.linalg.det(corners)
    outwards = np.abs(volumes) > 1e-6
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = units.mean(axis=0)
    # Qhull does not orient triangles; the mean of the sources is inside the hull.
    sign = np.sign(np.einsum("ij,ij->i", normals, corners[:, 0] - middle))
    outwards &= sign * np.einsum("ij,ij->i", normals, corners[:, 0]) > 0.0
    bases = triangles[outwards]
    if not len(bases):
        raise ValueError(
            "directions: expected three or more that do not lie in one plane with the centre"
        )
    edges = np.sort(bases[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    # Edges of a single triangle are the rim of an open hull.
    edges, counts = np.unique(edges, axis=0, return_counts=True)
    return bases, edges[counts == 1]


def _hull(units: F64) -> I64:
    """Triangles (S, 3) of the convex hull of units (P, 3), or in the plane of coplanar units."""
    if len(units) == 3:
        return np.array([[0, 1, 2]], np.int64)
    from scipy.spatial import ConvexHull, QhullError

    try:
        triangles: I64 = ConvexHull(units).simplices.astype(np.int64)
    except (QhullError, ValueError):
        # Coplanar sources: a ring seen from outside its plane, triangulated in this plane.
        centred = units - units.mean(axis=0)
        axes = np.linalg.svd(centred, full_matrices=False)[2]
        triangles = simplices_of(centred @ axes[:2].T)
    return triangles


def _on_rim(units: F64, sources: F64, rim: I64) -> F64:
    """Gains (n, P), unnormalized, at the nearest direction on the arcs ``rim`` (E, 2) of sources,
    the nearer end behind an arc. The nearest source alone without a rim."""
    # Start from the nearest source; also the result without a rim, where only rounding led here.
    gains = np.eye(len(sources))[np.argmax(units @ sources.T, axis=1)]
    best = np.full(len(units), -np.inf)
    for i, j in rim:
        base = np.stack([sources[i], sources[j]])
        factors = np.maximum(units @ np.linalg.pinv(base), 0.0)
        along = factors @ base
        lengths = np.linalg.norm(along, axis=1)
        # A direction behind both ends of the arc goes to the nearer end.
        is_behind = lengths <= _ROUNDING
        nearer = np.argmax(units @ base.T, axis=1)
        factors[is_behind] = np.eye(2)[nearer[is_behind]]
        along = factors @ base
        cosines = np.einsum("nd,nd->n", units, along) / np.linalg.norm(along, axis=1)
        better = cosines > best
        best[better] = cosines[better]
        gains[better] = 0.0
        gains[np.ix_(better, [i, j])] = factors[better]
    return gains


class LinePanning:
    """Panning along a strip: the two neighbours of a place share its power; ends play beyond.
    ``positions`` (A,) are along the strip, m. With a ``period`` the strip is closed: the last
    position is next to the first, and positions and places are within 0 and the period."""

    def __init__(self, positions: F64, period: float | None = None) -> None:
        places, place_of = merged_places(positions[:, None])
        order = np.argsort(places[:, 0], kind="stable")
        self._places = places[order, 0]
        self._place_of = np.argsort(order)[place_of]
        self._period = period

    def gains(self, points: F64) -> F64:
        """Gains (n, A), squares summing to 1, for places (n, 1) along the line, m; 0 if not finite.
        Actuators at one place divide its power. g1 = sqrt(1 - d / D), g2 = sqrt(d / D) at distance
        d from the first of two neighbours that are D apart (Politis, Pugliese, Takala)."""
        values, count = points[:, 0], len(self._places)
        shares = np.zeros((len(values), count))
        rows = np.flatnonzero(np.isfinite(values))
        at = values[rows]
        after = np.searchsorted(self._places, at, side="right")
        if self._period is None:
            # Beyond an end both neighbours are the end itself, at a gap of 0.
            before, after = np.maximum(after - 1, 0), np.minimum(after, count - 1)
            gap = self._places[after] - self._places[before]
            way = at - self._places[before]
        else:
            before, after = (after - 1) % count, after % count
            # On a ring the last place is before the first.
            gap = np.mod(self._places[after] - self._places[before], self._period)
            gap[gap == 0.0] = self._period  # a single actuator
            way = np.mod(at - self._places[before], self._period)
        share = np.clip(np.divide(way, gap, out=np.zeros_like(way), where=gap > 0.0), 0.0, 1.0)
        # Added, not assigned: with one place both neighbours are the same column.
        np.add.at(shares, (rows, before), 1.0 - share)
        np.add.at(shares, (rows, after), share)
        crowd = np.bincount(self._place_of, minlength=count)
        return np.sqrt((shares / crowd)[:, self._place_of])


class RingPanning(LinePanning):
    """Panning around a belt by ``angles`` (A,) of the actuators seen from the centre, radians. The
    two neighbours of a direction share its power; a single actuator plays all directions."""

    def __init__(self, angles: F64) -> None:
        super().__init__(_turns(angles), period=1.0)

    def gains(self, points: F64) -> F64:
        """Gains (n, A), squares summing to 1, for angles (n, 1), radians; 0 if not finite."""
        return super().gains(_turns(points))


def _turns(angles: F64) -> F64:
    """Angles in radians as turns, 0 included to 1 excluded."""
    return np.asarray(np.mod(angles / (2.0 * np.pi), 1.0))
