# SPDX-License-Identifier: GPL-3.0-or-later
"""Amplitude and frequency envelopes of waveforms.

Amplitude is the magnitude of the analytic signal (D. Gabor, "Theory of communication", 1946).
Frequency is the instantaneous frequency weighted by power (L. Cohen, "Time-frequency
distributions - a review", 1989).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...files import limits
from ..signals.curves import Curve
from ..signals.signals import Piece, frequencies_through_silence

ROWS_HZ: Final = 500.0
AMPLITUDE_S: Final = 0.005  # averaging window of amplitudes, seconds
FREQUENCY_S: Final = 0.02
_SILENT: Final = 5e-4  # amplitudes below this share of full scale are 0
_BLOCK_ROWS: Final = 4096
_MARGIN_S: Final = 0.5  # samples before and after a block for its analytic signal, seconds
BYTES: Final = 128.0
"""Memory per sample of a waveform while it is analysed."""


@dataclass(frozen=True, eq=False)
class Waveform:
    """Uniform samples from a start time on."""

    start_s: float
    rate_hz: float
    values: F64  # (n,)

    @property
    def end_s(self) -> float:
        """Time after the last sample, seconds."""
        return self.start_s + len(self.values) / self.rate_hz

    def until(self, end_s: float) -> "Waveform":
        """Waveform cut at ``end_s``; unchanged if that is not after the start, or after the end."""
        count = round((end_s - self.start_s) * self.rate_hz)
        return Waveform(self.start_s, self.rate_hz, self.values[:count]) if count > 0 else self


def added(waveforms: Sequence[Waveform], name: str) -> Waveform:
    """Sum of one or more waveforms at the highest rate, from the earliest start on; silent outside
    each, slower ones interpolated. Raises TooLargeError beyond the memory limit of a file."""
    rate = max(waveform.rate_hz for waveform in waveforms)
    start = min(waveform.start_s for waveform in waveforms)
    count = round((max(waveform.end_s for waveform in waveforms) - start) * rate)
    limits.MEMORY.check(BYTES * count, name, "its waveform would take")
    total = np.zeros(count)
    for waveform in waveforms:
        first, part = round((waveform.start_s - start) * rate), waveform.values
        if waveform.rate_hz != rate:
            times = np.arange(int((waveform.end_s - waveform.start_s) * rate)) / rate
            part = np.interp(times, np.arange(len(part)) / waveform.rate_hz, part)
        part = part[: count - first]
        total[first : first + len(part)] += part
    return Waveform(start, rate, total)


def piece_of(waveform: Waveform, gain: float) -> Piece:
    """Piece with amplitude (times ``gain``) and frequency of a waveform, 500 keyframes a second.
    The amplitude of a steady tone is exact. Changes within 5 ms are averaged by power."""
    rate = waveform.rate_hz
    rows = np.arange(int(len(waveform.values) * ROWS_HZ / rate) + 1) / ROWS_HZ
    amplitude, hertz = np.zeros((2, len(rows)))
    for first in range(0, len(rows), _BLOCK_ROWS):  # bounds the memory of long waveforms
        block = slice(first, first + _BLOCK_ROWS)
        begin = max(int((rows[block][0] - _MARGIN_S) * rate), 0)
        end = int((rows[block][-1] + _MARGIN_S) * rate) + 1
        part = gain * waveform.values[begin:end]
        # Index of each row within the part, whose margin covers the reach of the analytic signal.
        at = np.minimum(np.round(rows[block] * rate).astype(np.int64) - begin, len(part) - 1)
        amplitude[block], hertz[block] = _analysed(part, rate, at)
    times = waveform.start_s + rows
    hertz = frequencies_through_silence(amplitude, hertz)
    return Piece(waveform.start_s, waveform.end_s, Curve(times, amplitude), Curve(times, hertz))


def _analysed(values: F64, rate_hz: float, at: npt.NDArray[np.int64]) -> tuple[F64, F64]:
    """Amplitude and Hz, (len(at),) each, of samples (n,) at indices ``at``. Averaged over 5 and 20
    ms; amplitudes below 5e-4 are 0."""
    count = len(values)
    padded = 1 << (count + int(rate_hz * FREQUENCY_S)).bit_length()
    # The analytic signal has the positive frequencies only, of twice the strength.
    spectrum = np.fft.fft(values, padded)
    spectrum[1 : padded // 2] *= 2.0
    spectrum[padded // 2 + 1 :] = 0.0
    analytic = np.fft.ifft(spectrum)[: count + 1]
    power = np.abs(analytic[:count]) ** 2
    turned = analytic[1:] * np.conj(analytic[:-1])
    # Phase advance per sample, at most half a turn, weighted by power.
    turns = np.angle(turned) * np.abs(turned)
    amplitude = np.sqrt(np.maximum(_averaged(power, AMPLITUDE_S * rate_hz)[at], 0.0))
    amplitude[amplitude < _SILENT] = 0.0
    weight = _averaged(np.abs(turned), FREQUENCY_S * rate_hz)[at]
    turning = np.maximum(_averaged(turns, FREQUENCY_S * rate_hz)[at], 0.0)
    hertz = turning / np.where(weight > 0.0, weight, 1.0) * rate_hz / (2.0 * np.pi)
    return amplitude, np.asarray(np.minimum(hertz, rate_hz / 2.0))


def _averaged(values: F64, width: float) -> F64:
    """Centred moving average, (n,), weighted by a raised cosine of ``width`` samples."""
    half = max(int(width / 2.0), 1)
    window = np.hanning(2 * half + 1)
    padded = np.concatenate([np.zeros(half), values, np.zeros(half)])
    size = 1 << (len(padded) + len(window)).bit_length()
    spectrum = np.fft.rfft(padded, size) * np.fft.rfft(window / window.sum(), size)
    return np.asarray(np.fft.irfft(spectrum, size)[2 * half : 2 * half + len(values)])
