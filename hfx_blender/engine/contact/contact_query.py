# SPDX-License-Identifier: GPL-3.0-or-later
"""Query of the contacts of one volume with one body, and its result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from ..arrays import F64, I32, I64, Bool, Weights
from ..counters import Counters
from ..scene import EffectBlock, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..volume.shape import Falloff, Shape
from .reachable_bounds import ReachableBounds

if TYPE_CHECKING:
    from concurrent.futures import Executor

FLATTENED: Final = "is flattened, infinite or not a number"
"""Predicate, after a volume's name, of the warning about an unusable placement."""


@dataclass(frozen=True, eq=False)
class ContactQuery:
    """One volume and one body at some rows of a block, and the requested details."""

    effect: EffectBlock  # of a volume
    falloff: Falloff
    skin: BodySkin
    pose: PoseBlock
    bounds: ReachableBounds
    counters: Counters
    rows: I64  # (n,) rows with an active volume, ascending, a subset of ``bounds.rows``
    follows: Bool  # (n,) the row before is the sample before, so contacts in between count
    reported: Bool  # (n,) other rows only start tracking
    own_sets: bool = False  # one vertex set for each row
    with_details: bool = False  # record places of contacts
    with_impact: bool = False  # record beginnings of contacts, however slow
    threads: Executor | None = None  # for the narrow phase, parallel to the caller
    name: str = ""  # of the effect, for warnings

    @property
    def asks_details(self) -> bool:
        """True if :class:`ContactDetails` are requested, for places or for impact."""
        return self.with_details or self.with_impact


@dataclass(frozen=True, eq=False)
class ContactDetails:
    """Place and beginning of each contact, shape space.

    The *place* is the vertex if that is inside, else the deepest sample of its skin. For a contact
    that ended before the sample, the place is the deepest one halfway through the passage.
    """

    places: F64  # (3, total)
    since: F64  # (total,) begin as share of the time since the sample before; NaN: earlier
    entries: F64  # (3, total) first point of entry
    ways: F64  # (3, total) motion at entry, per sample interval


@dataclass(frozen=True, eq=False)
class DetailArrays:
    """Details of all possible contacts, filled in row by row."""

    places: F64  # (rows, columns, 3)
    since: F64  # (rows, columns)
    entries: F64  # (rows, columns, 3)
    ways: F64  # (rows, columns, 3)

    @classmethod
    def empty(cls, *shape: int) -> DetailArrays:
        vectors = np.zeros((3, *shape, 3))
        return cls(vectors[0], np.full(shape, np.nan), vectors[1], vectors[2])

    def of(self, rows: I64, columns: I64) -> ContactDetails:
        """Details of contacts, given by row and column (total,) each."""
        return ContactDetails(
            self.places[rows, columns].T,
            self.since[rows, columns],
            self.entries[rows, columns].T,
            self.ways[rows, columns].T,
        )

    def place_deepest(
        self, samples: F64, contacts: I64, shapes: Sequence[Shape], matrices: F64
    ) -> None:
        """Set ``places`` to the deepest sample of each contact; called for vertices outside only.

        Samples (n, 3) are inside, in shape space; ``contacts`` (n,): row times the number of
        columns, plus column. ``shapes`` and placing ``matrices`` (rows, 4, 4) are by row.
        """
        # Row by row, because shape and placement are those of a row.
        rows, columns = np.divmod(contacts, max(self.since.shape[1], 1))
        for row in np.unique(rows).tolist():
            mine = np.flatnonzero(rows == row)
            depths = shapes[row].depth_m(samples[mine].T, matrices[row])
            # By column, deepest first; the first sample of each column is kept.
            order = np.lexsort((-depths, columns[mine]))
            order = mine[order[np.flatnonzero(np.diff(columns[mine][order], prepend=-1))]]
            self.places[row, columns[order]] = samples[order]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of a body with a volume at some rows; equal successive sets are stored once."""

    rows: I64  # (n,) rows of the block with contact, ascending
    sets: I64  # (n,) vertex set of each row, from 0, rising by 0 or 1
    offsets: I64  # (m + 1,) set j has the vertices slice(offsets[j], offsets[j + 1])
    vertices: I32  # (total,) ascending within a set
    weights: Weights  # (total,) in (0, 1]
    details: ContactDetails | None  # on request; then each row has a set of its own
