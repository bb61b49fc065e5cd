# SPDX-License-Identifier: GPL-3.0-or-later
"""Bands and effects of HJIF from dense envelopes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import gcd
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ..curves import Curve, CurveTolerance, simplified
from ..signals import joined_times
from .model import Band, Effect, Keyframe
from .semantics import MAX_TIMESCALE

MAX_HZ: Final = 1000
_SHORTEST: Final = 3  # keyframes of a curve: the reference synthesizer is silent with fewer
_FINE_TICKS: Final = 8000  # a second, where that divides well


def timescale_of(*rates_hz: Fraction) -> int:
    """Timescale, in ticks a second, with a whole number of ticks per period of each rate, if
    possible.

    The first rate counts most. 48000 is the standard's most; rates that need more are met
    within a tick.
    """
    ticks = 1
    for rate in rates_hz:
        both = ticks * rate.numerator // gcd(ticks, rate.numerator)
        if both <= MAX_TIMESCALE:
            ticks = both
    return ticks * max(1, _FINE_TICKS // ticks)


@dataclass(frozen=True, eq=False)
class Dense:
    """A row a sample: strength -1..1 of full scale and, of a vibration, its frequency."""

    times_s: F64  # (T,) from 0
    strength: F64  # (T,)
    frequency_hz: F64 | None = None  # (T,)


class Library:
    """Effects of one perception; repeated ones are stored once."""

    def __init__(self) -> None:
        self._bands: list[tuple[list[Effect], list[tuple[int, tuple[Keyframe, ...]]]]] = []

    def band(self, bursts: Sequence[tuple[int, tuple[Keyframe, ...]]]) -> list[Effect]:
        """Effects of a band, filled in by :meth:`settle`."""
        effects: list[Effect] = []
        self._bands.append((effects, list(bursts)))
        return effects

    def settle(self) -> tuple[Effect, ...]:
        """Fill in the bands; the effects of the library."""
        counts: dict[tuple[Keyframe, ...], int] = {}
        for _, bursts in self._bands:
            for _, keyframes in bursts:
                counts[keyframes] = counts.get(keyframes, 0) + 1
        repeated = [keyframes for keyframes, count in counts.items() if count > 1]
        ids = {keyframes: k + 1 for k, keyframes in enumerate(repeated)}
        for effects, bursts in self._bands:
            for position, keyframes in bursts:
                if keyframes in ids:
                    effects.append(Effect("Reference", id=ids[keyframes], position=position))
                else:
                    effects.append(_wave(position, keyframes))
        return tuple(_wave(0, keyframes, ids[keyframes]) for keyframes in repeated)


def _wave(position: int, keyframes: tuple[Keyframe, ...], id: int | None = None) -> Effect:
    return Effect(
        "Basis", id=id, position=position, phase=0.0, base_signal="Sine", keyframes=keyframes
    )


def wave_bursts(
    dense: Dense, timescale: int, tolerance: CurveTolerance, pitch_hz: float
) -> list[tuple[int, tuple[Keyframe, ...]]]:
    """A vibration as stretches between silences: position and keyframes of each.

    Equal stretches get equal keyframes, so that a library can hold them once.
    """
    found = []
    known: dict[bytes, tuple[Keyframe, ...]] = {}
    frequency = dense.frequency_hz
    assert frequency is not None
    loud = np.flatnonzero(dense.strength > 0.0)
    if not len(loud):
        return []
    cuts = np.flatnonzero(np.diff(loud) > 1)
    firsts = loud[np.concatenate([[0], cuts + 1])]
    lasts = loud[np.concatenate([cuts, [len(loud) - 1]])]
    for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True):
        start, stop = max(first - 1, 0), min(last + 2, len(dense.strength))
        levels, hertz = dense.strength[start:stop], frequency[start:stop].copy()
        hertz[: first - start] = hertz[first - start]  # silent rows beside have no pitch
        hertz[last + 1 - start :] = hertz[last - start]
        times = dense.times_s[start:stop] - dense.times_s[start]
        key = np.round(np.concatenate([times, levels, hertz]), 9).tobytes()
        if key not in known:
            known[key] = _wave_keyframes(times, levels, hertz, timescale, tolerance, pitch_hz)
        found.append((_ticks(float(dense.times_s[start]), timescale), known[key]))
    return found


def _wave_keyframes(
    times: F64,
    levels: F64,
    hertz: F64,
    timescale: int,
    tolerance: CurveTolerance,
    pitch_hz: float,
) -> tuple[Keyframe, ...]:
    amplitude = simplified(
        Curve(times, levels), tolerance, lowest=0.0, highest=1.0, keeps_silence=True
    )
    pitch = simplified(
        Curve(times, hertz),
        CurveTolerance(pitch_hz),
        lowest=float(hertz.min()),
        highest=float(hertz.max()),
    )
    knots = joined_times([amplitude, pitch], 0.0, float(times[-1]))
    return tuple(
        Keyframe(tick, round(min(max(level, 0.0), 1.0), 6), round(frequency))
        for tick, level, frequency in zip(
            _ascending_ticks(knots, timescale),
            amplitude.at(knots).tolist(),
            pitch.at(knots).tolist(),
            strict=True,
        )
    )


def curve_effect(dense: Dense, timescale: int, tolerance: CurveTolerance) -> Effect:
    """A pressure, temperature or wind over the whole time: one effect at position 0."""
    few = simplified(
        Curve(dense.times_s, dense.strength),
        tolerance,
        lowest=-1.0,
        highest=1.0,
        keeps_silence=True,
    )
    times, values = few.times_s.tolist(), few.values.tolist()
    while len(times) < _SHORTEST:
        end = times[-1] + (2.0 / timescale if len(times) == 1 else 0.0)
        times = [times[0], (times[0] + end) / 2.0, end]
        values = [values[0], (values[0] + values[-1]) / 2.0, values[-1]]
    ticks = _ascending_ticks(np.array(times), timescale)
    return Effect(
        "Basis",
        position=0,
        keyframes=tuple(
            Keyframe(tick, round(min(max(value, -1.0), 1.0), 6))
            for tick, value in zip(ticks, values, strict=True)
        ),
    )


def wave_band(effects: Sequence[Effect]) -> Band:
    """A band for a vibration."""
    return Band("VectorialWave", 0, MAX_HZ, tuple(effects))


def curve_band(effect: Effect) -> Band:
    """A band for anything else."""
    return Band("Curve", 0, MAX_HZ, (effect,), curve_type="Linear")


def _ticks(seconds: float, timescale: int) -> int:
    return round(seconds * timescale)


def _ascending_ticks(times: F64, timescale: int) -> list[int]:
    """Round to whole ticks, each later than the one before."""
    steps = np.arange(len(times))
    rounded = np.rint(times * timescale).astype(np.int64)
    return [int(each) for each in np.maximum.accumulate(rounded - steps) + steps]
