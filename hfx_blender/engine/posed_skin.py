# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin of some clusters at some rows, posed: all of it in flat arrays.

A *pair* is a cluster at a row. Its points, units and cells stand together, pair after pair, so
that one pass looks at all that a volume may touch. A *slot* is a unit of a pair, a *contact* a
cell of a pair.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .indexing import ramp
from .skin_table import SkinTable

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


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

    @cached_property
    def shifts(self) -> I64:
        """What is added to a place of a pair's cluster to find its point, (pairs,)."""
        counts = np.diff(self.table.starts)[self.clusters]
        shifts: I64 = np.cumsum(counts) - counts - self.table.starts[self.clusters]
        return shifts

    @cached_property
    def _ramp(self) -> tuple[I64, I64]:
        return ramp(self.table.unit_counts[self.clusters])

    @property
    def pairs(self) -> I64:
        """The pair of each slot."""
        return self._ramp[1]

    @cached_property
    def units(self) -> I64:
        """The unit of each slot."""
        step, pair = self._ramp
        units: I64 = self.table.starts[self.clusters][pair] + step
        return units

    @cached_property
    def at(self) -> I64:
        """The point of each slot's vertex."""
        at: I64 = self.units + self.shifts[self.pairs]
        return at

    @cached_property
    def slot_rows(self) -> I64:
        """The row of each slot."""
        return self.rows[self.pairs]

    @cached_property
    def point_rows(self) -> I64:
        """The row of each point."""
        return np.repeat(self.rows, np.diff(self.table.starts)[self.clusters])

    @cached_property
    def reaches(self) -> F64:
        """How far a unit's skin can be from its vertex, shape space, (slots,)."""
        reaches: F64 = self.gaps * self.table.reaches[self.units]
        return reaches

    @cached_property
    def distances(self) -> F64:
        """How far a unit's skin can be from its vertex on average, shape space, (slots,)."""
        distances: F64 = self.gaps * self.table.means[self.units]
        return distances

    def distances_of(self, slots: I64) -> F64:
        """As :attr:`distances`, from the corners as they are: less where joints bend."""
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

    @property
    def contact_pairs(self) -> I64:
        """The pair of each contact."""
        return self._contacts[1]

    @property
    def contact_cells(self) -> I64:
        """The cell of each contact, as the table counts them."""
        return self._contacts[2]

    @cached_property
    def contact_of(self) -> I64:
        """The contact that each slot belongs to."""
        if self.table.is_simple:
            return np.arange(len(self.units))
        found: I64 = self._contacts[0][self.pairs] + self.table.cell_of[self.units]
        return found

    def by_contact(self, shares: F64) -> F64:
        """Sums of what is given for each slot, for each contact."""
        if self.table.is_simple:
            return shares
        return np.asarray(np.bincount(self.contact_of, shares, len(self.contact_cells)), np.float64)

    def corners(self, pairs: I64, quads: I64) -> tuple[I64, I64, I64]:
        """The points of the corners of quads' triangles, each in one of the pairs."""
        shift = self.shifts[pairs]
        around = self.table.around[quads]
        return shift + self.table.unit_of[quads], shift + around[:, 0], shift + around[:, 1]
