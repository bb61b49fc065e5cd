# SPDX-License-Identifier: GPL-3.0-or-later
"""Fans of Dyson's Link series, by the MQTT messages of the device's app in the home network.

Dyson has published no description. The messages are those of several free programs (such as
libdyson), unchanged since 2017; none was tried on a fan here.
"""

from __future__ import annotations

import base64
import hashlib
import json
import time
from collections.abc import Mapping
from typing import Final

from .mqtt import MqttPublisher

SPEEDS: Final = 10
HEATING: Final = "455"
"""Product number of the Pure Hot+Cool Link; the Pure Cool Link (475) only blows."""

_INTERVAL_S: Final = 1.0  # between messages; the fan's motor is slower
_FULL_M_S: Final = 4.0  # of the configuration
_NEUTRAL_C: Final = 24.0


class DysonFan:
    """Fan with the serial number, the product number and the Wi-Fi password of its sticker."""

    def __init__(self, host: str, port: int, serial: str, product: str, password: str) -> None:
        digest = base64.b64encode(hashlib.sha512(password.encode()).digest()).decode()
        self._broker = MqttPublisher(host, port, "hfx", serial, digest)
        self._topic = f"{product}/{serial}/command"
        self._heats = product == HEATING
        self._last: dict[str, str] = {}
        self._sent_s = -_INTERVAL_S

    def set(self, values: Mapping[str, float]) -> None:
        """Apply values by actuator (``fan`` in m/s, ``air`` in degrees Celsius), at most once a
        second, except for off."""
        wanted = state_of(values, heats=self._heats)
        now_s = time.monotonic()
        is_off = wanted.get("fmod") == "OFF"
        if wanted != self._last and (is_off or now_s - self._sent_s >= _INTERVAL_S):
            stamp = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
            message = {"msg": "STATE-SET", "time": stamp, "mode-reason": "LAPP", "data": wanted}
            self._broker.publish(self._topic, json.dumps(message).encode())
            self._last, self._sent_s = wanted, now_s
        self._broker.keep_alive()

    def close(self) -> None:
        """Switch off and disconnect."""
        self.set({})
        self._broker.close()


def state_of(values: Mapping[str, float], *, heats: bool) -> dict[str, str]:
    """Members of the fan's state for values by actuator; off without wind and warmth."""
    speed = min(max(values.get("fan", 0.0) / _FULL_M_S, 0.0), 1.0)
    warm_c = values.get("air", _NEUTRAL_C)
    is_warm = heats and warm_c > _NEUTRAL_C + 0.5
    if speed <= 0.0 and not is_warm:
        return {"fmod": "OFF"}
    steps = max(round(speed * SPEEDS), 1)  # heat needs some air
    state = {"fmod": "FAN", "fnsp": f"{steps:04d}"}
    if heats:
        state["hmod"] = "HEAT" if is_warm else "OFF"
        if is_warm:
            state["hmax"] = f"{round((min(warm_c, 37.0) + 273.0) * 10):04d}"  # tenths of a kelvin
    return state
