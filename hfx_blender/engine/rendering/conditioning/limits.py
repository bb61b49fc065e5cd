# SPDX-License-Identifier: GPL-3.0-or-later
"""The last guard before a value leaves the engine: finite, then in range."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...arrays import F64, I64
from ..device import DeviceConfig


def limited(
    values: npt.ArrayLike, lowest: npt.ArrayLike, highest: npt.ArrayLike, silent: npt.ArrayLike
) -> F64:
    """Values that an actuator may be given.

    One parameter that is NaN or infinite silences the actuator in all its parameters: a
    minimum or maximum alone would turn NaN into full power.

    Parameters
    ----------
    values : (..., P)
        Parameters of one actuator in the last axis.
    lowest, highest : (P,) or broadcastable
        Allowed range, both included.
    silent : (P,) or broadcastable
        What is given instead, itself in the range.

    Returns
    -------
    (..., P) float64
    """
    values = np.asarray(values, np.float64)
    is_number = np.isfinite(values).all(axis=-1, keepdims=True)
    return np.clip(np.where(is_number, values, silent), lowest, highest)


class DeviceLimits:
    """The limits of all A actuators of a device, of which each has up to P controls.

    An actuator with fewer controls than others repeats its strength.

    Attributes
    ----------
    neutral : (columns,) float64
    silent : (A, P) float64
        The same by actuator, its strength first.
    """

    def __init__(self, device: DeviceConfig) -> None:
        kinds = [actuator.type for actuator in device.actuators]
        controls = device.controls
        self.neutral: F64 = device.neutral
        counts = np.array([len(kind.controls) for kind in kinds])
        places = np.arange(counts.max())
        self._columns: I64 = device.strength_columns[:, None] + np.where(
            places < counts[:, None], places, 0
        )
        self._lowest = np.array([c.lowest for c in controls], np.float64)[self._columns]
        self._highest = np.array([c.highest for c in controls], np.float64)[self._columns]
        self.silent: F64 = self.neutral[self._columns]

    def by_actuator(self, values: F64) -> F64:
        """Values (columns,) as limited ones (A, P)."""
        return limited(values[self._columns], self._lowest, self._highest, self.silent)

    def joined(self, values: F64) -> F64:
        """Values (A, P) as (columns,)."""
        found = np.zeros_like(self.neutral)
        for place in reversed(range(values.shape[1])):  # the strength last, as it may be repeated
            found[self._columns[:, place]] = values[:, place]
        return found
