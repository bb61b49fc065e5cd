# SPDX-License-Identifier: GPL-3.0-or-later
"""OSC 1.0 over UDP, with addresses as configured, such as VRChat's parameters."""

import socket
from contextlib import suppress
from typing import Final

from pythonosc.parsing import osc_types

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig, OscEncoder
from ..host.encoders import Channels, osc_addresses
from ..host.output import OutputLostError

STOPS: Final = 3
MAX_DATAGRAM: Final = 1400
"""Largest datagram, bytes: below the packet size of usual networks."""

_BUNDLE: Final = osc_types.write_string("#bundle") + osc_types.write_date(osc_types.IMMEDIATELY)


# python-osc's builders decode each encoded message again: 40 actuators at 1 kHz would need a whole
# processor core. The functions for single OSC types need a tenth.
def message(address: str, value: float) -> bytes:
    """Encode an OSC message with the float32 argument ``value``."""
    types = osc_types.write_string(",f")
    return osc_types.write_string(address) + types + osc_types.write_float(value)


def bundles(messages: list[bytes]) -> list[bytes]:
    """Pack messages in order into as few bundles of 1400 bytes at most; a longer message has a
    bundle of its own. An empty list gives one bundle without messages."""
    complete: list[bytes] = []
    bundle = _BUNDLE
    for content in messages:
        element = osc_types.write_int(len(content)) + content
        # A full bundle is complete, unless the message alone exceeds the limit.
        if len(bundle) + len(element) > MAX_DATAGRAM and bundle != _BUNDLE:
            complete.append(bundle)
            bundle = _BUNDLE
        bundle += element
    return [*complete, bundle]


class OscOutput:
    """Output to an OSC receiver at ``host`` and ``port``; OutputLostError if unreachable."""

    def __init__(self, device: DeviceConfig, how: OscEncoder, host: str, port: int) -> None:
        self._how = how
        self._name = f"{host}:{port}"
        self._channels = Channels(device)
        self._addresses = osc_addresses(device, how)
        try:
            # AI_NUMERICSERV: the port is a number, without a lookup of services.
            family, kind, protocol, _, target = socket.getaddrinfo(
                host, port, type=socket.SOCK_DGRAM, flags=socket.AI_NUMERICSERV
            )[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.setblocking(False)
            self._socket.connect(target)
        except OSError as error:
            raise OutputLostError(f"{self._name} cannot be reached ({error}).") from None

    def send(self, values: F64) -> None:
        """Send values (columns,)."""
        self._send(self._channels.values(values))

    def stop(self) -> None:
        """Send neutral values three times, as datagrams may be lost, without OutputLostError."""
        for _ in range(STOPS):
            with suppress(OutputLostError):
                self._send(self._channels.neutral)

    def close(self) -> None:
        """Close the socket, without a stop."""
        self._socket.close()

    def _send(self, values: F64) -> None:
        sent = self._channels.fractions(values) if self._how.is_fraction else values
        messages = [message(a, float(v)) for a, v in zip(self._addresses, sent, strict=True)]
        for datagram in bundles(messages) if self._how.is_bundle else messages:
            try:
                self._socket.send(datagram)
            except (BlockingIOError, ConnectionRefusedError):
                # A full queue drops the datagram, as any network may. "Refused" is the answer to
                # an earlier datagram: the receiver may be started later.
                continue
            except OSError as error:
                raise OutputLostError(
                    f"{self._name}: a datagram cannot be sent ({error})."
                ) from None
