# SPDX-License-Identifier: GPL-3.0-or-later
"""Waveforms for actuators that are driven as sound: phase-continuous, alike at any block size."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

Shape = Literal["sine", "square", "noise"]

RAMP_S: Final = 0.005
"""Amplitude and frequency go to new values within so long: no clicks, and no delay to speak of."""


class Oscillators:
    """One oscillator for each of C channels.

    Parameters
    ----------
    channels : int
    rate_hz : float
    shape : {"sine", "square", "noise"}
        Noise is white and has no frequency.
    seed : int
        Of the noise.
    """

    def __init__(self, channels: int, rate_hz: float, shape: Shape = "sine", seed: int = 0) -> None:
        self._rate_hz = rate_hz
        self._shape = shape
        self._random = np.random.default_rng(seed)
        self._steps = max(1, round(RAMP_S * rate_hz))
        self._cycles = np.zeros(channels)  # modulo 1
        # From, to: rows of amplitude and frequency.
        self._from = np.zeros((2, channels))
        self._to = np.zeros((2, channels))
        self._done = self._steps  # of the ramp, in samples

    def aim(self, amplitudes: F64, frequencies_hz: F64) -> None:
        """Go to these from where we are now; what is no number is silence.

        Parameters
        ----------
        amplitudes : (C,) float64
            0..1 of full scale.
        frequencies_hz : (C,) float64
        """
        wanted = np.array([amplitudes, frequencies_hz], np.float64)
        wanted[:, ~np.isfinite(wanted).all(axis=0)] = 0.0
        wanted[0] = np.clip(wanted[0], 0.0, 1.0)
        wanted[1] = np.clip(wanted[1], 0.0, 0.5 * self._rate_hz)
        here = self._at(np.array([self._done]))[:, 0]
        is_silent = here[0] == 0.0
        here[1, is_silent] = wanted[1, is_silent]  # what begins, begins with its own frequency
        ends = wanted[0] == 0.0
        wanted[1, ends] = here[1, ends]  # and what ends, ends with its own
        self._from, self._to, self._done = here, wanted, 0

    def block(self, count: int) -> F64:
        """The next samples (count, C), in -1..1."""
        place = self._done + np.arange(1, count + 1)
        amplitudes, frequencies_hz = self._at(place)
        self._done = min(self._done + count, self._steps)
        cycles = self._cycles + np.cumsum(frequencies_hz / self._rate_hz, axis=0)
        if count:
            self._cycles = cycles[-1] % 1.0
        if self._shape == "noise":
            wave = self._random.uniform(-1.0, 1.0, cycles.shape)
        elif self._shape == "square":
            wave = np.where(cycles % 1.0 < 0.5, 1.0, -1.0)
        else:
            wave = np.sin(2.0 * np.pi * cycles)
        return np.asarray(amplitudes * wave)

    def _at(self, place: npt.NDArray[np.int64]) -> F64:
        """Amplitudes and frequencies (2, n, C) at samples of the ramp."""
        share = np.minimum(place / self._steps, 1.0)[None, :, None]
        return np.asarray(self._from[:, None] * (1.0 - share) + self._to[:, None] * share)
