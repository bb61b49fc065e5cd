# SPDX-License-Identifier: GPL-3.0-or-later
"""Continuous collision detection: contacts between two samples, too fast for either to see.

Samples of skin move straight in the volume's own space, in as many steps as its turning asks
for, and each step is tested exactly, so that no wall is too thin. Slow motion is not looked at:
what it hides between two samples is nearer to the boundary than the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from ..kinematics.motion import Motion
from ..skin.posed_skin import PosedSkin
from ..tolerance import Tolerance
from ..volume.mesh import MeshVolume
from ..volume.placing_matrix import inverse_placement
from ..volume.shape import Falloff, Shape
from ..ways import Ways
from .contact_details import Details
from .narrow_phase import WHOLE, Inside, sampled, steps_of, vertex_sample_suffices
from .target import Target, steepest

MESH_WALL_M: Final = 0.001
"""Walls of meshes, whose thickness is not known, are taken to be no thinner than this."""

_MOST_STEPS: Final = 64
_ROUNDING: Final = 1e-9
_ALONG: Final = 5  # places of a passage at which falloff is looked up


def max_untracked_motion_m(
    shape: Shape, inverses: F64, falloff: Falloff, tolerance: Tolerance, edge_m: float
) -> F64:
    """Largest motion of skin relative to a volume between two samples that needs no tracking,
    metres.

    Half of the volume's least width, so that nothing passes through it, and no more than can
    hide a contact of depth ``edge_m``, or one that falloff keeps weaker than the tolerance.
    ``inverses`` (n, 4, 4) are from the world to shape space; one number for each.
    """
    if isinstance(shape, MeshVolume):
        return np.full(len(inverses), min(MESH_WALL_M, 2.0 * edge_m))
    steepest_way = np.square(inverses[:, :3, :3]).sum(axis=2).max(axis=1)
    thin: F64 = 1.0 / np.sqrt(steepest_way)
    hidden = np.full(len(thin), edge_m)
    if not falloff.is_flat:
        hidden = np.maximum(hidden, tolerance.amplitude / steepest(falloff) * thin)
    return np.minimum(thin, 2.0 * hidden)


@dataclass(frozen=True, eq=False)
class Drift:
    """Relative motion, in a volume's space, of points that rest in a body's frame, in ``n``
    intervals.
    """

    steps: int
    from_before: F64  # (steps + 1, n, 4, 4) shape space at the start to the frame's later place
    from_after: F64  # (steps + 1, n, 4, 4) the same from the end

    @classmethod
    def of(cls, volume: tuple[F64, F64], body: tuple[F64, F64], steps: int) -> Drift:
        """Interpolate placing matrices (n, 4, 4) before and after, in ``steps`` of even length."""
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

    def ways(self, before: F64, after: F64, rows: I64) -> Ways:
        """Ways of points (3, N) in intervals that end at ``rows`` (N,)."""
        return Ways(before, after, rows - 1, self.from_before, self.from_after)


def steps_for(angles: F64, moves_m: F64, edge_m: float) -> I64:
    """Straight steps that follow turning motions within ``edge_m``, one number for each.

    An arc of length s that turns by an angle a leaves its chord by s a / 8; n steps divide that
    by n squared. Powers of two, so that intervals share their steps.
    """
    wanted = np.sqrt(0.5 * np.pi * moves_m * angles / 8.0 / max(edge_m, 1e-4))
    wanted = np.where(np.isfinite(wanted), np.maximum(wanted, 1.0), _MOST_STEPS)
    steps: I64 = np.minimum(2.0 ** np.ceil(np.log2(wanted)), _MOST_STEPS).astype(np.int64)
    return steps


@dataclass(frozen=True, eq=False)
class Crossings:
    """Samples of skin that were inside at some moment of an interval."""

    contacts: I64  # (N,) the contact that each belongs to
    first: F64  # (N,) shares of the interval
    last: F64  # (N,)
    shares: F64  # (N,) contact weight times share of the cell's area
    ways: Ways  # shape space

    def peaks(self, count: int) -> F64:
        """Largest share of each contact's cell inside at one moment, (count,)."""
        key = np.concatenate([self.contacts] * 2)
        when = np.concatenate([self.first, self.last])
        is_exit = np.repeat([False, True], len(self.contacts))
        change = np.concatenate([self.shares, -self.shares])
        order = np.lexsort((is_exit, when, key))
        key, change = key[order], change[order]
        inside = np.cumsum(change)
        starts = np.flatnonzero(np.diff(key, prepend=-1))
        base = np.repeat(inside[starts] - change[starts], np.diff(starts, append=len(key)))
        peaks = np.zeros(count)
        if len(starts):
            peaks[key[starts]] = np.maximum.reduceat(inside - base, starts)
        peaks[peaks > WHOLE] = 1.0
        return peaks

    def tell(self, details: Details, places: Callable[[I64], tuple[I64, I64]]) -> None:
        """Fill in how contacts began; ``places`` gives rows and columns of some contacts."""
        order = np.lexsort((self.first, self.contacts))
        order = order[np.flatnonzero(np.diff(self.contacts[order], prepend=-1))]
        at, first = places(self.contacts[order]), self.first[order]
        path = self.ways.taken(order).path()
        step, which = _steps_at(path, first), np.arange(len(order))
        details.since[at] = first
        details.entries[:, *at] = _along(path, first)
        moves = path[step + 1, :, which] - path[step, :, which]
        details.ways[:, *at] = moves.T * self.ways.steps

    def inside(self, posed: PosedSkin, is_asked: Bool) -> Inside:
        """Samples of some of the contacts (count,), at the middle of their passage."""
        which = np.flatnonzero(is_asked[self.contacts])
        rows, cells = posed.cells_of(self.contacts[which])
        middle = 0.5 * (self.first[which] + self.last[which])
        return Inside(rows, cells, _along(self.ways.taken(which).path(), middle))


