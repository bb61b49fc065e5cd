# SPDX-License-Identifier: GPL-3.0-or-later
"""Counting within groups of different sizes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .arrays import I64


def ramp(counts: I64) -> tuple[I64, I64]:
    """Steps and owners of counts: for 2, 3 they are 0 1 0 1 2 and 0 0 1 1 1."""
    owners = np.repeat(np.arange(len(counts)), counts)
    steps = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    return steps, owners


def lacking(is_there: npt.NDArray[np.bool_], wanted: I64) -> I64:
    """Numbers in ``wanted`` for which nothing is there, each once, ascending."""
    known = is_there[wanted]
    return np.zeros(0, np.int64) if known.all() else np.unique(wanted[~known])


def sorted_by(keys: npt.NDArray[np.integer[Any]], count: int) -> tuple[I64, I64]:
    """Stable counting sort of keys (E,), each below ``count``: order, and start of each key, (count
    + 1,)."""
    # Numpy sorts 16 bits in one pass.
    short = keys.astype(np.uint16) if count <= 1 << 16 else keys
    order = np.argsort(short, kind="stable").astype(np.int64, copy=False)
    starts = np.zeros(count + 1, np.int64)
    np.cumsum(np.bincount(keys, minlength=count), out=starts[1:])
    return order, starts
