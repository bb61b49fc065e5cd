# SPDX-License-Identifier: GPL-3.0-or-later
"""Waveforms of actuators driven as sound, shared by files and live output.

Amplitude and frequency go straight from one value to the next; the phase is the exact integral of
the frequency, so it never jumps. Each sample is a function of its phase alone, also in a square
and in noise, so that it does not matter how samples are cut into blocks. An amplitude is a peak:
no wave exceeds its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Literal

import numpy as np

from ...arrays import F64, I64, U64

Waveform = Literal["sine", "square", "noise"]
WAVEFORMS: Final[tuple[Waveform, ...]] = ("sine", "square", "noise")

NOISE_REPEATS: Final = 2**16
"""Cycles after which noise comes again: four minutes at 250 Hz."""


def kept_through_silence(amplitudes: tuple[F64, F64], hz: tuple[F64, F64]) -> tuple[F64, F64]:
    """Frequencies at the start and the end of ramps between two amplitudes, kept through silence.

    A silent end's frequency means nothing: what begins there begins with its own, and what ends
    there ends with its own.

    Parameters
    ----------
    amplitudes, hz : pair of (...) float64
        At the beginning, and at the end.
    """
    first = np.where(amplitudes[0] == 0.0, hz[1], hz[0])
    last = np.where(amplitudes[1] == 0.0, hz[0], hz[1])
    return first, last


def cycles_on_the_way(hz: tuple[F64, F64], share: F64, seconds: float) -> F64:
    """Cycles played since a ramp began, after ``share`` (0..1) of its ``seconds``."""
    return np.asarray(share * (hz[0] + (hz[1] - hz[0]) * (share / 2.0)) * seconds)


def cycles_since_the_beginning(hz: F64, seconds: float, repeats: F64) -> F64:
    """Phase of a new wave, in cycles: as if it had sounded from the beginning of time.

    Vibrations of one frequency are so in phase, and add.

    Parameters
    ----------
    hz : (...) float64
    repeats : (...) float64
        Cycles after which a wave comes again.
    """
    return np.asarray(hz * seconds % repeats)


def kinds_of(waveforms: Sequence[Waveform]) -> I64:
    """Numbers of the waveforms of C channels, (C,): their places in ``WAVEFORMS``."""
    return np.array([WAVEFORMS.index(each) for each in waveforms], np.int64)


def cycles_until_it_repeats(kinds: I64) -> F64:
    """Cycles after which waves of these kinds repeat: phases are kept modulo these."""
    return np.where(kinds == WAVEFORMS.index("noise"), float(NOISE_REPEATS), 1.0)


def waves(
    kinds: I64,
    amplitudes: tuple[F64, F64],
    hz: tuple[F64, F64],
    share: F64,
    cycles: F64,
    rate_hz: float,
) -> F64:
    """Samples at a share of the ramps between amplitudes, at given cycles.

    Parameters
    ----------
    kinds : int64, as wide as ``cycles`` or 1 along each axis
    amplitudes, hz : pair of float64
        At the ends of the ways; amplitudes are peaks.
    share, cycles : float64
    rate_hz : float
        Of the samples.
    """
    amplitude = amplitudes[0] * (1.0 - share) + amplitudes[1] * share
    if not kinds.any():
        return np.asarray(amplitude * _sines(cycles, cycles))
    hz_now = hz[0] * (1.0 - share) + hz[1] * share
    steps = np.broadcast_to(hz_now / rate_hz, cycles.shape)
    if (kinds == kinds.flat[0]).all():
        return np.asarray(amplitude * _UNIT_WAVES[kinds.flat[0]](cycles, steps))
    wanted = np.broadcast_to(kinds, cycles.shape)
    found = np.zeros(cycles.shape)
    for kind, unit_wave in enumerate(_UNIT_WAVES):
        is_its = wanted == kind
        found[is_its] = unit_wave(cycles[is_its], steps[is_its])
    return np.asarray(amplitude * found)


def _sines(cycles: F64, _steps: F64) -> F64:
    return np.asarray(np.sin(2.0 * np.pi * cycles))


def _squares(cycles: F64, steps: F64) -> F64:
    """Square waves in phase with sines; an edge takes two samples, on two parabolas.

    This is a square with polynomial band-limited steps (Välimäki and Huovilainen, IEEE Signal
    Processing Magazine 2007): what is mirrored at half the rate is faint, and nothing overshoots,
    as a square made of its first harmonics does.

    Parameters
    ----------
    cycles, steps : (...) float64
        Phase, and its advance from one sample to the next.
    """
    halves = 2.0 * cycles
    number = np.floor(halves)
    into = halves - number
    rise = np.minimum(np.minimum(into, 1.0 - into) / np.clip(2.0 * steps, 1e-12, 0.5), 1.0)
    is_low = number - 2.0 * np.floor(0.5 * number)
    return np.asarray((1.0 - 2.0 * is_low) * rise * (2.0 - rise))


def noises(cycles: F64, _steps: F64) -> F64:
    """Band noise around the frequency: each cycle fades from one sine to another.

    The phases of these sines are drawn once and for all, by the number of the cycle. Two sines
    that share one amplitude never exceed it. The fading is smooth (3 s^2 - 2 s^3): half of the
    power lies within a fifth of the frequency to either side, nine tenths within a half of it.
    """
    number = np.floor(cycles)
    into = cycles - number
    first = number.astype(np.int64) & (NOISE_REPEATS - 1)
    share = into * into * (3.0 - 2.0 * into)
    one = np.sin(2.0 * np.pi * (into + _TURNS[first]))
    other = np.sin(2.0 * np.pi * (into + _TURNS[first + 1]))
    return np.asarray(one + share * (other - one))


def split_mix(count: int) -> U64:
    """The first outputs of SplitMix64 from seed 0 (Steele, Lea and Flood, OOPSLA 2014)."""
    mixed = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(mixed ^ (mixed >> np.uint64(31)))


_TURNS: Final[F64] = np.resize(split_mix(NOISE_REPEATS) * 2.0**-64, NOISE_REPEATS + 1)
"""Phases of the sines of noise in cycles, 0 to 1; the last one is the first one again."""

_UNIT_WAVES: Final[tuple[Callable[[F64, F64], F64], ...]] = (_sines, _squares, noises)
"""Waves of amplitude 1 in the order of ``WAVEFORMS``."""
