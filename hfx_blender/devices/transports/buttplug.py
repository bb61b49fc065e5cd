# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to a device of a Buttplug v4 server such as Intiface (docs.buttplug.io, JSON messages)."""

import json
import math
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, Final

from ...engine.arrays import F64
from ...engine.rendering.device_config import ButtplugEncoder, DeviceConfig
from ...text import printable
from ..host.encoders import Channels
from ..host.output import OutputLostError, shown
from .reservations import Keys, are_free, release, reserve, server_key
from .websocket import WebSocket

ANSWER_S: Final = 3.0  # time limit for an answer of a server, seconds
_LEAST_INTERVAL_S: Final = 0.02
# Bounds of the interval between two commands, seconds, for any demand of a server.
_LONGEST_INTERVAL_S: Final = 0.25

_EXPECTED: Final = "Expected is what a Buttplug server such as Intiface Central sends"

_opening: defaultdict[tuple[str, int], threading.Lock] = defaultdict(threading.Lock)
_users = threading.Lock()
_servers: "dict[tuple[str, int], Server]" = {}
had_before: dict[tuple[tuple[str, int], str], str] = {}
"""Label of the server's device that was chosen last, by server and id of the configuration; only
where several devices fitted."""


@dataclass(frozen=True)
class ServedDevice:
    """Device of a Buttplug server."""

    index: int  # may change after a reconnection
    name: str
    display_name: str  # "" without
    label: str  # names, with "#" and the index if several devices have the same names
    facts: Mapping[str, Any]  # entry of the server's list

    @property
    def names(self) -> str:
        """Name, and display name in parentheses if it differs."""
        is_same = self.display_name in ("", self.name)
        return self.name if is_same else f"{self.name} ({self.display_name})"

    def fits(self, how: ButtplugEncoder) -> bool:
        """Test for the names and outputs of a configuration."""
        is_named = any(n.startswith(how.device_name) for n in (self.name, self.display_name))
        return is_named and self.ranges(how) is not None

    def ranges(self, how: ButtplugEncoder) -> list[tuple[int, int]] | None:
        """Lowest and highest level of each configured output; None if an output is missing."""
        ranges = []
        try:
            for feature, kind in how.outputs:
                low, high = self.facts["DeviceFeatures"][str(feature)]["Output"][kind]["Value"]
                ranges.append((int(low), int(high)))
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        return ranges


def served_devices(devices: Mapping[str, Any]) -> list[ServedDevice]:
    """Devices of a server's list, sorted by index; invalid entries are left out.

    Names are cut at 80 characters; labels of equal names end in the index.
    """
    served = []
    for facts in devices.values():
        with suppress(KeyError, TypeError, ValueError, OverflowError):
            index = int(facts["DeviceIndex"])
            keys = ("DeviceName", "DeviceDisplayName")
            name, display_name = (str(facts.get(key) or "")[:80] for key in keys)
            served.append(ServedDevice(index, name, display_name, "", facts))
    served.sort(key=lambda device: device.index)
    # The index distinguishes devices of equal names; otherwise a label has none, as it may change.
    count = Counter(device.names for device in served)
    labels = (f"{x.names} #{x.index}" if count[x.names] > 1 else x.names for x in served)
    return [replace(device, label=label) for device, label in zip(served, labels, strict=True)]


def chosen(unit: str, devices: Sequence[ServedDevice]) -> ServedDevice | None:
    """Device with a label, else with a name or display name, else with ``#`` and an index.

    None without a match, or with several.
    """
    for matches in (
        [x for x in devices if unit == x.label],
        [x for x in devices if unit in (x.names, x.name, x.display_name)],
        [x for x in devices if unit in (f"{x.names} #{x.index}", f"#{x.index}")],
    ):
        if matches:
            return matches[0] if len(matches) == 1 else None
    return None


