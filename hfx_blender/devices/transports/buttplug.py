# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to a device of a Buttplug v4 server such as Intiface (docs.buttplug.io, JSON messages)."""

from __future__ import annotations

import json
import math
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from ...engine.arrays import F64
from ...engine.rendering.device_config import ButtplugEncoder, DeviceConfig
from ...text import printable
from ..host.encoders import Channels
from ..host.output import OutputLostError, shown
from .reservations import Keys, are_free, release, reserve, server_key
from .websocket import WebSocket

ANSWER_S: Final = 3.0
_LEAST_INTERVAL_S: Final = 0.02
_LONGEST_INTERVAL_S: Final = 0.25
"""A server cannot have a device changed less often than this; silence waits for nothing."""

_EXPECTED: Final = "Expected is what a Buttplug server such as Intiface Central sends"

_opening: defaultdict[tuple[str, int], threading.Lock] = defaultdict(threading.Lock)
_users = threading.Lock()
_servers: dict[tuple[str, int], Server] = {}
had_before: dict[tuple[tuple[str, int], str], str] = {}
"""Server and device of ours -> label of the server's device that it got, if several fitted."""


@dataclass(frozen=True)
class ServedDevice:
    """Device of a Buttplug server.

    Attributes
    ----------
    index : int
        The server may give another one after a reconnection.
    label : str
        Name, display name in parentheses if it has one, and "#" with the index where another
        device of the server has the same names.
    """

    index: int
    name: str
    display_name: str
    label: str
    facts: Mapping[str, Any]

    @property
    def names(self) -> str:
        """Label without the index."""
        return _names(self.name, self.display_name)

    def fits(self, how: ButtplugEncoder) -> bool:
        """Test for a configuration's name and outputs."""
        is_named = any(n.startswith(how.device_name) for n in (self.name, self.display_name))
        return is_named and self.ranges(how) is not None

    def ranges(self, how: ButtplugEncoder) -> list[tuple[int, int]] | None:
        """Range of whole numbers of each of a configuration's outputs; None if one is not there."""
        found = []
        try:
            for feature, kind in how.outputs:
                low, high = self.facts["DeviceFeatures"][str(feature)]["Output"][kind]["Value"]
                found.append((int(low), int(high)))
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        return found


def _names(name: str, display_name: str) -> str:
    return f"{name} ({display_name})" if display_name not in ("", name) else name


def served_devices(devices: Mapping[str, Any]) -> list[ServedDevice]:
    """Devices of a server's list, by ascending index; entries without an index are left out."""
    found = []
    for facts in devices.values():
        with suppress(KeyError, TypeError, ValueError, OverflowError):
            index = int(facts["DeviceIndex"])
            name, display = (
                str(facts.get(key) or "")[:80] for key in ("DeviceName", "DeviceDisplayName")
            )
            found.append((index, name, display, facts))
    found.sort(key=lambda each: each[0])
    count = Counter(_names(name, display) for _, name, display, _ in found)
    return [
        ServedDevice(
            index,
            name,
            display,
            label=(names := _names(name, display)) + (f" #{index}" if count[names] > 1 else ""),
            facts=facts,
        )
        for index, name, display, facts in found
    ]


def chosen(unit: str, devices: Sequence[ServedDevice]) -> ServedDevice | None:
    """The one device that a text means: by its names first, else by names and index.

    Parameters
    ----------
    unit : str
        A label, a name, a display name, or ``#`` and an index.

    Returns
    -------
    ServedDevice or None
        None where no device is meant, or more than one.
    """
    for meant in (
        [each for each in devices if unit == each.label],
        [each for each in devices if unit in (each.names, each.name, each.display_name)],
        [each for each in devices if unit in (f"{each.names} #{each.index}", f"#{each.index}")],
    ):
        if meant:
            return meant[0] if len(meant) == 1 else None
    return None


