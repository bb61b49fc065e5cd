# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages between processes of this package, with a length prefix and an upper bound.

Layout: length of the body (uint32), kind (uint8), number (uint16), little-endian, then the body:
empty, text, JSON, float64 values, or JSON with arrays (``devices/workers/message_bodies.py``).
No part of a message is executed as code.
"""

import json
import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import IO, Any, Final, NamedTuple

MAX_BODY: Final = 1 << 24  # largest body of a message, 16 MiB; 16 times as much for the kind JSON
EVERY_DEVICE: Final = 0xFFFF  # number for all devices, and of messages without a number
_HEAD: Final = struct.Struct("<IBH")


class MessageKind(IntEnum):
    """Kind of a message, with the content of the body."""

    # Blender to the output process; the number is the device's.
    HEARTBEAT = 0
    CONNECT = 1  # JSON
    DISCONNECT = 2
    ARM = 3
    STOP = 4
    VALUES = 5  # float64, one for each column
    HAPTICS = 6  # JSON with arrays; also from the output process to a script
    PULSE = 7  # JSON
    SETTINGS = 8  # JSON
    PAUSE = 9  # silence without a stop: of one device, or of all during work of Blender
    SCENE = 10  # JSON: scene data for later moments, for all devices
    MOMENT = 11  # JSON with arrays: the present samples
    # A script worker or render worker to the output process.
    READY = 16
    ANSWER = 17  # float64
    FAULT = 18  # text
    LOG = 19  # text
    # Jobs and their progress, units of a batch, events of the output process; without a number.
    JSON = 32


class Message(NamedTuple):
    """Decoded message; ``device`` is a device's number, or the number of a question."""

    kind: MessageKind
    device: int
    body: bytes


class MessageError(Exception):
    """Raised for data that violates the protocol."""


def message(kind: MessageKind, device: int = EVERY_DEVICE, body: bytes = b"") -> bytes:
    """Encode a message; MessageError for a body above :data:`MAX_BODY`."""
    _check_length(len(body), kind)
    return _HEAD.pack(len(body), kind, device) + body


def json_message(content: Any) -> bytes:
    """Encode a message of the kind JSON; MessageError above 256 MiB."""
    return message(MessageKind.JSON, body=encode_json(content))


def read_message(stream: IO[bytes]) -> Message | None:
    """Read the next message of a buffered stream; None at the end, also within a message. Raises
    MessageError: the data is no message: unknown kind or too long."""
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    length, number, device = _HEAD.unpack(head)
    try:
        kind = MessageKind(number)
    except ValueError:
        kind = None
    # The length first: a damaged head must not allocate gigabytes.
    _check_length(length, kind)
    if kind is None:
        raise MessageError(f"a message of the unknown kind {number}")
    body = stream.read(length)
    return None if len(body) < length else Message(kind, device, body)


def messages(stream: IO[bytes]) -> Iterator[Message]:
    """Yield each message of a buffered stream on arrival; MessageError for invalid data."""
    while (content := read_message(stream)) is not None:
        yield content


def _check_length(length: int, kind: MessageKind | None) -> None:
    """Raise MessageError for a body above 16 MiB, of the kind JSON above 256 MiB."""
    largest = 16 * MAX_BODY if kind is MessageKind.JSON else MAX_BODY
    if length > largest:
        raise MessageError(f"a message of {length} bytes, allowed are {largest}")


def encode_json(content: Any) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode()


def decode_json(body: bytes) -> dict[str, Any]:
    """Decode a JSON object; MessageError for anything else."""
    try:
        content = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"not JSON: {error}") from None
    if not isinstance(content, dict):
        raise MessageError("not a JSON object")
    return content
