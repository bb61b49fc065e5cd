# SPDX-License-Identifier: GPL-3.0-or-later
"""Reverberation: an independent reverberator for each loudspeaker, for diffuse wet sound.

Each reverberator is a chain of all-pass sections (Schroeder 1961) with random delays and signs, so
every frequency leaves every loudspeaker with the same power. Convolution runs block by block and
carries a tail over.
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
_SHRINKING: Final = 0.65  # ratio of delays of successive sections
_LEAST_SHARE: Final = 0.7  # smallest factor of a randomly shortened delay


class Reverberators:
    """Reverberators of C channels, with together the power of the input.

    ``decay_s`` is the time of a decay by 60 dB; ``block`` the samples in each call of
    :meth:`process`.
    """

    def __init__(
        self, channels: int, rate_hz: int, decay_s: float = 1.4, block: int = 1 << 15
    ) -> None:
        self.block = block
        self._rate_hz = rate_hz
        self._chains = [_Chain.drawn(channel, rate_hz, decay_s) for channel in range(channels)]
        length = max(int(decay_s * rate_hz), 1)
        impulses = np.stack([chain.impulse(length) for chain in self._chains])
        power = channels * np.square(impulses).sum(
            axis=1, keepdims=True
        )  # without the tail that is cut off
        self.impulses: F64 = impulses / np.sqrt(power)  # (C, length)
        size = 1 << int(np.ceil(np.log2(block + length - 1)))
        self._size = size
        self._spectra = np.fft.rfft(self.impulses, size, axis=1)
        self._tail = np.zeros((channels, size - block))

    def response(self, frequencies_hz: F64) -> npt.NDArray[np.complex128]:
        """Complex gains (n, C) of the channels for steady sines of frequencies (n,) in Hz."""
        responses = [chain.response(frequencies_hz / self._rate_hz) for chain in self._chains]
        return np.stack(responses, axis=1) / np.sqrt(len(responses))

    def process(self, signal: F64) -> F64:
        """Reverberate the next ``block`` samples of a mono signal, (block, C); keeps the tail.

        Raises ValueError for a signal of another length.
        """
        if signal.shape != (self.block,):
            raise ValueError(f"signal: expected ({self.block},), got {signal.shape}")
        whole = np.zeros((len(self._tail), self._size))
        # Overlap-add: the tail of all blocks before, plus the response to this block.
        whole[:, : self._tail.shape[1]] = self._tail
        if signal.any():
            spectrum = np.fft.rfft(signal, self._size)
            for channel, own in enumerate(self._spectra):
                whole[channel] += np.fft.irfft(spectrum * own, self._size)
        self._tail = whole[:, self.block :]
        return np.ascontiguousarray(whole[:, : self.block].T)


@dataclass(frozen=True)
class _Chain:
    """Successive all-pass sections y[n] = -g x[n] + x[n - d] + g y[n - d]."""

    delays: tuple[int, ...]  # samples
    gains: tuple[float, ...]

    @classmethod
    def drawn(cls, channel: int, rate_hz: int, decay_s: float) -> _Chain:
        """Chain of a channel, from a fixed seed; the longest section decays in ``decay_s``."""
        rng = np.random.default_rng([_SEED, channel])
        # A comb with gain g and delay d decays by 60 dB in -3 d / log10(g) samples.
        longest = decay_s * rate_hz * -np.log10(_GAIN) / 3.0
        delays = longest * _SHRINKING ** np.arange(_SECTIONS)
        delays = np.maximum(delays * rng.uniform(_LEAST_SHARE, 1.0, _SECTIONS), 1.0)
        gains = _GAIN * rng.choice([-1.0, 1.0], _SECTIONS)
        return cls(tuple(delays.astype(int).tolist()), tuple(gains.tolist()))

    def impulse(self, length: int) -> F64:
        """First ``length`` samples of the impulse response of all sections in a row."""
        signal = np.zeros(length)
        signal[0] = 1.0
        for delay, gain in zip(self.delays, self.gains, strict=True):
            passed = -gain * signal
            passed[delay:] += signal[: max(length - delay, 0)]
            # The recursion reaches back by one delay, so whole runs of that length are independent.
            for start in range(delay, length, delay):
                part = passed[start : start + delay]
                part += gain * passed[start - delay : start - delay + len(part)]
            signal = passed
        return signal

    def response(self, turns_per_sample: F64) -> npt.NDArray[np.complex128]:
        """Complex gains (n,), of magnitude 1, at frequencies (n,) as shares of the sample rate."""
        gains = np.ones(len(turns_per_sample), np.complex128)
        for delay, gain in zip(self.delays, self.gains, strict=True):
            later = np.exp(-2j * np.pi * delay * turns_per_sample)
            gains *= (later - gain) / (1.0 - gain * later)
        return gains
