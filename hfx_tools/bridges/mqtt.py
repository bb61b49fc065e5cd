# SPDX-License-Identifier: GPL-3.0-or-later
"""Publisher of MQTT 3.1.1 (OASIS standard, 2014): messages of quality 0 to a broker over TCP."""

from __future__ import annotations

import socket
import struct
import time
from contextlib import suppress
from typing import Final

from hfx_blender.errors import DeviceError

KEEP_ALIVE_S: Final = 30
_CONNECT, _CONNACK, _PUBLISH, _PINGREQ, _DISCONNECT = 0x10, 0x20, 0x30, 0xC0, 0xE0
_CLEAN, _PASSWORD, _USER = 0x02, 0x40, 0x80
_REFUSED: Final = {
    1: "it does not accept this version of MQTT",
    2: "it does not accept the client's name",
    3: "it is not available",
    4: "the user name or password is wrong",
    5: "access is not allowed",
}
"""Return codes of table 3.1 of the standard."""


class MqttPublisher:
    """Connection to a broker. Raises DeviceError: the broker cannot be reached, refuses the client,
    or is lost."""

    def __init__(
        self, host: str, port: int, client: str, user: str = "", password: str = ""
    ) -> None:
        self._name = f"MQTT broker {host}:{port}"
        try:
            self._socket = socket.create_connection((host, port), timeout=5.0)
        except OSError as error:
            raise DeviceError(f"{self._name} cannot be reached ({error}).") from None
        flags = _CLEAN | _USER * bool(user) | _PASSWORD * bool(password)
        body = _text("MQTT") + struct.pack(">BBH", 4, flags, KEEP_ALIVE_S) + _text(client)
        body += b"".join(_text(part) for part in (user, password) if part)
        self._send(_CONNECT, body)
        answer = self._received(4)
        if answer[0] != _CONNACK or answer[3]:
            self._socket.close()
            raise DeviceError(f"{self._name}: {_REFUSED.get(answer[3], 'it refuses')}.")
        self._socket.settimeout(5.0)

    def publish(self, topic: str, content: bytes) -> None:
        """Send a message, once and unconfirmed (quality 0)."""
        self._send(_PUBLISH, _text(topic) + content)

    def keep_alive(self) -> None:
        """Send a ping if nothing was sent for half of the time after which the broker closes."""
        if time.monotonic() - self._sent_s > KEEP_ALIVE_S / 2:
            self._send(_PINGREQ, b"")

    def close(self) -> None:
        """Say goodbye and close; never raises."""
        with suppress(DeviceError):
            self._send(_DISCONNECT, b"")
        self._socket.close()

    def _send(self, kind: int, body: bytes) -> None:
        try:
            self._socket.sendall(bytes([kind]) + _length(len(body)) + body)
        except OSError as error:
            raise DeviceError(f"{self._name} is lost ({error}).") from None
        self._sent_s = time.monotonic()

    def _received(self, count: int) -> bytes:
        content = b""
        while len(content) < count:
            try:
                part = self._socket.recv(count - len(content))
            except OSError as error:
                raise DeviceError(f"{self._name} does not answer ({error}).") from None
            if not part:
                raise DeviceError(f"{self._name} closed the connection.")
            content += part
        return content


def _text(text: str) -> bytes:
    """Text with its length in two bytes (section 1.5.3)."""
    content = text.encode()
    return struct.pack(">H", len(content)) + content


def _length(count: int) -> bytes:
    """Remaining length (section 2.2.3): seven bits a byte, lowest first; the top bit: more."""
    content = bytearray()
    while True:
        count, rest = divmod(count, 128)
        content.append(rest | 128 * bool(count))
        if not count:
            return bytes(content)
