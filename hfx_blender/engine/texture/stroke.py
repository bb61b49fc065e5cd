# SPDX-License-Identifier: GPL-3.0-or-later
"""Strokes of a finger on a surface, at uneven times as from a touch screen."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64

# Speeds of the textile study (textiles on the phone, section 5)
SLOW_M_S: Final = 0.02
FAST_M_S: Final = 0.1


@dataclass(frozen=True, eq=False)
class Stroke:
    """Positions of a finger, joined by straight lines (equation 5 of the textile paper).

    ``times_s`` (N,) ascend, at least two; ``points_m`` (N, 2) are surface coordinates. Raises
    InputError for fewer than two positions, times that do not ascend, or values that are not
    finite.
    """

    times_s: F64
    points_m: F64

    def __post_init__(self) -> None:
        times = np.asarray(self.times_s, np.float64)
        points = np.asarray(self.points_m, np.float64)
        if times.ndim != 1 or points.shape != (len(times), 2):
            raise InputError(
                f"Stroke: expected N times and (N, 2) positions, got {times.shape} and "
                f"{points.shape}."
            )
        if len(times) < 2:
            raise InputError(f"Stroke: {len(times)} position; a stroke needs two.")
        if not (np.isfinite(times).all() and np.isfinite(points).all()):
            raise InputError("Stroke: a time or a position is not a finite number.")
        if not (np.diff(times) > 0.0).all():
            late = int(np.flatnonzero(np.diff(times) <= 0.0)[0]) + 1
            raise InputError(
                f"Stroke: time {late} ({times[late]:g} s) is not after the one before."
            )
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "points_m", points)

    @property
    def duration_s(self) -> float:
        """Time from first to last position, seconds."""
        return float(self.times_s[-1] - self.times_s[0])

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())

    @property
    def speeds_m_s(self) -> F64:
        """Speeds between successive positions, (N - 1,), m/s."""
        steps = np.linalg.norm(np.diff(self.points_m, axis=0), axis=1)
        return np.asarray(steps / np.diff(self.times_s))

    def texels_per_s(self, texel_m: tuple[float, float]) -> F64:
        """Texels per second between successive positions, (N - 1,), along the faster axis."""
        steps = np.abs(np.diff(self.points_m, axis=0)) / np.asarray(texel_m)
        return np.asarray(steps.max(axis=1) / np.diff(self.times_s))

    def at(self, times_s: F64) -> F64:
        """Surface positions (..., 2), m, at any times; constant before and after the stroke."""
        times = np.asarray(times_s, np.float64)
        parts = [np.interp(times, self.times_s, self.points_m[:, k]) for k in (0, 1)]
        return np.stack(parts, axis=-1)

    def speed_at(self, times_s: F64) -> F64:
        """Speeds at any times, m/s; 0 outside the stroke."""
        times = np.asarray(times_s, np.float64)
        # Segment of each time; the last position belongs to the last segment.
        which = np.searchsorted(self.times_s, times, "right") - 1
        inside = (which >= 0) & (times <= self.times_s[-1])
        return np.where(inside, self.speeds_m_s[np.clip(which, 0, len(self.times_s) - 2)], 0.0)

    def resampled(self, rate_hz: float) -> "Stroke":
        """Stroke sampled at a rate from its start on, as by a touch screen, with its last position.
        Raises InputError for a rate that is not positive."""
        if not (np.isfinite(rate_hz) and rate_hz > 0.0):
            raise InputError(f"Stroke: a rate of {rate_hz:g} Hz; expected more than 0.")
        count = int(np.floor(self.duration_s * rate_hz * (1.0 + 1e-12)))
        times = self.times_s[0] + np.arange(count + 1) / rate_hz
        # Unless the last position falls on a multiple of the period.
        if self.times_s[-1] - times[-1] > 1e-9 * max(self.duration_s, 1.0):
            times = np.append(times, self.times_s[-1])
        return Stroke(times, self.at(times))


def line(
    start_m: tuple[float, float],
    direction_rad: float,
    length_m: float,
    speed_m_s: float,
    rate_hz: float = 120.0,
) -> Stroke:
    """Straight stroke at constant speed from time 0, sampled at ``rate_hz``. Raises InputError for
    a length, speed or rate not above zero."""
    way = length_m * np.array([np.cos(direction_rad), np.sin(direction_rad)])
    return along(np.array([start_m, np.asarray(start_m) + way]), speed_m_s, rate_hz)


def along(path_m: F64, speed_m_s: float, rate_hz: float = 120.0) -> Stroke:
    """Stroke along a path (N, 2) at constant speed from time 0, sampled at a pointer's rate.
    Successive equal positions count once; the last position is included. Raises InputError for a
    path without length, or a speed or rate not above zero."""
    path = np.asarray(path_m, np.float64)
    if path.ndim != 2 or path.shape[1:] != (2,) or len(path) < 2 or not np.isfinite(path).all():
        raise InputError(f"Path: expected two or more positions (N, 2), got {path.shape}.")
    if not (np.isfinite(speed_m_s) and speed_m_s > 0.0):
        raise InputError(f"Path: a speed of {1e3 * speed_m_s:g} mm/s; expected more than 0.")
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    if steps.sum() <= 0.0:
        raise InputError("Path: all of its positions are the same; expected a way to go.")
    # Equal positions would have equal times, which a stroke refuses.
    keep = np.concatenate([[True], steps > 0.0])
    times = np.concatenate([[0.0], np.cumsum(steps[steps > 0.0])]) / speed_m_s
    return Stroke(times, path[keep]).resampled(rate_hz)
