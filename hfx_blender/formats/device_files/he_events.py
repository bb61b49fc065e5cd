# SPDX-License-Identifier: GPL-3.0-or-later
"""Events of .he files from signals: few points, whole milliseconds."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64, Bool
from ..signals.signals import FrequencyRange, Signal, bursts, joined_times
from . import he_rules

_SHORTEST_MS: Final = (
    he_rules.MIN_CURVE_POINTS - 1
)  # of an event, whose points have different times
_SAME_LEVEL: Final = 0.005
_SAME_SHARE: Final = 1.0  # percent


@dataclass(frozen=True)
class HeEvent:
    """Event of a .he file: continuous with points, or a transient without."""

    start_ms: int
    points: tuple[
        tuple[int, float, int], ...
    ]  # ms from its start, intensity 0..1, frequency 0..100
    transient: tuple[int, int] | None = None  # intensity and frequency, 0..100

    @property
    def end_ms(self) -> int:
        """Time of the last point, ms from the start of the signal; the start of a transient."""
        return self.start_ms + (self.points[-1][0] if self.points else 0)


def silent_end(signal: Signal, events: Sequence[HeEvent]) -> list[HeEvent]:
    """Silent events of at most 5 s each, from the last event to the end of the signal; none for a
    rest of at most ``MIN_CURVE_POINTS`` (4) ms, too short for the points of an event."""
    end = round(1000.0 * signal.duration_s)
    begin = max((event.end_ms for event in events), default=0)
    # An event needs four points at different milliseconds.
    starts = range(begin, end - he_rules.MIN_CURVE_POINTS, he_rules.MAX_DURATION_MS)
    silence = [(start, min(end - start, he_rules.MAX_DURATION_MS)) for start in starts]
    return [
        HeEvent(start, tuple(_with_enough_points([(0, 0.0, 0), (length, 0.0, 0)])))
        for start, length in silence
    ]


def events_of(signal: Signal, frequencies: FrequencyRange, *, falls_to_zero: bool) -> list[HeEvent]:
    """Convert a signal to events in time order, cut at ticks and at the format's limits. The signal
    is simplified, without two keyframes at the same time. ``falls_to_zero``: begin and end each
    event silent, as version 1 requires. An event lasts 3 ms or more: shorter sounds end later, and
    ticks within 3 ms of an end of an event are moved there."""
    ticks_ms = [round(1000.0 * tick.time_s) for tick in signal.transients]
    sounds: list[list[npt.NDArray[Any]]] = []  # times in ms, levels, shares
    times = signal.amplitude.times_s
    for first, last in bursts(signal.amplitude):
        start, end = float(times[first]), float(times[last])
        knots = joined_times([signal.amplitude, signal.frequency_hz], start, end)
        levels = signal.amplitude.at(knots)
        levels[-1] = signal.amplitude.before(end)
        shares = np.rint(100.0 * frequencies.share(signal.frequency_hz.at(knots)))
        # Times become whole milliseconds: near-duplicates within a millisecond go first. Times
        # that still coincide are raised: with k subtracted from time k, "strictly ascending"
        # becomes "never falling", which a running maximum ensures.
        is_level_key = np.isin(knots, times)
        indices = _distinct_indices(knots, levels, shares, is_level_key)
        steps = np.arange(len(indices))
        grid = np.rint(1000.0 * knots[indices]).astype(np.int64)
        grid = np.maximum.accumulate(grid - steps) + steps
        sound = [grid, levels[indices], shares[indices]]
        # A short sound is joined with a sound that follows within 3 ms.
        if sounds and sounds[-1][0][-1] <= grid[0] < sounds[-1][0][0] + _SHORTEST_MS:
            sound = list(map(np.append, sounds.pop(), sound))
        sounds.append(sound)
    events = []
    moved: dict[int, int] = {}  # times of ticks
    for grid, levels, shares in sounds:
        if grid[-1] < grid[0] + _SHORTEST_MS:
            # Silent from the next millisecond on, not on a line down to the third.
            silent = sorted({int(grid[-1]) + 1, int(grid[0]) + _SHORTEST_MS})
            grid, levels = np.append(grid, silent), np.append(levels, [0.0] * len(silent))
            shares = np.append(shares, [shares[-1]] * len(silent))
        cuts, end = [int(grid[0])], int(grid[-1])
        for time in sorted(ms for ms in ticks_ms if cuts[0] < ms < end):
            if end - time < _SHORTEST_MS <= time - cuts[-1]:
                moved[time] = end
            elif time - cuts[-1] < _SHORTEST_MS:
                moved[time] = cuts[-1]
            else:
                cuts.append(time)
        # Points on the line are added at ticks, where events are cut, and every 5 s in longer
        # gaps, the longest event.
        times_ms = {*grid.tolist(), *cuts}
        for time, after in pairwise(sorted(times_ms)):
            times_ms |= set(range(time, after, he_rules.MAX_DURATION_MS))
        all_ms = sorted(times_ms)
        all_levels = np.interp(all_ms, grid, levels).tolist()
        all_shares = np.rint(np.interp(all_ms, grid, shares)).astype(int).tolist()
        points = list(zip(all_ms, all_levels, all_shares, strict=True))
        events += _cut(points, [*cuts, end], falls_to_zero)
    for tick, time in zip(signal.transients, ticks_ms, strict=True):
        share = round(100 * float(frequencies.share(tick.frequency_hz)))
        events.append(HeEvent(moved.get(time, time), (), (round(100 * tick.amplitude), share)))
    # A tick ends where it starts, so at equal starts the tick precedes the envelope's event.
    return sorted(events, key=lambda each: (each.start_ms, each.end_ms))


def patterns_of(events: Sequence[HeEvent]) -> list[tuple[int, list[HeEvent]]]:
    """Group events into patterns of version 2: (absolute time in ms, at most 16 events) of each.

    A pattern ends where players accept the next pattern without delay, as late as possible. Without
    such an end among 16 events, the pattern ends before the tick with the smallest delay, and the
    next pattern begins later than its first event.
    """
    patterns: list[tuple[int, list[HeEvent]]] = []
    spacing = he_rules.PatternSpacing()
    first = 0
    while first < len(events):
        start = max(events[first].start_ms, spacing.earliest_ms)
        candidates = [
            event
            for event in events[first : first + he_rules.MAX_PATTERN_EVENTS]
            if event.start_ms - start <= he_rules.MAX_RELATIVE_MS
        ]
        times = [
            (max(e.start_ms - start, 0), None if e.transient else e.points[-1][0])
            for e in candidates
        ]
        delays = {}  # delay of the next pattern, ms, by the number of events in this pattern
        # Longest pattern first. Without a successor, or with one late enough, the pattern
        # is free to end.
        for count in range(len(candidates), 0, -1):
            following = events[first + count : first + count + 1]
            earliest = spacing.after(start, times[:count])
            if not following or following[0].start_ms >= earliest:
                delays[count] = 0
                break
            # Continuous events join without gaps: only a tick may be played late.
            if following[0].transient:
                delays[count] = earliest - following[0].start_ms
        count = min(delays, key=lambda number: delays[number], default=len(candidates))
        spacing.follow(start, times[:count])
        patterns.append((start, candidates[:count]))
        first += count
    return patterns


def _distinct_indices(knots: F64, levels: F64, shares: F64, is_level_key: Bool) -> list[int]:
    """Ascending indices of keyframes (times ``knots`` in s) without near-duplicates in a
    millisecond: ``shares`` (percent of the range) within 1, and levels (0..1) within 0.005 or one
    keyframe of the frequency alone, whose level lies on a line. The earlier of two near-duplicates
    remains, but ``is_level_key`` before others, and always the first and the last keyframe."""
    indices = [0]
    last = len(knots) - 1
    for k in range(1, last + 1):
        before = indices[-1]
        is_same_ms = round(1000.0 * knots[k]) == round(1000.0 * knots[before])
        if not is_same_ms or abs(shares[k] - shares[before]) > _SAME_SHARE:
            indices.append(k)
        elif is_level_key[k] and not is_level_key[before]:
            indices[-1] = k
        elif is_level_key[k] and abs(levels[k] - levels[before]) > _SAME_LEVEL:
            indices.append(k)
        elif k == last and len(indices) > 1:
            indices[-1] = k
    return indices if indices[-1] == last else [*indices, last]


_PointMs = tuple[int, float, int]  # ms, level 0..1, frequency 0..100


def _cut(points: list[_PointMs], cuts: list[int], falls_to_zero: bool) -> list[HeEvent]:
    """Cut points into events at the ascending times ``cuts``, ms, of begin, ticks and end, and at
    limits; successive events share a point. Limits: 16 points (14 with ``falls_to_zero``, which
    adds a silent point at both ends), and 3 ms to 5 s."""
    events = []
    most = he_rules.MAX_CURVE_POINTS - (2 if falls_to_zero else 0)
    first = 0
    while first < len(points) - 1:
        start, stop = points[first][0], first + 1
        # Extend the event up to the limits of points and duration, but not beyond a tick.
        while (
            stop + 1 < len(points)
            and stop + 1 - first < most
            and points[stop + 1][0] - start <= he_rules.MAX_DURATION_MS
            and cuts[bisect_left(cuts, points[stop][0])] > points[stop][0]
        ):
            stop += 1
        end = points[stop][0]
        # Neither this event nor the next one may be too short.
        if end < start + _SHORTEST_MS:
            end = start + he_rules.MAX_DURATION_MS
        rest = cuts[bisect_left(cuts, end)] - end
        if 0 < rest < _SHORTEST_MS:
            end += rest - _SHORTEST_MS
        stop = bisect_left(points, (end,), first)
        if points[stop][0] != end:
            points.insert(stop, _between(points[stop - 1], points[stop], end))
        part = [(time - start, level, share) for time, level, share in points[first : stop + 1]]
        if falls_to_zero:
            # Version 1: both ends are at level 0. A loud end is moved inwards by 1 ms, unless the
            # other side of a jump is there.
            (_, level, share), (length, last_level, last_share) = part[0], part[-1]
            inner = part[1:-1]
            if level > 0.0 and not (inner and inner[0][0] <= 1):
                inner = [(1, level, share), *inner]
            if last_level > 0.0 and not (inner and inner[-1][0] >= length - 1):
                inner.append((length - 1, last_level, last_share))
            part = [(0, 0.0, share), *inner, (length, 0.0, last_share)]
        events.append(HeEvent(start, tuple(_with_enough_points(part))))
        first = stop
    return events


def _with_enough_points(part: list[_PointMs]) -> list[_PointMs]:
    """Halve the longest interval by a point on the line, in whole ms, until there are four points;
    four or more points are returned unchanged. ``part`` lasts 3 ms or more."""
    while len(part) < he_rules.MIN_CURVE_POINTS:
        k = max(range(len(part) - 1), key=lambda k: part[k + 1][0] - part[k][0])
        middle = (part[k][0] + part[k + 1][0]) // 2
        part = [*part[: k + 1], _between(part[k], part[k + 1], middle), *part[k + 1 :]]
    return part


def _between(a: _PointMs, b: _PointMs, time: int) -> _PointMs:
    """Point of a time on the line from ``a`` to ``b``."""
    part = (time - a[0]) / (b[0] - a[0])
    return (time, a[1] + part * (b[1] - a[1]), round(a[2] + part * (b[2] - a[2])))


def event_entry(event: HeEvent, relative_ms: int) -> dict[str, Any]:
    """JSON entry of an event, at ``relative_ms`` from the start of its pattern. Curve levels are
    0..1 of intensity 100, rounded to 4 decimals."""
    if event.transient is not None:
        intensity, frequency = event.transient
        return {
            "Type": "transient",
            "RelativeTime": relative_ms,
            "Parameters": {"Intensity": intensity, "Frequency": frequency},
        }
    return {
        "Type": "continuous",
        "RelativeTime": relative_ms,
        "Duration": event.points[-1][0],
        "Parameters": {
            # Points of the curve multiply the intensity and add to the frequency: 100 and 0 leave
            # the points' values.
            "Intensity": 100,
            "Frequency": 0,
            "Curve": [
                {"Time": time, "Intensity": round(intensity, 4), "Frequency": frequency}
                for time, intensity, frequency in event.points
            ],
        },
    }
