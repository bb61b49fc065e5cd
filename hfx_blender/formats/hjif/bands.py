# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF bands as curves, tones, ticks and waveforms (reader); only tones include the gain.

Curves are interpolated between keyframes as in the standard's reference software.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from operator import itemgetter
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64
from ...files import limits
from ..signals.curves import Curve, clipped, with_crossings
from ..signals.signals import Piece, Transient
from ..sound.waveforms import BYTES, Waveform

DEFAULT_HZ: Final = 100.0
_LEAST_RATE_HZ: Final = 2000.0
_SAMPLES: Final = 64  # samples per keyframe, at most, of a curve used as waveform
_LEAST_SAMPLES: Final = 1 << 16
_OVERSAMPLING: Final = 8.0  # sampling rate over the band's upper frequency

Placed = tuple[int, dict[str, Any]]  # position, ticks, and effect
_Points = list[tuple[float, float]]  # times, s, and values


def tone(band: dict[str, Any], placed: Placed, timescale: int, gain: float) -> Piece:
    """Vectorial wave as a piece: amplitude times ``gain``, and frequency, to the last keyframe.
    Amplitude 1 without keyframes; a negative amplitude is made positive. Frequencies are clipped to
    the band; without any, the band's middle, or 100 Hz for a band of 0 to 0 Hz, is used."""
    position, effect = placed
    levels, hertz = _columns(effect.get("keyframes", ()), position, timescale)
    begin = position / timescale
    low, high = float(band["lower_frequency_limit"]), float(band["upper_frequency_limit"])
    pitch = _curve_of(hertz, (begin, (low + high) / 2.0 or DEFAULT_HZ))
    if low < high:
        pitch = clipped(pitch, low, high)
    # The absolute value of a line bends where the line crosses 0: a keyframe is added there. A
    # change of sign is a change of phase, which envelopes do not store.
    amplitude = with_crossings(_curve_of(levels, (begin, 1.0)), 0.0)
    amplitude = Curve(amplitude.times_s, gain * np.abs(amplitude.values))
    end = max(float(amplitude.times_s[-1]), float(pitch.times_s[-1]))
    return Piece(begin, end, amplitude, pitch)


def ticks(band: dict[str, Any], placed: Placed, timescale: int) -> Iterator[Transient]:
    """Yield a tick per keyframe; default amplitude 1, frequency the band's middle."""
    position, effect = placed
    middle = (band["lower_frequency_limit"] + band["upper_frequency_limit"]) / 2.0
    for frame in effect.get("keyframes", ()):
        time = (position + frame.get("relative_position", 0)) / timescale
        level = abs(frame.get("amplitude_modulation", 1.0))
        yield Transient(time, level, float(frame.get("frequency_modulation", middle)))


def curve(band: dict[str, Any], effects: Iterable[Placed], timescale: int) -> Curve | None:
    """Join the interpolated effects of a curve band in time; None without amplitude keyframes."""
    curves = []
    for position, effect in effects:
        levels, _ = _columns(effect.get("keyframes", ()), position, timescale)
        if levels:
            curves.append(interpolated(_curve_of(levels), band.get("curve_type")))
    return one_after_another(curves) if curves else None


def curve_as_waveform(band: dict[str, Any], values: Curve, name: str) -> Waveform:
    """Sample a curve band of a vibration at 2 to 8 kHz, with fewer samples for long curves. Raises
    TooLargeError beyond the limits of duration or memory; ``name`` is the file's."""
    rate = max(_LEAST_RATE_HZ, _OVERSAMPLING * min(band["upper_frequency_limit"], 1000.0))
    begin, end = float(values.times_s[0]), float(values.times_s[-1])
    limits.SECONDS.check(end, name, "its curves last")
    # A long curve with few keyframes is smooth: 64 samples per keyframe bound its memory.
    rate = min(rate, max(_SAMPLES * len(values), _LEAST_SAMPLES) / max(end - begin, 1e-6))
    limits.MEMORY.check(BYTES * (end - begin) * rate, name, "its waveform would take")
    times = begin + np.arange(int((end - begin) * rate) + 1) / rate
    return Waveform(begin, rate, values.at(times))


def _columns(
    frames: Iterable[dict[str, Any]], position: int, timescale: int
) -> tuple[_Points, _Points]:
    """Points (s, amplitude) and (s, hertz) of keyframes, each by time; a keyframe may lack either.
    ``position`` is in ticks, ``timescale`` in ticks per second."""
    levels, hertz = [], []
    for frame in frames:
        time = (position + frame.get("relative_position", 0)) / timescale
        if "amplitude_modulation" in frame:
            levels.append((time, float(frame["amplitude_modulation"])))
        if "frequency_modulation" in frame:
            hertz.append((time, float(frame["frequency_modulation"])))
    return sorted(levels, key=itemgetter(0)), sorted(hertz, key=itemgetter(0))


