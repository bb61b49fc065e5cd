# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to the bHaptics Player: frames of dots over its local websocket (SDK1)."""

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
"""Duration of a frame in the Player, ms; without a further frame it is silent then."""

INTERVAL_S: Final = 0.02
"""Shortest time between two frames, seconds: the Player's own rate."""
_PATH: Final = "/v2/feedbacks?app_id=hfx_blender&app_name=HFX"


class BhapticsOutput:
    """Output to a device of the bHaptics Player at ``host`` and ``port``.

    Raises OutputLostError: the Player does not run, or an actuator is in use by another device.
    """

    def __init__(self, device: DeviceConfig, how: BhapticsEncoder, host: str, port: int) -> None:
        self._channels = Channels(device, strengths_only=True)
        self._dots = how.worn_dots(is_mirrored=device.is_mirrored)
        # A frame addresses one position; dots of a device may lie on several.
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
        """Send values (columns,) as levels 0..100; off for positions that have become silent.

        Values within 20 ms of the last frame, or with unsent bytes, are dropped.
        """
        self._socket.check()
        now = time.monotonic()
        if now < self._sent_s + INTERVAL_S or self._socket.waiting:
            return
        self._sent_s = now
        levels = self._channels.whole(self._channels.values(values), 100)
        dots: dict[str, list[dict[str, int]]] = {position: [] for position in self._positions}
        for (position, index), level in zip(self._dots, levels, strict=True):
            if level > 0:
                dots[position].append({"index": index, "intensity": int(level)})
        is_on = {position for position, entries in dots.items() if entries}
        frames = [self._frame(p, dots[p]) for p in self._positions if p in is_on]
        # A frame would hold for 100 ms, so silence is sent as "turnOff", once.
        frames += [self._off(position) for position in sorted(self._was_on - is_on)]
        self._was_on = is_on
        if frames:
            self._socket.send(json.dumps({"Submit": frames}))

    def stop(self) -> None:
        """Send "turnOff" for all positions, despite unsent bytes; never raises OutputLostError."""
        self._was_on = set()
        with suppress(OutputLostError):
            frames = [self._off(position) for position in self._positions]
            self._socket.send(json.dumps({"Submit": frames}), is_urgent=True)

    def close(self) -> None:
        """Disconnect without a stop, after up to 1 s for the Player's close frame, and release the
        dots. Raises OutputLostError without the frame, and at a second call."""
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