class Server:
    """Connection to a Buttplug server, shared by all outputs: many servers take one client only.

    Raises
    ------
    OutputLostError
        There is no server, or none that speaks version 4.
    """

    def __init__(self, host: str, port: int) -> None:
        self.users = 0
        self._id = 0
        self._ids = threading.Lock()
        self._ping_s = 0.0  # 0: the server asks for none
        self._pinged_s = 0.0
        self._info: dict[str, Any] | None = None
        self.devices: list[ServedDevice] | None = None
        """The newest list that the server sent; None before the first."""
        self._fault = ""
        self.unanswered: set[int] = set()  # numbers of the newest stop of each output
        self._received = threading.Condition()
        self.socket = WebSocket(host, port, "/", self._on_text, self._on_tick)
        try:
            self._greet()
            self._request("RequestDeviceList")
            self._answer(lambda: self.devices, f"{self.socket.name} sent no list of devices.")
        except BaseException:  # a server may say anything
            self.socket.close()
            raise

    def _greet(self) -> None:
        self._request("RequestServerInfo", ClientName="HFX", ProtocolVersionMajor=4,
                  ProtocolVersionMinor=0)  # fmt: skip
        info = self._answer(
            lambda: self._info,
            f"{self.socket.name} does not answer. {_EXPECTED}, ServerInfo of version 4.",
        )
        version = info.get("ProtocolVersionMajor")
        if version != 4:
            raise OutputLostError(
                f"The Buttplug server at {self.socket.name} speaks version {shown(str(version))} "
                "of the protocol; expected is version 4. Update the server."
            )
        self._ping_s = _seconds(info.get("MaxPingTime"))

    def message(self, kind: str, **content: Any) -> dict[str, Any]:
        """Message with a number of its own."""
        with self._ids:
            number = self._id = self._id % 0xFFFFFFFF + 1
        return {kind: {"Id": number, **content}}

    def _request(self, kind: str, **content: Any) -> None:
        self.socket.send(json.dumps([self.message(kind, **content)]))

    def await_stop(self, number: int) -> None:
        """Wait, at most :data:`ANSWER_S`, for the answer to a stop.

        Raises
        ------
        OutputLostError
            The connection is lost, or there is no answer.
        """
        if number in self.unanswered:
            self._answer(
                lambda: None if number in self.unanswered else True,
                "The server does not confirm the stop.",
            )

    def _answer(self, found: Callable[[], Any], otherwise: str) -> Any:
        until = time.monotonic() + ANSWER_S
        with self._received:
            while found() is None:
                self.check()
                if time.monotonic() > until:
                    raise OutputLostError(otherwise)
                self._received.wait(0.05)
        return found()

    def check(self) -> None:
        """Raise ``OutputLostError`` once the server is gone or reports a fault."""
        self.socket.check()
        if self._fault:
            raise OutputLostError(self._fault)

    # In the upkeep's thread:

    def _on_text(self, text: str) -> None:
        try:
            messages = json.loads(text)
            if not isinstance(messages, list):
                raise TypeError
            with self._received:
                for each in messages:
                    self._process(dict(each))
                self._received.notify_all()
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise OutputLostError(
                f"the server sent {shown(text)}. {_EXPECTED}, a JSON list of messages of version 4."
            ) from None

    def _process(self, message: dict[str, Any]) -> None:
        if "ServerInfo" in message:
            self._info = dict(message["ServerInfo"])
        elif "DeviceList" in message:
            # Sent anew whenever a device appears or vanishes.
            self.devices = served_devices(dict(message["DeviceList"]["Devices"]))
        elif "Ok" in message:
            self.unanswered.discard(message["Ok"]["Id"])
        elif "Error" in message:
            reason = printable(str(message["Error"].get("ErrorMessage", "")))[:200]
            self._fault = f"The Buttplug server at {self.socket.name} reports a fault: {reason}"

    def _on_tick(self) -> None:
        now = time.monotonic()
        if self._ping_s > 0.0 and now > self._pinged_s + 0.3 * self._ping_s:
            self._pinged_s = now
            self._request("Ping")


def _shared(host: str, port: int) -> Server:
    """Connection to a server, the one of other outputs where there is one."""
    key = server_key(host, port)
    with _users:
        known = _servers.get(key)
        if known is not None:
            with suppress(OutputLostError):
                known.check()
                known.users += 1
                return known
    made = Server(host, port)
    with _users:
        made.users = 1
        _servers[key] = made
    return made


def _leave(server: Server) -> None:
    """Close a connection unless other outputs use it."""
    with _users:
        server.users -= 1
        if server.users > 0:
            return
        for key in [key for key, each in _servers.items() if each is server]:
            del _servers[key]
    server.socket.close()


def devices_at(host: str, port: int) -> list[ServedDevice]:
    """Devices of a server.

    Raises
    ------
    OutputLostError
        There is no server, or none that speaks version 4.
    """
    server = _shared(host, port)
    try:
        return server.devices or []
    finally:
        _leave(server)


