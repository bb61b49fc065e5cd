# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF bands and effects from dense envelopes (writer)."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import gcd
from typing import Any, Final, NamedTuple

import numpy as np

from ...engine.arrays import F64, I64
from ..signals.curves import Curve, simplified
from ..signals.signals import stretches
from .semantics import MAX_TIMESCALE

MAX_HZ: Final = 1000
_WHOLE_HZ: Final = 0.5  # rounding error of whole hertz
_SHORTEST: Final = 3  # keyframes of a curve
_FINE_TICKS: Final = 8000  # ticks per second, or the next lower multiple of the rates

_SILENT: Final = 0.01  # largest value, as a share of the tolerance, where the original is 0
_STRAIGHT: Final = 1e-9
"""Smallest deviation from the line between its neighbours for which a keyframe is stored."""

_HOLD: Final = 3  # least number of successive equal rows that form a hold
PITCH_HZ: Final = 1.0  # largest frequency error of a vibration, hertz
MAX_POSITION: Final = 2**16 - 1
"""Largest tick of a keyframe within its effect: the binary encoding has 16 bits."""


def timescale_of(*rates_hz: Fraction, seconds: float = 0.0) -> int:
    """Ticks per second with whole ticks in one period of each rate, where possible.

    Earlier rates have priority: a rate needing more than 48000, the standard's limit, is rounded to
    ticks. The scale is about 8000, less for ``seconds`` > 0, to let an effect of this duration fit
    into 16 bits.
    """
    # Least common multiple of the numerators: periods of all these rates are whole ticks.
    ticks = 1
    for rate in rates_hz:
        both = ticks * rate.numerator // gcd(ticks, rate.numerator)
        if both <= MAX_TIMESCALE:
            ticks = both
    finest = min(_FINE_TICKS, int(MAX_POSITION / seconds)) if seconds > 0.0 else _FINE_TICKS
    return ticks * max(1, finest // ticks)


@dataclass(frozen=True, eq=False)
class Dense:
    """Strength -1..1 of full scale, and the frequency of a vibration, at ascending times from 0."""

    times_s: F64  # (T,)
    strength: F64  # (T,)
    frequency_hz: F64 | None = None  # (T,); None for other modalities


class Keyframe(NamedTuple):
    """Keyframe of an effect; ``hertz`` is None for curves."""

    ticks: int  # from the effect's position
    level: float  # -1..1
    hertz: int | None = None


Burst = tuple[int, tuple[Keyframe, ...]]  # position of an effect in ticks, and its keyframes


def shared_waves(
    bands: Sequence[Sequence[Burst]],
) -> tuple[list[dict[str, Any]], list[list[dict[str, Any]]]]:
    """Effect library of a perception, and for each band the list of its effects. Keyframes
    occurring twice or more are stored once in the library (ids from 1), and referenced."""
    # Equal keyframes are equal tuples, so counting finds repetitions.
    counts = Counter(keyframes for bursts in bands for _, keyframes in bursts)
    repeated = [keyframes for keyframes, count in counts.items() if count > 1]
    ids = {keyframes: k + 1 for k, keyframes in enumerate(repeated)}
    library = [_wave(0, keyframes, id=ids[keyframes]) for keyframes in repeated]
    effects = [
        [
            {"effect_type": "Reference", "id": ids[keyframes], "position": position}
            if keyframes in ids
            else _wave(position, keyframes)
            for position, keyframes in bursts
        ]
        for bursts in bands
    ]
    return library, effects


def _wave(position: int, keyframes: Iterable[Keyframe], **id: int) -> dict[str, Any]:
    """Sine effect at ``position`` ticks with keyframes; ``id`` only for entries of the library."""
    wave = {"position": position, "phase": 0.0, "base_signal": "Sine"}
    return {"effect_type": "Basis", **id, **wave, "keyframes": keyframes_of(keyframes)}


def keyframes_of(frames: Iterable[Keyframe]) -> list[dict[str, Any]]:
    """Encode keyframes as JSON; without ``frequency_modulation`` where ``hertz`` is None."""
    members: list[dict[str, Any]] = []
    for ticks, level, hertz in frames:
        members.append({"relative_position": ticks, "amplitude_modulation": level})
        if hertz is not None:
            members[-1]["frequency_modulation"] = hertz
    return members


def wave_bursts(dense: Dense, timescale: int, tolerance: float) -> list[Burst]:
    """Split a vibration at its silences into effects: position and keyframes, in ticks, of each,
    with the silent row before and after. An effect longer than 65535 ticks is cut into several.
    Equal stretches get equal keyframes, so a library can store them once. Empty for silence."""
    bursts = []
    cached: dict[bytes, tuple[Keyframe, ...]] = {}  # by rounded rows
    frequency = dense.frequency_hz
    assert frequency is not None
    # One silent row at both ends: the wave fades to 0 there.
    for first, end in stretches(dense.strength > 0.0):
        start, stop = max(first - 1, 0), min(end + 1, len(dense.strength))
        levels, hertz = dense.strength[start:stop], frequency[start:stop].copy()
        # The silent rows at both ends carry no pitch: a ramp from their value would be heard.
        hertz[: first - start] = hertz[first - start]
        hertz[end - start :] = hertz[end - 1 - start]
        times = dense.times_s[start:stop] - dense.times_s[start]
        # Repetitions differ in the last bits, as their times are differences of other numbers:
        # equal after rounding is equal.
        key = np.round(np.concatenate([times, levels, hertz]), 9).tobytes()
        if key not in cached:
            cached[key] = _wave_keyframes(times, levels, hertz, timescale, tolerance)
        begin = round(float(dense.times_s[start]) * timescale)
        bursts += [(begin + tick, part) for tick, part in _split(cached[key])]
    return bursts


def _wave_keyframes(
    times: F64, levels: F64, hertz: F64, timescale: int, tolerance: float
) -> tuple[Keyframe, ...]:
    """Keyframes of a vibration (T,), simplified to ``tolerance`` of full scale and to 1 Hz.
    Amplitude and frequency are simplified separately, then sampled at the keyframes of both."""
    # The few keyframes of amplitude and frequency need not be at the same times.
    strength, tone = Curve(times, levels), Curve(times, hertz)
    few = simplified(strength, tolerance, lowest=0.0, highest=1.0, keeps_silence=True)
    amplitude = _on_grid(few, strength, tolerance, timescale)
    left_hz = PITCH_HZ - _WHOLE_HZ  # rounding to whole hertz takes the rest
    few = simplified(tone, left_hz, lowest=float(hertz.min()), highest=float(hertz.max()))
    pitch = _on_grid(few, tone, left_hz, timescale)
    # Both curves stay exact: sampling at all knots adds points only on straight lines.
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


def _on_grid(few: Curve, dense: Curve, tolerance: float, ticks_per_s: int) -> tuple[I64, F64]:
    """Move the keyframes of ``few`` to whole ticks; returns ticks (n,), ascending, and values (n,).

    ``few`` is within ``tolerance`` (unit of the values) of ``dense``, the original. Holds of the
    original (three or more equal rows) stay exactly constant. Where a moved keyframe leaves the
    tolerance, the adjacent rows of the original replace it; rows on whole ticks are then exact.
    Keyframes on the line between their neighbours are dropped.
    """
    own_ticks = np.rint(dense.times_s * ticks_per_s).astype(np.int64)
    few_ticks = np.rint(few.times_s * ticks_per_s).astype(np.int64)
    # Rows of the original that are stored exactly ("pinned"): at first those of holds.
    is_pinned = np.zeros(len(own_ticks), np.bool_)
    for begin, end in stretches(dense.values[1:] == dense.values[:-1]):
        is_pinned[begin : end + 1] |= end - begin + 1 >= _HOLD
    row = np.clip(np.searchsorted(own_ticks, few_ticks, side="right") - 1, 0, len(own_ticks) - 1)
    after = np.minimum(row + 1, len(own_ticks) - 1)
    # Each round pins the rows around every violation, so the loop ends at the latest with the
    # original itself. Errors of piecewise linear curves are largest at a keyframe of either one.
    while True:
        # A keyframe between two pinned rows, or on one, is replaced by these. Later entries win
        # where several have one tick: the original's rows come last.
        is_replaced = is_pinned[row] & (is_pinned[after] | (own_ticks[row] == few_ticks))
        all_ticks = np.concatenate([few_ticks[~is_replaced], own_ticks[is_pinned]])
        all_values = np.concatenate([few.values[~is_replaced], dense.values[is_pinned]])
        ticks, last = np.unique(all_ticks[::-1], return_index=True)
        values = all_values[::-1][last]
        knots = np.union1d(ticks, own_ticks)
        exact = np.interp(knots, own_ticks, dense.values)
        errors = np.abs(np.interp(knots, ticks, values) - exact)
        is_off = (errors > tolerance) | ((exact == 0.0) & (errors > _SILENT * tolerance))
        off_row = np.searchsorted(own_ticks, knots[is_off], side="right") - 1
        pinned = np.unique(np.concatenate([off_row, np.minimum(off_row + 1, len(own_ticks) - 1)]))
        if is_pinned[pinned].all():
            break
        is_pinned[pinned] = True
    # A keyframe on the line between its neighbours is redundant.
    keep = np.ones(len(ticks), np.bool_)
    slopes = np.diff(values) / np.diff(ticks)
    keep[1:-1] = (
        np.abs(np.diff(slopes)) * np.minimum(np.diff(ticks)[:-1], np.diff(ticks)[1:]) > _STRAIGHT
    )
    return ticks[keep], values[keep]


def _split(frames: tuple[Keyframe, ...]) -> list[Burst]:
    """Cut keyframes at 16-bit limits: first tick and keyframes, from tick 0, of each part. Each
    part begins with an interpolated copy of the last keyframe of the previous part."""
    if frames[-1].ticks <= MAX_POSITION:
        return [(0, frames)]
    firsts = [*range(frames[0].ticks, frames[-1].ticks, MAX_POSITION), frames[-1].ticks]
    return [
        (first, tuple(frame._replace(ticks=frame.ticks - first) for frame in part))
        for first, stop in pairwise(firsts)
        for part in [_between(frames, first, stop)]
    ]


def _between(frames: Sequence[Keyframe], first: int, stop: int) -> list[Keyframe]:
    """Keyframes from ``first`` to ``stop`` ticks, with interpolated keyframes at both ends."""
    ticks, levels, hertz = zip(*frames, strict=True)

    def at(tick: int) -> Keyframe:
        level = round(float(np.interp(tick, ticks, levels)), 6)
        if hertz[0] is None:
            return Keyframe(tick, level)
        return Keyframe(tick, level, round(float(np.interp(tick, ticks, hertz))))

    return [at(first), *(frame for frame in frames if first < frame.ticks < stop), at(stop)]


def curve_effects(dense: Dense, timescale: int, tolerance: float) -> list[dict[str, Any]]:
    """Effects of a pressure, temperature or wind curve; several only beyond 65535 ticks. A constant
    of a single row lasts two ticks."""
    strength = Curve(dense.times_s, dense.strength)
    few = simplified(strength, tolerance, lowest=-1.0, highest=1.0, keeps_silence=True)
    ticks, values = _on_grid(few, strength, tolerance, timescale)
    # A constant needs a duration.
    if len(ticks) == 1:
        ticks, values = np.array([ticks[0], ticks[0] + 2]), np.repeat(values, 2)
    frames = tuple(
        Keyframe(tick, round(min(max(value, -1.0), 1.0), 6))
        for tick, value in zip(ticks.tolist(), values.tolist(), strict=True)
    )
    effects = []
    for position, part in _split(frames):
        first, stop = part[0].ticks, part[-1].ticks
        # The reference synthesizer is silent with two keyframes: a third goes between.
        if len(part) < _SHORTEST and stop - first >= 2:
            part = (*_between(part, first, (first + stop) // 2), part[-1])
        effects.append(
            {"effect_type": "Basis", "position": position, "keyframes": keyframes_of(part)}
        )
    return effects


def band(kind: str, effects: Sequence[dict[str, Any]], **members: str) -> dict[str, Any]:
    """JSON of a band of type ``kind``, 0 to 1000 Hz, with effects and further members."""
    return {
        "band_type": kind,
        "lower_frequency_limit": 0,
        "upper_frequency_limit": MAX_HZ,
        "effects": effects,
        **members,
    }
