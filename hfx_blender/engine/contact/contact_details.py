# SPDX-License-Identifier: GPL-3.0-or-later
"""Place and beginning of contacts, for samples that record them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import F64, I64, Bool
from ..volume.shape import Shape
from .narrow_phase import Inside


@dataclass(frozen=True, eq=False)
class Details:
    """Details of each contact, in shape space.

    The *place* of a contact is the vertex where that is inside, else the deepest sample of its
    skin; of a contact that is over when the sample is taken, the deepest halfway through.
    """

    places: F64  # (3, total)
    since: F64  # (total,) when it began, a share of the time since the sample before; else NaN
    entries: F64  # (3, total) where skin entered first
    ways: F64  # (3, total) how it moved then, for a whole time between samples

    @classmethod
    def empty(cls, *shape: int) -> Details:
        return cls(
            np.zeros((3, *shape)),
            np.full(shape, np.nan),
            np.zeros((3, *shape)),
            np.zeros((3, *shape)),
        )

    def of(self, rows: I64, columns: I64) -> Details:
        """Details of some contacts, by their rows and columns."""
        return Details(
            self.places[:, rows, columns],
            self.since[rows, columns],
            self.entries[:, rows, columns],
            self.ways[:, rows, columns],
        )


def tell_deepest(
    details: Details,
    is_open: Bool,
    inside: list[Inside],
    column_of: I64,
    shapes: Sequence[Shape],
    matrices: F64,
) -> None:
    """Place contacts whose vertex is outside at their deepest sample.

    Parameters
    ----------
    details : Details
        Of rows and columns.
    is_open : (rows, columns) bool
        Contacts that are to be placed.
    inside : list of Inside
        Samples that are inside.
    column_of : (cells,) int64
        The column of each cell that :class:`Inside` names.
    shapes, matrices : (rows,), (rows, 4, 4)
        The volume at each row, and its place in the world.
    """
    if not inside:
        return
    rows = np.concatenate([each.rows for each in inside])
    columns = column_of[np.concatenate([each.cells for each in inside])]
    points = np.concatenate([each.points for each in inside], axis=1)
    asked = is_open[rows, columns]
    rows, columns, points = rows[asked], columns[asked], points[:, asked]
    for row in np.unique(rows).tolist():
        mine = np.flatnonzero(rows == row)
        depths = shapes[row].depth_m(points[:, mine], matrices[row])
        order = np.lexsort((-depths, columns[mine]))
        order = order[np.flatnonzero(np.diff(columns[mine][order], prepend=-1))]
        details.places[:, row, columns[mine][order]] = points[:, mine[order]]