class ButtplugOutput:
    """Output to one device behind a Buttplug server.

    Parameters
    ----------
    host, port
        Of the server.
    unit : str
        Which of several devices of the server, as :func:`chosen` takes it; empty: the first that
        fits and that no other output has, or the one that the device had in this process before.

    Attributes
    ----------
    command_interval_s : float
        Least time between two commands, unless the device falls silent.

    Raises
    ------
    OutputLostError
        No server, none that speaks version 4, no device that fits, or another output has it.
    """

    def __init__(
        self, device: DeviceConfig, how: ButtplugEncoder, host: str, port: int, unit: str = ""
    ) -> None:
        self._how = how
        self._channels = Channels(device, strengths_only=True)
        self._given: list[int | None] = []
        self._given_s = 0.0
        self._reserved: Keys = frozenset()
        self._stop_number = 0  # of the newest stop
        self._is_closed = False
        key = server_key(host, port)
        # One after the other: of two devices that open together, the first takes the first.
        with _opening[key]:
            self._server = _shared(host, port)
            self._socket = self._server.socket
            try:
                self._choose(device.id, key, unit)
            except BaseException:
                self.close()
                raise

    @property
    def chosen_device(self) -> str:
        """The device that was chosen, as the server knows it: two may have one name."""
        return self._device.label

    def send(self, values: F64) -> None:
        """Hand over values (columns,): a command for each changed one, at the device's own rate."""
        self._check()
        now = time.monotonic()
        if not self._socket.has_room:
            return
        shares = self._channels.fractions(self._channels.values(values))
        silent = self._channels.fractions(self._channels.neutral)
        if now < self._given_s + self.command_interval_s and (shares != silent).any():
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
            command = self._server.message("StopCmd", DeviceIndex=self._device.index)
            self._server.unanswered.discard(self._stop_number)
            self._stop_number = int(command["StopCmd"]["Id"])
            self._server.unanswered.add(self._stop_number)
            self._socket.send(json.dumps([command]), is_urgent=True)

    def close(self) -> None:
        """Leave the server; without any device of ours it is disconnected, which stops them.

        Raises
        ------
        OutputLostError
            The server has not confirmed the stop.
        """
        if self._is_closed:
            return
        self._is_closed = True
        try:
            self._server.await_stop(self._stop_number)
        finally:
            self._server.unanswered.discard(self._stop_number)
            _leave(self._server)
            release(self._reserved)

    def _choose(self, device_id: str, key: tuple[str, int], unit: str) -> None:
        """Reserve one of the server's devices that fit."""
        there = self._server.devices or []
        fitting = [each for each in there if each.fits(self._how)]
        wanted = unit or had_before.get((key, device_id), "")
        free = [each for each in fitting if are_free([(*key, each.index)])]
        found = chosen(wanted, fitting) if wanted else next(iter(free or fitting), None)
        if found is None:
            names = ", ".join(f"{each.names} #{each.index}" for each in there) or "none"
            named = wanted or self._how.device_name
            which = f"{'single ' if wanted else ''}device {repr(named) + ' ' if named else ''}"
            raise OutputLostError(f"The server has no {which}that fits; it has: {names}.")
        ranges = found.ranges(self._how)
        assert ranges is not None
        self._reserved = reserve([(*key, found.index)], f"'{found.label}' of the server")
        if len(fitting) > 1:
            had_before[key, device_id] = found.label
        self._device, self._ranges = found, ranges
        gap_s = _seconds(found.facts.get("DeviceMessageTimingGap"))
        self.command_interval_s = min(max(gap_s, _LEAST_INTERVAL_S), _LONGEST_INTERVAL_S)
        self._given = [None] * len(ranges)

    def _check(self) -> None:
        """Raise ``OutputLostError`` if the server is gone, or has not this device at its index."""
        self._server.check()
        ours = self._device
        for each in self._server.devices or ():
            if each.index == ours.index and each.names == ours.names:
                return
        raise OutputLostError("The device was disconnected from the server.")

    def _output(self, k: int, level: int) -> dict[str, Any]:
        feature, kind = self._how.outputs[k]
        return self._server.message(
            "OutputCmd",
            DeviceIndex=self._device.index,
            FeatureIndex=feature,
            Command={kind: {"Value": level}},
        )


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
