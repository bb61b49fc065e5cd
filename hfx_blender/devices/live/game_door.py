# SPDX-License-Identifier: GPL-3.0-or-later
"""Loopback door through which a game on this computer drives devices, with their limits.

A datagram is ``HFX1``, a token of 16 bytes, a number that rises (uint32), the length of a device's
id (uint8), the id, and a float32 for each of its columns; all little-endian. Whatever else comes
is not heard. Without a valid datagram for the dead-man time a device is silent.
"""

from __future__ import annotations

import hmac
import secrets
import socket
import struct
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device_config import DEAD_MAN_MS, DeviceConfig
from ...errors import UsageError
from .client import LiveClient

ADDRESS: Final = "127.0.0.1"
TOKEN_BYTES: Final = 16
DEAD_MAN_S: Final = DEAD_MAN_MS / 1000.0

_MARK: Final = b"HFX1"
_HEAD: Final = struct.Struct(f"<4s{TOKEN_BYTES}sIB")
_MOST_BYTES: Final = 1 << 16
_MOST_AT_ONCE: Final = 256  # datagrams of one step; who sends more is not waited for


@dataclass(eq=False)
class _Driven:
    """Device, and what it was told last."""

    name: str
    neutral: F64
    number: int = -1  # last one that was heard
    heard_s: float = -np.inf
    first: int | None = None  # first one of a game that may have begun anew

    def is_next(self, number: int, now_s: float) -> bool:
        """Test a datagram's number: it has to rise.

        After the dead-man time a game may begin lower. It is heard from its second datagram on:
        one datagram that is sent again and again is not.
        """
        rises = number > self.number
        if not rises and now_s - self.heard_s > DEAD_MAN_S:
            rises = self.first is not None and number > self.first
            self.first = number
        if rises:
            self.number, self.heard_s, self.first = number, now_s, None
        return rises


class GameDoor:
    """Values of a game for the devices of a client, as a source that :func:`play` plays.

    Parameters
    ----------
    devices : mapping
        Devices by the names under which the client knows them.
    port : int
        0: any that is free.
    token : bytes, optional
        By default a new one.

    Raises
    ------
    UsageError
        There is no such port, or it is taken.
    """

    is_rendered = False
    start_s = 0.0
    end_s = np.inf
    sample_s = 0.01

    def __init__(
        self,
        devices: Mapping[str, DeviceConfig],
        port: int = 0,
        token: bytes | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.token = token or secrets.token_bytes(TOKEN_BYTES)
        self._clock = clock
        self._driven = {
            device.id.encode(): _Driven(name, device.neutral) for name, device in devices.items()
        }
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.bind((ADDRESS, port))
        except OverflowError:
            self.socket.close()
            raise UsageError(f"port {port}: expected 1 to 65535, or 0 for any") from None
        except OSError as error:
            self.socket.close()
            raise UsageError(f"port {port} of {ADDRESS}: {error.strerror}") from None
        self.socket.setblocking(False)
        self.port = int(self.socket.getsockname()[1])

    def close(self) -> None:
        self.socket.close()

    def begin(self, client: LiveClient) -> None:
        """Do nothing: values come rendered."""

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send what has come; neutral values to devices that nothing has come for in time."""
        for _ in range(_MOST_AT_ONCE):
            try:
                datagram = self.socket.recv(_MOST_BYTES)
            except OSError:  # none waits; on Windows also: an answer could not be delivered
                break
            found = self._values(datagram)
            if found is not None:
                client.send(*found)
        now_s = self._clock()
        for each in self._driven.values():
            if now_s - each.heard_s > DEAD_MAN_S:
                client.send(each.name, each.neutral)

    def _values(self, datagram: bytes) -> tuple[str, F64] | None:
        """Device and values of a valid datagram that is newer than the last, else None."""
        if len(datagram) < _HEAD.size:
            return None
        mark, token, number, length = _HEAD.unpack_from(datagram)
        if mark != _MARK or not hmac.compare_digest(token, self.token):
            return None
        driven = self._driven.get(datagram[_HEAD.size : _HEAD.size + length])
        content = datagram[_HEAD.size + length :]
        if driven is None or len(content) != 4 * len(driven.neutral):
            return None
        if not driven.is_next(number, self._clock()):
            return None
        return driven.name, np.frombuffer(content, "<f4").astype(np.float64)
