# SPDX-License-Identifier: GPL-3.0-or-later
"""The guard: what any value must pass before it is made into bytes.

Order: a real number, finite (else the actuator is silent), range, slew (rises only), time on.
Whatever a script or an engine asks for, nothing else reaches an actuator.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ...engine.rendering.device import DeviceConfig
from ...engine.rendering.limits import DeviceLimits

F64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]


class Guard:
    """Limits of one device in time; it keeps what each actuator was given last.

    Parameters
    ----------
    device : DeviceConfig
    """

    def __init__(self, device: DeviceConfig) -> None:
        kinds = [actuator.type for actuator in device.actuators]
        self._limits = DeviceLimits(device)
        self.neutral = self._limits.neutral
        self._silent = self._limits.silent
        self._slew_per_s = np.array([kind.slew_per_s for kind in kinds], np.float64)
        self._maximum_on_s = np.array([kind.maximum_on_s for kind in kinds], np.float64)
        self._rest_s = np.array([kind.rest_s for kind in kinds], np.float64)
        self.reset()

    def reset(self) -> None:
        """Begin from silence, as after every stop."""
        self._given = self._silent[:, 0].copy()  # (A,) strengths
        self._on_s = np.zeros(len(self._given))
        self._resting_s = np.zeros(len(self._given))

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
        safe = self._limits.by_actuator(values)
        silent = self._silent[:, 0]
        rise = self._slew_per_s * step_s if step_s else np.zeros(len(silent))
        safe[:, 0] = _slewed(self._given, safe[:, 0], silent, rise)
        has_to_rest = self._has_to_rest(safe[:, 0] != silent, step_s)
        safe[has_to_rest] = self._silent[has_to_rest]
        self._given = safe[:, 0].copy()
        return self._limits.joined(safe)

    def _has_to_rest(self, is_on: Bool, step_s: float) -> Bool:
        """Count time on; an actuator that was on too long rests before it plays again."""
        is_resting = self._resting_s > 0.0
        self._resting_s = np.where(is_resting, self._resting_s - step_s, self._resting_s)
        self._on_s = np.where(is_resting, self._on_s, np.where(is_on, self._on_s + step_s, 0.0))
        is_over = ~is_resting & (self._on_s > self._maximum_on_s)
        self._on_s[is_over] = 0.0
        self._resting_s[is_over] = self._rest_s[is_over]
        return is_resting | is_over


def _as_numbers(wanted: Sequence[float] | F64 | None, count: int) -> F64:
    """Values (count,); not a number wherever something else was handed over."""
    try:
        values = np.asarray(wanted, np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    return values.copy() if values.shape == (count,) else np.full(count, np.nan)


def _slewed(given: F64, wanted: F64, silent: F64, rise: F64) -> F64:
    """Strengths (A,): away from silence by ``rise`` at most, back towards it at once."""
    before, after = given - silent, wanted - silent
    # Through silence: from there it rises anew.
    most = np.where(before * after < 0.0, 0.0, np.abs(before)) + rise
    is_slow = np.abs(after) <= most
    return np.where(is_slow, wanted, silent + np.sign(after) * np.where(is_slow, 0.0, most))
