# SPDX-License-Identifier: GPL-3.0-or-later
"""Reverberation with one independent reverberator for each loudspeaker, which gives diffuse wet
sound.

Noise that dies away evenly, another for each channel: the plainest late reverberation there is
(Moorer 1979). Convolution goes block by block; only a tail is carried on.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64

_SEED: Final = 20120711
_RISE_S: Final = 0.012  # until the reverberation is dense
_DAMPING: Final = 0.35  # of a one-pole low pass: air swallows the highs


class Reverberators:
    """Reverberators of C channels.

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
        self.impulses = _impulses(channels, rate_hz, decay_s)
        length = self.impulses.shape[1]
        size = 1 << int(np.ceil(np.log2(block + length - 1)))
        self._size = size
        self._spectra = np.fft.rfft(self.impulses, size, axis=1)
        self._tail = np.zeros((channels, size - block))

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


def _impulses(channels: int, rate_hz: int, decay_s: float) -> F64:
    """Impulse responses (C, n) that together pass the power of the input."""
    count = max(int(decay_s * rate_hz), 1)
    times = np.arange(count) / rate_hz
    shape = 10.0 ** (-3.0 * times / decay_s) * np.minimum(times / _RISE_S, 1.0)
    impulses = np.zeros((channels, count))
    for channel in range(channels):
        noise = np.random.default_rng([_SEED, channel]).standard_normal(count)
        noise[1:] += _DAMPING * noise[:-1]
        impulse = noise * shape
        impulses[channel] = impulse / np.sqrt(np.sum(np.square(impulse)) * channels)
    return impulses