def passing(posed: PosedSkin, later: Bool, target: Target, *, is_straight: bool) -> I64:
    """Slots of pairs ``later`` (pairs,) whose skin may have met the volume since the pair before.

    The clearance of a point changes by no more than it moves: on a straight way of length l
    between clearances a and b it is nowhere less than (a + b - l) / 2.
    """
    slots = np.flatnonzero(later[posed.pairs])
    if not is_straight:
        return slots
    after, before = posed.at[slots], _places_before(posed, slots)
    reaches = np.maximum(posed.reaches[slots], posed.reaches[_slots_before(posed, slots)])
    clear = posed.clear[before] + posed.clear[after]
    ways = posed.points.take(after, axis=1) - posed.points.take(before, axis=1)
    lengths = np.sqrt(np.einsum("in,in->n", ways, ways))
    may = ~(clear - lengths > 2.0 * reaches + _ROUNDING * (np.abs(clear) + lengths))
    if len(target.shapes) > 1:  # the clearance from another shape is meaningless
        rows = posed.rows_of(slots)
        may |= target.which[rows] != target.which[rows - 1]
    return slots[may]


def _slots_before(posed: PosedSkin, slots: I64) -> I64:
    """Slots of the same units in the pairs before."""
    before: I64 = slots - posed.table.unit_counts[posed.clusters[posed.pairs[slots]]]
    return before


def _places_before(posed: PosedSkin, slots: I64) -> I64:
    """The points of some slots' vertices in the pairs before."""
    pairs = posed.pairs[slots]
    before: I64 = posed.at[slots] + (posed.shifts[pairs - 1] - posed.shifts[pairs])
    return before


