# SPDX-License-Identifier: GPL-3.0-or-later
"""Bands and effects of HJIF from dense envelopes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from math import gcd
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ..signals.curve_grid import on_grid
from ..signals.curves import Curve, simplified
from .document import Band, Effect, Keyframe
from .semantics import MAX_TIMESCALE

MAX_HZ: Final = 1000
_WHOLE_HZ: Final = 0.5  # that rounding to whole hertz may take
_SHORTEST: Final = 3  # keyframes of a curve: the reference synthesizer is silent with fewer
_FINE_TICKS: Final = 8000  # a second, where that divides well

MAX_POSITION: Final = 2**16 - 1
"""Ticks from the beginning of an effect to its last keyframe: the binary form has 16 bits."""


def timescale_of(*rates_hz: Fraction, seconds: float = 0.0) -> int:
    """Timescale, in ticks a second, with a whole number of ticks per period of each rate, if
    possible.

    The first rate counts most. 48000 is the standard's most; rates that need more are met
    within a tick. Where that many ``seconds`` fit into one effect, the timescale is one with
    which they do.
    """
    ticks = 1
    for rate in rates_hz:
        both = ticks * rate.numerator // gcd(ticks, rate.numerator)
        if both <= MAX_TIMESCALE:
            ticks = both
    finest = min(_FINE_TICKS, int(MAX_POSITION / seconds)) if seconds > 0.0 else _FINE_TICKS
    return ticks * max(1, finest // ticks)


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
    dense: Dense, timescale: int, tolerance: float, pitch_hz: float
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
        begin = round(float(dense.times_s[start]) * timescale)
        found += [(begin + tick, part) for tick, part in _split(known[key])]
    return found


def _wave_keyframes(
    times: F64,
    levels: F64,
    hertz: F64,
    timescale: int,
    tolerance: float,
    pitch_hz: float,
) -> tuple[Keyframe, ...]:
    strength, tone = Curve(times, levels), Curve(times, hertz)
    few = simplified(strength, tolerance, lowest=0.0, highest=1.0, keeps_silence=True)
    amplitude = on_grid(few, strength, tolerance, timescale)
    left_hz = max(pitch_hz - _WHOLE_HZ, 0.0)
    few = simplified(tone, left_hz, lowest=float(hertz.min()), highest=float(hertz.max()))
    pitch = on_grid(few, tone, left_hz, timescale)
    knots = np.union1d(amplitude[0], pitch[0])
    return tuple(
        Keyframe(tick, round(min(max(level, 0.0), 1.0), 6), round(frequency))
        for tick, level, frequency in zip(
            knots.tolist(),
            np.interp(knots, *amplitude).tolist(),
            np.interp(knots, *pitch).tolist(),
            strict=True,
        )
    )


def _split(frames: tuple[Keyframe, ...]) -> list[tuple[int, tuple[Keyframe, ...]]]:
    """Cut keyframes so that each part fits into an effect: its first tick, and its keyframes.

    A part begins with the last keyframe of the one before.
    """
    ticks = [each.relative_position or 0 for each in frames]
    if ticks[-1] <= MAX_POSITION:
        return [(0, frames)]
    firsts = [*range(ticks[0], ticks[-1], MAX_POSITION), ticks[-1]]
    return [
        (first, _shifted(_between(frames, first, stop), first)) for first, stop in pairwise(firsts)
    ]


def _between(frames: Sequence[Keyframe], first: int, stop: int) -> list[Keyframe]:
    """Keyframes from one tick to another, both with one of their own, on the straight lines."""
    ticks = np.array([each.relative_position for each in frames])
    inside = np.flatnonzero((ticks > first) & (ticks < stop)).tolist()

    def at(tick: int) -> Keyframe:
        level = np.interp(tick, ticks, [each.amplitude_modulation or 0.0 for each in frames])
        if frames[0].frequency_modulation is None:
            return Keyframe(tick, round(float(level), 6))
        hertz = np.interp(tick, ticks, [each.frequency_modulation or 0.0 for each in frames])
        return Keyframe(tick, round(float(level), 6), round(float(hertz)))

    return [at(first), *(frames[k] for k in inside), at(stop)]


def _shifted(frames: Sequence[Keyframe], ticks: int) -> tuple[Keyframe, ...]:
    return tuple(
        replace(each, relative_position=(each.relative_position or 0) - ticks) for each in frames
    )


def curve_effects(dense: Dense, timescale: int, tolerance: float) -> list[Effect]:
    """A pressure, temperature or wind over the whole time: one effect at position 0, if it fits."""
    strength = Curve(dense.times_s, dense.strength)
    few = simplified(strength, tolerance, lowest=-1.0, highest=1.0, keeps_silence=True)
    ticks, values = on_grid(few, strength, tolerance, timescale)
    if len(ticks) == 1:
        ticks, values = np.array([ticks[0], ticks[0] + 2]), np.repeat(values, 2)
    frames = tuple(
        Keyframe(tick, round(min(max(value, -1.0), 1.0), 6))
        for tick, value in zip(ticks.tolist(), values.tolist(), strict=True)
    )
    return [
        Effect("Basis", position=first, keyframes=_with_enough_keyframes(part))
        for first, part in _split(frames)
    ]


def _with_enough_keyframes(frames: tuple[Keyframe, ...]) -> tuple[Keyframe, ...]:
    """Three keyframes at least, without changing the curve."""
    first, stop = frames[0].relative_position or 0, frames[-1].relative_position or 0
    if len(frames) >= _SHORTEST or stop - first < 2:
        return frames
    middle = (first + stop) // 2
    return (*_between(frames, first, middle), frames[-1])


def wave_band(effects: Sequence[Effect]) -> Band:
    """A band for a vibration."""
    return Band("VectorialWave", 0, MAX_HZ, tuple(effects))


def curve_band(effects: Sequence[Effect]) -> Band:
    """A band for anything else."""
    return Band("Curve", 0, MAX_HZ, tuple(effects), curve_type="Linear")
