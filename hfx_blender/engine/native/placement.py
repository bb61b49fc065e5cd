# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes around all that volumes move through, and rotation angles; ``placement.c``."""

from __future__ import annotations

import numpy as np

from ..arrays import F64, Bool
from .library import loaded


def volume_boxes(matrices: F64, levels: F64, bounds: F64) -> tuple[F64, F64, Bool]:
    """World boxes of volumes over some rows.

    Parameters
    ----------
    matrices : (E, T, 4, 4) float64
        Shape space to world, of each volume.
    levels : (E, T) float64
        Where one is not above 0, its volume is off.
    bounds : (E, 2, 3) float64
        Lowest and highest corner in shape space.

    Returns
    -------
    low, high : (E, 3) float64
    is_sure : (E,) bool
        Else the volume may be anywhere.
    """
    count, rows = levels.shape
    boxes, is_sure = np.empty((count, 2, 3)), np.empty(count, np.bool_)
    loaded().hfx_volume_boxes(count, rows, matrices, levels, bounds, boxes, is_sure)
    return boxes[:, 0], boxes[:, 1], is_sure


def turns(before: F64, after: F64) -> F64:
    """Angles of rotation between placements (n, 4, 4), radians (n,); exactly 0 for no rotation."""
    assert before.shape == after.shape == (len(before), 4, 4)
    angles = np.empty(len(before))
    loaded().hfx_turns(len(angles), before, after, angles)
    return angles
