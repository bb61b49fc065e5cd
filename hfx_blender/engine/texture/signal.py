# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibration signals: amplitude and frequency over time, and the waveform of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import F64


@dataclass(frozen=True, eq=False)
class Signal:
    """A vibration over time.

    Value ``i`` of amplitude and frequency belongs to the time from ``times_s[i]`` to
    ``times_s[i + 1]`` (the last one: for as long as the one before it).
    """

    times_s: F64  # (N,) begin of each step
    step_s: float
    amplitude_m_s2: F64  # (N,) peak
    frequency_hz: F64  # (N,)
    waveform_m_s2: F64  # (M,) from times_s[0]
    waveform_rate_hz: float

    @property
    def duration_s(self) -> float:
        return len(self.times_s) * self.step_s


def carrier(amplitude: F64, frequency_hz: F64, step_s: float, rate_hz: float) -> F64:
    """Sine with the amplitudes and frequencies of the steps; its phase never jumps.

    Parameters
    ----------
    amplitude, frequency_hz : (N,) float64
    step_s : float
        Length of a step.
    rate_hz : float
        Of the waveform.

    Returns
    -------
    (round(N * step_s * rate_hz),) float64
        Unit of the amplitude.
    """
    count = round(len(amplitude) * step_s * rate_hz)
    which = np.minimum(
        (np.arange(count) / (rate_hz * step_s) + 1e-9).astype(np.int64), len(amplitude) - 1
    )
    phase = 2.0 * np.pi * np.cumsum(frequency_hz[which]) / rate_hz
    waveform: F64 = amplitude[which] * np.sin(phase - phase[:1])
    return waveform
