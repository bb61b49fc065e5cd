# SPDX-License-Identifier: GPL-3.0-or-later
"""Actuator gains from vertex weights, by ``source/rendering.c``."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from ..arrays import F32, F64, I32, I64
from .library import DOUBLES, INTEGER, INTS, LONGS, SINGLES, library


@cache
def _calls() -> ctypes.CDLL | None:
    """The library, with the arguments of these functions."""
    found = library()
    if found is not None:
        found.hfx_strongest.argtypes = [
            *(INTEGER, LONGS, INTS, SINGLES, INTEGER, LONGS, INTS, SINGLES),
            *(INTEGER, DOUBLES),
        ]
        found.hfx_strongest.restype = None
    return found


def strongest(
    offsets: I64,
    vertices: I32,
    weights: F32,
    starts: I64,
    reached: I32,
    factors: F32 | None,
    actuator_count: int,
) -> F64 | None:
    """Gain of each actuator: the largest weight among the vertices that it reaches.

    Parameters
    ----------
    offsets : (n + 1,) int64
        Sample ``k`` has the entries ``slice(offsets[k], offsets[k + 1])``.
    vertices : (total,) int32
    weights : (total,) float32
    starts : (V + 1,) int64
        Vertex ``v`` drives the actuators ``reached[starts[v]:starts[v + 1]]``.
    reached : (m,) int32
    factors : (m,) float32, optional
        How strongly.

    Returns
    -------
    (n, actuator_count) float64, or None where there is no library.
    """
    found = _calls()
    if found is None:
        return None
    offsets = np.ascontiguousarray(offsets, np.int64)
    vertices = np.ascontiguousarray(vertices, np.int32)
    weights = np.ascontiguousarray(weights, np.float32)
    gains = np.zeros((len(offsets) - 1, actuator_count))
    found.hfx_strongest(
        *(len(gains), offsets, vertices, weights),
        *(len(starts) - 1, starts, reached, factors),
        *(actuator_count, gains),
    )
    return gains
