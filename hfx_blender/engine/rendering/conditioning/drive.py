# SPDX-License-Identifier: GPL-3.0-or-later
"""Drive of an actuator for a desired strength of vibration.

An actuator's output is seldom proportional to its drive, and differs over frequency. Where that
was measured, the curves are inverted here; where not, output is taken to be proportional.
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
    """Drive, 0..1, for amplitudes at frequencies; full drive beyond reach.

    Each curve is inverted on straight lines between its points. Between two frequencies the drive
    goes straight from one to the other, beyond them it is that of the nearest.

    Parameters
    ----------
    curves : sequence of DriveCurve
        At least one, by ascending frequency.
    amplitudes, frequencies_hz : (...) float64
        m/s^2 and Hz. What is not a number is not driven.
    """
    amplitudes, hz = np.broadcast_arrays(amplitudes, frequencies_hz)
    is_number = np.isfinite(amplitudes) & np.isfinite(hz)
    asked = np.where(is_number, np.maximum(amplitudes, 0.0), 0.0)
    known_hz = np.array([curve.frequency_hz for curve in curves])
    drives = np.stack(
        [
            np.interp(asked, [y for _, y in each.points], [x for x, _ in each.points])
            for each in curves
        ]
    )
    place = np.interp(np.where(is_number, hz, 0.0), known_hz, np.arange(len(curves)))
    below = np.minimum(np.floor(place).astype(np.int64), len(curves) - 1)
    above = np.minimum(below + 1, len(curves) - 1)
    share = place - below
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
    """Amplitudes of sines, 0..1 of full scale, for the desired vibration of channels.

    Parameters
    ----------
    curves : sequence of C sequences of DriveCurve
        Of each channel; empty: output is proportional to its drive.
    amplitudes, frequencies_hz : (..., C) float64
        m/s^2 and Hz.
    full_scale : float
        Amplitude of a channel without curves that is driven fully, m/s^2.
    totals : (..., C) float64, optional
        Amplitude of all sines together, where there are several: each then has its share of
        the drive that all together need, so that they never exceed it.
    """
    found = amplitudes / full_scale
    for channel, each in enumerate(curves):
        if not each:
            continue
        mine = amplitudes[..., channel]
        total = mine if totals is None else totals[..., channel]
        drive = drive_of(each, total, frequencies_hz[..., channel])
        share = np.divide(mine, total, out=np.zeros_like(mine), where=total > 0.0)
        found[..., channel] = drive * share
    return found
