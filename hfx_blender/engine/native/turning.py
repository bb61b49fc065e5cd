# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotation angles between placements; ``turning.c``."""

from __future__ import annotations

import numpy as np

from ..arrays import F64
from .library import loaded


def turns(before: F64, after: F64) -> F64:
    """Angles of rotation between placements (n, 4, 4), radians (n,); exactly 0 for no rotation."""
    assert before.shape == after.shape == (len(before), 4, 4)
    angles = np.empty(len(before))
    loaded().hfx_turns(len(angles), before, after, angles)
    return angles
