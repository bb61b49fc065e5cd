# SPDX-License-Identifier: GPL-3.0-or-later
"""Contacts between two samples: what passes too fast for either to see.

Samples of skin move straight in the volume's own space, in as many steps as its turning asks
for, and each step is tested exactly, so that no wall is too thin. Slow motion is not looked at:
what it hides between two samples is nearer to the boundary than the tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from .coverage import SkinPatch
from .motion import Motion
from .narrow import WHOLE, Details, Target, beyond, sampled, steepest
from .tolerance import Tolerance
from .volume.mesh import MeshVolume
from .volume.placement import inverse_placement
from .volume.shape import Falloff, Shape

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

MESH_WALL_M: Final = 0.001
"""Walls of meshes, whose thickness is not known, are taken to be no thinner than this."""

_MOST_STEPS: Final = 64
_ALONG: Final = 5  # places of a passage at which falloff is looked up


def unseen_m(
    shape: Shape, inverse: F64, falloff: Falloff, tolerance: Tolerance, edge_m: float
) -> float:
    """How far skin may move against a volume between two samples without being followed, metres.

    Half of the volume's least width, so that nothing passes through it, and no more than can
    hide a contact of depth ``edge_m``, or one that falloff keeps weaker than the tolerance.
    """
    thin = MESH_WALL_M
    if not isinstance(shape, MeshVolume):
        thin = float(1.0 / np.sqrt(np.square(inverse[:3, :3]).sum(axis=1).max()))
        if not falloff.is_flat:
            edge_m = max(edge_m, tolerance.amplitude / steepest(falloff) * thin)
    return min(thin, 2.0 * edge_m)


@dataclass(frozen=True, eq=False)
class Drift:
    """How points that rest in a body's frame move in a volume's space, in ``n`` intervals."""

    steps: int
    from_before: F64  # (steps + 1, n, 4, 4) shape space at the start to the frame's later place
    from_after: F64  # (steps + 1, n, 4, 4) the same from the end

    @classmethod
    def of(cls, volume: tuple[F64, F64], body: tuple[F64, F64], steps: int) -> Drift:
        """From placing matrices (n, 4, 4) before and after; ``steps`` of even length."""
        if steps == 1:
            return cls(1, np.zeros((0, 0, 4, 4)), np.zeros((0, 0, 4, 4)))
        volumes, bodies = Motion.between(*volume), Motion.between(*body)
        places = []
        for k in range(steps + 1):
            inverses, _ = inverse_placement(volumes.at(k / steps))
            places.append(inverses @ bodies.at(k / steps))
        path = np.stack(places)
        back = [inverse_placement(matrices)[0] @ volume[k] for k, matrices in enumerate(body)]
        return cls(steps, path @ back[0], path @ back[1])

    def at(self, intervals: I64) -> Drift:
        """The same for some of its intervals."""
        if self.steps == 1:
            return self
        return Drift(self.steps, self.from_before[:, intervals], self.from_after[:, intervals])

    def path(self, before: F64, after: F64, rows: I64) -> F64:
        """Places of points (3, N), each in one of the intervals: (steps + 1, 3, N)."""
        if self.steps == 1:
            return np.stack([before, after])
        places = np.zeros((self.steps + 1, *before.shape))
        for k in range(self.steps + 1):
            share = k / self.steps
            if share < 1.0:
                places[k] += (1.0 - share) * _moved(self.from_before[k], before, rows)
            if share > 0.0:
                places[k] += share * _moved(self.from_after[k], after, rows)
        places[0], places[-1] = before, after
        return places


def _moved(matrices: F64, points: F64, rows: I64) -> F64:
    moved: F64 = np.einsum("nij,jn->in", matrices[rows, :3, :3], points)
    moved += matrices[rows, :3, 3].T
    return moved


def steps_for(angles: F64, moves_m: F64, edge_m: float) -> int:
    """Straight steps that follow turning motions within ``edge_m``.

    An arc of length s that turns by an angle a leaves its chord by s a / 8; n steps divide that
    by n squared. Powers of two, so that intervals share their steps.
    """
    sagitta = float(np.max(0.5 * np.pi * moves_m * angles / 8.0, initial=0.0))
    wanted = np.sqrt(sagitta / max(edge_m, 1e-4))
    if not np.isfinite(wanted):
        return _MOST_STEPS
    return int(min(2 ** np.ceil(np.log2(max(wanted, 1.0))), _MOST_STEPS))


@dataclass(frozen=True, eq=False)
class Crossings:
    """Samples of skin that were inside at some moment of an interval."""

    rows: I64  # (N,)
    cells: I64  # (N,) places in the patch's cells
    first: F64  # (N,) shares of the interval
    last: F64  # (N,)
    shares: F64  # (N,) contact weight times share of the cell's area
    entries: F64  # (3, N) where they entered, shape space
    ways: F64  # (3, N) how they moved then in a whole interval, shape space
    middles: F64  # (3, N) halfway through

    def peaks(self, count: int, cells: int) -> F64:
        """The most that was inside of each cell at one moment, (count, cells)."""
        key = np.concatenate([self.rows * cells + self.cells] * 2)
        when = np.concatenate([self.first, self.last])
        is_exit = np.repeat([False, True], len(self.rows))
        change = np.concatenate([self.shares, -self.shares])
        order = np.lexsort((is_exit, when, key))
        key, change = key[order], change[order]
        inside = np.cumsum(change)
        starts = np.flatnonzero(np.diff(key, prepend=-1))
        base = np.repeat(inside[starts] - change[starts], np.diff(starts, append=len(key)))
        peaks = np.zeros(count * cells)
        if len(starts):
            peaks[key[starts]] = np.maximum.reduceat(inside - base, starts)
        peaks[peaks > WHOLE] = 1.0
        return peaks.reshape(count, cells)

    def tell(self, details: Details, rows: I64, columns: I64) -> None:
        """Fill in how contacts began; ``rows`` and ``columns`` place the intervals and cells."""
        order = np.lexsort((self.first, self.cells, self.rows))
        key = self.rows[order] * len(columns) + self.cells[order]
        order = order[np.flatnonzero(np.diff(key, prepend=-1))]
        at = rows[self.rows[order]], columns[self.cells[order]]
        details.since[at] = self.first[order]
        details.entries[:, *at] = self.entries[:, order]
        details.ways[:, *at] = self.ways[:, order]


def crossings(
    patch: SkinPatch,
    before: F64,
    after: F64,
    reaches: F64,
    open_cells: Bool,
    target: Target,
    drift: Drift,
) -> Crossings:
    """Which samples of a patch enter a volume in between.

    Parameters
    ----------
    before, after : (3, n, V) float64
        The patch's vertices at both ends of each interval, shape space.
    reaches : (n, units) float64
        How far a unit's skin can be from its vertex, shape space.
    open_cells : (n, C) bool
        Cells that are looked at.
    target : Target
        Its ``n`` rows, at the end.
    """
    units = patch.units
    row, unit = np.nonzero(open_cells[:, patch.cells_of(np.arange(units))])
    path = drift.path(before[:, row, unit], after[:, row, unit], row)
    near = _may_meet(path, reaches[row, unit], row, target)
    row, unit, path = row[near], unit[near], path[:, :, near]
    found = [_entered(patch, path, row, unit, patch.vertex_shares[unit], target)]
    split = np.flatnonzero(patch.steps[unit] > 0)
    row, quad = patch.quads_of(row[split], unit[split])
    if drift.steps == 1:
        passing = np.flatnonzero(~_stays_beyond(patch, before, after, row, quad, target))
        row, quad = row[passing], quad[passing]
    ends = (sampled(patch, points, row, quad, target) for points in (before, after))
    for start, end in zip(*ends, strict=True):
        path = drift.path(start.points, end.points, start.rows)
        found.append(_entered(patch, path, start.rows, start.units, start.shares, target))
    return _joined(found)


def _stays_beyond(
    patch: SkinPatch, before: F64, after: F64, row: I64, quad: I64, target: Target
) -> Bool:
    """Which quads move straight on one side of the volume's box, all the way."""
    corners = patch.corners(row, quad)
    common = np.full(len(row), 255, np.uint8)
    for points in (before, after):
        faces = beyond(points, target, patch.bulge_m * target.stretches)
        for corner in corners:
            common &= faces[corner]
    return common != 0