def _curve_of(points: _Points, otherwise: tuple[float, float] = (0.0, 0.0)) -> Curve:
    """Curve through points (s, value), or of the single point ``otherwise`` without points."""
    times, values = np.array(points or [otherwise], np.float64).T
    return Curve(times, values)


def one_after_another(curves: list[Curve]) -> Curve:
    """Concatenate one or more curves in time order, 0 in gaps; in overlaps the later curve wins."""
    curves = sorted(curves, key=lambda each: float(each.times_s[0]))
    times, values = [curves[0].times_s], [curves[0].values]
    for before, after in pairwise(curves):
        # Curves of one band do not add: an effect ends where the next effect begins.
        is_before = times[-1] <= after.times_s[0]
        times[-1], values[-1] = times[-1][is_before], values[-1][is_before]
        if float(after.times_s[0]) > float(before.times_s[-1]):  # silent in between
            times.append(np.array([before.times_s[-1], after.times_s[0]]))
            values.append(np.zeros(2))
        times.append(after.times_s)
        values.append(after.values)
    joined = np.concatenate(times)
    order = np.argsort(joined, kind="stable")
    return Curve(joined[order], np.concatenate(values)[order])


_PARTS: Final = 16  # straight pieces between two keyframes: within 0.3 % of their difference
_FEWER_PARTS: Final = 4  # pieces of very long curves
_LONG: Final = 100_000  # keyframes


def interpolated(keyframes: Curve, kind: str | None) -> Curve:
    """Interpolate keyframes by a curve type, as straight pieces. ``kind`` is the band's
    ``curve_type``; None and ``Unknown`` are cubic. Two keyframes, and steps, are always joined by
    lines. Bezier and BSpline curves do not pass through all keyframes."""
    times, values = keyframes.times_s, keyframes.values
    if kind == "Linear" or len(times) < 3 or (np.diff(times) <= 0.0).any():
        return keyframes
    parts = _PARTS if len(times) < _LONG else _FEWER_PARTS
    share = np.arange(parts) / parts
    if kind in ("Bezier", "BSpline"):
        points = np.column_stack([times, values])
        if kind == "Bezier":
            # Quadratic arches of three keyframes each; a single interval at the end is a line.
            if len(points) % 2 == 0:
                points = np.concatenate([points[:-1], [points[-2:].mean(axis=0)], points[-1:]])
            starts, middles, ends = points[:-2:2], points[1:-1:2], points[2::2]
        else:
            # A quadratic B-spline with uniform knots and clamped ends: its arches join half way
            # between inner keyframes.
            joints = (points[1:-2] + points[2:-1]) / 2.0
            joints = np.concatenate([points[:1], joints, points[-1:]])
            starts, middles, ends = joints[:-1], points[1:-1], joints[1:]
        along = share[None, :, None]
        start, middle, end = (part[:, None, :] for part in (starts, middles, ends))
        dense = start * (1.0 - along) ** 2 + 2.0 * middle * along * (1.0 - along) + end * along**2
        dense = np.concatenate([dense.reshape(-1, 2), ends[-1:]])
        # Times of an arch ascend, but for rounding, and curves refuse descending times.
        return Curve(np.maximum.accumulate(dense[:, 0]), dense[:, 1])
    # Cubic curves of the reference software are flat at every keyframe.
    slopes = _akima_slopes(times, values) if kind == "Akima" else np.zeros(len(times))
    width, rise = np.diff(times)[:, None], np.diff(values)[:, None]
    # Cubic Hermite curve with these slopes at its ends.
    bend = share * (1.0 - share)
    level = values[:-1, None] + rise * share**2 * (3.0 - 2.0 * share)
    level = level + width * bend * (slopes[:-1, None] * (1.0 - share) - slopes[1:, None] * share)
    dense_times = (times[:-1, None] + width * share).ravel()
    return Curve(np.append(dense_times, times[-1]), np.append(level.ravel(), values[-1]))


def _akima_slopes(times: F64, values: F64) -> F64:
    """Slopes at n >= 3 keyframes (n,) with ascending times (H. Akima, "A new method of
    interpolation", 1970)."""
    inner = np.diff(values) / np.diff(times)
    # Akima's parabola through the last three keyframes continues the curve by two intervals.
    before = [3.0 * inner[0] - 2.0 * inner[1], 2.0 * inner[0] - inner[1]]
    after = [2.0 * inner[-1] - inner[-2], 3.0 * inner[-1] - 2.0 * inner[-2]]
    slopes = np.concatenate([before, inner, after])
    turns = np.abs(np.diff(slopes))
    # Weights: the change of slope on the opposite side. Without any bend the left slope is used.
    left, right = turns[:-2], turns[2:]
    total = left + right
    # Relative to the sharpest bend: turns from rounding alone would give a quotient of noise.
    is_bent = total > 1e-8 * max(float(total.max()), 1e-300)
    mean = (right * slopes[1:-2] + left * slopes[2:-1]) / np.where(is_bent, total, 1.0)
    return np.asarray(np.where(is_bent, mean, slopes[1:-2]))
