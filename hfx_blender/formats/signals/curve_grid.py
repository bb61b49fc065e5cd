# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplified curves with keyframes at whole ticks, still within their tolerance."""

from __future__ import annotations

from typing import Final

import numpy as np

from ...engine.arrays import F64, I64, Bool
from .curves import Curve

_SILENT: Final = 0.01
"""Share of the tolerance that may be left where the original is silent."""

_STRAIGHT: Final = 1e-9
"""Distance from the straight line between its neighbours at which a keyframe is needed."""

_HOLD: Final = 3
"""Rows of one value in a row that make a hold."""


def on_grid(few: Curve, dense: Curve, tolerance: float, ticks_per_s: int) -> tuple[I64, F64]:
    """A simplified curve with its keyframes moved to whole ticks.

    Holds of the original, three rows of one value or more, stay exactly constant. Where a
    moved keyframe leaves the tolerance, the original's own rows beside it are taken: they are
    met exactly wherever they lie on ticks.

    Parameters
    ----------
    few : Curve
        Within ``tolerance`` of ``dense``.
    dense : Curve
        Times ascend strictly.
    tolerance : float
        In the unit of the values.
    ticks_per_s : int

    Returns
    -------
    ticks : (n,) int64
        Ascending, from the original's first tick to its last.
    values : (n,) float64
    """
    own_ticks = np.rint(dense.times_s * ticks_per_s).astype(np.int64)
    few_ticks = np.rint(few.times_s * ticks_per_s).astype(np.int64)
    is_held = _holds(dense.values)
    is_pinned = is_held.copy()
    is_pinned[1:] |= is_held[:-1]  # a hold's last row
    while True:
        ticks, values = _merged(few_ticks, few.values, own_ticks, dense.values, is_pinned)
        at = np.union1d(ticks, own_ticks)
        wanted = np.interp(at, own_ticks, dense.values)
        off = np.abs(np.interp(at, ticks, values) - wanted)
        is_off = (off > tolerance) | ((wanted == 0.0) & (off > _SILENT * tolerance))
        row = np.searchsorted(own_ticks, at[is_off], side="right") - 1
        newly = np.unique(np.concatenate([row, np.minimum(row + 1, len(own_ticks) - 1)]))
        if is_pinned[newly].all():
            break
        is_pinned[newly] = True
    keep = np.ones(len(ticks), np.bool_)
    slopes = np.diff(values) / np.diff(ticks)
    keep[1:-1] = (
        np.abs(np.diff(slopes)) * np.minimum(np.diff(ticks)[:-1], np.diff(ticks)[1:]) > _STRAIGHT
    )
    return ticks[keep], values[keep]


def _holds(values: F64) -> Bool:
    """Mask of rows whose next row continues a hold, (n,)."""
    is_same = np.concatenate([values[1:] == values[:-1], [False]])
    edges = np.diff(np.concatenate([[0], is_same.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    found = np.zeros(len(values), np.bool_)
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        found[begin:end] = end - begin + 1 >= _HOLD
    return found


def _merged(
    few_ticks: I64, few_values: F64, own_ticks: I64, own_values: F64, is_pinned: Bool
) -> tuple[I64, F64]:
    """Simplified keyframes, but rows of the original where these are pinned."""
    row = np.clip(np.searchsorted(own_ticks, few_ticks, side="right") - 1, 0, len(own_ticks) - 1)
    after = np.minimum(row + 1, len(own_ticks) - 1)
    is_taken = is_pinned[row] & (is_pinned[after] | (own_ticks[row] == few_ticks))
    # Later entries win where several have one tick: the original's rows come last.
    ticks = np.concatenate([few_ticks[~is_taken], own_ticks[is_pinned]])
    values = np.concatenate([few_values[~is_taken], own_values[is_pinned]])
    ascending, last = np.unique(ticks[::-1], return_index=True)
    return ascending, values[::-1][last]
