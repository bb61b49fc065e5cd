# SPDX-License-Identifier: GPL-3.0-or-later
"""The guard: what any value must pass before it is made into bytes.

Order: a real number, finite (else the actuator is silent), range, slew (rises only), time on.
Whatever a script or an engine asks for, nothing else reaches an actuator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...engine.rendering.device import DeviceConfig
from ...engine.rendering.limits import limited

F64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class _Part:
    """One actuator's columns; the first is its strength."""

    columns: slice
    slew_per_s: float
    maximum_on_s: float
    rest_s: float


class Guard:
    """Limits of one device in time; it keeps what each actuator was given last.

    Parameters
    ----------
    device : DeviceConfig
    """

    def __init__(self, device: DeviceConfig) -> None:
        controls = [c for actuator in device.actuators for c in actuator.type.controls]
        self.neutral: F64 = np.array([c.neutral for c in controls], np.float64)
        self._lowest = np.array([c.lowest for c in controls], np.float64)
        self._highest = np.array([c.highest for c in controls], np.float64)
        self._parts: list[_Part] = []
        first = 0
        for actuator in device.actuators:
            kind = actuator.type
            stop = first + len(kind.controls)
            self._parts.append(
                _Part(slice(first, stop), kind.slew_per_s, kind.maximum_on_s, kind.rest_s)
            )
            first = stop
        self.reset()

    def reset(self) -> None:
        """Begin from silence, as after every stop."""
        self._given = self.neutral.copy()
        self._on_s = np.zeros(len(self._parts))
        self._resting_s = np.zeros(len(self._parts))

    def passed(self, wanted: Sequence[float] | F64 | None, step_s: float) -> F64:
        """Values that may be sent, (columns,).

        Parameters
        ----------
        wanted : (columns,)
            Anything at all: what is not one finite number for each column is silence.
        step_s : float
            Time since the last call; what is not a number above 0 lets nothing rise.
        """
        values = _as_numbers(wanted, len(self.neutral))
        step_s = step_s if step_s > 0.0 and np.isfinite(step_s) else 0.0
        for k, part in enumerate(self._parts):
            columns = part.columns
            safe = limited(
                values[columns],
                self._lowest[columns],
                self._highest[columns],
                self.neutral[columns],
            )
            silent = self.neutral[columns.start]
            rise = part.slew_per_s * step_s if step_s else 0.0
            safe[0] = _slewed(float(self._given[columns.start]), float(safe[0]), silent, rise)
            if self._has_to_rest(k, part, is_on=safe[0] != silent, step_s=step_s):
                safe[:] = self.neutral[columns]
            self._given[columns] = safe
        return self._given.copy()

    def _has_to_rest(self, k: int, part: _Part, *, is_on: bool, step_s: float) -> bool:
        """Count time on; an actuator that was on too long rests before it plays again."""
        if self._resting_s[k] > 0.0:
            self._resting_s[k] -= step_s
            return True
        self._on_s[k] = self._on_s[k] + step_s if is_on else 0.0
        if self._on_s[k] <= part.maximum_on_s:
            return False
        self._on_s[k], self._resting_s[k] = 0.0, part.rest_s
        return True


def _as_numbers(wanted: Sequence[float] | F64 | None, count: int) -> F64:
    """Values (count,); not a number wherever something else was handed over."""
    try:
        values = np.asarray(wanted, np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    return values.copy() if values.shape == (count,) else np.full(count, np.nan)


def _slewed(given: float, wanted: float, silent: float, rise: float) -> float:
    """Away from silence by ``rise`` at most; back towards it at once."""
    before, after = given - silent, wanted - silent
    if before * after < 0.0:  # through silence: from there it rises anew
        before = 0.0
    if abs(after) <= abs(before) + rise:
        return wanted
    return silent + np.sign(after) * (abs(before) + rise)
