# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes around clusters that bones move; ``bounds.c``."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64
from .declarations import structure
from .library import i64, loaded

_ROOM: Final = 24  # numbers for each bone


class Outline:
    """Boxes of what each bone moves of a model, cluster by cluster. A pair is a cluster and one of
    its bones.

    Parameters
    ----------
    bones : (B,) int64
        Of the pose, all that move anything; those that a pose has not, rest.
    starts : (C + 1,) int64
        Each cluster's first pair.
    slots : (P,) int64
        Which of the bones each pair has.
    centres, halves : (P, 3) float64
        The boxes of what pairs' bones move at rest.

    Attributes
    ----------
    pointers : Structure
        ``hfx_outline``.
    """

    def __init__(self, bones: I64, starts: I64, slots: I64, centres: F64, halves: F64) -> None:
        bones, slots, boxes = i64(bones), i64(slots), np.stack([centres, halves], axis=2)
        self._size = len(bones), len(starts) - 1
        arrays = bones, starts, slots, bones[slots], centres, halves, boxes
        self.pointers = structure("hfx_outline")(*self._size, *arrays)

    def bounds(
        self, posed: F64, rows: I64, to_target: F64, margins: F64 | None
    ) -> tuple[F64, F64, F64, F64]:
        """World boxes of skin.

        Parameters
        ----------
        posed : (T, B, 3, 4) float64
            Rest space to posed armature space.
        rows : (n,) int64
            Of these.
        to_target : (n, 4, 4) float64
            From armature space.
        margins : (C,) float64 or None
            How far skin may be beyond what bones move, at rest.

        Returns
        -------
        low, high : (n, C, 3) float64
            Of each cluster at each row.
        of_rows : (n, 2, 3) float64
            Around all clusters at each row.
        of_clusters : (C, 2, 3) float64
            Around each cluster at all rows.
        """
        bones, clusters = self._size
        low, high = np.empty((2, len(rows), clusters, 3))
        of_rows, of_clusters = np.empty((len(rows), 2, 3)), np.empty((clusters, 2, 3))
        loaded().hfx_bounds(
            *(self.pointers, len(rows), posed.shape[1], posed, rows, to_target, margins),
            *(np.empty(_ROOM * bones), low, high, of_rows, of_clusters),
        )
        return low, high, of_rows, of_clusters