def _may_meet(path: F64, reaches: F64, rows: I64, target: Target) -> I64:
    """Which balls of radii ``reaches`` (N,) on paths (steps + 1, 3, N) may meet the volume.

    Every convex shape here holds the unit ball, so that within a factor 1 + r of it is all that
    is nearer than r.
    """
    size = 1.0 + reaches
    meets = np.zeros(len(rows), np.bool_)
    for start, end in pairwise(path):
        first, _ = target.passages_of_hull(start, end, size, rows)
        meets |= np.isfinite(first)
    return np.flatnonzero(meets)


def _entered(
    patch: SkinPatch, path: F64, rows: I64, units: I64, shares: F64, target: Target
) -> Crossings:
    """Samples that are inside somewhere on their path, (steps + 1, 3, N)."""
    steps = len(path) - 1
    first = np.full(len(rows), np.inf)
    last = -first
    entries, ways = np.zeros((3, len(rows))), np.zeros((3, len(rows)))
    for k in range(steps):
        enter, leave = target.passages(path[k], path[k + 1], rows)
        came = np.flatnonzero(np.isinf(first) & np.isfinite(enter))
        first[came] = (k + enter[came]) / steps
        way = path[k + 1][:, came] - path[k][:, came]
        entries[:, came] = path[k][:, came] + enter[came] * way
        ways[:, came] = way * steps
        inside = np.isfinite(leave)
        last[inside] = (k + leave[inside]) / steps
    kept = np.flatnonzero(np.isfinite(first))
    first, last, rows, units = first[kept], last[kept], rows[kept], units[kept]
    path = path[:, :, kept]
    strength = np.ones(len(kept))
    if not target.falloff.is_flat:
        strength = np.zeros(len(kept))
        for share in np.linspace(0.0, 1.0, _ALONG):
            at = _along(path, first + share * (last - first))
            np.maximum(strength, target.weights(at, rows), out=strength)
    return Crossings(
        rows,
        patch.cells_of(units),
        first,
        last,
        shares[kept] * strength,
        entries[:, kept],
        ways[:, kept],
        _along(path, 0.5 * (first + last)),
    )


def _along(path: F64, share: F64) -> F64:
    """Places on polylines (steps + 1, 3, N) at shares (N,) of their time, (3, N)."""
    steps = len(path) - 1
    step = np.clip((share * steps).astype(np.int64), 0, steps - 1)
    which = np.arange(path.shape[2])
    start, end = path[step, :, which].T, path[step + 1, :, which].T
    places: F64 = start + (share * steps - step) * (end - start)
    return places


def _joined(parts: list[Crossings]) -> Crossings:
    none = np.zeros(0)
    empty = np.zeros((3, 0))
    start = Crossings(
        none.astype(np.int64), none.astype(np.int64), none, none, none, empty, empty, empty
    )
    parts = [start, *parts]
    return Crossings(
        np.concatenate([part.rows for part in parts]),
        np.concatenate([part.cells for part in parts]),
        np.concatenate([part.first for part in parts]),
        np.concatenate([part.last for part in parts]),
        np.concatenate([part.shares for part in parts]),
        np.concatenate([part.entries for part in parts], axis=1),
        np.concatenate([part.ways for part in parts], axis=1),
        np.concatenate([part.middles for part in parts], axis=1),
    )
