# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on a mesh, for points that are near to it: a grid of cells that name triangles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from ..indexing import ramp

_ENTRIES_PER_TRIANGLE: Final = 48
_SPARE_ENTRIES: Final = 20_000
_AT_ONCE: Final = 512  # points asked together: more, and pairs leave the processor's cache
_AXIS: Final = 1 << 20  # cells along an axis, for keys
_FLAT: Final = 1e-8  # sine of the angle at a corner below which a triangle has no area
_MOST_THINNED: Final = 1_000_000  # entries; a mesh with more is asked more slowly
_PAIRS_THINNED: Final = 1 << 15  # entries together


@dataclass(frozen=True, eq=False)
class Nearest:
    """Nearest places on a mesh, for the points that have one within reach."""

    point: I64  # (n,) which points have one, ascending
    triangle: I64  # (n,)
    weights: F64  # (n, 3) barycentric, each in 0..1, sum 1
    place: F64  # (n, 3)
    distance: F64  # (n,)


class TriangleGrid:
    """Search grid over a mesh for nearest places up to a distance.

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
            self._solid = np.flatnonzero(squared > _FLAT**2 * longest**2)
        kept = self._corners = np.ascontiguousarray(corners[self._solid])
        self._fill(kept)
        edges = np.stack([edge_1[self._solid], edge_2[self._solid]], axis=1)
        self._table, self._gram = _tables(kept[:, 0] - self._origin, edges)
        if not self._is_for_once and len(self._members) <= _MOST_THINNED:
            self._thin()

    def _fill(self, corners: F64) -> None:
        if not len(corners):
            self._members = np.zeros(0, np.int64)
            self._cells = np.array([np.iinfo(np.int64).max])
            self._starts = np.zeros(2, np.int64)
            self._origin, self._size = np.zeros(3), 1.0
            return
        low, high = corners.min(axis=1) - self.reach, corners.max(axis=1) + self.reach
        extent = high.max(axis=0) - low.min(axis=0)
        self._origin = low.min(axis=0)
        # The whole boxes of all triangles are listed, so cells grow until that is affordable.
        allowed = _ENTRIES_PER_TRIANGLE * len(corners) + _SPARE_ENTRIES
        edge = float(np.median(np.ptp(corners, axis=1).max(axis=1)))
        wanted = max(2.0 * self.reach, 2.0 * edge) if self._is_for_once else 0.7 * edge
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
        cells, starts = np.unique(key[order], return_index=True)
        # One more, that no point is in, so that a search never ends beyond the last.
        self._cells = np.append(cells, np.iinfo(np.int64).max)
        self._starts = np.append(starts, [len(order)] * 2).astype(np.int64)

    def _thin(self) -> None:
        """Drop from each cell the triangles that are nowhere in it the nearest within reach.

        With R half of the cell's diagonal: those that are farther from its middle than the
        nearest triangle by more than 2 R, or than the reach by more than R.
        """
        radius = 0.5 * np.sqrt(3.0) * self._size
        kept = []
        sizes = np.diff(self._starts)
        last = 0
        every = np.searchsorted(self._starts, np.arange(1, len(self._members), _PAIRS_THINNED))
        for end in np.unique([*every[every < len(sizes)].tolist(), len(sizes)]).tolist():
            cells = self._cells[last:end]
            index = np.stack([cells // _AXIS**2, cells // _AXIS % _AXIS, cells % _AXIS])
            middles = (index + 0.5) * self._size
            owner = np.repeat(np.arange(end - last), sizes[last:end])
            members = self._members[self._starts[last] : self._starts[end]]
            starts = self._starts[last:end] - self._starts[last]
            filled = sizes[last:end] > 0
            away = np.sqrt(self._all_distances(middles.take(owner, axis=1), members))
            least = np.full(end - last, np.inf)
            least[filled] = np.minimum.reduceat(away, starts[filled])
            bound = np.minimum(least + 2.0 * radius, self.reach + radius) * (1.0 + 1e-9)
            kept.append(away <= bound[owner])
            last = end
        chosen = np.concatenate([np.zeros(0, np.bool_), *kept])
        self._members = self._members[chosen]
        before = np.concatenate([[0], np.cumsum(chosen)])
        self._starts = before[self._starts].astype(np.int64)

    def _all_distances(self, points: F64, triangle: I64) -> F64:
        """Squared distance of each pair of a point (3, P), from the origin, and a triangle."""
        v, w, height = self._in_planes(points, triangle)
        squared = height * height
        outside = np.flatnonzero(_is_outside(v, w))
        squared[outside] += _to_edges(self._gram, triangle[outside], v, w, outside)
        return np.asarray(squared)

    def _in_planes(self, points: F64, triangle: I64) -> F64:
        """Barycentric v and w of points in the planes of triangles, and the height over them."""
        table = self._table.take(triangle, axis=1).reshape(3, 4, -1)
        found: F64 = np.einsum("kip,ip->kp", table[:, :3], points)
        found += table[:, 3]
        return found

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
        relative = (points - self._origin).T
        with np.errstate(invalid="ignore"):
            cell = (relative * (1.0 / self._size)).clip(0.0, _AXIS - 1.0).astype(np.int64)
        key = (cell[0] * _AXIS + cell[1]) * _AXIS + cell[2]
        slot = self._cells.searchsorted(key)
        begins = self._starts[slot]
        counts = (self._starts[slot + 1] - begins) * (self._cells[slot] == key)
        asked = counts.nonzero()[0]
        if not len(asked):
            return _nothing()
        if len(asked) < len(points):
            counts, begins, relative = counts[asked], begins[asked], relative[:, asked]
        starts = counts.cumsum() - counts
        owner = np.arange(len(asked)).repeat(counts)
        triangle = self._members[(begins - starts).take(owner) + np.arange(len(owner))]
        v, w, height = self._in_planes(relative.take(owner, axis=1), triangle)
        # A triangle is no nearer than its plane: only planes nearer than what is straight above
        # or below a point need a look at their triangles' edges.
        plane = height * height
        outside = _is_outside(v, w)
        squared = np.where(outside, np.inf, plane)
        best = np.minimum.reduceat(squared, starts)
        bound = np.minimum(best, self.reach**2 * (1.0 + 1e-9))
        bound *= 1.0 - 1e-9
        bound -= 1e-16 * self.reach**2
        outside &= plane < bound.take(owner)
        edge = outside.nonzero()[0]
        if len(edge):
            squared[edge] = plane[edge] + _to_edges(self._gram, triangle[edge], v, w, edge)
            best = np.minimum.reduceat(squared, starts)
        is_best = (squared == best.take(owner)).nonzero()[0]
        near = (best <= self.reach**2).nonzero()[0]
        if not len(near):
            return _nothing()
        # The first of equals; a point that is not a number has none, but is not near either.
        first = is_best[is_best.searchsorted(starts[near])]
        triangle = triangle[first]
        weights = np.zeros((len(near), 3))
        weights[:, 1] = v[first]
        weights[:, 2] = w[first]
        weights[:, 0] = 1.0 - weights[:, 1] - weights[:, 2]
        place = np.einsum("nk,nkc->nc", weights, self._corners.take(triangle, axis=0))
        return Nearest(asked[near], self._solid[triangle], weights, place, np.sqrt(best[near]))


def _nothing() -> Nearest:
    none = np.zeros(0, np.int64)
    return Nearest(none, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def _tables(corner: F64, edges: F64) -> tuple[F64, F64]:
    """Linear maps from a point to its v, w and height over each triangle, (12, F); the edges'
    products.

    Parameters
    ----------
    corner : (F, 3) float64
        The first one of each triangle.
    edges : (F, 2, 3) float64
        From it to the others.
    """
    a, b, c = (np.einsum("fi,fi->f", edges[:, i], edges[:, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    det = (a * c - b * b)[:, None]
    normal = np.cross(edges[:, 0], edges[:, 1])
    length = np.sqrt(np.einsum("fi,fi->f", normal, normal))[:, None]
    rows = np.stack(
        [
            (c[:, None] * edges[:, 0] - b[:, None] * edges[:, 1]) / det,
            (a[:, None] * edges[:, 1] - b[:, None] * edges[:, 0]) / det,
            normal / length,
        ],
        axis=1,
    )
    offset = -np.einsum("fki,fi->fk", rows, corner)
    table = np.concatenate([rows, offset[:, :, None]], axis=2).reshape(-1, 12)
    return np.ascontiguousarray(table.T), np.stack([a, b, c])


def _is_outside(v: F64, w: F64) -> Bool:
    return np.asarray(np.minimum(np.minimum(v, w), 1.0 - v - w) < 0.0)


def _to_edges(gram: F64, triangle: I64, v: F64, w: F64, which: I64) -> F64:
    """Squared distance in the plane to the nearest edge; v and w are moved there.

    With edges e1 and e2, a = e1 e1, b = e1 e2 and c = e2 e2, a step of v and w is as long as
    the root of a v v + 2 b v w + c w w.
    """
    a, b, c = gram.take(triangle, axis=1)
    v0, w0 = v[which], w[which]
    t = np.zeros((3, len(which)))
    np.divide(w0 * b, a, out=t[0])  # on e1: (t, 0)
    t[0] += v0
    np.divide(v0 * b, c, out=t[1])  # on e2: (0, t)
    t[1] += w0
    np.divide((1.0 - v0) * (a - b) + w0 * (c - b), a - 2.0 * b + c, out=t[2])  # (1 - t, t)
    t.clip(0.0, 1.0, out=t)
    steps_v = np.stack([t[0] - v0, -v0, 1.0 - t[2] - v0])
    steps_w = np.stack([-w0, t[1] - w0, t[2] - w0])
    cost = steps_v * (a * steps_v + 2.0 * b * steps_w) + c * steps_w * steps_w
    edge, all_ = cost.argmin(axis=0), np.arange(len(which))
    v[which] = np.choose(edge, [t[0], 0.0, 1.0 - t[2]])
    w[which] = np.choose(edge, [0.0, t[1], t[2]])
    nearest: F64 = np.maximum(cost[edge, all_], 0.0)
    return nearest


def _key(cell: I64) -> I64:
    key: I64 = (cell[..., 0] * _AXIS + cell[..., 1]) * _AXIS + cell[..., 2]
    return key
