# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of the firmware's protocol as bytes, without any port. See docs/wire-protocol.md.

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

from ...engine.rendering.device_config import DEAD_MAN_MS

VERSION: Final = 1

MAX_FRAME: Final = 96
"""Longest encoded frame, bytes."""

FULL_SCALE: Final = 0xFFFF
"""Level of an actuator's maximum."""

_HEAD: Final = struct.Struct("<BBH")
_CRC: Final = struct.Struct("<I")
_CONFIGURE: Final = struct.Struct("<IBHI")  # session, channels, dead-man ms, maximum on ms
_REST: Final = struct.Struct("<I")  # rest ms; optional, by default the board's own
_VALUES: Final = struct.Struct("<IH")  # CRC of the configuration, time to live ms
_READY: Final = struct.Struct("<IB")  # CRC of the configuration, channels
_STOPPED: Final = struct.Struct("<B")


class FrameKind(IntEnum):
    """Kind of a frame; the highest bit marks replies of the board."""

    CONFIGURE = 0x01
    VALUES = 0x02
    STOP = 0x03
    READY = 0x81
    STOPPED = 0x83


class Reason(IntEnum):
    """Reason of a board's silence, in STOPPED."""

    ASKED = 0
    NO_VALUES = 1
    REFUSED = 2  # values before a configuration, or for another configuration


@dataclass(frozen=True)
class Frame:
    """Received frame with a valid CRC."""

    kind: int
    sequence: int
    payload: bytes


def encode_cobs(content: bytes) -> bytes:
    """Encode content by COBS, without zero bytes; longer by a byte for each 254 bytes begun."""
    encoded = bytearray()
    for piece in content.split(b"\0"):
        while len(piece) >= 254:  # no zero is implied after a full block
            encoded.append(255)
            encoded += piece[:254]
            piece = piece[254:]
        encoded.append(len(piece) + 1)
        encoded += piece
    return bytes(encoded)


def decode_cobs(content: bytes) -> bytes | None:
    """Decode COBS without the final zero; None if empty, with a zero byte or a cut-off block."""
    decoded = bytearray()
    at = 0
    while at < len(content):
        length = content[at]
        if length == 0 or at + length > len(content):
            return None
        block = content[at + 1 : at + length]
        if 0 in block:
            return None
        decoded += block
        at += length
        # A zero ends all blocks except full blocks and the last block.
        if length < 255 and at < len(content):
            decoded.append(0)
    return bytes(decoded) if content else None


def encode_frame(kind: int, sequence: int, payload: bytes = b"") -> bytes:
    """Encode a frame between two zeros; the first zero ends a frame that was cut off before."""
    content = _HEAD.pack(VERSION, kind, sequence & 0xFFFF) + payload
    return b"\0" + encode_cobs(content + _CRC.pack(zlib.crc32(content))) + b"\0"


def encode_configuration(
    session: int, channels: int, maximum_on_ms: int, rest_ms: int = 0
) -> bytes:
    """Payload of CONFIGURE; values refer to the CRC-32 of this payload.

    Parameters
    ----------
    session : int
        A number of 32 bits that differs for each configuration sent.
    channels : int
        1 to 32.
    maximum_on_ms : int
        Longest time on; 0: the board's own maximum.
    rest_ms : int
        Rest after ``maximum_on_ms``; 0: the board's own.
    """
    longest = min(maximum_on_ms, 0xFFFFFFFF)
    payload = _CONFIGURE.pack(session, channels, DEAD_MAN_MS, longest)
    return payload + _REST.pack(min(rest_ms, 0xFFFFFFFF)) if rest_ms else payload


def encode_values(
    configuration_crc: int, levels: Sequence[int], live_ms: int = DEAD_MAN_MS
) -> bytes:
    """Payload of VALUES: levels 0..65535 of all channels, valid for ``live_ms`` after arrival."""
    return _VALUES.pack(configuration_crc, live_ms) + struct.pack(f"<{len(levels)}H", *levels)


def decode_ready(payload: bytes) -> tuple[int, int] | None:
    """Decode READY: CRC of the configuration and number of channels; None for a wrong length."""
    if len(payload) != _READY.size:
        return None
    crc, channels = _READY.unpack(payload)
    return crc, channels


def decode_stopped(payload: bytes) -> int | None:
    """Decode STOPPED: a :class:`Reason` as a number; None for a wrong length."""
    return payload[0] if len(payload) == _STOPPED.size else None


class Receiver:
    """Decoder of a stream of bytes; anything but intact frames is dropped."""

    def __init__(self) -> None:
        self.unfinished = bytearray()
        self._is_skipping = False

    def take(self, content: bytes) -> list[Frame]:
        """Append received bytes; return intact frames in order. Text before a zero of more than
        :data:`MAX_FRAME` bytes, and damaged frames, are dropped.
        """
        frames = []
        for byte in content:
            if byte == 0:
                frame = None if self._is_skipping else decode_frame(bytes(self.unfinished))
                if frame is not None:
                    frames.append(frame)
                self.unfinished.clear()
                self._is_skipping = False
            elif len(self.unfinished) >= MAX_FRAME:  # noise: skip to the next zero
                self._is_skipping = True
            else:
                self.unfinished.append(byte)
        return frames


def decode_frame(content: bytes) -> Frame | None:
    """Decode a frame without the zeros; None for another version or a damaged frame."""
    plain = decode_cobs(content)
    if plain is None or len(plain) < _HEAD.size + _CRC.size:
        return None
    # The CRC-32 covers everything before it.
    body, (crc,) = plain[: -_CRC.size], _CRC.unpack(plain[-_CRC.size :])
    version, kind, sequence = _HEAD.unpack(body[: _HEAD.size])
    if version != VERSION or zlib.crc32(body) != crc:
        return None
    return Frame(kind, sequence, body[_HEAD.size :])
