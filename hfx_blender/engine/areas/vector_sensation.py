# SPDX-License-Identifier: GPL-3.0-or-later
"""Vector sensations: curves for single actuators of one device, without rendering schemes.

Schneider et al., UIST 2015: full control where someone wants it, one parameter curve for each
actuator. Other effects add to it on the device, and the device's limits come after.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import F64, I64
from ..counters import Counters
from ..samples import Drive
from ..scene import ActuatorArea, EffectBlock


def driven(
    name: str, area: ActuatorArea, animated: EffectBlock, rows: I64, counters: Counters
) -> tuple[I64, Drive]:
    """Rows of a block at which any actuator is driven, and their drive."""
    assert animated.drive is not None
    values = animated.drive[rows]
    is_known = np.isfinite(values).all(axis=1)
    if not is_known.all():
        counters.warn(
            f"effect '{name}': an actuator's value is not a finite number; it is silent there",
            int(np.count_nonzero(~is_known)),
        )
    values = np.clip(np.where(is_known[:, None], values, 0.0), 0.0, 1.0).astype(np.float32)
    is_on = (values > 0.0).any(axis=1)
    return rows[is_on], Drive(area.device_id, area.actuators, values[is_on])


def gains_of(drive: Drive, device_id: str, actuators: Sequence[str]) -> F64:
    """Gains of A actuators of a device, (n, A); 0 for any other device."""
    gains = np.zeros((len(drive.values), len(actuators)))
    if drive.device_id == device_id:
        place = {actuator: k for k, actuator in enumerate(drive.actuators)}
        for a, actuator in enumerate(actuators):
            if actuator in place:
                gains[:, a] = drive.values[:, place[actuator]]
    return gains
