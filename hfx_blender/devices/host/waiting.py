# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that wait until their device is held back for long enough, and can take them."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device import DeviceConfig

MAX_OFFSET_S: Final = 1.0

LEAST_APART_S: Final = 0.001
"""Frames that come closer are one, so that those that wait for an offset have a bound."""

_LONGEST_TICK_S: Final = 0.05 / 3.0
"""A device that takes values less often is silent at once: it may not be so 50 ms later, after it
has completed a ramp and has played what came before."""


class Waiting:
    """A device's frames that are not played yet.

    What comes faster than the device takes it is played all the same: of frames that are due
    together each actuator gets the strongest, for one of the device's updates, and then the
    newest.

    Parameters
    ----------
    tick : float
        Seconds between two updates of the device.
    keep_s : float
        What is older than its offset by more than this is not played any more.
    """

    def __init__(self, device: DeviceConfig, tick: float, keep_s: float) -> None:
        counts = [len(actuator.type.controls) for actuator in device.actuators]
        self._silent = np.array([a.type.strength.neutral for a in device.actuators], np.float64)
        self._firsts = device.strength_columns
        self._columns = np.repeat(np.arange(len(counts)), counts)  # their actuators
        self._holds_silence_back = tick <= _LONGEST_TICK_S
        self._oldest_s = MAX_OFFSET_S + keep_s
        self._frames: deque[tuple[float, F64]] = deque()  # when they came, values

    def __len__(self) -> int:
        return len(self._frames)

    def clear(self) -> None:
        """Drop all waiting values."""
        self._frames.clear()

    def add(self, values: F64, now_s: float) -> None:
        """A frame that came now."""
        if self._frames and now_s - self._frames[-1][0] < LEAST_APART_S:
            now_s = self._frames.pop()[0]
        self._frames.append((now_s, values))
        while self._frames[0][0] < now_s - self._oldest_s:
            self._frames.popleft()  # nobody took it

    def due_s(self, offset_s: float) -> float:
        """Time at which the first of them is to be played; infinite without any."""
        return self._frames[0][0] + offset_s if self._frames else math.inf

    def taken(self, now_s: float, offset_s: float) -> F64 | None:
        """Take the newest of the values that are due; None without any."""
        due: list[tuple[float, F64]] = []
        while self._frames and self.due_s(offset_s) <= now_s:
            due.append(self._frames.popleft())
        if not due:
            return None
        newest = due[-1][1]
        if any(len(values) != len(self._columns) for _, values in due):
            return newest  # tones: of them only the newest
        strongest = self._strongest([values for _, values in due])
        if not np.array_equal(strongest, newest, equal_nan=True):
            self._frames.appendleft(due[-1])
        return strongest

    def _strongest(self, frames: list[F64]) -> F64:
        newest = frames[-1]
        ways = np.array([np.abs(values[self._firsts] - self._silent) for values in frames])
        # Not a number is for the guard to see; of equal ones the newest.
        ways = np.where(np.isfinite(ways), ways, np.inf)
        chosen = len(frames) - 1 - np.argmax(ways[::-1], axis=0)
        if not self._holds_silence_back:
            chosen = np.where(ways[-1] == 0.0, len(frames) - 1, chosen)
        return np.array(frames)[chosen[self._columns], np.arange(len(newest))]
