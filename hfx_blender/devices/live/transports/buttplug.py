# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to a device of a Buttplug v4 server such as Intiface (docs.buttplug.io, JSON messages)."""

from __future__ import annotations

import json
import math
import threading
import time
from contextlib import suppress
from typing import Any, Final

from ....engine.arrays import F64
from ....engine.rendering.device import DeviceConfig
from ....engine.rendering.device_output import ButtplugEncoder
from ..encoders import Channels
from ..output import OutputLostError
from .websocket import WebSocket

ANSWER_S: Final = 3.0
_LEAST_INTERVAL_S: Final = 0.02
_LONGEST_INTERVAL_S: Final = 0.25
"""A server cannot have a device changed less often than this; silence waits for nothing."""


class ButtplugOutput:
    """Output to one device behind a Buttplug server.

    Parameters
    ----------
    host, port
        Of the server.

    Raises
    ------
    OutputLostError
        No server, none that speaks version 4, or no device that fits.
    """

    def __init__(self, device: DeviceConfig, how: ButtplugEncoder, host: str, port: int) -> None:
        self._how = how
        self._channels = Channels(device, strengths_only=True)
        self._id = 0
        self._ping_s = 0.0  # 0: the server asks for none
        self._pinged_s = 0.0
        self._server: dict[str, Any] | None = None
        self._devices: dict[str, Any] | None = None
        self._fault = ""
        self._received = threading.Condition()
        self._given: list[int | None] = []
        self._given_s = 0.0
        self._socket = WebSocket(host, port, "/", self._on_text, self._on_tick)
        try:
            self._greet()
            self._find()
        except BaseException:  # a server may say anything
            self._socket.close()
            raise

    @property
    def chosen_device(self) -> str:
        """The device that was chosen, as the server knows it: two may have one name."""
        return f"{self._index}"

    def send(self, values: F64) -> None:
        """Hand over values (columns,): a command for each changed one, at the device's own rate."""
        self._check()
        now = time.monotonic()
        if not self._socket.has_room:
            return
        shares = self._channels.fractions(self._channels.values(values))
        silent = self._channels.fractions(self._channels.neutral)
        if now < self._given_s + self._interval_s and (shares != silent).any():
            return
        commands = []
        for k, (share, rest, (low, high)) in enumerate(
            zip(shares, silent, self._ranges, strict=True)
        ):
            level = _level(float(share), float(rest), low, high)
            if level != self._given[k]:
                self._given[k] = level
                commands.append(self._output(k, level))
        if commands:
            self._given_s = now
            self._socket.send(json.dumps(commands))

    def stop(self) -> None:
        """Stop this device."""
        self._given = [None] * len(self._given)
        with suppress(OutputLostError):
            command = self._message("StopCmd", DeviceIndex=self._index)
            self._socket.send(json.dumps([command]), is_urgent=True)

    def close(self) -> None:
        """Disconnect from the server; it stops our device."""
        self._socket.close()

    def _greet(self) -> None:
        self._request("RequestServerInfo", ClientName="HFX", ProtocolVersionMajor=4,
                  ProtocolVersionMinor=0)  # fmt: skip
        info = self._answer(lambda: self._server, "a Buttplug server of version 4")
        if info.get("ProtocolVersionMajor") != 4:
            raise OutputLostError("The server does not speak version 4 of Buttplug's protocol.")
        self._ping_s = _seconds(info.get("MaxPingTime"))

    def _find(self) -> None:
        """Choose the first device with matching name and features."""
        self._request("RequestDeviceList")
        devices = self._answer(lambda: self._devices, "a list of devices")
        for each in devices.values():
            found = self._ranges_of(each)
            if found is not None and str(each.get("DeviceName", "")).startswith(
                self._how.device_name
            ):
                self._ranges = found
                self._index = int(each["DeviceIndex"])
                gap_s = _seconds(each.get("DeviceMessageTimingGap"))
                self._interval_s = min(max(gap_s, _LEAST_INTERVAL_S), _LONGEST_INTERVAL_S)
                self._given = [None] * len(found)
                return
        wanted = f"'{self._how.device_name}' " if self._how.device_name else ""
        named = (each.get("DeviceName") for each in devices.values() if isinstance(each, dict))
        names = ", ".join(str(each)[:80] for each in named) or "none"
        raise OutputLostError(f"The server has no device {wanted}that fits; it has: {names}.")

    def _ranges_of(self, device: dict[str, Any]) -> list[tuple[int, int]] | None:
        found = []
        try:
            int(device["DeviceIndex"])
            for feature, kind in self._how.outputs:
                low, high = device["DeviceFeatures"][str(feature)]["Output"][kind]["Value"]
                found.append((int(low), int(high)))
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        return found

    def _output(self, k: int, level: int) -> dict[str, Any]:
        feature, kind = self._how.outputs[k]
        return self._message(
            "OutputCmd",
            DeviceIndex=self._index,
            FeatureIndex=feature,
            Command={kind: {"Value": level}},
        )

    def _message(self, kind: str, **content: Any) -> dict[str, Any]:
        self._id = self._id % 0xFFFFFFFF + 1
        return {kind: {"Id": self._id, **content}}

    def _request(self, kind: str, **content: Any) -> None:
        self._socket.send(json.dumps([self._message(kind, **content)]))

    def _answer(self, found: Any, named: str) -> dict[str, Any]:
        until = time.monotonic() + ANSWER_S
        with self._received:
            while found() is None:
                self._check()
                if time.monotonic() > until:
                    raise OutputLostError(f"The server does not answer like {named}.")
                self._received.wait(0.05)
        answer: dict[str, Any] = found()
        return answer

    def _check(self) -> None:
        self._socket.check()
        if self._fault:
            raise OutputLostError(self._fault)

    # In the upkeep's thread:

    def _on_text(self, text: str) -> None:
        messages = json.loads(text)
        with self._received:
            for each in messages if isinstance(messages, list) else []:
                self._process(each)
            self._received.notify_all()

    def _process(self, message: dict[str, Any]) -> None:
        if "ServerInfo" in message:
            self._server = dict(message["ServerInfo"])
        elif "DeviceList" in message:
            devices = dict(message["DeviceList"]["Devices"])
            # Sent anew whenever a device appears or vanishes.
            if self._given and not any(
                each.get("DeviceIndex") == self._index for each in devices.values()
            ):
                self._fault = "The device was disconnected from the server."
            self._devices = devices
        elif "Error" in message:
            reason = str(message["Error"].get("ErrorMessage", ""))[:200]
            self._fault = f"The server reports a fault: {reason}"

    def _on_tick(self) -> None:
        now = time.monotonic()
        if self._ping_s > 0.0 and now > self._pinged_s + 0.3 * self._ping_s:
            self._pinged_s = now
            self._request("Ping")


def _seconds(milliseconds: object) -> float:
    """Milliseconds that a server tells; 0 where it is no number above 0."""
    if isinstance(milliseconds, bool) or not isinstance(milliseconds, int | float):
        return 0.0
    return milliseconds / 1000.0 if 0.0 < milliseconds < math.inf else 0.0


def _level(share: float, rest: float, low: int, high: int) -> int:
    """Convert a share 0..1 to a feature's whole numbers; a signed feature rests at 0."""
    if low >= 0:
        return round(low + share * (high - low))
    if share >= rest:
        return round(high * (share - rest) / max(1.0 - rest, 1e-9))
    return round(low * (rest - share) / max(rest, 1e-9))
