# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrices of bones, and bounds of clusters that they move; ``skin.c``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays import F64, I64
from .declarations import structure
from .library import loaded
from .skin_binding import Clusters as Clusters


@dataclass(frozen=True, eq=False)
class UsedBones:
    """Bones that move anything, ascending; a bone missing in a pose is at rest."""

    ids: I64  # (k,)

    def slots(self, given: int) -> I64:
        """Index of each bone of a pose among these, (given + 1,); the last entry is the bone that
        rests.
        """
        if given not in self._slots:
            if len(self.ids) and self.ids[-1] > given:
                raise IndexError(f"bone {self.ids[-1]} of a pose of {given}")
            self._slots[given] = slots = np.zeros(given + 1, np.int64)
            slots[self.ids] = np.arange(len(self.ids))
        return self._slots[given]

    @cached_property
    def _slots(self) -> dict[int, I64]:
        return {}


class PosedBones:
    """Matrices of bones at some rows, from rest to target space, and bounds of their stretch.

    Parameters
    ----------
    posed : (T, B, 3, 4) float64
        Rest space to posed armature space.
    rows : (n,) int64
        Of these.
    to_target : (n, 4, 4) float64, optional
        From armature space. Without it, room is made for what is found out later.
    bones : UsedBones
        Those that matter; B is one that rests.

    Attributes
    ----------
    matrices : (n, k, 3, 4) float64
        Rest to target space.
    stretches : (n, k) float64
        No less than what each matrix stretches any direction by.
    pointers : Structure
        ``hfx_bones``.
    """

    def __init__(self, posed: F64, rows: I64, to_target: F64 | None, bones: UsedBones) -> None:
        count, used, given = len(rows), bones.ids, posed.shape[1]
        self.matrices = np.empty((count, len(used), 3, 4))
        self.stretches = np.empty((count, len(used)))
        found = self.matrices, self.stretches
        self.pointers = structure("hfx_bones")(*found, bones.slots(given), len(used))
        if to_target is not None:
            arrays = posed, rows, used, to_target
            loaded().hfx_bone_matrices(count, len(used), given, *arrays, *found)

    def cell_means(self, groups: Any, rows: I64, clusters: I64) -> F64:
        """Upper bounds of the mean distance of cells' skin from their vertex, target space (m, k);
        see :class:`..skin.cell_sizes.CellSizes`.

        ``groups`` are ``hfx_groups`` of all clusters, filled in for these; ``rows`` (m,) are some
        of these rows.
        """
        means = np.empty((len(rows), len(clusters)))
        loaded().hfx_cell_means(
            *(self.pointers, groups, len(rows), rows, len(clusters), clusters, means)
        )
        return means
