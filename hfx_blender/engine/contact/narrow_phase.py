# SPDX-License-Identifier: GPL-3.0-or-later
"""Narrow phase: the share of each cell of skin that is inside a volume.

Only units of skin that the boundary may cut are sampled: one whose vertex is farther from the
boundary than its skin reaches is wholly on one side. Where strength falls off so slowly that it
hardly changes within a unit, vertices tell enough, on the boundary too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from ..skin.posed_skin import PosedSkin
from ..skin.skin_quads import ROUNDING, diagonals, squares_of, steps_within
from .target import Target, steepest

WHOLE: Final = 1.0 - 1e-9
"""Sum of shares that counts as 1 despite rounding."""

_AT_ONCE: Final = 1 << 15
"""Samples that are looked at together: their places stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Inside:
    """Samples of skin inside a volume, for optional details."""

    rows: I64  # (N,)
    cells: I64  # (N,) as the skin's table counts them
    points: F64  # (3, N) shape space


def coverage_weights(
    posed: PosedSkin, wanted: Bool, target: Target, inside: list[Inside] | None = None
) -> F64:
    """Contact weights, one for each contact of ``posed``: the share of each cell that is inside.

    Parameters
    ----------
    posed : PosedSkin
    wanted : (pairs,) bool
        Pairs that are looked at; the others get 0.
    target : Target
    inside : list of Inside, optional
        Takes the samples that are inside.
    """
    table, clear = posed.table, posed.clear
    shares = np.zeros(len(posed.units))
    gap, reach = clear[posed.at], posed.reaches
    # Units with all of their skin outside are dropped.
    slots = np.flatnonzero((gap <= reach) & wanted[posed.pairs])
    unit, at, rows = posed.units[slots], posed.at[slots], posed.rows_of(slots)
    gap, reach = gap[slots], reach[slots]
    at_vertex = target.weights(posed.points.take(at, axis=1), rows)
    near = (gap >= -reach) & table.is_split
    if not target.falloff.is_flat:
        varies = table.is_split & (steepest(target.falloff) * reach > target.amplitude)
        near |= varies & (at_vertex > 0.0) & (-gap < target.falloff.share + reach)
        asked = np.flatnonzero(near)
        near[asked] = ~vertex_sample_suffices(posed, slots[asked], target)
    shares[slots] = at_vertex * table.unit_shares[unit]
    some = np.flatnonzero(near)
    if len(some):
        shares[slots[some]] = at_vertex[some] * table.vertex_shares[unit[some]]
        owner, quad = table.quads_of(unit[some])
        slot = slots[some][owner]
        is_in, is_cut = _sides(posed, slot, quad, target)
        whole, cut = np.flatnonzero(is_in), np.flatnonzero(is_cut)
        if len(whole):
            shares += np.bincount(slot[whole], table.wholes[quad[whole]], len(shares))
        slot, quad = slot[cut], quad[cut]
        corners = posed.corners(posed.pairs[slot], quad)
        felt: list[tuple[I64, F64]] = []
        steps = steps_of(posed, posed.pairs[slot], quad, corners, target)
        for samples in sampled(posed, slot, quad, corners, steps, target):
            every = samples.slots if len(target.shapes) > 1 else samples.slots[:0]
            found = target.weights(samples.points, posed.rows_of(every))
            felt.append((samples.owners, samples.summed(found)))
            if inside is not None:
                kept = np.flatnonzero(found > 0.0)
                inside.append(_inside(posed, samples.slots[kept], samples.points[:, kept]))
        if felt:
            owners, sums = (np.concatenate(each) for each in zip(*felt, strict=True))
            shares += np.bincount(owners, sums, len(shares))
    if inside is not None:
        kept = np.flatnonzero(at_vertex > 0.0)
        inside.append(_inside(posed, slots[kept], posed.points.take(at[kept], axis=1)))
    if not table.is_simple:
        some = np.flatnonzero(shares)
        of_cells = np.bincount(posed.contacts_of(some), shares[some], posed.contact_count)
        shares = np.asarray(of_cells, np.float64)
    shares[shares > WHOLE] = 1.0
    return shares


def vertex_sample_suffices(posed: PosedSkin, slots: I64, target: Target) -> Bool:
    """Test slots for vertices that suffice: strength at the units' vertices is close enough.

    The mean over a unit's skin differs from its vertex by no more than the steepest change of
    strength times the mean distance from the vertex, wherever it is; a cell differs by the mean
    of its units. Rise changes by no more than the way in the space of a convex shape, which
    holds the unit ball.
    """
    if target.falloff.is_flat or not target.is_convex or target.amplitude == 0.0:
        return np.zeros(len(slots), np.bool_)
    limit = target.amplitude / steepest(target.falloff)
    if posed.table.is_simple:
        distances = posed.farthest_of(slots)
        far = np.flatnonzero(distances > limit)
        distances[far] = posed.distances_of(slots[far])
        return np.asarray(distances <= limit)
    contacts = posed.contacts_of(np.arange(len(posed.units)))
    is_asked = np.zeros(posed.contact_count, np.bool_)
    is_asked[contacts[slots]] = True
    every = np.flatnonzero(is_asked[contacts])
    distances = posed.distances_of(every)
    weighted = distances * posed.table.unit_shares[posed.units[every]]
    of_cells = np.bincount(contacts[every], weighted, posed.contact_count)
    is_near = np.zeros(len(posed.units), np.bool_)
    is_near[every] = distances <= limit
    told: Bool = is_near[slots] | (of_cells[contacts[slots]] <= limit)
    return told


