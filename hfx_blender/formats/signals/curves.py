# SPDX-License-Identifier: GPL-3.0-or-later
"""Piecewise linear curves, and their reduction to the fewest keyframes within a tolerance."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64

_MARGIN: Final = 1e-6  # share of a tolerance reserved for rounding

_SILENT: Final = 0.01
"""Share of a tolerance within which a keyframe becomes 0, where silence must be exact."""

_SILENT_WALL: Final = 0.0025
"""Half width of the corridor at silent rows, a share of the tolerance.

A line through two silent rows is then within ``_SILENT`` one row later.
"""

_APART_S: Final = 1e-6
"""Duration of a step in a simplified curve, seconds, as curves there have one value per time."""

_Point = tuple[float, float]  # time, value
_Line = tuple[float, float, float]  # time, value there, slope


@dataclass(frozen=True, eq=False)
class Curve:
    """Keyframes joined by straight lines, constant before the first and after the last.

    Two keyframes at the same time are a step. Raises ValueError without keyframes, for infinite or
    NaN numbers, and for descending times.
    """

    times_s: F64  # (n,) ascending
    values: F64  # (n,)

    def __post_init__(self) -> None:
        if self.times_s.shape != self.values.shape or self.times_s.ndim != 1:
            raise ValueError(f"expected (n,) twice: {self.times_s.shape}, {self.values.shape}")
        if not len(self.times_s):
            raise ValueError("a curve has at least one keyframe")
        if not (np.isfinite(self.times_s).all() and np.isfinite(self.values).all()):
            raise ValueError("a curve's keyframes are finite numbers")
        if (np.diff(self.times_s) < 0.0).any():
            raise ValueError("the times of a curve ascend")

    def __len__(self) -> int:
        return len(self.times_s)

    def at(self, times_s: npt.ArrayLike) -> F64:
        """Values at times of any shape; at a step the right limit."""
        times = np.asarray(times_s, np.float64)
        # At a step np.interp returns either value: keyframe times are looked up instead.
        values = np.interp(times, self.times_s, self.values)
        last = np.searchsorted(self.times_s, times, side="right") - 1
        is_keyframe = (last >= 0) & (self.times_s[np.maximum(last, 0)] == times)
        return np.asarray(np.where(is_keyframe, self.values[last], values))

    def before(self, times_s: npt.ArrayLike) -> F64:
        """Values at times of any shape; at a step the left limit."""
        times = np.asarray(times_s, np.float64)
        values = np.interp(times, self.times_s, self.values)
        first = np.minimum(np.searchsorted(self.times_s, times, side="left"), len(self) - 1)
        return np.asarray(np.where(self.times_s[first] == times, self.values[first], values))

    @classmethod
    def of(cls, times_s: npt.ArrayLike, values: npt.ArrayLike) -> "Curve":
        """Create a curve from any sequences of numbers; ValueError as for the class."""
        return cls(np.asarray(times_s, np.float64), np.asarray(values, np.float64))


def simplified(
    curve: Curve,
    tolerance: float,
    *,
    lowest: float = -np.inf,
    highest: float = np.inf,
    keeps_silence: bool = False,
    is_free: npt.NDArray[np.bool_] | None = None,
) -> Curve:
    """Return the curve of the fewest keyframes within a tolerance.

    Keyframes may lie anywhere between the original ones in time and value; the count is minimal
    (Imai and Iri, "An optimal algorithm for approximating a piecewise linear function", 1986).
    Steps become ramps of 1 us.

    ``tolerance`` is the largest distance at any time, in the unit of the values; 0 only removes
    keyframes within constant stretches. ``lowest`` and ``highest`` are bounds of the result; the
    original must be within. ``keeps_silence`` keeps zeros of the original exactly 0. ``is_free``
    (n,): keyframes of the original with an arbitrary value (the frequency of silence).
    """
    times, values = curve.times_s, curve.values
    if len(times) > 1 and (np.diff(times) < _APART_S).any():
        # Move times later where needed to be 1 us apart; the first time of a step remains.
        steps = np.arange(len(times)) * _APART_S
        times = np.maximum.accumulate(times - steps) + steps
    if len(times) == 1:
        return Curve(times, values)
    if tolerance <= 0.0:
        # Keep keyframes that differ from a neighbour; first and last remain.
        stays = np.ones(len(times), np.bool_)
        stays[1:-1] = (values[1:-1] != values[:-2]) | (values[1:-1] != values[2:])
        return Curve(times[stays], values[stays])
    if (values == values[0]).all():
        return Curve(times[[0, -1]], values[[0, -1]])
    # The corridor is narrower than the tolerance by the later snapping to 0 and by rounding.
    silent = _SILENT * tolerance if keeps_silence else 0.0
    reach = tolerance * (1.0 - _MARGIN) - silent
    low, high = values - reach, values + reach
    if keeps_silence:
        is_silent = values == 0.0
        wall = _SILENT_WALL * tolerance
        low = np.where(is_silent, np.maximum(low, -wall), low)
        high = np.where(is_silent, np.minimum(high, wall), high)
    low, high = np.maximum(low, lowest), np.minimum(high, highest)
    # Rounding must not close the corridor: at least 2e-9 wide, of the middle if above 1.
    middle = (low + high) / 2.0
    half = np.maximum((high - low) / 2.0, 1e-9 * np.maximum(1.0, np.abs(middle)))
    low, high = middle - half, middle + half
    if is_free is not None:
        # A free row allows any value of the curve, so no line is bounded there.
        low = np.where(is_free, max(lowest, float(values.min())) - 1e-9, low)
        high = np.where(is_free, min(highest, float(values.max())) + 1e-9, high)
    times, values = _fewest_pieces(times, low, high)
    values = np.clip(values, lowest, highest)
    if keeps_silence:
        # Snapped to silence: the corridor was narrowed by this much above.
        values = np.where(np.abs(values) <= silent * (1.0 + _MARGIN), 0.0, values)
    return Curve(times, values)


def clipped(curve: Curve, lowest: float, highest: float) -> Curve:
    """Clip a curve to a range at every time, with keyframes at the crossings of the limits."""
    if curve.values.min() >= lowest and curve.values.max() <= highest:
        return curve
    crossed = with_crossings(with_crossings(curve, lowest), highest)
    return Curve(crossed.times_s, np.clip(crossed.values, lowest, highest))


def with_crossings(curve: Curve, level: float) -> Curve:
    """Insert keyframes of value ``level`` where a curve changes from above to below or back.
    Keyframes on the level are not repeated."""
    times, values = curve.times_s, curve.values - level
    signs = np.sign(values)
    passes = np.flatnonzero(signs[:-1] * signs[1:] < 0.0)
    share = values[passes] / (values[passes] - values[passes + 1])
    crossings = times[passes] + share * (times[passes + 1] - times[passes])
    return Curve(
        np.insert(times, passes + 1, crossings), np.insert(curve.values, passes + 1, level)
    )


def _fewest_pieces(times: F64, low: F64, high: F64) -> tuple[F64, F64]:
    """Keyframes of the continuous curve of fewest pieces between walls ``low`` and ``high``.

    The walls of the corridor are straight from row to row. Greedy: each piece is the line reaching
    furthest; the next piece crosses this line within a window, from the line's last contact with a
    wall to the exit from the corridor. The lines of the current piece are bounded by the steepest
    rising line (over a lower point, under a later upper point) and the steepest falling line.
    """
    # Rows within flat stretches of the corridor cannot bound any line.
    is_flat = np.zeros(len(times), np.bool_)
    is_flat[1:-1] = (
        (low[1:-1] == low[:-2])
        & (low[1:-1] == low[2:])
        & (high[1:-1] == high[:-2])
        & (high[1:-1] == high[2:])
    )
    rows = np.flatnonzero(~is_flat)
    t, lows, highs = times[rows].tolist(), low[rows].tolist(), high[rows].tolist()
    count = len(t)
    lines: list[_Line] = []
    windows: list[tuple[float, float]] = []  # time span for the turn into the next piece
    upper: list[_Point] = [(t[0], highs[0])]  # convex hull of the upper wall
    lower: list[_Point] = [(t[0], lows[0])]
    first_upper = first_lower = 0  # hull points before these can no longer be tangent points
    rising: _Line | None = None
    falling: _Line | None = None
    rising_end = falling_end = 0  # row after the line's last contact
    rising_touch = falling_touch = (0.0, 0.0)
    row = 1
    while row < count:
        x, top, bottom = t[row], highs[row], lows[row]
        is_blocked_above = falling is not None and top < _value(falling, x)
        is_blocked_below = rising is not None and bottom > _value(rising, x)
        # No line passes this row: close the piece with the extreme line on the blocked side. The
        # next piece starts in the window between that line's last contact and its exit; the hulls
        # are rebuilt from there.
        if is_blocked_above or is_blocked_below:
            if is_blocked_above and falling is not None:
                line, touch, after, wall_points = falling, falling_touch, falling_end, upper
                exit_point = _crossing(line, wall_points[-1], (x, top))
                lower, upper = [touch], [exit_point]
                for k in range(after, row):
                    _push(lower, (t[k], lows[k]), 0, 1.0)
                first_lower = first_upper = 0
                rising, falling = _through(touch, exit_point), None
                rising_touch, rising_end = exit_point, row
            elif rising is not None:
                line, touch, after, wall_points = rising, rising_touch, rising_end, lower
                exit_point = _crossing(line, wall_points[-1], (x, bottom))
                lower, upper = [exit_point], [touch]
                for k in range(after, row):
                    _push(upper, (t[k], highs[k]), 0, -1.0)
                first_lower = first_upper = 0
                falling, rising = _through(touch, exit_point), None
                falling_touch, falling_end = exit_point, row
            lines.append(line)
            windows.append((touch[0], exit_point[0]))
        # Tighten the extreme lines: the new row lowers the steepest rising line to the tangent of
        # the lower hull, and raises the steepest falling line to the tangent of the upper hull.
        # Both are computed from the lines before this row.
        new_rising, new_falling = rising, falling
        if rising is None or top < _value(rising, x):
            first_lower = _support(lower, first_lower, (x, top), 1.0)
            if lower[first_lower][0] < x:
                new_rising = _through(lower[first_lower], (x, top))
                rising_touch, rising_end = (x, top), row + 1
        if falling is None or bottom > _value(falling, x):
            first_upper = _support(upper, first_upper, (x, bottom), -1.0)
            if upper[first_upper][0] < x:
                new_falling = _through(upper[first_upper], (x, bottom))
                falling_touch, falling_end = (x, bottom), row + 1
        rising, falling = new_rising, new_falling
        _push(upper, (x, top), first_upper, -1.0)
        _push(lower, (x, bottom), first_lower, 1.0)
        row += 1
    # Any line between the extreme ones reaches the end; the mean has most room on both sides.
    # Without one of them the other counts, without both a horizontal line.
    if rising is None or falling is None:
        lines.append(rising or falling or (t[0], (lows[0] + highs[0]) / 2.0, 0.0))
    else:
        at, value, slope = rising
        lines.append((at, (value + _value(falling, at)) / 2.0, (slope + falling[2]) / 2.0))
    return _keyframes(lines, windows, t[0], t[-1])


def _value(line: _Line, x: float) -> float:
    """Value of a line (time, value, slope) at time ``x``."""
    return line[1] + (x - line[0]) * line[2]


def _through(a: _Point, b: _Point) -> _Line:
    """Line through two points, anchored at the later point b; horizontal for equal times."""
    return (b[0], b[1], (b[1] - a[1]) / (b[0] - a[0]) if b[0] > a[0] else 0.0)


def _crossing(line: _Line, a: _Point, b: _Point) -> _Point:
    """Crossing of a line and the wall of the tolerance corridor from point ``a`` to ``b``; its x is
    clamped to those of the points."""
    before, after = _value(line, a[0]) - a[1], _value(line, b[0]) - b[1]
    share = before / (before - after) if before != after else 1.0
    x = a[0] + (b[0] - a[0]) * min(max(share, 0.0), 1.0)
    return (x, _value(line, x))


def _push(hull: list[_Point], point: _Point, first: int, sign: float) -> None:
    """Append a point to a hull in place, popping points made redundant, but none up to ``first``.
    ``sign`` 1: concave hull of the lower wall, -1: convex hull of the upper wall."""
    x, y = point
    while len(hull) - first >= 2:
        (ax, ay), (bx, by) = hull[-2], hull[-1]
        if sign * ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) < 0.0:
            break
        hull.pop()
    hull.append(point)


def _support(hull: list[_Point], first: int, point: _Point, sign: float) -> int:
    """Index, from ``first`` on, of the hull's tangent point for a line to the later ``point``.
    ``sign`` as for :func:`_push`."""
    x, y = point
    while first + 1 < len(hull):
        (ax, ay), (bx, by) = hull[first], hull[first + 1]
        if bx >= x or sign * ((y - by) * (x - ax) - (y - ay) * (x - bx)) > 0.0:
            break
        first += 1
    return first


def _keyframes(
    lines: list[_Line], windows: list[tuple[float, float]], first: float, last: float
) -> tuple[F64, F64]:
    """Times and values of both ends and of the intersections of successive lines. Intersections are
    clamped to their windows, and at least 1 us apart from an earlier one."""
    times, values = [first], [_value(lines[0], first)]
    for k, (earliest, latest) in enumerate(windows):
        a, b = lines[k], lines[k + 1]
        turn = a[2] - b[2]
        # Parallel lines have no intersection: the turn is at the end of the window.
        x = b[0] + (b[1] - _value(a, b[0])) / turn if turn else latest
        x = min(max(x, earliest, times[-1]), latest)
        if x <= times[-1]:
            x = times[-1] + _APART_S
        times.append(x)
        values.append((_value(a, x) + _value(b, x)) / 2.0)
    times.append(max(last, times[-1] + _APART_S))
    values.append(_value(lines[-1], last))
    return np.array(times), np.array(values)
