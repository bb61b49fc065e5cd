# SPDX-License-Identifier: GPL-3.0-or-later
"""Drive and waveforms of vibration actuators driven as sound, for files and live output.

Amplitude and frequency change linearly from value to value (a *ramp*); the phase is the exact
integral of the frequency and never jumps. Each sample depends on the phase only, also in square and
noise, so results do not depend on block sizes. Amplitudes are peaks; no wave exceeds the amplitude.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from ...arrays import F64, I64, U64

Waveform = Literal["sine", "square", "noise"]
WAVEFORMS: Final[tuple[Waveform, ...]] = ("sine", "square", "noise")

NOISE_REPEATS: Final = 2**16  # period of noise in cycles: four minutes at 250 Hz


def kept_through_silence(amplitudes: tuple[F64, F64], hz: tuple[F64, F64]) -> tuple[F64, F64]:
    """Frequencies at the start and end of ramps; a silent end takes the frequency of the loud end.
    ``amplitudes`` and ``hz`` are pairs (start, end) of (...); two silent ends are exchanged."""
    first = np.where(amplitudes[0] == 0.0, hz[1], hz[0])
    last = np.where(amplitudes[1] == 0.0, hz[0], hz[1])
    return first, last


def cycles_on_the_way(hz: tuple[F64, F64], share: F64, seconds: float) -> F64:
    """Cycles since the start of a ramp, after ``share`` (0..1) of its ``seconds``."""
    return np.asarray(share * (hz[0] + (hz[1] - hz[0]) * (share / 2.0)) * seconds)


def cycles_since_the_beginning(hz: F64, seconds: float, repeats: F64) -> F64:
    """Phase of a wave at ``seconds`` as if started at time 0, in cycles modulo ``repeats``.
    ``repeats``: its period. Vibrations of equal frequency are then in phase, and add."""
    return np.asarray(hz * seconds % repeats)


def kinds_of(waveforms: Sequence[Waveform]) -> I64:
    """Waveforms of C channels as indices into ``WAVEFORMS``, (C,)."""
    return np.array([WAVEFORMS.index(name) for name in waveforms], np.int64)


def cycles_until_it_repeats(kinds: I64) -> F64:
    """Periods (C,) of the waves ``kinds``, in cycles: 65536 for noise, otherwise 1."""
    return np.where(kinds == WAVEFORMS.index("noise"), float(NOISE_REPEATS), 1.0)


def waves(
    kinds: I64,
    amplitudes: tuple[F64, F64],
    hz: tuple[F64, F64],
    share: F64,
    cycles: F64,
    rate_hz: float,
) -> F64:
    """Samples of waves on ramps, linear in amplitude (peak) and frequency.

    ``kinds`` (see :func:`kinds_of`) is as wide as ``cycles``, or 1 along each axis; ``amplitudes``
    and ``hz`` are pairs of start and end; ``share``, 0..1, and ``cycles`` are position on the ramp
    and phase. ``rate_hz`` is the sample rate.
    """
    amplitude = amplitudes[0] * (1.0 - share) + amplitudes[1] * share
    # Sines only, the common case, need no frequency.
    if not kinds.any():
        return np.asarray(amplitude * _sines(cycles, cycles))
    hz_now = hz[0] * (1.0 - share) + hz[1] * share
    steps = np.broadcast_to(hz_now / rate_hz, cycles.shape)
    if (kinds == kinds.flat[0]).all():
        return np.asarray(amplitude * _UNIT_WAVES[kinds.flat[0]](cycles, steps))
    kind_of_sample = np.broadcast_to(kinds, cycles.shape)
    wave = np.zeros(cycles.shape)
    for kind, unit_wave in enumerate(_UNIT_WAVES):
        is_of_kind = kind_of_sample == kind
        wave[is_of_kind] = unit_wave(cycles[is_of_kind], steps[is_of_kind])
    return np.asarray(amplitude * wave)


def _sines(cycles: F64, _steps: F64) -> F64:
    """Sines, -1..1, of phases in cycles."""
    return np.asarray(np.sin(2.0 * np.pi * cycles))


def _squares(cycles: F64, steps: F64) -> F64:
    """Squares, -1..1, in phase with sines; an edge takes two samples, on two parabolas.

    ``steps``: advance of the phase per sample. Polynomial band-limited steps (Välimäki and
    Huovilainen, IEEE Signal Processing Magazine 2007): little aliasing, and unlike a sum of
    harmonics no overshoot.
    """
    halves = 2.0 * cycles
    number = np.floor(halves)
    into = halves - number
    # Distance from the nearest edge in units of two samples, at most 1.
    rise = np.minimum(np.minimum(into, 1.0 - into) / np.clip(2.0 * steps, 1e-12, 0.5), 1.0)
    is_low = number - 2.0 * np.floor(0.5 * number)
    return np.asarray((1.0 - 2.0 * is_low) * rise * (2.0 - rise))


def noises(cycles: F64, _steps: F64) -> F64:
    """Band noise about the frequency: each cycle fades from one sine to the next.

    The phases of the sines are fixed random numbers by cycle. Two sines that share an amplitude
    never exceed it. With the smooth fade 3 s^2 - 2 s^3 half of the power lies within a fifth of the
    frequency to either side, nine tenths within half of it.
    """
    number = np.floor(cycles)
    into = cycles - number
    first = number.astype(np.int64) & (NOISE_REPEATS - 1)
    share = into * into * (3.0 - 2.0 * into)
    fading_out = np.sin(2.0 * np.pi * (into + _TURNS[first]))
    fading_in = np.sin(2.0 * np.pi * (into + _TURNS[first + 1]))
    return np.asarray(fading_out + share * (fading_in - fading_out))


def split_mix(count: int) -> U64:
    """First ``count`` outputs of SplitMix64 from seed 0 (Steele, Lea and Flood, OOPSLA 2014)."""
    # Wrap-around of uint64 is the generator's arithmetic modulo 2^64.
    mixed = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(mixed ^ (mixed >> np.uint64(31)))


_TURNS: Final[F64] = np.resize(split_mix(NOISE_REPEATS) * 2.0**-64, NOISE_REPEATS + 1)
"""Phases of the sines of noise in cycles, 0 to 1; the last equals the first."""

_UNIT_WAVES: Final[tuple[Callable[[F64, F64], F64], ...]] = (_sines, _squares, noises)
"""Unit waves in the order of ``WAVEFORMS``."""


@dataclass(frozen=True)
class DriveCurve:
    """Measured output over drive at one frequency, as output is seldom proportional to drive."""

    frequency_hz: float
    points: tuple[tuple[float, float], ...]  # (0..1 of full drive, m/s^2), both rising from 0


def drive_of(curves: Sequence[DriveCurve], amplitudes: F64, frequencies_hz: F64) -> F64:
    """Drive (...) in 0..1 for amplitudes (...), m/s^2, at frequencies (...), Hz.

    1 for unreachable amplitudes; non-finite values count as amplitude 0. ``curves``, at least one,
    ascend in frequency. Curves are inverted by linear interpolation between their points. Drives
    are interpolated between the frequencies of two curves; beyond all curves the nearest holds.
    """
    amplitudes, hz = np.broadcast_arrays(amplitudes, frequencies_hz)
    is_number = np.isfinite(amplitudes) & np.isfinite(hz)
    wanted_m_s2 = np.where(is_number, np.maximum(amplitudes, 0.0), 0.0)
    curve_hz = np.array([curve.frequency_hz for curve in curves])
    drives = np.stack(
        [
            np.interp(wanted_m_s2, [y for _, y in curve.points], [x for x, _ in curve.points])
            for curve in curves
        ]
    )
    # Fractional index of the frequency among the curves.
    position = np.interp(np.where(is_number, hz, 0.0), curve_hz, np.arange(len(curves)))
    below = np.minimum(np.floor(position).astype(np.int64), len(curves) - 1)
    above = np.minimum(below + 1, len(curves) - 1)
    share = position - below
    low = np.take_along_axis(drives, below[None], axis=0)[0]
    high = np.take_along_axis(drives, above[None], axis=0)[0]
    return np.asarray(low * (1.0 - share) + high * share)


def driven(
    curves: Sequence[Sequence[DriveCurve]],
    amplitudes: F64,
    frequencies_hz: F64,
    full_scale: float,
    totals: F64 | None = None,
) -> F64:
    """Amplitudes (..., C) of sines, 0..1 of full scale, for the vibration of C channels.

    Amplitudes are m/s^2; ``full_scale`` is the acceleration of a fully driven channel without
    curves. ``curves`` are the curves of each channel; empty for proportional output. ``totals``
    (..., C) is the amplitude of all sines of a channel together: each sine takes its share of the
    drive for the total, so that the sum stays within full scale.
    """
    drives = amplitudes / full_scale
    for channel, channel_curves in enumerate(curves):
        if not channel_curves:
            continue
        own = amplitudes[..., channel]
        total = own if totals is None else totals[..., channel]
        # Curves are not linear: a drive of its own for each sine would overshoot the total.
        drive = drive_of(channel_curves, total, frequencies_hz[..., channel])
        share = np.divide(own, total, out=np.zeros_like(own), where=total > 0.0)
        drives[..., channel] = drive * share
    return drives
