# SPDX-License-Identifier: GPL-3.0-or-later
"""Client that plays the values of clips and games at a person's strengths."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.dispatch import ActuatorGroup


class PersonalClient(LiveClient):
    """Client with devices of :func:`.person_profile.personal`, by name.

    Tracks are rendered in the output process, with the marks; other values get the marks here.
    """

    def __init__(self, devices: Mapping[str, DeviceConfig]) -> None:
        super().__init__()
        self._groups = {
            name: [ActuatorGroup(device, item, load_model) for item in device.modalities]
            for name, device in devices.items()
            if any(actuator.type.marks for actuator in device.actuators)
        }

    def send(self, name: str, values: npt.ArrayLike) -> None:
        """Send values (columns,) with the marks of the device; see :meth:`LiveClient.send`."""
        row = np.array(values, np.float64)
        for group in self._groups.get(name, ()):
            strengths = row[group.strength_columns]
            row[group.strength_columns] = strengths * group.personal_factors(strengths[None])[0]
        super().send(name, row)
