# SPDX-License-Identifier: GPL-3.0-or-later
"""Interpolation of HJIF curve bands, as in the standard's reference software."""

from __future__ import annotations

from typing import Final

import numpy as np

from ...engine.arrays import F64
from ..signals.curves import Curve

_PARTS: Final = 16  # straight pieces between two keyframes: within 0.3 % of their difference
_FEWER_PARTS: Final = 4  # pieces of very long curves
_LONG: Final = 100_000  # keyframes


def interpolated(keyframes: Curve, kind: str | None) -> Curve:
    """Interpolate keyframes by a curve type, as straight pieces.

    ``kind`` is the band's ``curve_type``; None and ``Unknown`` are cubic. Two keyframes, and steps,
    are always joined by lines. Bezier and BSpline curves do not pass through all keyframes.
    """
    times, values = keyframes.times_s, keyframes.values
    if kind == "Linear" or len(times) < 3 or (np.diff(times) <= 0.0).any():
        return keyframes
    parts = _PARTS if len(times) < _LONG else _FEWER_PARTS
    if kind in ("Bezier", "BSpline"):
        points = np.column_stack([times, values])
        return _along(_arches(points) if kind == "Bezier" else _spline(points), parts)
    slopes = _akima_slopes(times, values) if kind == "Akima" else np.zeros(len(times))
    share = np.arange(parts) / parts
    width, rise = np.diff(times)[:, None], np.diff(values)[:, None]
    # Cubic Hermite curve with these slopes at its ends.
    bend = share * (1.0 - share)
    level = values[:-1, None] + rise * share**2 * (3.0 - 2.0 * share)
    level = level + width * bend * (slopes[:-1, None] * (1.0 - share) - slopes[1:, None] * share)
    dense = (times[:-1, None] + width * share).ravel()
    return Curve(np.append(dense, times[-1]), np.append(level.ravel(), values[-1]))


def _akima_slopes(times: F64, values: F64) -> F64:
    """Slopes at the keyframes, (n,) (H. Akima, "A new method of interpolation", 1970)."""
    inner = np.diff(values) / np.diff(times)
    before = [3.0 * inner[0] - 2.0 * inner[1], 2.0 * inner[0] - inner[1]]
    after = [2.0 * inner[-1] - inner[-2], 3.0 * inner[-1] - 2.0 * inner[-2]]
    slopes = np.concatenate([before, inner, after])
    turns = np.abs(np.diff(slopes))
    # Weights: the change of slope on the opposite side. Without any bend the left slope is used.
    left, right = turns[:-2], turns[2:]
    total = left + right
    is_bent = total > 1e-8 * max(float(total.max()), 1e-300)
    mean = (right * slopes[1:-2] + left * slopes[2:-1]) / np.where(is_bent, total, 1.0)
    return np.asarray(np.where(is_bent, mean, slopes[1:-2]))


def _arches(points: F64) -> F64:
    """Quadratic Bezier arches of three keyframes each, (arches, 3, 2); the last may be a line."""
    if len(points) % 2 == 0:
        points = np.concatenate([points[:-1], [points[-2:].mean(axis=0)], points[-1:]])
    return np.stack([points[:-2:2], points[1:-1:2], points[2::2]], axis=1)


def _spline(points: F64) -> F64:
    """Quadratic B-spline with uniform knots and clamped ends as Bezier arches, (arches, 3, 2)."""
    joints = (points[1:-2] + points[2:-1]) / 2.0
    joints = np.concatenate([points[:1], joints, points[-1:]])
    return np.stack([joints[:-1], points[1:-1], joints[1:]], axis=1)


def _along(arches: F64, parts: int) -> Curve:
    """Sample Bezier arches at ``parts`` points each; times are made monotonic."""
    share = (np.arange(parts) / parts)[None, :, None]
    start, middle, end = (arches[:, k, None, :] for k in range(3))
    dense = start * (1.0 - share) ** 2 + 2.0 * middle * share * (1.0 - share) + end * share**2
    dense = np.concatenate([dense.reshape(-1, 2), arches[-1, 2:]])
    return Curve(np.maximum.accumulate(dense[:, 0]), dense[:, 1])
