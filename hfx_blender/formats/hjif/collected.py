# SPDX-License-Identifier: GPL-3.0-or-later
"""Summary of a track's samples of one effect on one body, collected run by run.

A few numbers a sample and body part are kept, not the contacts: a long track needs little memory.
"""

from __future__ import annotations

import numpy as np

from ...engine.arrays import F32, F64, I64, U32
from ...engine.samples import SampleRun


class Collected:
    """The samples of one stream.

    Parameters
    ----------
    masks : (V,) uint32
        The body part of each vertex of its model.
    by_part : bool
        Keep the strongest weight of each body part; if not, only the first vertex set is kept.
    """

    def __init__(self, masks: U32, *, by_part: bool) -> None:
        self._masks, part_of = np.unique(masks, return_inverse=True)
        self._part_of: I64 = part_of.reshape(-1)
        self._is_touched = np.zeros(len(masks), np.bool_)
        self._by_part = by_part
        self._rows: list[I64] = []
        self._levels: list[F64] = []
        self._parameters: list[F64] = []
        self._strongest: list[F32] = []  # (n, parts)
        self.first_set: tuple[I64, F64] | None = None
        """Vertices and weights of the first sample."""
        self.changes = False
        """Test for a sample with other vertices; only told if not by part."""

    def add(self, run: SampleRun) -> None:
        """Take the next samples."""
        self._rows.append(run.indices)
        self._levels.append(run.levels)
        self._parameters.append(run.parameters)
        if self.first_set is None:
            part = slice(0, int(run.offsets[1]))
            self.first_set = (
                run.vertices[part].astype(np.int64),
                run.weights[part].astype(np.float64),
            )
        if not self._by_part:
            first = self.first_set[0]
            self.changes |= bool((np.diff(run.offsets) != len(first)).any()) or not np.array_equal(
                run.vertices, np.tile(first, len(run.offsets) - 1)
            )
        else:
            sizes, parts = np.diff(run.offsets), len(self._masks)
            table = np.zeros(len(sizes) * parts, np.float32)
            base = np.repeat(np.arange(len(sizes)) * parts, sizes)
            np.maximum.at(table, base + self._part_of[run.vertices], run.weights)
            self._strongest.append(table.reshape(-1, parts)[run.set_of])
            self._is_touched[run.vertices] = True

    def __len__(self) -> int:
        return sum(len(rows) for rows in self._rows)

    @property
    def rows(self) -> I64:
        """Sample indices, (n,)."""
        return np.concatenate(self._rows)

    @property
    def levels(self) -> F64:
        """(n,)"""
        return np.concatenate(self._levels)

    @property
    def parameters(self) -> F64:
        """(n, P)"""
        return np.concatenate(self._parameters)

    def touched(self) -> list[tuple[int, F64, I64]]:
        """Touched body parts: mask, strongest weight of each sample, vertices."""
        touched = np.flatnonzero(self._is_touched)
        strongest = np.concatenate(self._strongest)
        return [
            (
                int(self._masks[part]),
                strongest[:, part].astype(np.float64),
                touched[self._part_of[touched] == part],
            )
            for part in np.unique(self._part_of[touched]).tolist()
        ]
