# SPDX-License-Identifier: GPL-3.0-or-later
"""Actuator gains from vertex weights, by ``source/rendering.c``."""

from __future__ import annotations

import numpy as np

from ..arrays import F32, F64, I32, I64
from .library import library


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
    found = library()
    if found is None:
        return None
    gains = np.zeros((len(offsets) - 1, actuator_count))
    found.hfx_strongest(
        *(len(gains), offsets, vertices, weights, len(starts) - 1, starts, reached, factors),
        *(actuator_count, gains),
    )
    return gains