def crossings(posed: PosedSkin, slots: I64, target: Target, drift: Drift) -> Crossings:
    """Find the samples of skin that enter a volume in between.

    Parameters
    ----------
    posed : PosedSkin
    slots : (k,) int64
        Where it is looked for: those of :func:`passing`, or some of them.
    target : Target
    drift : Drift
        Its intervals end at the rows from the second on.
    """
    table = posed.table
    pairs, unit, rows = posed.pairs[slots], posed.units[slots], posed.rows_of(slots)
    earlier = _slots_before(posed, slots)
    reaches = np.maximum(posed.reaches[slots], posed.reaches[earlier])
    before = posed.points.take(_places_before(posed, slots), axis=1)
    ways = drift.ways(before, posed.points.take(posed.at[slots], axis=1), rows)
    near = np.flatnonzero(target.comes_near(ways, reaches, rows))
    slots, pairs, unit, ways = slots[near], pairs[near], unit[near], ways.taken(near)
    earlier = earlier[near]
    told = vertex_sample_suffices(posed, slots, target) & vertex_sample_suffices(
        posed, earlier, target
    )
    shares = np.where(told, table.unit_shares[unit], table.vertex_shares[unit])
    found = [_entered(posed, ways, slots, shares, target)]
    split = np.flatnonzero(~told & table.is_split)
    owner, quad = table.quads_of(unit[split])
    slots, pairs = slots[split][owner], pairs[split][owner]
    rings = [posed.corners(each, quad) for each in (pairs - 1, pairs)]
    if drift.steps == 1:
        met = np.flatnonzero(~_stays_outside(posed, rings, slots, target))
        slots, quad, pairs = slots[met], quad[met], pairs[met]
        rings = [(one[met], two[met], three[met]) for one, two, three in rings]
    ends = zip((pairs - 1, pairs), rings, strict=True)
    needed = [steps_of(posed, each, quad, corners, target) for each, corners in ends]
    steps = np.maximum(*needed)
    paths = (sampled(posed, slots, quad, corners, steps, target) for corners in rings)
    for start, end in zip(*paths, strict=True):
        rows = posed.rows_of(start.slots)
        ways = drift.ways(start.points, end.points, rows)
        found.append(_entered(posed, ways, start.slots, start.shares, target))
    return _joined(found)


def _stays_outside(
    posed: PosedSkin, rings: list[tuple[I64, I64, I64]], slots: I64, target: Target
) -> Bool:
    """Test quads for straight motion on one side of a plane beside the volume, all the way."""
    rows, clusters = posed.rows_of(slots), posed.clusters[posed.pairs[slots]]
    stretches = np.maximum(target.stretches[rows - 1], target.stretches[rows])
    corners = [posed.points.take(corner, axis=1) for ring in rings for corner in ring]
    return target.parted(corners, rows, posed.table.bulge_m[clusters] * stretches)


def _entered(posed: PosedSkin, ways: Ways, slots: I64, shares: F64, target: Target) -> Crossings:
    """Samples that are inside somewhere on their ways."""
    first, last = target.passages(ways, posed.rows_of(slots))
    kept = np.flatnonzero(np.isfinite(first))
    first, last, slots, ways = first[kept], last[kept], slots[kept], ways.taken(kept)
    strength = np.ones(len(kept))
    if not target.falloff.is_flat:
        rows, path, strength = posed.rows_of(slots), ways.path(), np.zeros(len(kept))
        for share in np.linspace(0.0, 1.0, _ALONG):
            at = _along(path, first + share * (last - first))
            np.maximum(strength, target.weights(at, rows), out=strength)
    return Crossings(posed.contacts_of(slots), first, last, shares[kept] * strength, ways)


def _steps_at(path: F64, share: F64) -> I64:
    """Step of polylines (steps + 1, 3, N) at shares (N,) of their time, (N,)."""
    steps = len(path) - 1
    found: I64 = np.clip((share * steps).astype(np.int64), 0, steps - 1)
    return found


def _along(path: F64, share: F64) -> F64:
    """Places on polylines (steps + 1, 3, N) at shares (N,) of their time, (3, N)."""
    steps, step = len(path) - 1, _steps_at(path, share)
    which = np.arange(path.shape[2])
    start, end = path[step, :, which].T, path[step + 1, :, which].T
    places: F64 = start + (share * steps - step) * (end - start)
    return places


def _joined(parts: list[Crossings]) -> Crossings:
    """All of them; their ways are of the same intervals."""
    return Crossings(
        np.concatenate([part.contacts for part in parts]),
        np.concatenate([part.first for part in parts]),
        np.concatenate([part.last for part in parts]),
        np.concatenate([part.shares for part in parts]),
        Ways.joined([part.ways for part in parts]),
    )
