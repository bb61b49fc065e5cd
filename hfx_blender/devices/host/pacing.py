# SPDX-License-Identifier: GPL-3.0-or-later
"""Pacing of a device's values: delay of frames, ramps between frames, update rates."""

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

# Longest update interval of a device that may play a strong frame before silence, seconds. The
# end of the ramp, the strong frame and silence take three updates, which may take 50 ms at most.
_LONGEST_TICK_S: Final = 0.05 / 3.0

LONGEST_RAMP_S: Final = 0.05
"""Longest duration of a ramp, and so its longest delay, seconds."""

# Tolerance of times, as a share of an interval: clocks and sleeps are not exact.
_ROUNDING: Final = 0.05


def tick_s(device: DeviceConfig) -> float:
    """Interval between two values of a device, of the fastest actuator, 0.005 to 0.05 seconds."""
    fastest = min((a.type.update_interval_ms for a in device.actuators), default=20.0) / 1000.0
    # Values come at least every 50 ms, so that a device's dead-man switch does not stop the device.
    return min(max(fastest, 0.005), 0.05)


class DelayQueue:
    """Queue of a device's frames before its offset has passed and its next update is due.

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
        younger than 1 ms; drop frames older than the largest offset and ``keep_s``."""
        if self._frames and now_s - self._frames[-1][0] < LEAST_APART_S:
            # Replace the last frame, but keep its time, so that frames in quick succession become
            # due.
            now_s = self._frames.pop()[0]
        self._frames.append((now_s, values))
        while self._frames[0][0] < now_s - self._oldest_s:
            self._frames.popleft()

    def due_s(self, offset_s: float) -> float:
        """Time at which the oldest frame is to be played, its arrival plus ``offset_s``; inf for an
        empty queue."""
        return self._frames[0][0] + offset_s if self._frames else math.inf

    def taken(self, now_s: float, offset_s: float) -> F64 | None:
        """Remove all frames that arrived by ``now_s - offset_s``; return (columns,), for each
        actuator its values of the largest distance from silence, of equal distances the newest,
        None without a due frame. Devices with updates slower than 16.7 ms take silence of the
        newest frame.
        The newest due frame stays in the queue, unless it equals the result. Frames with tones, of
        other lengths, return the newest alone.
        """
        due: list[tuple[float, F64]] = []
        while self._frames and self.due_s(offset_s) <= now_s:
            due.append(self._frames.popleft())
        if not due:
            return None
        frames = [values for _, values in due]
        newest = frames[-1]
        if any(len(values) != len(self._columns) for values in frames):
            return newest  # frames with tones differ in length: only the newest is played
        strengths = np.array([np.abs(values[self._firsts] - self._silent) for values in frames])
        # NaN counts as strongest and reaches the guard. Of equal strengths the newest counts:
        # argmax returns the first, so the order is reversed.
        strengths = np.where(np.isfinite(strengths), strengths, np.inf)
        chosen = len(frames) - 1 - np.argmax(strengths[::-1], axis=0)
        if not self._holds_silence_back:
            chosen = np.where(strengths[-1] == 0.0, len(frames) - 1, chosen)
        # All columns of an actuator come from one frame: a frequency belongs to its strength.
        strongest = np.array(frames)[chosen[self._columns], np.arange(len(newest))]
        if not np.array_equal(strongest, newest, equal_nan=True):
            # The strongest values are played first, the newest frame with the next update.
            self._frames.appendleft(due[-1])
        return strongest


