# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns a scan so that it is seen from above, in whichever direction its scanner looked."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64

_STEEP: Final = np.cos(np.radians(30.0))
_THICK: Final = 0.25  # of its narrower spread
_LINE: Final = 1e-7  # of its longer spread


def seen_from_above(points: npt.ArrayLike) -> F64:
    """Rotate points (N, 3) of a sheet so that z is its height.

    A sheet that leans by less than 30 degrees keeps its own x and y; any other is turned so that
    the plane that fits it best is level, as little as that takes.

    Raises
    ------
    InputError
        Fewer than three points, points on a line, or no sheet at all.
    """
    found = np.asarray(points, np.float64)
    if len(found) < 3:
        raise InputError(f"Scan: {len(found)} points; a surface needs three or more.")
    centred = found - found.mean(axis=0)
    spread, axes = np.linalg.eigh(centred.T @ centred / len(found))
    if not spread[1] > _LINE**2 * spread[2]:
        raise InputError("Scan: its points are one place or on a line; a surface needs more.")
    if spread[0] > _THICK**2 * spread[1]:
        raise InputError("Scan: its points are no sheet; expected a piece of a surface.")
    up = axes[:, 0] * (1.0 if axes[2, 0] >= 0.0 else -1.0)
    if up[2] >= _STEEP:
        return found
    x = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < _STEEP else np.array([0.0, 1.0, 0.0])
    x = x - up * (x @ up)
    x /= np.linalg.norm(x)
    return centred @ np.stack([x, np.cross(up, x), up]).T
