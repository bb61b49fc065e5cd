# SPDX-License-Identifier: GPL-3.0-or-later
"""The bHaptics Player on this computer: frames of dots over its local websocket (SDK1)."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from typing import Any, Final

from ...engine.arrays import F64
from ...engine.rendering.device_config import BhapticsEncoder, DeviceConfig
from ..host.encoders import Channels
from ..host.output import OutputLostError
from .reservations import release, reserve, server_key
from .websocket import WebSocket

DURATION_MS: Final = 100
"""Time for which the Player holds a frame, ms: then it is silent, if we are."""

INTERVAL_S: Final = 0.02
_PATH: Final = "/v2/feedbacks?app_id=hfx_blender&app_name=HFX"


class BhapticsOutput:
    """Output to a device that the bHaptics Player drives.

    Parameters
    ----------
    host, port
        Of the Player.

    Raises
    ------
    OutputLostError
        The Player does not run, or another device has one of the actuators.
    """

    def __init__(self, device: DeviceConfig, how: BhapticsEncoder, host: str, port: int) -> None:
        self._channels = Channels(device, strengths_only=True)
        self._dots = how.worn_dots(is_mirrored=device.is_mirrored)
        self._positions = list(dict.fromkeys(position for position, _ in self._dots))
        self._key = f"hfx-{device.id}"
        server = server_key(host, port)
        self._reserved = reserve(
            (("bhaptics", server, dot) for dot in self._dots),
            f"'{' and '.join(self._positions)}' of the bHaptics Player",
        )
        self._sent_s = 0.0
        self._was_on: set[str] = set()
        try:
            self._socket = WebSocket(host, port, _PATH, lambda _text: None)
        except BaseException:
            release(self._reserved)
            raise

    def send(self, values: F64) -> None:
        """Hand over values (columns,); at most every 20 ms, the Player's own rate."""
        self._socket.check()
        now = time.monotonic()
        if now < self._sent_s + INTERVAL_S or not self._socket.has_room:
            return
        self._sent_s = now
        levels = self._channels.whole(self._channels.values(values), 100)
        dots: dict[str, list[dict[str, int]]] = {each: [] for each in self._positions}
        for (position, index), level in zip(self._dots, levels, strict=True):
            if level > 0:
                dots[position].append({"index": index, "intensity": int(level)})
        is_on = {position for position, each in dots.items() if each}
        frames = [self._frame(each, dots[each]) for each in self._positions if each in is_on]
        frames += [self._off(each) for each in sorted(self._was_on - is_on)]
        self._was_on = is_on
        if frames:
            self._socket.send(json.dumps({"Submit": frames}))

    def stop(self) -> None:
        """Switch off all actuators of this device."""
        self._was_on = set()
        with suppress(OutputLostError):
            frames = [self._off(each) for each in self._positions]
            self._socket.send(json.dumps({"Submit": frames}), is_urgent=True)

    def close(self) -> None:
        """Leave the Player, when it has read the stop.

        Raises
        ------
        OutputLostError
            It has not read the stop.
        """
        try:
            self._socket.finish()
        finally:
            self._socket.close()
            release(self._reserved)

    def _off(self, position: str) -> dict[str, Any]:
        return {"Type": "turnOff", "Key": f"{self._key}-{position}"}

    def _frame(self, position: str, dots: list[dict[str, int]]) -> dict[str, Any]:
        return {
            "Type": "frame",
            "Key": f"{self._key}-{position}",
            "Frame": {
                "position": position,
                "dotPoints": dots,
                "pathPoints": [],
                "durationMillis": DURATION_MS,
            },
        }
