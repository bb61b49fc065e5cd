# SPDX-License-Identifier: GPL-3.0-or-later
"""Phase-continuous oscillators of actuators driven as sound, equal for any size of blocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.rendering.conditioning.waveform import (
    Waveform,
    cycles_on_the_way,
    cycles_since_the_beginning,
    cycles_until_it_repeats,
    kept_through_silence,
    kinds_of,
    waves,
)
from .tones import Tones

RAMP_S: Final = 0.005
"""Duration of ramps to new amplitudes and frequencies, seconds; avoids clicks."""


class Oscillators:
    """Oscillators of C channels.

    Parameters
    ----------
    waveforms : sequence of C of {"sine", "square", "noise"}
    begins_at : int
        Number of samples played before, for the phase at a start from silence: oscillators of
        equal frequency are in phase.
    """

    def __init__(
        self,
        waveforms: Sequence[Waveform],
        rate_hz: float,
        *,
        begins_at: int = 0,
    ) -> None:
        self._rate_hz = rate_hz
        self._kinds = kinds_of(waveforms)
        self._repeats = cycles_until_it_repeats(self._kinds)
        channels = len(waveforms)
        self._steps = max(1, round(RAMP_S * rate_hz))
        self._played = begins_at  # samples altogether
        self._cycles = np.zeros(channels)  # phase at the start of the ramp, modulo repeats
        # Start and target of the ramp: rows of amplitude and frequency.
        self._from = np.zeros((2, channels))
        self._to = np.zeros((2, channels))
        self._done = self._steps  # samples since the start of the ramp

    @property
    def is_silent(self) -> bool:
        """Test that all channels are silent and no ramp goes on."""
        return self._done >= self._steps and not self._to[0].any()

    def aim(self, amplitudes: F64, frequencies_hz: F64) -> None:
        """Start a ramp to new amplitudes and frequencies.

        Parameters
        ----------
        amplitudes : (C,) float64
            Clipped to 0..1 of full scale. A channel with a non-finite entry is silent.
        frequencies_hz : (C,) float64
            Clipped to 0..half the sample rate.
        """
        target = np.array([amplitudes, frequencies_hz], np.float64)
        target[:, ~np.isfinite(target).all(axis=0)] = 0.0
        target[0] = np.clip(target[0], 0.0, 1.0)
        target[1] = np.clip(target[1], 0.0, 0.5 * self._rate_hz)
        share = min(self._done / self._steps, 1.0)
        here = self._from * (1.0 - share) + self._to * share
        # The phase goes on through the change; a start from silence takes that of the time since
        # 0.
        cycles = self._cycles_at(np.array([self._done]))[0] % self._repeats
        is_start = here[0] == 0.0
        # A silent end of a ramp gets the frequency of the sounding end: no glide in fades.
        here[1], target[1] = kept_through_silence((here[0], target[0]), (here[1], target[1]))
        since = cycles_since_the_beginning(target[1], self._played / self._rate_hz, self._repeats)
        self._cycles = np.where(is_start, since, cycles)
        self._from, self._to, self._done = here, target, 0

    def block(self, count: int) -> F64:
        """Next ``count`` samples (count, C), -1..1, in the ramp and then at the last targets."""
        steps = self._done + np.arange(1, count + 1)
        self._done += count
        self._played += count
        share = np.minimum(steps / self._steps, 1.0)[:, None]
        amplitudes = self._from[0], self._to[0]
        hz = self._from[1], self._to[1]
        return waves(self._kinds, amplitudes, hz, share, self._cycles_at(steps), self._rate_hz)

    def _cycles_at(self, steps: npt.NDArray[np.int64]) -> F64:
        """Phase (n, C) in cycles at ``steps`` (n,) samples after the start of the ramp: frequencies
        change linearly on the ramp and stay afterwards.
        """
        share = np.minimum(steps / self._steps, 1.0)[:, None]
        beyond_s = np.maximum(steps - self._steps, 0)[:, None] / self._rate_hz
        frequencies = self._from[1], self._to[1]
        on_ramp = cycles_on_the_way(frequencies, share, self._steps / self._rate_hz)
        return np.asarray(self._cycles + on_ramp + frequencies[1] * beyond_s)


class SumOfTones:
    """Sum of several tones on each of C channels, with a set of oscillators by tone number.

    Parameters
    ----------
    waveforms : sequence of C of {"sine", "square", "noise"}
        Waveform of all tones of a channel.
    """

    def __init__(self, waveforms: Sequence[Waveform], rate_hz: float) -> None:
        self._waveforms = tuple(waveforms)
        self._channels = len(self._waveforms)
        self._rate_hz = rate_hz
        self._played = 0
        self._sounding: dict[int, Oscillators] = {}

    def aim(self, tones: Tones) -> None:
        """Start 5 ms ramps to new tones, amplitudes (K, C) 0..1 of full scale; sounding tones whose
        number is missing fade out, new numbers start from silence.
        """
        nothing = np.zeros(self._channels)
        numbers = tones.numbers.tolist()
        for number, oscillators in self._sounding.items():
            if number not in numbers:
                oscillators.aim(nothing, nothing)
        for number, amplitudes, hz in zip(
            numbers, tones.amplitudes, tones.frequencies_hz, strict=True
        ):
            if number not in self._sounding:
                self._sounding[number] = Oscillators(
                    self._waveforms, self._rate_hz, begins_at=self._played
                )
            self._sounding[number].aim(amplitudes, hz)

    def block(self, count: int) -> F64:
        """Next samples (count, C); sums of tones may exceed -1..1."""
        samples = np.zeros((count, self._channels))
        for bank in self._sounding.values():
            samples += bank.block(count)
        self._played += count
        # Silent tones are dropped: a next start gets the phase from the count of samples.
        self._sounding = {n: bank for n, bank in self._sounding.items() if not bank.is_silent}
        return samples
