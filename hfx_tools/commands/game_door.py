# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a game on this computer for devices, by UDP datagrams to the loopback address.

A datagram is ``HFX1``, a token of 16 bytes, a rising number (uint32), the length of a device's id
(uint8), the id, and a float32 for each column of the device, all little-endian. Invalid datagrams
are ignored. A device without a valid datagram for the dead-man time is silent.
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

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.engine.arrays import F64
from hfx_blender.engine.rendering.device_config import DEAD_MAN_MS, DeviceConfig
from hfx_blender.errors import UsageError

ADDRESS: Final = "127.0.0.1"
TOKEN_BYTES: Final = 16
DEAD_MAN_S: Final = DEAD_MAN_MS / 1000.0

_MARK: Final = b"HFX1"
_HEAD: Final = struct.Struct(f"<4s{TOKEN_BYTES}sIB")
_MOST_BYTES: Final = 1 << 16
_MOST_AT_ONCE: Final = 256  # datagrams read in one step


@dataclass(eq=False)
class _Driven:
    """Device, and the state of received datagrams."""

    name: str
    neutral: F64  # (columns,)
    number: int = -1  # of the last accepted datagram
    heard_s: float = -np.inf  # time of the last accepted datagram
    first: int | None = None  # first number of a game that may have been restarted

    def is_next(self, number: int, now_s: float) -> bool:
        """Accept or reject a datagram by the rising number; updates the state.

        After the dead-man time a restarted game may start at a lower number: the first datagram
        is rejected and the second accepted, so that a repeated datagram stays rejected.
        """
        rises = number > self.number
        # A lower number after a silence: the second datagram of a restarted game is accepted. A
        # single one may be a late copy, which a network can repeat at any time.
        if not rises and now_s - self.heard_s > DEAD_MAN_S:
            rises = self.first is not None and number > self.first
            self.first = number
        if rises:
            self.number, self.heard_s, self.first = number, now_s, None
        return rises


class GameDoor:
    """Values of a game as a :class:`.playback_loop.ValueSource`, without an end.

    ``devices``: devices by their names in the client.
    ``port``: UDP port; 0: any free port. The attribute ``port`` has the port in use.
    ``token``: secret of 16 bytes, also an attribute; random by default.

    Raises UsageError: the port is not allowed or in use.
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
        """Close the socket."""
        self.socket.close()

    def begin(self, client: LiveClient) -> None:
        """Do nothing: values need no scene."""

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send values of up to 256 received datagrams, and neutral values to each device without a
        valid datagram for the dead-man time; ``time_s`` is not used."""
        for _ in range(_MOST_AT_ONCE):
            try:
                datagram = self.socket.recv(_MOST_BYTES)
            except OSError:  # no datagram; on Windows also an undeliverable answer
                break
            accepted = self._values(datagram)
            if accepted is not None:
                client.send(*accepted)
        now_s = self._clock()
        for driven in self._driven.values():
            if now_s - driven.heard_s > DEAD_MAN_S:
                client.send(driven.name, driven.neutral)

    def _values(self, datagram: bytes) -> tuple[str, F64] | None:
        """Device name and values (columns,) of a datagram with right mark, token, known id, length
        and rising number; else None. Updates the device's last number and time."""
        if len(datagram) < _HEAD.size:
            return None
        mark, token, number, length = _HEAD.unpack_from(datagram)
        # Compared in constant time, so that the token cannot be guessed byte by byte.
        if mark != _MARK or not hmac.compare_digest(token, self.token):
            return None
        driven = self._driven.get(datagram[_HEAD.size : _HEAD.size + length])
        content = datagram[_HEAD.size + length :]
        if driven is None or len(content) != 4 * len(driven.neutral):
            return None
        if not driven.is_next(number, self._clock()):
            return None
        return driven.name, np.frombuffer(content, "<f4").astype(np.float64)
