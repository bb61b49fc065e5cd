# SPDX-License-Identifier: GPL-3.0-or-later
"""Waveforms as envelopes: amplitude and frequency over time.

The analytic signal (D. Gabor, "Theory of communication", 1946) has the waveform's amplitude as
its magnitude; its frequency is the mean of its spectrum at each time (L. Cohen, "Time-frequency
distributions - a review", 1989, instantaneous frequency weighted by power).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from .. import file_limits
from ..engine.arrays import F64
from .curves import Curve
from .signals import Piece, heard

_ROWS_HZ: Final = 500.0
_AMPLITUDE_S: Final = 0.005  # duration that amplitudes are averaged over
_FREQUENCY_S: Final = 0.02
_SILENT: Final = 5e-4  # of full scale: below it a waveform is silent
_BYTES: Final = 64.0  # a sample, while it is analysed


@dataclass(frozen=True, eq=False)
class Waveform:
    """Samples at a rate, from a time on."""

    start_s: float
    rate_hz: float
    values: F64  # (n,)

    @property
    def end_s(self) -> float:
        """Time after the last sample, seconds."""
        return self.start_s + len(self.values) / self.rate_hz

    def until(self, end_s: float) -> Waveform:
        """The part before a time, if that is after its start: blocks are filled up with silence."""
        count = round((end_s - self.start_s) * self.rate_hz)
        return Waveform(self.start_s, self.rate_hz, self.values[:count]) if count > 0 else self


def added(waveforms: Sequence[Waveform], name: str) -> Waveform:
    """Sum of waveforms, at the highest of their rates; each is silent outside of its time.

    Raises
    ------
    TooLargeError
        It would have more samples than a file may ask for.
    """
    rate = max(each.rate_hz for each in waveforms)
    start = min(each.start_s for each in waveforms)
    count = round((max(each.end_s for each in waveforms) - start) * rate)
    file_limits.MEMORY.check(_BYTES * count, name, "its waveform would take")
    total = np.zeros(count)
    for each in waveforms:
        first = round((each.start_s - start) * rate)
        if each.rate_hz == rate:
            part = each.values[: count - first]
        else:
            times = np.arange(int((each.end_s - each.start_s) * rate)) / rate
            own_times = np.arange(len(each.values)) / each.rate_hz
            part = np.interp(times, own_times, each.values)[: count - first]
        total[first : first + len(part)] += part
    return Waveform(start, rate, total)


def piece_of(waveform: Waveform, gain: float) -> Piece:
    """Amplitude and frequency of a waveform, as a piece of a signal.

    A steady tone has exactly its amplitude; what changes within 5 ms has the tone's that has
    the same power.
    """
    values = gain * waveform.values
    count = len(values)
    padded = 1 << (count + int(waveform.rate_hz * _FREQUENCY_S)).bit_length()
    spectrum = np.fft.fft(values, padded)
    spectrum[1 : padded // 2] *= 2.0
    spectrum[padded // 2 + 1 :] = 0.0
    analytic = np.fft.ifft(spectrum)[: count + 1]
    power = np.abs(analytic[:count]) ** 2
    turned = analytic[1:] * np.conj(analytic[:-1])
    # Turned by more than half a turn a sample cannot be; its power weights each turn.
    turns = np.angle(turned) * np.abs(turned)
    rows = np.arange(int(count * _ROWS_HZ / waveform.rate_hz) + 1) / _ROWS_HZ
    at = np.minimum(np.round(rows * waveform.rate_hz).astype(np.int64), count - 1)
    amplitude = np.sqrt(np.maximum(_averaged(power, _AMPLITUDE_S * waveform.rate_hz)[at], 0.0))
    amplitude[amplitude < _SILENT] = 0.0
    width = _FREQUENCY_S * waveform.rate_hz
    weight = _averaged(np.abs(turned), width)[at]
    turning = _averaged(turns, width)[at]
    hertz = np.maximum(turning, 0.0) / np.where(weight > 0.0, weight, 1.0)
    hertz = heard(amplitude, hertz * waveform.rate_hz / (2.0 * np.pi))
    times = waveform.start_s + rows
    return Piece(waveform.start_s, waveform.end_s, Curve(times, amplitude), Curve(times, hertz))


def _averaged(values: F64, width: float) -> F64:
    """Mean about each sample, weighted by a raised cosine over ``width`` samples."""
    half = max(int(width / 2.0), 1)
    window = np.hanning(2 * half + 1)
    padded = np.concatenate([np.zeros(half), values, np.zeros(half)])
    size = 1 << (len(padded) + len(window)).bit_length()
    spectrum = np.fft.rfft(padded, size) * np.fft.rfft(window / window.sum(), size)
    return np.asarray(np.fft.irfft(spectrum, size)[2 * half : 2 * half + len(values)])
