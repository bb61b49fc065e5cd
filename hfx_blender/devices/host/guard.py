# SPDX-License-Identifier: GPL-3.0-or-later
"""Guard: limits on all values of a device, the last step before values are encoded as bytes.

Order: real, finite numbers (else the actuator is silent), range, slew rate (rises only), allowed
values, time on.
All values of scripts and of the engine pass through here.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.conditioning.actuator_limits import DeviceLimits
from ...engine.rendering.device_config import DeviceConfig
from ..workers.message_bodies import as_row
from .time_on import BudgetUse, TimeOn

LONGEST_RISE_S: Final = 0.05
"""Upper bound of the step that the slew limit counts with, seconds: no jump after a stall."""


class Guard:
    """Safety limits of a device, with the last strengths and the time on of all actuators as state.

    Not thread-safe but for ``time_on``, whose methods any thread may call.
    """

    def __init__(self, device: DeviceConfig) -> None:
        self._kinds = [actuator.type for actuator in device.actuators]
        self._limits = DeviceLimits(device)
        self.neutral = self._limits.neutral
        self._silent = self._limits.silent
        self._slew_per_s = np.array([kind.slew_per_s for kind in self._kinds], np.float64)
        self.time_on = TimeOn(self._kinds)
        self.reset()

    def share(self, uses: Sequence[BudgetUse]) -> None:
        """Use duty budgets that outlive this connection; to be called before the first values."""
        self.time_on = TimeOn(self._kinds, uses)

    def reset(self) -> None:
        """Set the last strengths to silence, and begin a use of the duty budgets; loads stay."""
        self._given = self._silent[:, 0].copy()  # (A,) last strengths before rounding
        self.time_on.begin()

    def limited(self, wanted: Sequence[float] | F64 | None, step_s: float) -> F64:
        """Limit values for sending: (columns,), finite and within all limits of the device.

        ``wanted``: any input is allowed. An actuator with an entry that is not a finite number is
        silent; all are silent if the number of entries is wrong.
        ``step_s``: time since the last call, seconds. 0, negative or NaN: no strength rises, and no
        time counts as rest.
        """
        # A wrong number of entries becomes NaN, which silences all actuators below.
        values = as_row(wanted)
        if values.shape != self.neutral.shape:
            values = np.full(len(self.neutral), np.nan)
        step_s = step_s if step_s > 0.0 and np.isfinite(step_s) else 0.0
        # Finite numbers and range: one row for each actuator, its strength in column 0.
        safe = self._limits.by_actuator(values)
        silent = self._silent[:, 0]
        # Slew rate, which limits the distance from silence, never a fall towards silence. Without
        # the test of the time, an infinite slew rate times 0 would be NaN.
        rise_s = min(step_s, LONGEST_RISE_S)
        rise = self._slew_per_s * rise_s if rise_s else np.zeros(len(silent))
        before, after = self._given - silent, safe[:, 0] - silent
        # A change of sign passes through silence, and the whole rise is counted from there.
        most = np.where(before * after < 0.0, 0.0, np.abs(before)) + rise
        is_slow = np.abs(after) <= most
        limited = silent + np.sign(after) * np.where(is_slow, 0.0, most)
        safe[:, 0] = np.where(is_slow, safe[:, 0], limited)
        # Rises go on from the strength before rounding: a step may be higher than one rise.
        given = safe[:, 0].copy()
        safe = self._limits.rounded(safe)
        # Time on comes last: only strengths that are really sent are charged.
        is_blocked = self.time_on.blocked(safe[:, 0] != silent, step_s)
        safe[is_blocked] = self._silent[is_blocked]
        self._given = np.where(is_blocked, silent, given)
        return self._limits.joined(safe)