def _inside(posed: PosedSkin, slots: I64, points: F64) -> Inside:
    return Inside(posed.rows_of(slots), posed.table.cell_of[posed.units[slots]], points)


def _sides(posed: PosedSkin, slot: I64, quad: I64, target: Target) -> tuple[Bool, Bool]:
    """Classify quads, each of a slot: wholly inside, and possibly cut by the boundary, two bool
    (k,).
    """
    table, clear, pairs = posed.table, posed.clear, posed.pairs[slot]
    corners = posed.corners(pairs, quad)
    rows = posed.rows[pairs]
    stretches = target.stretches[rows]
    ring = [posed.points.take(corner, axis=1) for corner in corners]
    is_cut = ~target.parted(ring, rows, table.bulge_m[posed.clusters[pairs]] * stretches)
    if not (target.is_convex and target.falloff.is_flat):
        return np.zeros(len(slot), np.bool_), is_cut
    deepest = np.maximum(np.maximum(clear[corners[0]], clear[corners[1]]), clear[corners[2]])
    wholly = deepest <= -table.heights_m[quad] * stretches
    return wholly, is_cut & ~wholly


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of some quads, each of a slot: as many of each, quad after quad."""

    owners: I64  # (Q,) slots
    points: F64  # (3, N) shape space
    shares: F64  # (N,) of the cell's area

    @property
    def slots(self) -> I64:
        """The slot of each sample, (N,)."""
        return np.repeat(self.owners, len(self.shares) // max(len(self.owners), 1))

    def summed(self, weights: F64) -> F64:
        """Weighted share of the cell's area, of each quad (Q,), from weights of samples (N,)."""
        by_quad = (each.reshape(len(self.owners), -1) for each in (weights, self.shares))
        sums: F64 = np.einsum("qs,qs->q", *by_quad)
        return sums


def steps_of(
    posed: PosedSkin, pairs: I64, quads: I64, corners: tuple[I64, I64, I64], target: Target
) -> I64:
    """Number of samples along each side of the quads of pairs, as they are posed, (P,).

    As many as at rest, until a pose takes skin farther from its samples than is accepted; and
    no more than the finest, which tell how much is covered however far the skin is stretched.
    """
    table = posed.table
    steps: I64 = table.steps[quads]
    some = np.flatnonzero(table.finest[quads] > steps)
    if not len(some):
        return steps
    pairs, quads = pairs[some], quads[some]
    start, one, other = (posed.points.take(each[some], axis=1) for each in corners)
    to_metres = target.to_metres[posed.rows[pairs]]
    along, across = (np.einsum("nij,jn->in", to_metres, each - start) for each in (one, other))
    squares, places = squares_of(along, across), table.quads[quads, :4].T
    allowed = posed.allowed_m[pairs]
    if np.isfinite(table.spacing_share):
        longest = np.sqrt(np.maximum(squares[0], squares[2]))
        allowed = np.minimum(allowed, table.spacing_share * longest)
    known = steps[some].astype(np.float64)
    most = 2.0 * known * allowed * (1.0 + ROUNDING)
    far = np.flatnonzero(diagonals(places, squares, known) > most)
    wanted = steps_within(places[:, far], squares[:, far], allowed[far])
    steps[some[far]] = np.fmin(wanted, table.finest[quads[far]]).astype(np.int64)
    return steps


def sampled(
    posed: PosedSkin,
    slots: I64,
    quads: I64,
    corners: tuple[I64, I64, I64],
    steps: I64,
    target: Target,
) -> Iterator[Samples]:
    """Sample the skin of quads: (P,) quads of slots, with the points of their corners."""
    table = posed.table
    for number in np.flatnonzero(np.bincount(steps)).tolist():
        mine = np.flatnonzero(steps == number)
        count = number * number
        size = max(1, _AT_ONCE // max(count, 1))
        for part in (mine[first : first + size] for first in range(0, len(mine), size)):
            some = quads[part]
            start, one, other = (posed.points.take(each[part], axis=1) for each in corners)
            along, across = one - start, other - start
            one, other, height, shares = table.samples_at(some, number)
            points = along[:, :, None] * one
            points += start[:, :, None]
            points += across[:, :, None] * other
            curved = np.flatnonzero(table.heights_m[some])
            if len(curved):
                rows = posed.rows_of(slots[part[curved]])
                outwards = np.zeros_like(start)
                outwards[:, curved] = target.outwards(along[:, curved], across[:, curved], rows)
                points += outwards[:, :, None] * height
            yield Samples(slots[part], points.reshape(3, -1), shares.ravel())
