# SPDX-License-Identifier: GPL-3.0-or-later
"""Curve bands between their keyframes, as the standard's reference software plays them."""

from __future__ import annotations

from typing import Final

import numpy as np

from ...engine.arrays import F64
from ..signals.curves import Curve

_PARTS: Final = 16  # straight pieces between two keyframes: within 0.3 % of their difference
_FEWER_PARTS: Final = 4  # of very long curves
_LONG: Final = 100_000  # keyframes


def interpolated(keyframes: Curve, kind: str | None) -> Curve:
    """A curve through or along keyframes, as straight pieces.

    Parameters
    ----------
    kind : str or None
        ``curve_type`` of the band. Without it, and for ``Unknown``, curves are cubic; two
        keyframes are always joined by a line, and so are steps.
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
    """Slopes at the keyframes (H. Akima, "A new method of interpolation", 1970), (n,)."""
    inner = np.diff(values) / np.diff(times)
    before = [3.0 * inner[0] - 2.0 * inner[1], 2.0 * inner[0] - inner[1]]
    after = [2.0 * inner[-1] - inner[-2], 3.0 * inner[-1] - 2.0 * inner[-2]]
    slopes = np.concatenate([before, inner, after])
    turns = np.abs(np.diff(slopes))
    left, right = turns[:-2], turns[2:]  # of the slopes before and after each keyframe
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
    """Quadratic B-spline with even knots and fixed ends, as Bezier arches, (arches, 3, 2)."""
    joints = (points[1:-2] + points[2:-1]) / 2.0
    joints = np.concatenate([points[:1], joints, points[-1:]])
    return np.stack([joints[:-1], points[1:-1], joints[1:]], axis=1)


def _along(arches: F64, parts: int) -> Curve:
    share = (np.arange(parts) / parts)[None, :, None]
    start, middle, end = (arches[:, k, None, :] for k in range(3))
    dense = start * (1.0 - share) ** 2 + 2.0 * middle * share * (1.0 - share) + end * share**2
    dense = np.concatenate([dense.reshape(-1, 2), arches[-1, 2:]])
    return Curve(np.maximum.accumulate(dense[:, 0]), dense[:, 1])
