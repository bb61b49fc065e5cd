# SPDX-License-Identifier: GPL-3.0-or-later
"""Bursts of moving sensations, for the illusions of movement on the skin.

A moving place is taken at regular onsets only, and played there for a fixed duration: after Israr
and Poupyrev, CHI 2011 (Tactile Brush), and Geldard and Sherrick, Science 1972 (saltation).
"""

from typing import Final

import numpy as np

from ...arrays import F64
from ..device_config import Scheme

_EARLY_S: Final = 1e-6  # tolerance of onsets, s: sample times are rounded


def brush_interval_ms(duration_ms: float) -> float:
    """Onset asynchrony of continuous motion for vibrations of a duration, both ms. Israr and
    Poupyrev, "Tactile Brush", CHI 2011: 0.32 times the duration, plus 47.3 ms."""
    return 0.32 * duration_ms + 47.3


def rhythm_s(scheme: Scheme) -> tuple[float, float] | None:
    """Interval of onsets and duration of a burst, s; None for a scheme without bursts."""
    if scheme.name == "brush":
        return brush_interval_ms(scheme.duration_ms) / 1e3, scheme.duration_ms / 1e3
    if scheme.name == "saltation":
        return scheme.interval_ms / 1e3, scheme.tap_ms / 1e3
    return None


class Bursts:
    """Bursts of one effect at A actuators; onsets are whole intervals from time 0."""

    def __init__(self, interval_s: float, duration_s: float) -> None:
        self._interval_s, self._duration_s = interval_s, duration_s
        self._last_s = np.nan
        self._bursts: dict[int, tuple[float, F64]] = {}  # onset and gains (A,), by interval

    def gains(self, times_s: F64, gains: F64) -> F64:
        """Gains (n, A) with bursts, of present gains (n, A) at ascending times (n,), s.

        Calls continue each other. The first sample of an interval starts a burst with its gains;
        the strongest of overlapping bursts counts. A repeated time, as of a paused scene, starts
        its burst anew. Bursts of later times, before a jump back, are discarded.
        """
        if not len(times_s):
            return gains
        numbers = np.floor((times_s + _EARLY_S) / self._interval_s).astype(np.int64)
        if times_s[0] == self._last_s:
            self._bursts.pop(int(numbers[0]), None)
        self._last_s = times_s[-1]
        first_s = float(times_s[0])
        # A finished burst remains until its interval ends, which would start it again.
        memory_s = max(self._duration_s, self._interval_s)
        self._bursts = {
            number: burst
            for number, burst in self._bursts.items()
            if first_s - memory_s < burst[0] <= first_s
        }
        for row in np.unique(numbers, return_index=True)[1]:
            self._bursts.setdefault(int(numbers[row]), (float(times_s[row]), gains[row].copy()))
        played = np.zeros_like(gains)
        for onset_s, own in self._bursts.values():
            start, stop = np.searchsorted(times_s, [onset_s, onset_s + self._duration_s - _EARLY_S])
            # A burst shorter than the distance of samples takes one sample.
            rows = slice(start, max(stop, start + (times_s[0] <= onset_s)))
            np.maximum(played[rows], own, out=played[rows])
        return played
