# SPDX-License-Identifier: GPL-3.0-or-later
"""Posed skin of some clusters at some rows, in flat arrays.

A *pair* is a cluster at a row. Its points, units and cells stand together, pair after pair, so
that one pass looks at all that a volume may touch. A *slot* is a unit of a pair, a *contact* a
cell of a pair.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import F64, I64
from ..indexing import ramp
from .skin_table import SkinTable


@dataclass(frozen=True, eq=False)
class PosedSkin:
    """Pairs, their points in a volume's shape space, and how far units reach.

    The pairs of a cluster follow each other in the order of their rows.
    """

    table: SkinTable  # filled for these clusters
    clusters: I64  # (pairs,) ascending
    rows: I64  # (pairs,)
    points: F64  # (3, N) the places of each pair
    gaps: F64  # (slots,) how far a unit's neighbours can be from it
    clear: F64  # (N,) a bound of each point's distance to the boundary, see Shape.clearance
    allowed_m: F64  # (pairs,) how far skin may be from its samples, as it is posed

    @cached_property
    def shifts(self) -> I64:
        """Offsets from a place within a pair's cluster to the index of its point, (pairs,)."""
        counts = self.table.place_counts[self.clusters]
        shifts: I64 = np.cumsum(counts) - counts - self.table.starts[self.clusters]
        return shifts

    @cached_property
    def _slot_counts(self) -> I64:
        counts: I64 = self.table.unit_counts[self.clusters]
        return counts

    def _counted_from(self, first: I64) -> I64:
        """Numbers that count up from ``first`` (pairs,) within each pair's slots."""
        ends = np.cumsum(self._slot_counts)
        before = ends - self._slot_counts
        found: I64 = np.arange(int(ends[-1])) + np.repeat(first - before, self._slot_counts)
        return found

    @cached_property
    def pairs(self) -> I64:
        """The pair of each slot."""
        return np.repeat(np.arange(len(self.rows)), self._slot_counts)

    @cached_property
    def units(self) -> I64:
        """The unit of each slot."""
        return self._counted_from(self.table.starts[self.clusters])

    @cached_property
    def at(self) -> I64:
        """The point of each slot's vertex."""
        return self._counted_from(self.table.starts[self.clusters] + self.shifts)

    def rows_of(self, slots: I64) -> I64:
        """The rows of some slots."""
        rows: I64 = self.rows[self.pairs[slots]]
        return rows

    @cached_property
    def reaches(self) -> F64:
        """Largest distance of a unit's skin from its vertex, shape space, (slots,)."""
        reaches: F64 = self.gaps * self.table.reaches[self.units]
        return reaches

    def farthest_of(self, slots: I64) -> F64:
        """Upper bound of the mean distance of units' skin from their vertices, shape
        space, (k,).
        """
        distances: F64 = self.gaps[slots] * self.table.means[self.units[slots]]
        return distances

    def distances_of(self, slots: I64) -> F64:
        """Sharper bound than :meth:`farthest_of`, from the posed corners: less where
        joints bend.
        """
        units = self.units[slots]
        owner, quads = self.table.quads_of(units)
        start, one, other = (
            self.points.take(each, axis=1) for each in self.corners(self.pairs[slots][owner], quads)
        )
        one, other = one - start, other - start
        squared = np.maximum(np.einsum("in,in->n", one, one), np.einsum("in,in->n", other, other))
        longest = np.zeros(len(slots))
        np.maximum.at(longest, owner, squared)
        distances: F64 = np.sqrt(longest) * self.table.means[units]
        return distances

    @cached_property
    def _contacts(self) -> tuple[I64, I64, I64]:
        first = self.table.cell_starts[self.clusters]
        counts = self.table.cell_starts[self.clusters + 1] - first
        step, pair = ramp(counts)
        return np.cumsum(counts) - counts - first, pair, first[pair] + step

    def contacts_of(self, slots: I64) -> I64:
        """Contacts that some slots belong to, (k,)."""
        if self.table.is_simple:
            return slots
        found: I64 = self._contacts[0][self.pairs[slots]] + self.table.cell_of[self.units[slots]]
        return found

    @property
    def contact_count(self) -> int:
        """Number of contacts."""
        return len(self.units) if self.table.is_simple else len(self._contacts[2])

    def cells_of(self, contacts: I64) -> tuple[I64, I64]:
        """Rows of some contacts, and their cells, as the table counts them."""
        if self.table.is_simple:
            return self.rows_of(contacts), self.table.cell_of[self.units[contacts]]
        return self.rows[self._contacts[1][contacts]], self._contacts[2][contacts]

    def corners(self, pairs: I64, quads: I64) -> tuple[I64, I64, I64]:
        """The points of the corners of quads' triangles, each in one of the pairs."""
        shift = self.shifts[pairs]
        around = self.table.around[quads]
        return shift + self.table.unit_of[quads], shift + around[:, 0], shift + around[:, 1]
