# SPDX-License-Identifier: GPL-3.0-or-later
"""Delta coding of a track's vertex sets; ``track.c``."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import I32, I64, U8, U32, Bool
from .library import library


def changes(sizes: I64, vertices: I32, weights: U8) -> tuple[U32, U32, U8] | None:
    """Encode each vertex set as its difference from the set before; None without the library, or
    for a negative vertex id.

    ``sizes`` (m,) are the numbers of vertices of the sets; ``vertices`` and ``weights`` (total,)
    are set after set, ids ascending within each. Returns the number (m,) of ids that enter or leave
    at each set, the first following an empty set; these ids, ascending within a set, as
    differences; and each weight (total,) minus the vertex's last stored weight (0 at first), modulo
    256.
    """
    native = library()
    if native is None or (len(vertices) and int(vertices.min()) < 0):
        return None
    last = np.zeros(int(vertices.max(initial=0)) + 1, np.uint8)
    counts, gaps = np.zeros(len(sizes), np.uint32), np.zeros(2 * len(vertices), np.uint32)
    differences = np.zeros(len(vertices), np.uint8)
    arrays = sizes, vertices, weights, last, counts, gaps, differences
    total = native.hfx_track_changes(len(sizes), *arrays)
    return counts, gaps[:total], differences


def repeats(offsets: I64, vertices: I32, weights: npt.NDArray[Any]) -> Bool | None:
    """Mask (m,) of sets equal to the set before, False for the first; None without the library.

    Set j has the entries ``slice(offsets[j], offsets[j + 1])`` of ``vertices`` and ``weights``
    (total,); weights of any type are compared bit by bit.
    """
    native = library()
    if native is None:
        return None
    same = np.zeros(len(offsets) - 1, np.bool_)
    native.hfx_track_repeats(len(same), offsets, vertices, weights, weights.dtype.itemsize, same)
    return same
