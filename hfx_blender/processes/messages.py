# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages between processes of this package: length-prefixed, bounded.

A message is its body's length (uint32), its kind (uint8), a number (uint16), all little-endian, and
the body: nothing, text, JSON, float64 values, or JSON followed by plain arrays
(``devices/workers/message_bodies.py``). Nothing in it is ever run.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import IO, Any, Final, NamedTuple

MAX_BODY: Final = 1 << 24
"""Largest body of a message, 16 MiB; of one that is all JSON, 16 times as much."""

EVERY_DEVICE: Final = 0xFFFF

_HEAD: Final = struct.Struct("<IBH")


class MessageKind(IntEnum):
    """Kind of a message."""

    # Blender to the output process; the number is the device's
    HEARTBEAT = 0
    CONNECT = 1  # JSON
    DISCONNECT = 2
    ARM = 3
    STOP = 4
    VALUES = 5  # float64, one for each column
    HAPTICS = 6  # packed; also on to a script
    PULSE = 7  # JSON
    SETTINGS = 8  # JSON
    PAUSE = 9  # silence without a stop: of one device, or of all while Blender works
    SCENE = 10  # JSON; scene data for rendering its moments, for all devices
    MOMENT = 11  # packed: the present samples
    # a script worker, or the one that renders, back to the output process
    READY = 16
    ANSWER = 17  # float64
    FAULT = 18  # text
    LOG = 19  # text
    # jobs and their progress, units of a batch, events of the output process; without a number
    JSON = 32


class Message(NamedTuple):
    """Message as it was read."""

    kind: MessageKind
    device: int
    body: bytes


class MessageError(Exception):
    """Raised for input that breaks the protocol."""


def message(kind: MessageKind, device: int = EVERY_DEVICE, body: bytes = b"") -> bytes:
    """The bytes of a message.

    Raises
    ------
    MessageError
        The body is longer than :data:`MAX_BODY`.
    """
    _check_length(len(body), kind)
    return _HEAD.pack(len(body), kind, device) + body


def json_message(content: Any) -> bytes:
    """The bytes of a message whose body is JSON."""
    return message(MessageKind.JSON, body=encode_json(content))


def read_message(stream: IO[bytes]) -> Message | None:
    """Read the next message of a buffered stream; None at its end, also in the middle of one.

    Raises
    ------
    MessageError
        What comes is not a message.
    """
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    length, number, device = _HEAD.unpack(head)
    try:
        kind = MessageKind(number)
    except ValueError:
        kind = None
    _check_length(length, kind)
    if kind is None:
        raise MessageError(f"a message of the unknown kind {number}")
    body = stream.read(length)
    return None if len(body) < length else Message(kind, device, body)


def messages(stream: IO[bytes]) -> Iterator[Message]:
    """Yield the messages of a buffered stream, each as soon as it is there, to its end.

    Raises
    ------
    MessageError
        What comes is not a message.
    """
    while (found := read_message(stream)) is not None:
        yield found


def _check_length(length: int, kind: MessageKind | None) -> None:
    largest = 16 * MAX_BODY if kind is MessageKind.JSON else MAX_BODY
    if length > largest:
        raise MessageError(f"a message of {length} bytes, allowed are {largest}")


def encode_json(content: Any) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode()


def decode_json(body: bytes) -> dict[str, Any]:
    """A JSON object.

    Raises
    ------
    MessageError
        It is none.
    """
    try:
        found = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"not JSON: {error}") from None
    if not isinstance(found, dict):
        raise MessageError("not a JSON object")
    return found