class Server:
    """Connection to a Buttplug server, shared by all outputs: many servers take one client.

    Raises OutputLostError: no program answers, or not as a Buttplug server of version 4.
    """

    def __init__(self, host: str, port: int) -> None:
        self.users = 0
        self._id = 0
        self._ids = threading.Lock()
        self._ping_s = 0.0  # interval; 0: the server needs no pings
        self._pinged_s = 0.0
        self._info: dict[str, Any] | None = None
        self.devices: list[ServedDevice] | None = None  # newest list; None before the first
        self._fault = ""
        self.unanswered: set[int] = set()  # numbers of stops without an answer, newest of an output
        self._received = threading.Condition()
        self.socket = WebSocket(host, port, "/", self._on_text, self._on_tick)
        name = self.socket.name
        try:
            self.request(
                "RequestServerInfo",
                ClientName="HFX",
                ProtocolVersionMajor=4,
                ProtocolVersionMinor=0,
            )
            expected = f"{name} does not answer. {_EXPECTED}, ServerInfo of version 4."
            info = self._answer(lambda: self._info, expected)
            version = info.get("ProtocolVersionMajor")
            if version != 4:
                raise OutputLostError(
                    f"The Buttplug server at {name} speaks version {shown(str(version))} "
                    "of the protocol; expected is version 4. Update the server."
                )
            self._ping_s = _seconds(info.get("MaxPingTime"))
            self.request("RequestDeviceList")
            self._answer(lambda: self.devices, f"{name} sent no list of devices.")
        except BaseException:  # answers of a server may raise any error
            self.socket.close()
            raise

    def message(self, kind: str, **content: Any) -> dict[str, Any]:
        """Message ``{kind: {"Id": number, **content}}`` with the next number, 1 after 2^32 - 1."""
        with self._ids:
            number = self._id = self._id % 0xFFFFFFFF + 1
        return {kind: {"Id": number, **content}}

    def request(self, kind: str, **content: Any) -> None:
        self.socket.send(json.dumps([self.message(kind, **content)]))

    def await_stop(self, number: int) -> None:
        """Wait, at most :data:`ANSWER_S`, for the answer to a stop with a number.

        Raises OutputLostError: the connection is lost, or no answer has come.
        """
        if number in self.unanswered:
            self._answer(
                lambda: None if number in self.unanswered else True,
                "The server does not confirm the stop.",
            )

    def _answer(self, value: Callable[[], Any], otherwise: str) -> Any:
        """Wait up to 3 s until ``value()`` is not None, and return the value.
        Raises OutputLostError: with text ``otherwise`` after 3 s, or at once by :meth:`check`."""
        until = time.monotonic() + ANSWER_S
        with self._received:
            while value() is None:
                self.check()
                if time.monotonic() > until:
                    raise OutputLostError(otherwise)
                # Short waits, as a lost connection sends no notification.
                self._received.wait(0.05)
        return value()

    def check(self) -> None:
        """Raise ``OutputLostError`` after a lost connection or a reported fault of the server."""
        self.socket.check()
        if self._fault:
            raise OutputLostError(self._fault)

    # Called in the thread of the websocket.

    def _on_text(self, text: str) -> None:
        """Process a JSON list of messages: server facts, device list, Ok of a stop, or a fault, for
        :meth:`check`; other messages are ignored. OutputLostError for anything but such a list."""
        try:
            messages = json.loads(text)
            if not isinstance(messages, list):
                raise TypeError
            with self._received:
                for message in map(dict, messages):
                    if "ServerInfo" in message:
                        self._info = dict(message["ServerInfo"])
                    elif "DeviceList" in message:
                        # Sent after each connection and disconnection of a device, too.
                        self.devices = served_devices(dict(message["DeviceList"]["Devices"]))
                    elif "Ok" in message:
                        self.unanswered.discard(message["Ok"]["Id"])
                    elif "Error" in message:
                        reason = printable(str(message["Error"].get("ErrorMessage", "")))[:200]
                        name = self.socket.name
                        self._fault = f"The Buttplug server at {name} reports a fault: {reason}"
                self._received.notify_all()
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise OutputLostError(
                f"the server sent {shown(text)}. {_EXPECTED}, a JSON list of messages of version 4."
            ) from None

    def _on_tick(self) -> None:
        """Send a ping after 0.3 of the server's interval; a server without pings stops devices."""
        now = time.monotonic()
        if self._ping_s > 0.0 and now > self._pinged_s + 0.3 * self._ping_s:
            self._pinged_s = now
            self.request("Ping")


def _shared(host: str, port: int) -> Server:
    """Existing connection to a server with another user counted, or a new one if none or lost.
    Raises OutputLostError: no Buttplug server of version 4 answers. :func:`_leave` ends the use."""
    key = server_key(host, port)
    with _users:
        # A lost connection is not used again: its devices have been stopped by the server.
        existing = _servers.get(key)
        if existing is not None:
            with suppress(OutputLostError):
                existing.check()
                existing.users += 1
                return existing
    # Outside the lock, as the connection takes time.
    server = Server(host, port)
    with _users:
        server.users = 1
        _servers[key] = server
    return server


def _leave(server: Server) -> None:
    """End a use of a connection; the last end forgets and closes the connection."""
    with _users:
        server.users -= 1
        if server.users > 0:
            return
        for key in [key for key, value in _servers.items() if value is server]:
            del _servers[key]
    server.socket.close()


def devices_at(host: str, port: int) -> list[ServedDevice]:
    """Devices of the Buttplug server at an address, by index; connects for this call, or uses an
    open connection. OutputLostError if no program answers, or not as a server of version 4."""
    server = _shared(host, port)
    try:
        return server.devices or []
    finally:
        _leave(server)


@contextmanager
def scanning(host: str, port: int) -> Iterator[Callable[[], list[ServedDevice]]]:
    """Let the Buttplug server at an address scan for devices, for the time of the block.

    The result is a function for the devices that the server has by now; it raises OutputLostError
    if the server is lost. OutputLostError as for :func:`devices_at`.
    """
    server = _shared(host, port)

    def devices() -> list[ServedDevice]:
        server.check()
        return server.devices or []

    try:
        server.request("StartScanning")
        yield devices
    finally:
        with suppress(OutputLostError):
            server.request("StopScanning")
        _leave(server)


