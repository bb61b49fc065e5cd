# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on a mesh, for points that are near to it: a grid of cells that name triangles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..indexing import ramp

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

_ENTRIES_PER_TRIANGLE: Final = 48
_SPARE_ENTRIES: Final = 20_000
_AT_ONCE: Final = 512  # points asked together: more, and pairs leave the processor's cache
_AXIS: Final = 1 << 20  # cells along an axis, for keys


@dataclass(frozen=True, eq=False)
class Nearest:
    """For each of some points: the nearest place on a mesh, if there is one within reach."""

    point: I64  # (n,) which points have one, ascending
    triangle: I64  # (n,)
    weights: F64  # (n, 3) barycentric, each in 0..1, sum 1
    place: F64  # (n, 3)
    distance: F64  # (n,)


class TriangleGrid:
    """A mesh whose nearest places are asked for, up to a distance.

    Parameters
    ----------
    corners : (F, 3, 3) float64
        Triangle, corner, coordinate. Triangles without area are never the nearest.
    reach : float
        Points farther away have no nearest place; also what the cells are made for.
    is_for_once : bool
        Make larger cells: quicker to make, slower to ask.
    """

    def __init__(self, corners: F64, reach: float, is_for_once: bool = False) -> None:
        self.reach = reach
        self._is_for_once = is_for_once
        edge_1 = corners[:, 1] - corners[:, 0]
        edge_2 = corners[:, 2] - corners[:, 0]
        normal = np.cross(edge_1, edge_2)
        squared = np.einsum("fi,fi->f", normal, normal)
        longest = np.maximum(
            np.einsum("fi,fi->f", edge_1, edge_1), np.einsum("fi,fi->f", edge_2, edge_2)
        )
        with np.errstate(invalid="ignore"):
            self._solid = np.flatnonzero(squared > 1e-24 * longest**2)
        kept = corners[self._solid]
        # Rows of a table of 24 numbers a triangle, gathered at once.
        edge_1, edge_2 = edge_1[self._solid], edge_2[self._solid]
        a = np.einsum("fi,fi->f", edge_1, edge_1)
        b = np.einsum("fi,fi->f", edge_1, edge_2)
        c = np.einsum("fi,fi->f", edge_2, edge_2)
        self._table = np.ascontiguousarray(
            np.concatenate([kept[:, 0].T, edge_1.T, edge_2.T, [a], [b], [c]])
        )
        middles = kept.mean(axis=1)
        away = np.sqrt(np.square(kept - middles[:, None]).sum(axis=2)).max(axis=1, initial=0.0)
        self._middles = np.ascontiguousarray(np.concatenate([middles.T, [away]]))
        self._fill(kept)

    def _fill(self, corners: F64) -> None:
        if not len(corners):
            self._cells = self._starts = self._members = np.zeros(0, np.int64)
            self._origin, self._size = np.zeros(3), 1.0
            return
        low, high = corners.min(axis=1) - self.reach, corners.max(axis=1) + self.reach
        extent = high.max(axis=0) - low.min(axis=0)
        self._origin = low.min(axis=0)
        # The whole boxes of all triangles are listed, so cells grow until that is affordable.
        allowed = _ENTRIES_PER_TRIANGLE * len(corners) + _SPARE_ENTRIES
        edge = float(np.median(np.ptp(corners, axis=1).max(axis=1)))
        wanted = max(2.0 * self.reach, 2.0 * edge) if self._is_for_once else edge
        size = max(0.5 * self.reach, wanted, 2.0 * float(extent.max()) / _AXIS, 1e-12)
        while True:
            first = np.floor((low - self._origin) / size).astype(np.int64)
            count = np.floor((high - self._origin) / size).astype(np.int64) - first + 1
            if float(np.prod(count.astype(np.float64), axis=1).sum()) <= allowed:
                break
            size *= 1.5
        self._size = size
        step, owner = ramp(np.prod(count, axis=1))
        wide, deep = count[owner, 0], count[owner, 1]
        cell = first[owner] + np.stack(
            [step % wide, step // wide % deep, step // (wide * deep)], axis=1
        )
        key = _key(cell)
        order = np.argsort(key, kind="stable")
        self._members = owner[order]
        self._cells, starts = np.unique(key[order], return_index=True)
        self._starts = np.append(starts, len(order)).astype(np.int64)

    def nearest(self, points: F64) -> Nearest:
        """The nearest place within reach of points (N, 3)."""
        parts = [
            self._nearest(points[first : first + _AT_ONCE])
            for first in range(0, max(len(points), 1), _AT_ONCE)
        ]
        if len(parts) == 1:
            return parts[0]
        return Nearest(
            np.concatenate([part.point + k * _AT_ONCE for k, part in enumerate(parts)]),
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("triangle", "weights", "place", "distance")
            ),
        )

    def _nearest(self, points: F64) -> Nearest:
        nothing = Nearest(
            np.zeros(0, np.int64),
            np.zeros(0, np.int64),
            np.zeros((0, 3)),
            np.zeros((0, 3)),
            np.zeros(0),
        )
        if not len(self._cells) or not len(points):
            return nothing
        with np.errstate(invalid="ignore"):
            cell = np.floor((points - self._origin) / self._size)
            asked = np.flatnonzero(((cell >= 0.0) & (cell < _AXIS)).all(axis=1))
        key = _key(cell[asked].astype(np.int64))
        slot = np.searchsorted(self._cells, key)
        slot[slot == len(self._cells)] = 0
        known = self._cells[slot] == key
        asked, slot = asked[known], slot[known]
        if not len(asked):
            return nothing
        counts = self._starts[slot + 1] - self._starts[slot]
        step, owner = ramp(counts)
        triangle = self._members[self._starts[slot][owner] + step]
        starts = np.cumsum(counts) - counts
        # A triangle's middle is a place on it: what is surely farther needs no closer look.
        middle = self._middles.take(triangle, axis=1)
        offset = middle[:3]
        offset -= points[asked].T.take(owner, axis=1)
        away = np.sqrt(np.einsum("ij,ij->j", offset, offset))
        bound = np.minimum(np.minimum.reduceat(away, starts), self.reach)
        close = np.flatnonzero(away - middle[3] <= bound[owner] * (1.0 + 1e-9))
        triangle, owner = triangle[close], owner[close]
        counts = np.bincount(owner, minlength=len(asked))
        asked = asked[counts > 0]
        owner = np.repeat(np.arange(len(asked)), counts[counts > 0])
        counts = counts[counts > 0]
        if not len(asked):
            return nothing
        starts = np.cumsum(counts) - counts
        v, w, squared = self._to_triangles(points[asked], owner, triangle)
        best = np.minimum.reduceat(squared, starts)
        is_best = np.flatnonzero(squared == best[owner])
        first = is_best[np.searchsorted(is_best, starts)]
        near = np.flatnonzero(best <= self.reach**2)
        first = first[near]
        triangle, v, w = triangle[first], v[first], w[first]
        table = self._table[:, triangle]
        place = (table[:3] + v * table[3:6] + w * table[6:9]).T
        return Nearest(
            asked[near],
            self._solid[triangle],
            np.stack([1.0 - v - w, v, w], axis=1),
            place,
            np.sqrt(best[near]),
        )

    def _to_triangles(self, points: F64, owner: I64, triangle: I64) -> tuple[F64, F64, F64]:
        """Barycentric v, w of the nearest place of each pair, and its squared distance.

        In the triangle's own plane, with edges e1 and e2 and their products a, b, c: inside,
        the solution of the two normal equations; else the best of the nearest on each edge.
        """
        table = self._table.take(triangle, axis=1)
        offset = points.T.take(owner, axis=1)
        offset -= table[:3]
        p = np.einsum("ij,ij->j", offset, table[3:6])
        q = np.einsum("ij,ij->j", offset, table[6:9])
        square = np.einsum("ij,ij->j", offset, offset)
        a, b, c = table[9:]
        det = a * c - b * b
        v, w = (p * c - q * b) / det, (q * a - p * b) / det
        outside = np.flatnonzero((v < 0.0) | (w < 0.0) | (v + w > 1.0))
        if len(outside):
            a_, b_, c_ = a[outside], b[outside], c[outside]
            p_, q_ = p[outside], q[outside]
            t = np.zeros((3, len(outside)))
            np.divide(p_, a_, out=t[0])  # on e1: (t, 0)
            np.divide(q_, c_, out=t[1])  # on e2: (0, t)
            np.divide(q_ - p_ - b_ + a_, a_ - 2.0 * b_ + c_, out=t[2])  # between: (1 - t, t)
            np.clip(t, 0.0, 1.0, out=t)
            cost = np.stack(
                [
                    t[0] * (t[0] * a_ - 2.0 * p_),
                    t[1] * (t[1] * c_ - 2.0 * q_),
                    _cost(1.0 - t[2], t[2], a_, b_, c_, p_, q_),
                ]
            )
            edge = np.argmin(cost, axis=0)
            v[outside] = np.choose(edge, [t[0], 0.0, 1.0 - t[2]])
            w[outside] = np.choose(edge, [0.0, t[1], t[2]])
        squared = square + _cost(v, w, a, b, c, p, q)
        return v, w, np.maximum(squared, 0.0)


def _cost(v: F64, w: F64, a: F64, b: F64, c: F64, p: F64, q: F64) -> F64:
    """Squared distance, but for the squared offset from the first corner."""
    return v * (v * a + 2.0 * w * b - 2.0 * p) + w * (w * c - 2.0 * q)


def _key(cell: I64) -> I64:
    key: I64 = (cell[..., 0] * _AXIS + cell[..., 1]) * _AXIS + cell[..., 2]
    return key
