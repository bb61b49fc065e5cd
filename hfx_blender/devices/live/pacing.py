# SPDX-License-Identifier: GPL-3.0-or-later
"""Between Blender's frames: strengths ramp, and no actuator is updated more often than it can."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from ...engine.rendering.device import DeviceConfig

F64 = npt.NDArray[np.float64]

LONGEST_RAMP_S: Final = 0.05
"""The most that ramping delays a value; frames that come faster than this delay it by less."""

FASTEST_S: Final = 0.005
SLOWEST_S: Final = 0.05
"""A device hears from us at least so often, so that its dead-man knows that we live."""


def tick_s(device: DeviceConfig) -> float:
    """How often a device is sent values: as its quickest actuator can take them."""
    fastest = min((a.type.update_interval_ms for a in device.actuators), default=20.0) / 1000.0
    return min(max(fastest, FASTEST_S), SLOWEST_S)


class Ramp:
    """Goes from one frame's values to the next while that one lasts.

    Only strengths ramp; a frequency between two frequencies would be one that nobody asked
    for. The time to the next frame is not known: it is taken to be that since the last one,
    at most :data:`LONGEST_RAMP_S`. A change is under way at the first tick after its frame and
    complete one frame later; that is the delay.

    Parameters
    ----------
    device : DeviceConfig
    tick : float
        Seconds between two calls of :meth:`at`.
    """

    def __init__(self, device: DeviceConfig, tick: float) -> None:
        controls = [c for actuator in device.actuators for c in actuator.type.controls]
        self._neutral = np.array([c.neutral for c in controls], np.float64)
        counts = [len(actuator.type.controls) for actuator in device.actuators]
        self._is_strength = np.zeros(len(controls), np.bool_)
        self._is_strength[np.cumsum([0, *counts[:-1]])] = True
        self._tick = tick
        self.reset()

    def reset(self) -> None:
        """Begin from silence."""
        self._from, self._to = self._neutral.copy(), self._neutral.copy()
        self._began_s, self._lasts_s = -np.inf, self._tick

    def aim(self, values: F64, now_s: float) -> None:
        """A new frame: go to its values (columns,) from where we are now.

        Any others than one for each column are not a frame: we go to silence at once.
        """
        if np.shape(values) != self._neutral.shape:
            self.reset()
            return
        here = self.at(now_s - self._tick)  # what was sent last
        self._from = np.where(np.isfinite(here), here, self._neutral)
        self._to = np.asarray(values, np.float64)
        since_s = now_s - self._began_s
        self._lasts_s = max(self._tick, since_s if since_s <= LONGEST_RAMP_S else self._tick)
        self._began_s = now_s

    def at(self, now_s: float) -> F64:
        """Values (columns,) to send now; what is not finite stays so, for the guard to see."""
        share = (now_s + self._tick - self._began_s) / self._lasts_s
        if not share < 1.0 - 1e-6:  # clocks round
            return self._to.copy()
        with np.errstate(invalid="ignore", over="ignore"):
            between = self._from + max(share, 0.0) * (self._to - self._from)
        return np.where(self._is_strength, between, self._to)


class Pace:
    """Lets each actuator change only as often as it can.

    In between it keeps its values, and then gets the strongest that was asked for meanwhile,
    as an export does; but silence passes at once.
    """

    def __init__(self, device: DeviceConfig, tick: float) -> None:
        controls = [c for actuator in device.actuators for c in actuator.type.controls]
        self._neutral = np.array([c.neutral for c in controls], np.float64)
        self._slow: list[tuple[slice, float]] = []  # columns, interval
        first = 0
        for actuator in device.actuators:
            stop = first + len(actuator.type.controls)
            interval_s = actuator.type.update_interval_ms / 1000.0
            if interval_s > 1.01 * tick:
                self._slow.append((slice(first, stop), interval_s))
            first = stop
        self.reset()

    def reset(self) -> None:
        self._given = self._neutral.copy()
        self._strongest = self._neutral.copy()
        self._next_s = [-np.inf] * len(self._slow)

    def paced(self, wanted: F64, now_s: float) -> F64:
        """What of the wanted values (columns,) may be sent now."""
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
