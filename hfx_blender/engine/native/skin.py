# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones that move skin, and their matrices; ``skin.h``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import I64
from .declarations import structure
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
    """Room for matrices of bones at some rows, from rest to target space, and for their stretch.

    Parameters
    ----------
    count : int
        Number of rows.
    bones : UsedBones
        Those that matter.
    given : int
        Number of bones of the pose; that bone is one that rests.

    Attributes
    ----------
    matrices : (n, k, 3, 4) float64
        Rest to target space; only of bones that move anything that is near.
    stretches : (n, k) float64
        No less than what each matrix stretches any direction by.
    pointers : Structure
        ``hfx_bones``.
    """

    def __init__(self, count: int, bones: UsedBones, given: int) -> None:
        self.matrices = np.empty((count, len(bones.ids), 3, 4))
        self.stretches = np.empty((count, len(bones.ids)))
        found = self.matrices, self.stretches
        self.pointers = structure("hfx_bones")(*found, bones.slots(given), len(bones.ids))
