# SPDX-License-Identifier: GPL-3.0-or-later
"""Counting within groups of different sizes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


def ramp(counts: I64) -> tuple[I64, I64]:
    """For counts 2, 3: steps 0 1 0 1 2 and owners 0 0 1 1 1."""
    owners = np.repeat(np.arange(len(counts)), counts)
    steps = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    return steps, owners


def largest(values: F64, owners: I64, count: int) -> F64:
    """The largest of ``values`` (E, ...) of each owner (E,), ascending; 0 where there is none."""
    largest = np.zeros((count, *values.shape[1:]))
    firsts = np.flatnonzero(np.diff(owners, prepend=-1))
    if len(firsts):
        largest[owners[firsts]] = np.maximum.reduceat(values, firsts, axis=0)
    return largest
