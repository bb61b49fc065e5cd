# SPDX-License-Identifier: GPL-3.0-or-later
"""Drive of a vibration actuator for an acceleration, from measured curves.

Output is seldom proportional to drive and depends on frequency. Without measured curves output
counts as proportional.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import F64


@dataclass(frozen=True)
class DriveCurve:
    """Measured output over drive at one frequency."""

    frequency_hz: float
    points: tuple[tuple[float, float], ...]  # (0..1 of full drive, m/s^2), both rising from 0


def drive_of(curves: Sequence[DriveCurve], amplitudes: F64, frequencies_hz: F64) -> F64:
    """Drive in 0..1 for amplitudes at frequencies; 1 for unreachable amplitudes.

    Curves are inverted by linear interpolation between their points. Drives are interpolated
    between the frequencies of two curves; beyond all curves the nearest holds.

    Parameters
    ----------
    curves : sequence of DriveCurve
        At least one, by ascending frequency.
    amplitudes, frequencies_hz : (...) float64
        m/s^2 and Hz. Non-finite values count as amplitude 0.
    """
    amplitudes, hz = np.broadcast_arrays(amplitudes, frequencies_hz)
    is_number = np.isfinite(amplitudes) & np.isfinite(hz)
    wanted_m_s2 = np.where(is_number, np.maximum(amplitudes, 0.0), 0.0)
    curve_hz = np.array([curve.frequency_hz for curve in curves])
    drives = np.stack(
        [
            np.interp(wanted_m_s2, [y for _, y in curve.points], [x for x, _ in curve.points])
            for curve in curves
        ]
    )
    # Fractional index of the frequency among the curves.
    position = np.interp(np.where(is_number, hz, 0.0), curve_hz, np.arange(len(curves)))
    below = np.minimum(np.floor(position).astype(np.int64), len(curves) - 1)
    above = np.minimum(below + 1, len(curves) - 1)
    share = position - below
    low = np.take_along_axis(drives, below[None], axis=0)[0]
    high = np.take_along_axis(drives, above[None], axis=0)[0]
    return np.asarray(low * (1.0 - share) + high * share)


def driven(
    curves: Sequence[Sequence[DriveCurve]],
    amplitudes: F64,
    frequencies_hz: F64,
    full_scale: float,
    totals: F64 | None = None,
) -> F64:
    """Amplitudes (..., C) of sines, 0..1 of full scale, for the vibration of C channels.

    Amplitudes are m/s^2; ``full_scale`` is the acceleration of a fully driven channel without
    curves. ``curves`` are the curves of each channel; empty for proportional output. ``totals``
    (..., C) is the amplitude of all sines of a channel together: each sine takes its share of the
    drive for the total, so that the sum stays within full scale.
    """
    drives = amplitudes / full_scale
    for channel, channel_curves in enumerate(curves):
        if not channel_curves:
            continue
        own = amplitudes[..., channel]
        total = own if totals is None else totals[..., channel]
        drive = drive_of(channel_curves, total, frequencies_hz[..., channel])
        share = np.divide(own, total, out=np.zeros_like(own), where=total > 0.0)
        drives[..., channel] = drive * share
    return drives
