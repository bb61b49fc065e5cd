# SPDX-License-Identifier: GPL-3.0-or-later
"""Waveforms for actuators driven as sound: phase-continuous, equal for any block size."""

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
"""Duration of ramps to new amplitudes and frequencies, seconds: no clicks, and hardly any delay."""


class Oscillators:
    """Oscillators, one for each of C channels.

    Parameters
    ----------
    waveforms : sequence of C of {"sine", "square", "noise"}
    begins_at : int
        Samples that have been played before.
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
        self._cycles = np.zeros(channels)  # at the beginning of the ramp, modulo repeats
        # From, to: rows of amplitude and frequency.
        self._from = np.zeros((2, channels))
        self._to = np.zeros((2, channels))
        self._done = self._steps  # samples since the ramp began

    @property
    def is_silent(self) -> bool:
        """Test for complete silence."""
        return self._done >= self._steps and not self._to[0].any()

    def aim(self, amplitudes: F64, frequencies_hz: F64) -> None:
        """Set the target amplitudes and frequencies; non-finite ones are silent.

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
        share = min(self._done / self._steps, 1.0)
        here = self._from * (1.0 - share) + self._to * share
        cycles = self._cycles_at(np.array([self._done]))[0] % self._repeats
        begins = here[0] == 0.0
        here[1], wanted[1] = kept_through_silence((here[0], wanted[0]), (here[1], wanted[1]))
        since = cycles_since_the_beginning(wanted[1], self._played / self._rate_hz, self._repeats)
        self._cycles = np.where(begins, since, cycles)
        self._from, self._to, self._done = here, wanted, 0

    def block(self, count: int) -> F64:
        """The next samples (count, C), in -1..1."""
        place = self._done + np.arange(1, count + 1)
        self._done += count
        self._played += count
        share = np.minimum(place / self._steps, 1.0)[:, None]
        amplitudes = self._from[0], self._to[0]
        hz = self._from[1], self._to[1]
        return waves(self._kinds, amplitudes, hz, share, self._cycles_at(place), self._rate_hz)

    def _cycles_at(self, place: npt.NDArray[np.int64]) -> F64:
        """Cycles (n, C) played at samples since the ramp began."""
        share = np.minimum(place / self._steps, 1.0)[:, None]
        beyond_s = np.maximum(place - self._steps, 0)[:, None] / self._rate_hz
        ways = self._from[1], self._to[1]
        on_the_way = cycles_on_the_way(ways, share, self._steps / self._rate_hz)
        return np.asarray(self._cycles + on_the_way + ways[1] * beyond_s)


class SumOfTones:
    """Bank of tones: channels that play several at once, each with oscillators of its own.

    Parameters
    ----------
    waveforms : sequence of C of {"sine", "square", "noise"}
        Of each channel: all its tones are of the same.
    """

    def __init__(self, waveforms: Sequence[Waveform], rate_hz: float) -> None:
        self._waveforms = tuple(waveforms)
        self._channels = len(self._waveforms)
        self._rate_hz = rate_hz
        self._played = 0
        self._sounding: dict[int, Oscillators] = {}

    def aim(self, tones: Tones) -> None:
        """Set the target tones, amplitudes 0..1 of full scale; missing tones end."""
        nothing = np.zeros(self._channels)
        numbers = tones.numbers.tolist()
        for number, each in self._sounding.items():
            if number not in numbers:
                each.aim(nothing, nothing)
        for number, amplitudes, hz in zip(
            numbers, tones.amplitudes, tones.frequencies_hz, strict=True
        ):
            if number not in self._sounding:
                self._sounding[number] = Oscillators(
                    self._waveforms, self._rate_hz, begins_at=self._played
                )
            self._sounding[number].aim(amplitudes, hz)

    def block(self, count: int) -> F64:
        """The next samples (count, C)."""
        found = np.zeros((count, self._channels))
        for each in self._sounding.values():
            found += each.block(count)
        self._played += count
        self._sounding = {n: each for n, each in self._sounding.items() if not each.is_silent}
        return found