class ButtplugOutput:
    """Output to a device of a Buttplug server.

    ``unit``: choice among several devices, as for :func:`chosen`. "": the device chosen last in
    this process, else the first free device that fits.

    The attribute ``command_interval_s`` is the shortest time between two commands; silence is sent
    at once.

    Raises OutputLostError: the server does not answer, or not in version 4; no device fits or is
    free.
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
        # Outputs to a server open one after another, so that each gets a different device.
        with _opening[key]:
            self._server = _shared(host, port)
            self._socket = self._server.socket
            try:
                self._choose(device.id, key, unit)
            except BaseException:
                self.close()
                raise

    def send(self, values: F64) -> None:
        """Send the changed levels of values (columns,), unless bytes are unsent or the last command
        was less than ``command_interval_s`` ago; silence of all outputs passes the second test.
        Raises OutputLostError: the server is lost, or the device is disconnected."""
        self._server.check()
        # A device that reconnects may have another index, which may belong to another device.
        device = self._device
        served = [(x.index, x.names) for x in self._server.devices or ()]
        if (device.index, device.names) not in served:
            raise OutputLostError("The device was disconnected from the server.")
        now = time.monotonic()
        if self._socket.waiting:
            return
        shares = self._channels.fractions(self._channels.values(values))
        silent = self._channels.fractions(self._channels.neutral)
        # Silence passes the rate limit, so that a stop is never late.
        if now < self._given_s + self.command_interval_s and (shares != silent).any():
            return
        commands = []
        outputs = zip(self._how.outputs, shares, silent, self._ranges, strict=True)
        for k, ((feature, kind), share, rest, (low, high)) in enumerate(outputs):
            level = _level(float(share), float(rest), low, high)
            # A server keeps the last level of an output.
            if level != self._given[k]:
                self._given[k] = level
                commands.append(
                    self._server.message(
                        "OutputCmd",
                        DeviceIndex=device.index,
                        FeatureIndex=feature,
                        Command={kind: {"Value": level}},
                    )
                )
        if commands:
            self._given_s = now
            self._socket.send(json.dumps(commands))

    def stop(self) -> None:
        """Send a stop of this device despite unsent bytes; forget the sent levels; never raises."""
        # After the stop the server's levels are 0, so all levels are sent again.
        self._given = [None] * len(self._given)
        with suppress(OutputLostError):
            command = self._server.message("StopCmd", DeviceIndex=self._device.index)
            self._server.unanswered.discard(self._stop_number)
            self._stop_number = int(command["StopCmd"]["Id"])
            self._server.unanswered.add(self._stop_number)
            self._socket.send(json.dumps([command]), is_urgent=True)

    def close(self) -> None:
        """Wait for the confirmation of the stop; the last output disconnects from the server.

        A disconnection stops all devices. May be called again.

        Raises OutputLostError: the server has not confirmed the stop.
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
        """Choose and reserve a fitting device: by ``unit``, else as the last time, else the first
        free.
        Raises OutputLostError: no device fits, or the device is in use. Sets levels and interval.
        """
        served = self._server.devices or []
        fitting = [x for x in served if x.fits(self._how)]
        name = unit or had_before.get((key, device_id), "")
        # Without a name a free device is preferred; one in use gives a clear message.
        free = [x for x in fitting if are_free([(*key, x.index)])]
        device = chosen(name, fitting) if name else next(iter(free or fitting), None)
        if device is None:
            names = ", ".join(f"{x.names} #{x.index}" for x in served) or "none"
            missing = name or self._how.device_name
            which = f"{'single ' if name else ''}device {repr(missing) + ' ' if missing else ''}"
            raise OutputLostError(f"The server has no {which}that fits; it has: {names}.")
        ranges = device.ranges(self._how)
        assert ranges is not None
        self._reserved = reserve([(*key, device.index)], f"'{device.label}' of the server")
        if len(fitting) > 1:
            had_before[key, device_id] = device.label
        self._device, self._ranges = device, ranges
        self.chosen_device = device.label
        gap_s = _seconds(device.facts.get("DeviceMessageTimingGap"))
        self.command_interval_s = min(max(gap_s, _LEAST_INTERVAL_S), _LONGEST_INTERVAL_S)
        self._given = [None] * len(ranges)


def _seconds(milliseconds: object) -> float:
    """Convert milliseconds of a server to seconds; 0 for anything but a finite number above 0."""
    if isinstance(milliseconds, bool) or not isinstance(milliseconds, int | float):
        return 0.0
    return milliseconds / 1000.0 if 0.0 < milliseconds < math.inf else 0.0


def _level(share: float, rest: float, low: int, high: int) -> int:
    """Convert a share 0..1, silent at ``rest``, to a level ``low``..``high``. A signed feature
    (``low`` < 0) is silent at 0, and each side of ``rest`` is scaled by itself."""
    if low >= 0:
        return round(low + share * (high - low))
    # Above rest the positive half, below it the negative half of the range.
    if share >= rest:
        return round(high * (share - rest) / max(1.0 - rest, 1e-9))
    return round(low * (rest - share) / max(rest, 1e-9))
