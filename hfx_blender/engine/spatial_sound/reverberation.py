# SPDX-License-Identifier: GPL-3.0-or-later
"""Reverberation with one independent reverberator for each loudspeaker, which gives diffuse wet
sound.

Each is a chain of all-pass sections (Schroeder 1961) with delays and signs of its own, so that
every frequency leaves every loudspeaker with the same power. Convolution goes block by block;
only a tail is carried on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64

_SEED: Final = 20120711
_SECTIONS: Final = 8
_GAIN: Final = 0.7  # Schroeder's
_SHRINKING: Final = 0.65  # delay of each section, as a share of that of the one before
_LEAST_SHARE: Final = 0.7  # delays are drawn between this share of it and all of it


class Reverberators:
    """Reverberators of C channels, which together pass the power of the input.

    Parameters
    ----------
    decay_s : float
        Time in which the sound falls by 60 dB.
    block : int
        Samples that are reverberated at once.
    """

    def __init__(
        self, channels: int, rate_hz: int, decay_s: float = 1.4, block: int = 1 << 15
    ) -> None:
        self.block = block
        self._rate_hz = rate_hz
        self._chains = [_Chain.drawn(channel, rate_hz, decay_s) for channel in range(channels)]
        length = max(int(decay_s * rate_hz), 1)
        found = np.stack([chain.impulse(length) for chain in self._chains])
        power = channels * np.square(found).sum(axis=1, keepdims=True)  # all but the cut tail's
        self.impulses: F64 = found / np.sqrt(power)  # (C, length)
        size = 1 << int(np.ceil(np.log2(block + length - 1)))
        self._size = size
        self._spectra = np.fft.rfft(self.impulses, size, axis=1)
        self._tail = np.zeros((channels, size - block))

    def response(self, frequencies_hz: F64) -> npt.NDArray[np.complex128]:
        """Complex gains of each channel for steady sines, (n,) to (n, C)."""
        found = [chain.response(frequencies_hz / self._rate_hz) for chain in self._chains]
        return np.stack(found, axis=1) / np.sqrt(len(found))

    def process(self, signal: F64) -> F64:
        """The next ``block`` samples of each channel, (block, C), for the next of the bus."""
        if signal.shape != (self.block,):
            raise ValueError(f"signal: expected ({self.block},), got {signal.shape}")
        whole = np.zeros((len(self._tail), self._size))
        whole[:, : self._tail.shape[1]] = self._tail
        if signal.any():
            spectrum = np.fft.rfft(signal, self._size)
            for channel, own in enumerate(self._spectra):
                whole[channel] += np.fft.irfft(spectrum * own, self._size)
        self._tail = whole[:, self.block :]
        return np.ascontiguousarray(whole[:, : self.block].T)


@dataclass(frozen=True)
class _Chain:
    """Sections y[n] = -g x[n] + x[n - d] + g y[n - d], one after the other."""

    delays: tuple[int, ...]  # samples
    gains: tuple[float, ...]

    @classmethod
    def drawn(cls, channel: int, rate_hz: int, decay_s: float) -> _Chain:
        """The chain of a channel, whose longest section decays in the time that is asked for."""
        rng = np.random.default_rng([_SEED, channel])
        longest = decay_s * rate_hz * -np.log10(_GAIN) / 3.0
        delays = longest * _SHRINKING ** np.arange(_SECTIONS)
        delays = np.maximum(delays * rng.uniform(_LEAST_SHARE, 1.0, _SECTIONS), 1.0)
        gains = _GAIN * rng.choice([-1.0, 1.0], _SECTIONS)
        return cls(tuple(delays.astype(int).tolist()), tuple(gains.tolist()))

    def impulse(self, length: int) -> F64:
        """Impulse response, its first ``length`` samples."""
        signal = np.zeros(length)
        signal[0] = 1.0
        for delay, gain in zip(self.delays, self.gains, strict=True):
            passed = -gain * signal
            passed[delay:] += signal[: max(length - delay, 0)]
            for start in range(delay, length, delay):
                part = passed[start : start + delay]
                part += gain * passed[start - delay : start - delay + len(part)]
            signal = passed
        return signal

    def response(self, turns_per_sample: F64) -> npt.NDArray[np.complex128]:
        """Complex gain, of magnitude 1, at frequencies as shares of the rate."""
        found = np.ones(len(turns_per_sample), np.complex128)
        for delay, gain in zip(self.delays, self.gains, strict=True):
            later = np.exp(-2j * np.pi * delay * turns_per_sample)
            found *= (later - gain) / (1.0 - gain * later)
        return found
