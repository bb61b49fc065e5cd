# SPDX-License-Identifier: GPL-3.0-or-later
"""Index of a table's entries by vertex, for look-ups without a full pass."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...engine.arrays import I64

Numbers = npt.NDArray[np.integer]


class Incidence:
    """Index of the occurrences of V vertices in a table.

    Parameters
    ----------
    table : (...) of int
        Vertices.
    vertex_count : int
        V.

    Attributes
    ----------
    places : (E,) int64
        Into the flattened table, those of the first vertex first. What belongs to the table's
        entries is put into this order once, for :meth:`of` to choose from.
    """

    def __init__(self, table: Numbers, vertex_count: int) -> None:
        flat = table.ravel()
        self.places: I64 = np.argsort(flat, kind="stable")
        counts = np.bincount(flat, minlength=vertex_count)
        self._first = np.concatenate([[0], np.cumsum(counts)])

    def of(self, vertices: Numbers) -> tuple[I64, I64]:
        """Indices into ``places`` for some vertices (n,), and how many each has, (n,)."""
        begin = self._first.take(vertices)
        counts = self._first[1:].take(vertices) - begin
        begin -= counts.cumsum()
        begin += counts
        found = np.repeat(begin, counts)
        found += np.arange(len(found))
        return found, counts
