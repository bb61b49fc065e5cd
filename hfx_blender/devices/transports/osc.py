# SPDX-License-Identifier: GPL-3.0-or-later
"""OSC 1.0 over UDP: our own addresses, or those of VRChat's parameters.

Specification: Wright, "The Open Sound Control 1.0 Specification" (2002).
"""

from __future__ import annotations

import socket
import struct
from contextlib import suppress
from typing import Final

from ...engine.arrays import F64
from ...engine.rendering.device import DeviceConfig
from ...engine.rendering.device_output import OscEncoder
from ..host.encoders import Channels
from ..host.output import OutputLostError

STOPS: Final = 3
MAX_DATAGRAM: Final = 1400
"""Bytes that pass a usual network in one piece."""

_BUNDLE: Final = b"#bundle\0" + struct.pack(">Q", 1)  # time tag 1: at once


def message(address: str, value: float) -> bytes:
    """OSC message with one float32 argument."""
    return _padded(address) + _padded(",f") + struct.pack(">f", value)


def bundles(messages: list[bytes]) -> list[bytes]:
    """Bundle messages so that each bundle fits one datagram."""
    found: list[bytes] = []
    now = _BUNDLE
    for each in messages:
        element = struct.pack(">i", len(each)) + each
        if len(now) + len(element) > MAX_DATAGRAM and now != _BUNDLE:
            found.append(now)
            now = _BUNDLE
        now += element
    return [*found, now]


def addresses(device: DeviceConfig, how: OscEncoder) -> list[str]:
    """The address of each channel; ``{number}`` counts channels from 1, as VRChat's do."""
    names = Channels(device).names
    templates = how.addresses if len(how.addresses) == len(names) else how.addresses * len(names)
    side = device.side or ""
    found = []
    for i, (template, (actuator, control)) in enumerate(zip(templates, names, strict=True)):
        facts = {
            "device": device.id,
            "actuator": actuator,
            "control": control,
            "number": str(i + 1),
            "side": side,
            "Side": side.capitalize(),
        }
        for key, fact in facts.items():
            template = template.replace("{" + key + "}", fact)
        found.append(template)
    return found


class OscOutput:
    """A device behind OSC.

    Parameters
    ----------
    host, port
        Where datagrams go.

    Raises
    ------
    OutputLostError
        There is no way to that host.
    """

    def __init__(self, device: DeviceConfig, how: OscEncoder, host: str, port: int) -> None:
        self._how = how
        self._channels = Channels(device)
        self._addresses = addresses(device, how)
        try:
            family, kind, protocol, _, target = socket.getaddrinfo(
                host, port, type=socket.SOCK_DGRAM, flags=socket.AI_NUMERICSERV
            )[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.setblocking(False)
            self._socket.connect(target)
        except OSError as error:
            raise OutputLostError(f"{host}:{port} cannot be reached ({error}).") from None

    def send(self, values: F64) -> None:
        """Send values (columns,)."""
        self._send(self._channels.values(values))

    def stop(self) -> None:
        """Send neutral values, several times: a datagram may be lost."""
        for _ in range(STOPS):
            with suppress(OutputLostError):
                self._send(self._channels.neutral)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, values: F64) -> None:
        sent = self._channels.fractions(values) if self._how.is_fraction else values
        messages = [message(a, float(v)) for a, v in zip(self._addresses, sent, strict=True)]
        for datagram in bundles(messages) if self._how.is_bundle else messages:
            try:
                self._socket.send(datagram)
            except (BlockingIOError, ConnectionRefusedError):
                # A full queue drops a datagram as any network does. "Refused" tells of one
                # before: the receiver may be started later.
                continue
            except OSError as error:
                raise OutputLostError(f"datagrams cannot be sent ({error}).") from None


def _padded(text: str) -> bytes:
    content = text.encode("ascii") + b"\0"
    return content + b"\0" * (-len(content) % 4)
