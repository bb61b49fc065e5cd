# SPDX-License-Identifier: GPL-3.0-or-later
"""Splitting the vertices of a model into clusters; ``clusters.c``."""

from __future__ import annotations

import numpy as np

from ..arrays import F32, I32, I64
from .library import loaded

_DEPTH = 64  # no more halvings follow each other


def split(pieces: list[I32], vertices: F32, load: I64 | None, leaf_size: int) -> list[I32]:
    """Halve pieces at the median of their longest axis until every one is small enough.

    Parameters
    ----------
    pieces : list of (n,) int32
        Vertex ids, none in two places.
    vertices : (V, 3) float32
    load : (V,) int64 or None
        How much of ``leaf_size`` each vertex takes; 1 by default.

    Returns
    -------
    list of (n,) int32
        Ascending vertex ids, in the order of the pieces.
    """
    if not pieces:
        return []
    ids = np.concatenate(pieces)
    todo = np.zeros(len(pieces) + _DEPTH, np.int64)
    todo[: len(pieces)] = np.cumsum([len(some) for some in pieces])[::-1]
    ends, room = np.empty(len(ids), np.int64), np.empty((2, len(ids)), np.uint64)
    found = loaded().hfx_split(len(pieces), todo, ids, vertices, load, leaf_size, ends, room)
    return cut(ids, ends[:found])


def cut(ids: I32, ends: I64) -> list[I32]:
    """Split an array into pieces that end at the given places."""
    last = ends.tolist()
    return [ids[first:end] for first, end in zip([0, *last], last, strict=False)]
