# SPDX-License-Identifier: GPL-3.0-or-later
"""Filters of a contact response: their values, and the folding of a stack.

A filter yields a value in 0..1. Most are one number for the whole touch; distance and a sine
in space have one for each vertex, which always multiplies its weight.
"""

from __future__ import annotations

import numpy as np

from ..arrays import F64
from .controls import CONTROLS, Filter, Operation


def within_limits(filters: tuple[Filter, ...], controls: F64) -> F64:
    """Controls (T, F, WIDTH) clipped to their ranges; NaN becomes the default."""
    limited = np.array(controls, np.float64)
    for k, each in enumerate(filters):
        for c, control in enumerate(CONTROLS[each.kind]):
            column = limited[:, k, c]
            column[~np.isfinite(column)] = control.default
            np.clip(column, control.minimum, control.maximum, out=column)
    return limited


def distance_value(distances_m: F64, controls: F64) -> F64:
    """Linear ramp between two distances, (n,); controls (WIDTH,)."""
    near, far, first, last = controls[1:5]
    share = np.clip((distances_m - near) / max(far - near, 1e-9), 0.0, 1.0)
    return np.asarray(first + (last - first) * share)


def speed_value(speeds_m_s: F64, controls: F64) -> F64:
    """Linear ramp from 0 at one speed to 1 at another, (n,); controls (n, WIDTH)."""
    still, full = controls[:, 1], controls[:, 2]
    rise = (speeds_m_s - still) / np.maximum(full - still, 1e-9)
    return np.asarray(np.clip(np.nan_to_num(rise), 0.0, 1.0))


def proximity_value(distances_m: F64, controls: F64) -> F64:
    """1 at the boundary, 0 at the range's end and beyond, (n, V); controls (n, WIDTH)."""
    share = 1.0 - distances_m / np.maximum(controls[:, 1:2], 1e-9)
    # Of a number and NaN these take the number, and are quicker than a search for NaN.
    return np.asarray(np.fmin(np.fmax(share, 0.0), 1.0) ** controls[:, 2:3])


def sine_value(turns: F64, controls: F64) -> F64:
    """Sine between 1 - depth and 1, 1 - depth / 2 at whole turns; controls (..., WIDTH)."""
    wave = np.sin(2.0 * np.pi * (turns + controls[..., 3]))
    return np.asarray(1.0 - 0.5 * controls[..., 2] * (1.0 - wave))


def mixed(value: F64, influence: F64) -> F64:
    """Blend a factor with 1 by its influence; an influence of 0 leaves it out."""
    return np.asarray(1.0 + influence * (value - 1.0))


def folded(filters: tuple[Filter, ...], start: F64, values: F64, influences: F64) -> F64:
    """Evaluate a stack from top to bottom, in 0..1.

    Parameters
    ----------
    filters : tuple of Filter
    start : (n,) float64
        What the volume does without filters: 1 while it is touched, else 0.
    values, influences : (n, F) float64
        Of each filter; those in space are passed over, they are in the weights.
    """
    result = np.array(start, np.float64)
    for k, each in enumerate(filters):
        if each.is_in_space:
            continue
        value, influence = values[:, k], influences[:, k]
        if each.operation is Operation.MULTIPLY:
            result = result * mixed(value, influence)
        elif each.operation is Operation.ADD:
            result = result + influence * value
        else:
            result = np.maximum(result, influence * value)
    return np.clip(result, 0.0, 1.0)
