# SPDX-License-Identifier: GPL-3.0-or-later
"""Guard: limits that any value must pass before it is made into bytes.

Order: a real number, finite (else the actuator is silent), range, slew (rises only), time on.
Whatever a script or an engine asks for, nothing else reaches an actuator.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.conditioning.limits import DeviceLimits
from ...engine.rendering.device import DeviceConfig
from ..workers.message_bodies import as_row
from .time_on import AccountUse, TimeOn

LONGEST_RISE_S: Final = 0.05
"""Longest time that one rise is counted for, seconds: after a stall, values must not jump."""


class Guard:
    """Guard of one device; it remembers the last values of each actuator."""

    def __init__(self, device: DeviceConfig) -> None:
        self._kinds = [actuator.type for actuator in device.actuators]
        self._limits = DeviceLimits(device)
        self.neutral = self._limits.neutral
        self._silent = self._limits.silent
        self._slew_per_s = np.array([kind.slew_per_s for kind in self._kinds], np.float64)
        self._time_on = TimeOn(self._kinds)
        self.reset()

    @property
    def has_time_limit(self) -> bool:
        """Test for any actuator whose time on is limited."""
        return self._time_on.is_limited

    def share(self, uses: Sequence[AccountUse]) -> None:
        """Use accounts of time on that outlive this connection; call before anything is played."""
        self._time_on = TimeOn(self._kinds, uses)

    def reset(self) -> None:
        """Begin from silence, as after every stop; time on is not forgotten."""
        self._given = self._silent[:, 0].copy()  # (A,) strengths
        self._time_on.begin()

    def record_silence(self, played_s: float, now_s: float) -> None:
        """Record silence from now on; the last values were played ``played_s`` longer."""
        self._time_on.end(played_s, now_s)

    def record_rest(self, now_s: float) -> None:
        """Record rest since the device fell silent, before it begins again."""
        self._time_on.record_rest(now_s)

    def limited(self, wanted: Sequence[float] | F64 | None, step_s: float) -> F64:
        """Values that may be sent, (columns,).

        Parameters
        ----------
        wanted : (columns,)
            Anything at all: what is not one finite number for each column is silence.
        step_s : float
            Time since the last call; what is not a number above 0 lets nothing rise or rest.
        """
        values = _as_numbers(wanted, len(self.neutral))
        step_s = step_s if step_s > 0.0 and np.isfinite(step_s) else 0.0
        safe = self._limits.by_actuator(values)
        silent = self._silent[:, 0]
        rise_s = min(step_s, LONGEST_RISE_S)
        rise = self._slew_per_s * rise_s if rise_s else np.zeros(len(silent))
        safe[:, 0] = _slewed(self._given, safe[:, 0], silent, rise)
        is_held = self._time_on.held_off(safe[:, 0] != silent, step_s)
        safe[is_held] = self._silent[is_held]
        self._given = safe[:, 0].copy()
        return self._limits.joined(safe)


def _as_numbers(wanted: Sequence[float] | F64 | None, count: int) -> F64:
    """Convert to values (count,); NaN wherever the input is not a number."""
    values = as_row(wanted)
    return values if values.shape == (count,) else np.full(count, np.nan)


def _slewed(given: F64, wanted: F64, silent: F64, rise: F64) -> F64:
    """Strengths (A,): away from silence by ``rise`` at most, back towards it at once."""
    before, after = given - silent, wanted - silent
    # Through silence: from there it rises anew.
    most = np.where(before * after < 0.0, 0.0, np.abs(before)) + rise
    is_slow = np.abs(after) <= most
    return np.where(is_slow, wanted, silent + np.sign(after) * np.where(is_slow, 0.0, most))
