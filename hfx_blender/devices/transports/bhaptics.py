# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to the bHaptics Player: levels of motors over its local websocket.

Messages are those of the first SDK, or of the second (wss, ``SdkPlayDotMode``), as the maker's
public plugin for SimHub sends them. Application id and key of the second are of a bHaptics account;
programs that imitate the Player take any.
"""

import json
import os
import time
import zlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any, Final
from urllib.parse import urlencode

from ...engine.arrays import F64
from ...engine.rendering.device_config import BhapticsEncoder, DeviceConfig
from ..host.encoders import Channels
from ..host.output import OutputLostError
from .reservations import release, reserve, server_key
from .websocket import WebSocket

DURATION_MS: Final = 100
"""Duration of a frame in the Player, ms; without a further frame it is silent then."""

INTERVAL_S: Final = 0.02  # shortest time between two frames, seconds: the Player's own rate
APP_ID: Final = "HFX_BHAPTICS_APP_ID"
API_KEY: Final = "HFX_BHAPTICS_API_KEY"
"""Environment variables with application id and key of the second SDK."""

_PATH: Final = "/v2/feedbacks?app_id=hfx_blender&app_name=HFX"
_MOTORS: Final = 40
# Number of each position's device in the second SDK, and its first motor there.
_PLACES: Final = {
    "VestFront": (0, 0),
    "VestBack": (0, 20),
    **{
        name: (number, 0)
        for number, name in enumerate(
            "ForearmL ForearmR Head HandL HandR FootL FootR GloveL GloveR".split(), 1
        )
    },
}

Dots = Mapping[str, Mapping[int, int]]


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
        server = server_key(host, port - how.sdk + 1)  # both ports are of one Player
        self._reserved = reserve(
            (("bhaptics", server, dot) for dot in self._dots),
            f"'{' and '.join(self._positions)}' of the bHaptics Player",
        )
        self._sent_s = 0.0
        self._was_on: set[str] = set()
        is_second = how.sdk == 2
        app_id, key = os.environ.get(APP_ID, "hfx_blender"), os.environ.get(API_KEY, "")
        self._texts = self._second_sdk if is_second else self._first_sdk
        path = _PATH
        if is_second:
            query = urlencode({"workspace_id": app_id, "api_key": key, "version": "1.0.2"})
            path = f"/v3/feedback?{query}"
        try:
            self._socket = WebSocket(host, port, path, lambda _text: None, tls=is_second)
            if is_second:
                named = ("applicationId", "applicationIdHashValue", "nonceHashValue", "cipher")
                login = {**dict.fromkeys(named, app_id), "sdkApiKey": key, "version": 1}
                self._socket.send(_message("SdkRequestAuth", login))
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
        dots: dict[str, dict[int, int]] = {}
        for (position, index), level in zip(self._dots, levels, strict=True):
            if level > 0:
                dots.setdefault(position, {})[index] = int(level)
        # A frame would hold for 100 ms, so silence is sent, once.
        silent = sorted(self._was_on - set(dots))
        self._was_on = set(dots)
        for text in self._texts(dots, silent):
            self._socket.send(text)

    def stop(self) -> None:
        """Send silence for all positions, despite unsent bytes; never raises OutputLostError."""
        self._was_on = set()
        with suppress(OutputLostError):
            for text in self._texts({}, self._positions):
                self._socket.send(text, is_urgent=True)
            if self._texts == self._second_sdk:
                self._socket.send(_message("SdkStopAll"), is_urgent=True)

    def close(self) -> None:
        """Disconnect without a stop, after up to 1 s for the Player's close frame, and release the
        dots. Raises OutputLostError without the frame, and at a second call."""
        try:
            self._socket.finish()
        finally:
            self._socket.close()
            release(self._reserved)

    def _first_sdk(self, dots: Dots, silent: Iterable[str]) -> list[str]:
        """Message with the levels of positions, and with silent positions; empty for neither."""
        frames: list[dict[str, Any]] = [
            {
                "Type": "frame",
                "Key": f"{self._key}-{position}",
                "Frame": {
                    "position": position,
                    "dotPoints": [{"index": k, "intensity": v} for k, v in dots[position].items()],
                    "pathPoints": [],
                    "durationMillis": DURATION_MS,
                },
            }
            for position in self._positions
            if position in dots
        ]
        frames += [{"Type": "turnOff", "Key": f"{self._key}-{position}"} for position in silent]
        return [json.dumps({"Submit": frames})] if frames else []

    def _second_sdk(self, dots: Dots, silent: Iterable[str]) -> list[str]:
        """Message for each device with levels or silence. A frame replaces the last frame with
        the same request id."""
        motors = {_PLACES[position][0]: [0] * _MOTORS for position in (*dots, *silent)}
        for position, levels in dots.items():
            number, first = _PLACES[position]
            for index, level in levels.items():
                motors[number][first + index] = level
        return [
            _message(
                "SdkPlayDotMode",
                {
                    "requestId": zlib.crc32(f"{self._key}-{number}".encode()) >> 1,
                    "position": number,
                    "motorValues": values,
                    "durationMillis": DURATION_MS,
                    "deviceIndex": -1,
                },
            )
            for number, values in motors.items()
        ]


def _message(kind: str, content: Mapping[str, Any] | None = None) -> str:
    """Message of the second SDK, whose content is JSON as text, or null."""
    text = None if content is None else json.dumps(content)
    return json.dumps({"Type": kind, "Message": text})
