# SPDX-License-Identifier: GPL-3.0-or-later
"""Queue of a device's frames before its offset has passed and its next update is due."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig

MAX_OFFSET_S: Final = 1.0
"""Largest delay of a device's values, seconds."""

LEAST_APART_S: Final = 0.001
"""Shortest time between two frames, seconds; a closer frame replaces the one before. So the length
of the queue has a bound."""

_LONGEST_TICK_S: Final = 0.05 / 3.0
"""Longest update interval of a device that may play a strong frame before silence, seconds. The
end of the ramp, the strong frame and silence take three updates, which may take 50 ms at most."""


class DelayQueue:
    """Queue of a device's frames that have not been played.

    No peak is lost where frames come faster than the device is updated: of all due frames
    each actuator plays the strongest value for an update, and then the newest value.

    ``tick``: seconds between two updates of the device.
    ``keep_s``: frames older than the offset by more than this time, seconds, are dropped.
    """

    def __init__(self, device: DeviceConfig, tick: float, keep_s: float) -> None:
        counts = [len(actuator.type.controls) for actuator in device.actuators]
        self._silent = np.array([a.type.strength.neutral for a in device.actuators], np.float64)
        self._firsts = device.strength_columns
        self._columns = np.repeat(np.arange(len(counts)), counts)  # actuator of each column
        self._holds_silence_back = tick <= _LONGEST_TICK_S
        self._oldest_s = MAX_OFFSET_S + keep_s
        self._frames: deque[tuple[float, F64]] = deque()  # time of arrival, values

    def __len__(self) -> int:
        return len(self._frames)

    def clear(self) -> None:
        """Drop all frames."""
        self._frames.clear()

    def add(self, values: F64, now_s: float) -> None:
        """Append ``values`` (columns,) that arrived at ``now_s``, or replace the last frame if
        younger than 1 ms; drop frames older than the largest offset and ``keep_s``.
        """
        if self._frames and now_s - self._frames[-1][0] < LEAST_APART_S:
            # Replace the last frame, but keep its time, so that frames in quick succession become
            # due.
            now_s = self._frames.pop()[0]
        self._frames.append((now_s, values))
        while self._frames[0][0] < now_s - self._oldest_s:
            self._frames.popleft()

    def due_s(self, offset_s: float) -> float:
        """Time at which the oldest frame is to be played; inf for an empty queue."""
        return self._frames[0][0] + offset_s if self._frames else math.inf

    def taken(self, now_s: float, offset_s: float) -> F64 | None:
        """Remove all frames that arrived by ``now_s - offset_s``; return (columns,), for each
        actuator its values of the largest distance from silence, None without a due frame.
        The newest due frame stays in the queue, unless it equals the result. Frames with tones, of
        other lengths, return the newest alone.
        """
        due: list[tuple[float, F64]] = []
        while self._frames and self.due_s(offset_s) <= now_s:
            due.append(self._frames.popleft())
        if not due:
            return None
        newest = due[-1][1]
        if any(len(values) != len(self._columns) for _, values in due):
            return newest  # frames with tones differ in length: only the newest is played
        strongest = self._strongest([values for _, values in due])
        if not np.array_equal(strongest, newest, equal_nan=True):
            # The strongest values are played first, the newest frame with the next update.
            self._frames.appendleft(due[-1])
        return strongest

    def _strongest(self, frames: list[F64]) -> F64:
        """Values (columns,): each actuator's columns are of the frame with the largest distance
        from silence, the newest of equals, a non-finite strength first. Devices with long updates
        take silence of the newest frame.
        """
        newest = frames[-1]
        strengths = np.array([np.abs(values[self._firsts] - self._silent) for values in frames])
        # NaN counts as strongest and reaches the guard. Of equal strengths the newest counts.
        strengths = np.where(np.isfinite(strengths), strengths, np.inf)
        chosen = len(frames) - 1 - np.argmax(strengths[::-1], axis=0)
        if not self._holds_silence_back:
            chosen = np.where(strengths[-1] == 0.0, len(frames) - 1, chosen)
        return np.array(frames)[chosen[self._columns], np.arange(len(newest))]
