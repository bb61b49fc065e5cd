# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets of vertices as their changes, for a track, by ``source/track.c``."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import I32, I64, U8, U32, Bool
from .library import library


def changes(sizes: I64, vertices: I32, weights: U8) -> tuple[U32, U32, U8] | None:
    """Changes from each set to the next; None without the library.

    Parameters
    ----------
    sizes : (m,) int64
    vertices : (total,) int32
        Set after set, ascending within each, none below 0.
    weights : (total,) uint8

    Returns
    -------
    counts : (m,) uint32
        How many ids enter or leave at each set, starting from none.
    gaps : (sum of counts,) uint32
        Those ids, ascending in each set, as differences.
    changes : (total,) uint8
        Weights minus the same vertex's weight before, modulo 256.
    """
    found = library()
    if found is None or (len(vertices) and int(vertices.min()) < 0):
        return None
    last = np.zeros(int(vertices.max(initial=0)) + 1, np.uint8)
    counts, gaps = np.zeros(len(sizes), np.uint32), np.zeros(2 * len(vertices), np.uint32)
    differences = np.zeros(len(vertices), np.uint8)
    arrays = sizes, vertices, weights, last, counts, gaps, differences
    total = found.hfx_track_changes(len(sizes), *arrays)
    return counts, gaps[:total], differences


def repeats(offsets: I64, vertices: I32, weights: npt.NDArray[Any]) -> Bool | None:
    """Sets that repeat the set before, as a mask; the first never does.

    Parameters
    ----------
    offsets : (m + 1,) int64
        Set j has the entries ``slice(offsets[j], offsets[j + 1])``.
    vertices : (total,) int32
    weights : (total,)
        Of any type; compared bit by bit.

    Returns
    -------
    (m,) bool, or None where there is no library.
    """
    found = library()
    if found is None:
        return None
    same = np.zeros(len(offsets) - 1, np.bool_)
    found.hfx_track_repeats(len(same), offsets, vertices, weights, weights.dtype.itemsize, same)
    return same
