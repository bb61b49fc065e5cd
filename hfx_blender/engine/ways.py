# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways of points through a volume's space in the time between two samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Ways:
    """Ways of N points, each of as many straight steps; what turns asks for more than one."""

    before: F64  # (3, N) shape space, where they begin
    after: F64  # (3, N) where they end
    intervals: I64  # (N,) which one each is of
    from_before: F64  # (steps + 1, n, 4, 4) the start to its place after each step; or empty
    from_after: F64  # (steps + 1, n, 4, 4) the same from the end; or empty: one step

    @classmethod
    def straight(cls, before: F64, after: F64) -> Ways:
        """Ways of one step between points (3, N)."""
        none = np.zeros((0, 0, 4, 4))
        return cls(before, after, np.zeros(before.shape[1], np.int64), none, none)

    @classmethod
    def joined(cls, parts: Sequence[Ways]) -> Ways:
        """All of some that are of the same intervals, in this order."""
        return cls(
            np.concatenate([part.before for part in parts], axis=1),
            np.concatenate([part.after for part in parts], axis=1),
            np.concatenate([part.intervals for part in parts]),
            parts[0].from_before,
            parts[0].from_after,
        )

    @property
    def steps(self) -> int:
        return max(len(self.from_before) - 1, 1)

    def taken(self, which: I64 | Bool) -> Ways:
        """Some of them."""
        return Ways(
            self.before[:, which],
            self.after[:, which],
            self.intervals[which],
            self.from_before,
            self.from_after,
        )

    def path(self) -> F64:
        """Places after each step, (steps + 1, 3, N)."""
        if self.steps == 1:
            return np.stack([self.before, self.after])
        places = np.zeros((self.steps + 1, *self.before.shape))
        places[0], places[-1] = self.before, self.after
        for k in range(1, self.steps):
            share = k / self.steps
            places[k] += (1.0 - share) * _moved(self.from_before[k], self.before, self.intervals)
            places[k] += share * _moved(self.from_after[k], self.after, self.intervals)
        return places


def _moved(matrices: F64, points: F64, intervals: I64) -> F64:
    moved: F64 = np.einsum("nij,jn->in", matrices[intervals, :3, :3], points)
    moved += matrices[intervals, :3, 3].T
    return moved
