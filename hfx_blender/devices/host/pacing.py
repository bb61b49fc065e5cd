# SPDX-License-Identifier: GPL-3.0-or-later
"""Pacing between Blender's frames: strengths ramp, and no actuator is updated more often than it
can.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device import DeviceConfig

LONGEST_RAMP_S: Final = 0.05
"""Longest delay by ramping, seconds; frames that come faster are delayed by less."""

_ROUNDING: Final = 0.05
"""Tolerance of times as a share of a tick: clocks and sleeps are not exact."""

FASTEST_S: Final = 0.005
SLOWEST_S: Final = 0.05
"""Longest interval between values, seconds, so that a device's dead-man switch knows
that we live."""


def tick_s(device: DeviceConfig) -> float:
    """Interval of a device's values, seconds, by its quickest actuator."""
    fastest = min((a.type.update_interval_ms for a in device.actuators), default=20.0) / 1000.0
    return min(max(fastest, FASTEST_S), SLOWEST_S)


class Ramp:
    """Ramp from one frame's values to the next over a frame's duration.

    Only strengths ramp; a frequency between two frequencies would be one that nobody asked
    for. Silence is not ramped to: it is there at once. The time to the next frame is not known:
    it is taken to be that since the last one, at most :data:`LONGEST_RAMP_S`. A change is under
    way with the first values that are sent after its frame and complete with the last before
    the next frame; that is the delay. An actuator that takes values only once a frame, or less
    often, is given the frame's at once: there is no ramp and no delay.

    Parameters
    ----------
    tick : float
        Seconds between two calls of :meth:`at`.
    """

    def __init__(self, device: DeviceConfig, tick: float) -> None:
        self._neutral = device.neutral
        counts = [len(actuator.type.controls) for actuator in device.actuators]
        self._is_strength = np.zeros(len(self._neutral), np.bool_)
        self._is_strength[device.strength_columns] = True
        intervals_s = [max(a.type.update_interval_ms / 1000.0, tick) for a in device.actuators]
        self._intervals_s = np.repeat(np.array(intervals_s, np.float64), counts)
        self._tick = tick
        self.reset()

    def reset(self) -> None:
        """Begin from silence."""
        self._from, self._to = self._neutral.copy(), self._neutral.copy()
        self._here = self._neutral.copy()  # last values
        self._began_s, self._lasts_s = -np.inf, self._tick
        self.share = 1.0  # share of the ramp to the newest frame, at the last values

    def aim(self, values: F64, now_s: float) -> None:
        """Start the ramp to a new frame's values (columns,), from the present ones.

        Raises
        ------
        ValueError
            They are not one for each column.
        """
        if np.shape(values) != self._neutral.shape:
            shape, count = np.shape(values), len(self._neutral)
            raise ValueError(f"values of shape {shape}; it takes {count}")
        # What was gone to already is there by now: else a frame that repeats itself, a little
        # before its ramp is complete, would never be reached.
        here = np.where(self._to == values, values, self._here)
        self._from = np.where(np.isfinite(here), here, self._neutral)
        self._to = np.asarray(values, np.float64)
        since_s = now_s - self._began_s
        self._lasts_s = since_s if self._tick <= since_s <= LONGEST_RAMP_S else self._tick
        self._began_s, self.share = now_s, 0.0

    def complete(self) -> None:
        """Be at the newest frame with the next values: the frame after it has come early."""
        self._lasts_s = self._tick

    def at(self, now_s: float) -> F64:
        """Values (columns,) to send now; what is not finite stays so, for the guard to see."""
        since_s = now_s - self._began_s
        self.share = float(self._share(since_s, np.array(self._tick)))
        if self.share >= 1.0:
            self._here = self._to.copy()
        else:
            shares = self._share(since_s, self._intervals_s)
            with np.errstate(invalid="ignore", over="ignore"):
                between = self._from + shares * (self._to - self._from)
            is_going = self._is_strength & (self._to != self._neutral) & (shares < 1.0)
            self._here = np.where(is_going, between, self._to)
        return self._here.copy()

    def _share(self, since_s: float, intervals_s: F64) -> F64:
        """Share of the way to the newest frame, with values taken this often."""
        steps = np.maximum(np.floor(self._lasts_s / intervals_s + _ROUNDING), 1.0)
        step = np.floor(since_s / intervals_s + _ROUNDING) + 1.0
        return np.asarray(np.minimum(step / steps, 1.0))

    def next_s(self, due_s: float, now_s: float) -> float:
        """Time of the next send: one that is due shortly before a frame waits for the frame.

        It would keep the frame waiting, as the device takes values only so often.
        """
        expected_s = self._began_s + self._lasts_s
        is_next = due_s < expected_s < due_s + self._tick and self._lasts_s > self._tick
        is_in_its_way = is_next and self.share >= 1.0
        if is_in_its_way and expected_s > now_s:
            return expected_s + 0.5 * self._tick  # if it does not come
        return due_s

    @property
    def is_going(self) -> bool:
        """Test for a frame since the start from silence."""
        return bool(np.isfinite(self._began_s))


class Pace:
    """Limits each actuator to its own update rate.

    In between it keeps its values, and then gets the strongest that was asked for meanwhile,
    as an export does; but silence passes at once.
    """

    def __init__(self, device: DeviceConfig, tick: float) -> None:
        self._neutral = device.neutral
        self._slow: list[tuple[slice, float]] = []  # columns, interval
        for actuator, part in zip(device.actuators, device.actuator_columns, strict=True):
            interval_s = actuator.type.update_interval_ms / 1000.0
            if interval_s > 1.01 * tick:
                self._slow.append((part, interval_s))
        self.reset()

    def reset(self) -> None:
        self._given = self._neutral.copy()
        self._strongest = self._neutral.copy()
        self._next_s = [-np.inf] * len(self._slow)

    def paced(self, wanted: F64, now_s: float) -> F64:
        """Wanted values (columns,) as far as they may be sent now."""
        given = np.array(wanted, np.float64)
        for k, (columns, interval_s) in enumerate(self._slow):
            first = columns.start
            silent = self._neutral[first]
            if given[first] == silent:
                self._strongest[columns] = self._neutral[columns]
            elif now_s >= self._next_s[k]:
                strongest = self._strongest[columns]
                if abs(strongest[0] - silent) > abs(given[first] - silent):
                    given[columns] = strongest
                self._next_s[k] = now_s + interval_s
                self._strongest[columns] = self._neutral[columns]
            else:
                if not abs(given[first] - silent) <= abs(self._strongest[first] - silent):
                    self._strongest[columns] = given[columns]
                given[columns] = self._given[columns]
        self._given = given.copy()
        return given
