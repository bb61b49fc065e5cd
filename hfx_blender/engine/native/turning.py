# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotation angles between placements; ``turning.c``."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from ..arrays import F64
from .library import DOUBLES, INTEGER, f64, loaded


@cache
def _calls() -> ctypes.CDLL:
    found = loaded()
    found.hfx_turns.argtypes, found.hfx_turns.restype = [INTEGER] + [DOUBLES] * 3, None
    return found


def turns(before: F64, after: F64) -> F64:
    """Angles of rotation between placements (n, 4, 4), radians (n,); exactly 0 for no rotation."""
    calls = _calls()
    before, after = f64(before), f64(after)
    assert before.shape == after.shape == (len(before), 4, 4)
    angles = np.empty(len(before))
    calls.hfx_turns(len(angles), before, after, angles)
    return angles