class Ramp:
    """Linear ramp between the values of successive frames, over the duration of a frame.

    Strengths ramp; frequencies and changes to silence jump. The duration is the time between the
    last two frames, as the time of the next frame is unknown; a tick for times
    below a tick or above :data:`LONGEST_RAMP_S`. The first values after a frame are
    the first step of the ramp, and the last values before the next frame reach the target. An
    actuator with a single update in a frame jumps to the target, without delay.

    ``tick``: seconds between two calls of :meth:`at`. The attribute ``share`` is the share of the
    ramp at the last values, 0..1.
    """

    def __init__(self, device: DeviceConfig, tick: float) -> None:
        self._neutral = device.neutral
        counts = [len(actuator.type.controls) for actuator in device.actuators]
        self._is_strength = np.zeros(len(self._neutral), np.bool_)
        self._is_strength[device.strength_columns] = True
        # A type may be faster than the device is served, which is once a tick.
        intervals_s = [max(a.type.update_interval_ms / 1000.0, tick) for a in device.actuators]
        self._intervals_s = np.repeat(np.array(intervals_s, np.float64), counts)
        self._tick = tick
        self.reset()

    def reset(self) -> None:
        """Set start, target and last values to neutral, without a frame; the share is 1."""
        self._from, self._to = self._neutral.copy(), self._neutral.copy()
        self._here = self._neutral.copy()  # last values
        self._began_s, self._lasts_s = -np.inf, self._tick
        self.share = 1.0

    def aim(self, values: F64, now_s: float) -> None:
        """Start the ramp from the last values to a new frame's values (columns,).

        Columns with an unchanged target start there, non-finite last values at neutral. NaN as a
        target is kept for the guard.

        Raises ValueError: the shape is not (columns,).
        """
        if np.shape(values) != self._neutral.shape:
            shape, count = np.shape(values), len(self._neutral)
            raise ValueError(f"values of shape {shape}; it takes {count}")
        # A column whose target stays equal counts as arrived. Otherwise equal frames
        # shortly before the end of a ramp would restart the ramp each time, without an end.
        here = np.where(self._to == values, values, self._here)
        self._from = np.where(np.isfinite(here), here, self._neutral)
        self._to = np.asarray(values, np.float64)
        since_s = now_s - self._began_s
        self._lasts_s = since_s if self._tick <= since_s <= LONGEST_RAMP_S else self._tick
        self._began_s, self.share = now_s, 0.0

    def complete(self) -> None:
        """Shorten the ramp: the next values reach the target."""
        self._lasts_s = self._tick

    def at(self, now_s: float) -> F64:
        """Values (columns,) to send at ``now_s``; non-finite targets stay, for the guard."""
        since_s = now_s - self._began_s
        # The share of the fastest actuator: at 1 all actuators have arrived.
        self.share = float(self._share(since_s, np.array(self._tick)))
        if self.share >= 1.0:
            self._here = self._to.copy()
        else:
            # Each actuator has steps of its own update interval; frequencies and silence jump.
            shares = self._share(since_s, self._intervals_s)
            with np.errstate(invalid="ignore", over="ignore"):
                between = self._from + shares * (self._to - self._from)
            is_going = self._is_strength & (self._to != self._neutral) & (shares < 1.0)
            self._here = np.where(is_going, between, self._to)
        return self._here.copy()

    def _share(self, since_s: float, intervals_s: F64) -> F64:
        """Share of the ramp ``since_s`` after its start, (0, 1], for each of ``intervals_s``,
        seconds. The ramp has a whole number of equal steps, at least 1; the step that starts now
        counts as done."""
        steps = np.maximum(np.floor(self._lasts_s / intervals_s + _ROUNDING), 1.0)
        step = np.floor(since_s / intervals_s + _ROUNDING) + 1.0
        return np.asarray(np.minimum(step / steps, 1.0))

    def next_s(self, due_s: float, now_s: float) -> float:
        """Time of the next send: ``due_s``, or half a tick after a frame expected within a tick.

        A repetition shortly before a frame would delay the frame, as the device takes new values
        only once a tick. Only complete ramps are postponed.
        """
        expected_s = self._began_s + self._lasts_s
        is_next = due_s < expected_s < due_s + self._tick and self._lasts_s > self._tick
        is_in_its_way = is_next and self.share >= 1.0
        if is_in_its_way and expected_s > now_s:
            return expected_s + 0.5 * self._tick  # in case that the frame does not come
        return due_s

    @property
    def is_going(self) -> bool:
        """Test that a frame has come since :meth:`reset`."""
        return bool(np.isfinite(self._began_s))


class Pace:
    """Limit of each actuator's update rate.

    Between two updates the values of an actuator stay. An update sends the strongest values since
    the last update, as an export does. Silence passes at once.
    """

    def __init__(self, device: DeviceConfig, tick: float) -> None:
        self._neutral = device.neutral
        self._slow: list[tuple[slice, float]] = []  # columns, interval
        for actuator, part in zip(device.actuators, device.actuator_columns, strict=True):
            interval_s = actuator.type.update_interval_ms / 1000.0
            # Actuators as fast as the device take each value; 1 % covers rounding.
            if interval_s > 1.01 * tick:
                self._slow.append((part, interval_s))
        self.reset()

    def reset(self) -> None:
        """Start from silence; the next update of each actuator is due at once."""
        self._given = self._neutral.copy()
        self._strongest = self._neutral.copy()
        self._next_s = [-np.inf] * len(self._slow)

    def paced(self, wanted: F64, now_s: float) -> F64:
        """Values (columns,) to send at ``now_s`` for the values ``wanted``: unchanged for actuators
        as fast as ``tick`` or silent, else the strongest since the last update, or the last values
        if no update is due."""
        given = np.array(wanted, np.float64)
        for k, (columns, interval_s) in enumerate(self._slow):
            first = columns.start
            silent = self._neutral[first]
            # Silence passes at once, without waiting for an update.
            if given[first] == silent:
                self._strongest[columns] = self._neutral[columns]
            # An update is due: the strongest values since the last update.
            elif now_s >= self._next_s[k]:
                strongest = self._strongest[columns]
                if abs(strongest[0] - silent) > abs(given[first] - silent):
                    given[columns] = strongest
                self._next_s[k] = now_s + interval_s
                self._strongest[columns] = self._neutral[columns]
            else:
                # "not <=" instead of ">", so that NaN counts as strongest and reaches the guard.
                if not abs(given[first] - silent) <= abs(self._strongest[first] - silent):
                    self._strongest[columns] = given[columns]
                given[columns] = self._given[columns]
        self._given = given.copy()
        return given
