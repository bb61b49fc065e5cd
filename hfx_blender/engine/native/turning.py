# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotation angles between placements; ``turning.c``."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from ..arrays import F64
from .library import DOUBLES, INTEGER, f64, library


@cache
def _calls() -> ctypes.CDLL | None:
    found = library()
    if found is not None:
        found.hfx_turns.argtypes, found.hfx_turns.restype = [INTEGER] + [DOUBLES] * 3, None
    return found


def is_there() -> bool:
    """Test for the compiled function."""
    return _calls() is not None


def turns(before: F64, after: F64) -> F64:
    """Angles of rotation between placements (n, 4, 4), radians (n,); exactly 0 for no rotation."""
    calls = _calls()
    assert calls is not None
    before, after = f64(before), f64(after)
    assert before.shape == after.shape == (len(before), 4, 4)
    angles = np.empty(len(before))
    calls.hfx_turns(len(angles), before, after, angles)
    return angles
