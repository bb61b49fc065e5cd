# SPDX-License-Identifier: GPL-3.0-or-later
"""The protocol of our firmware: frames as bytes, without any port. See docs/wire-protocol.md.

A frame is ``version, type, sequence (2), payload, CRC-32 (4)``, little-endian, then COBS
(Cheshire and Baker, IEEE/ACM Transactions on Networking 1999), then a zero byte.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from ...engine.rendering.device_output import DEAD_MAN_MS

VERSION: Final = 1

MAX_FRAME: Final = 96
"""Longest frame as sent, bytes."""

FULL_SCALE: Final = 0xFFFF

_HEAD: Final = struct.Struct("<BBH")
_CRC: Final = struct.Struct("<I")
_CONFIGURE: Final = struct.Struct("<IBHI")  # session, channels, dead-man ms, most on ms
_REST: Final = struct.Struct("<I")  # ms; a configuration without has the board's own
_VALUES: Final = struct.Struct("<IH")  # CRC of the configuration, time to live ms
_READY: Final = struct.Struct("<IB")  # CRC of the configuration, channels
_STOPPED: Final = struct.Struct("<B")


class FrameKind(IntEnum):
    """Kind of a frame; replies have the highest bit."""

    CONFIGURE = 0x01
    VALUES = 0x02
    STOP = 0x03
    READY = 0x81
    STOPPED = 0x83


class Reason(IntEnum):
    """Reason why a board fell silent."""

    ASKED = 0
    NO_VALUES = 1
    REFUSED = 2  # values before a configuration, or for another one


@dataclass(frozen=True)
class Frame:
    """Frame that arrived whole."""

    kind: int
    sequence: int
    payload: bytes


def encode_cobs(content: bytes) -> bytes:
    """Encode content without zero bytes (COBS), at most one byte in 254 longer."""
    found = bytearray()
    for piece in content.split(b"\0"):
        while len(piece) >= 254:  # a full block is not followed by a zero
            found.append(255)
            found += piece[:254]
            piece = piece[254:]
        found.append(len(piece) + 1)
        found += piece
    return bytes(found)


def decode_cobs(content: bytes) -> bytes | None:
    """Decode :func:`encode_cobs` content; None if it is not valid."""
    found = bytearray()
    at = 0
    while at < len(content):
        length = content[at]
        if length == 0 or at + length > len(content):
            return None
        block = content[at + 1 : at + length]
        if 0 in block:
            return None
        found += block
        at += length
        if length < 255 and at < len(content):
            found.append(0)
    return bytes(found) if content else None


def encode_frame(kind: int, sequence: int, payload: bytes = b"") -> bytes:
    """Encode a frame. The zero in front ends whatever was cut off before it."""
    content = _HEAD.pack(VERSION, kind, sequence & 0xFFFF) + payload
    return b"\0" + encode_cobs(content + _CRC.pack(zlib.crc32(content))) + b"\0"


def encode_configuration(
    session: int, channels: int, maximum_on_ms: int, rest_ms: int = 0
) -> bytes:
    """Payload of CONFIGURE; values refer to its CRC-32.

    Parameters
    ----------
    session : int
        A number of 32 bits that differs each time.
    channels : int
        1 to 32.
    maximum_on_ms : int
        0: the board's own maximum.
    rest_ms : int
        After so much time on; 0: the board's own.
    """
    longest = min(maximum_on_ms, 0xFFFFFFFF)
    payload = _CONFIGURE.pack(session, channels, DEAD_MAN_MS, longest)
    return payload + _REST.pack(min(rest_ms, 0xFFFFFFFF)) if rest_ms else payload


def encode_values(
    configuration_crc: int, levels: Sequence[int], live_ms: int = DEAD_MAN_MS
) -> bytes:
    """Payload of VALUES: levels 0..65535, valid for ``live_ms`` after they arrive."""
    return _VALUES.pack(configuration_crc, live_ms) + struct.pack(f"<{len(levels)}H", *levels)


def decode_ready(payload: bytes) -> tuple[int, int] | None:
    """CRC of the configuration and number of channels of a READY; None: garbled."""
    if len(payload) != _READY.size:
        return None
    crc, channels = _READY.unpack(payload)
    return crc, channels


def decode_stopped(payload: bytes) -> int | None:
    """Reason of a STOPPED; None: garbled."""
    return payload[0] if len(payload) == _STOPPED.size else None


class Receiver:
    """Frames out of a stream; whatever is not a whole, intact frame is dropped."""

    def __init__(self) -> None:
        self.unfinished = bytearray()
        self._is_skipping = False

    def take(self, content: bytes) -> list[Frame]:
        """Frames that ``content`` completes."""
        found = []
        for byte in content:
            if byte == 0:
                each = None if self._is_skipping else decode_frame(bytes(self.unfinished))
                if each is not None:
                    found.append(each)
                self.unfinished.clear()
                self._is_skipping = False
            elif len(self.unfinished) >= MAX_FRAME:
                self._is_skipping = True
            else:
                self.unfinished.append(byte)
        return found


def decode_frame(content: bytes) -> Frame | None:
    """Parse a frame without its zeros; None for other versions and damaged ones."""
    plain = decode_cobs(content)
    if plain is None or len(plain) < _HEAD.size + _CRC.size:
        return None
    body, (crc,) = plain[: -_CRC.size], _CRC.unpack(plain[-_CRC.size :])
    version, kind, sequence = _HEAD.unpack(body[: _HEAD.size])
    if version != VERSION or zlib.crc32(body) != crc:
        return None
    return Frame(kind, sequence, body[_HEAD.size :])
