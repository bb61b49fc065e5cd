# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a contact response's filters, and evaluation of a stack.

Values are in 0..1: one for the whole touch, or one for each vertex of filters in space, which
always multiply weights.
"""

import numpy as np

from ..arrays import F64
from .controls import CONTROLS, Filter, Operation


def within_limits(filters: tuple[Filter, ...], controls: F64) -> F64:
    """Copy of controls (T, F, WIDTH) clamped to the ranges; NaN and infinity become the default.
    Unused columns stay."""
    limited = np.array(controls, np.float64)
    for k, filter_ in enumerate(filters):
        for c, control in enumerate(CONTROLS[filter_.kind]):
            column = limited[:, k, c]
            column[~np.isfinite(column)] = control.default
            np.clip(column, control.minimum, control.maximum, out=column)
    return limited


def distance_value(distances_m: F64, controls: F64) -> F64:
    """Linear ramp (n,) from ``near_value`` at and below ``near_m`` to ``far_value`` at and beyond
    ``far_m``; controls (WIDTH,)."""
    near, far, first, last = controls[1:5]
    share = np.clip((distances_m - near) / max(far - near, 1e-9), 0.0, 1.0)
    return np.asarray(first + (last - first) * share)


def speed_value(speeds_m_s: F64, controls: F64) -> F64:
    """Linear ramp (n,) from 0 at ``still_m_s`` to 1 at ``full_m_s``, clamped, 0 for NaN; controls
    (n, WIDTH)."""
    still, full = controls[:, 1], controls[:, 2]
    rise = (speeds_m_s - still) / np.maximum(full - still, 1e-9)
    return np.asarray(np.clip(np.nan_to_num(rise), 0.0, 1.0))


def proximity_value(distances_m: F64, controls: F64) -> F64:
    """Nearness (n, V): 1 inside and at the boundary, 0 from the range on and for NaN, between (1 -
    distance / range) ** exponent; controls (n, WIDTH)."""
    share = 1.0 - distances_m / np.maximum(controls[:, 1:2], 1e-9)
    # fmin and fmax drop NaN, faster than a search for NaN.
    return np.asarray(np.fmin(np.fmax(share, 0.0), 1.0) ** controls[:, 2:3])


def sine_value(turns: F64, controls: F64) -> F64:
    """Sine between 1 - depth and 1, with 1 - depth / 2 at whole turns; controls (..., WIDTH)."""
    wave = np.sin(2.0 * np.pi * (turns + controls[..., 3]))
    return np.asarray(1.0 - 0.5 * controls[..., 2] * (1.0 - wave))


def mixed(value: F64, influence: F64) -> F64:
    """Blend of 1 (influence 0) with a factor (influence 1): 1 + influence * (value - 1)."""
    return np.asarray(1.0 + influence * (value - 1.0))


def folded(filters: tuple[Filter, ...], start: F64, values: F64, influences: F64) -> F64:
    """Result (n,) of a stack, evaluated from top to bottom, clipped to 0..1 at the end.

    MULTIPLY blends the factor with 1 by the influence; ADD and MAXIMUM use influence times value.
    ``start`` (n,) is the value without filters: 1 while touched, else 0. ``values`` and
    ``influences`` are (n, F); filters in space are skipped, because weights include them.
    """
    result = np.array(start, np.float64)
    for k, filter_ in enumerate(filters):
        if filter_.is_in_space:
            continue
        value, influence = values[:, k], influences[:, k]
        if filter_.operation is Operation.MULTIPLY:
            result = result * mixed(value, influence)
        elif filter_.operation is Operation.ADD:
            result = result + influence * value
        else:
            result = np.maximum(result, influence * value)
    return np.clip(result, 0.0, 1.0)
