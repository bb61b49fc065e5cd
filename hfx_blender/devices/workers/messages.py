# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages between Blender, the output process and script workers: length-prefixed, bounded.

A message is its body's length (uint32), its kind (uint8), the device's number (uint16), all
little-endian, and the body: nothing, float64 values, or JSON followed by plain arrays. Nothing
in it is ever run.
"""

from __future__ import annotations

import json
import math
import struct
from enum import IntEnum
from typing import IO, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...processes.start import read_exactly

Array = npt.NDArray[Any]

MAX_BODY: Final = 1 << 24
"""Largest body of a message: 16 MiB."""

EVERY_DEVICE: Final = 0xFFFF

_HEAD: Final = struct.Struct("<IBH")
_LENGTH: Final = struct.Struct("<I")
_DTYPES: Final = ("<f8", "<f4", "<i4", "<i8")


class MessageKind(IntEnum):
    """Kind of a message."""

    # Blender to the output process
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
    if len(body) > MAX_BODY:
        raise MessageError(f"a message of {len(body)} bytes, allowed are {MAX_BODY}")
    return _HEAD.pack(len(body), kind, device) + body


def read_message(stream: IO[bytes]) -> Message | None:
    """Read the next message of a blocking stream; None at its end, also in the middle of one.

    Raises
    ------
    MessageError
        What comes is not a message.
    """
    head = read_exactly(stream, _HEAD.size)
    if head is None:
        return None
    length, kind, device = _HEAD.unpack(head)
    if length > MAX_BODY:
        raise MessageError(f"a message of {length} bytes, allowed are {MAX_BODY}")
    try:
        known = MessageKind(kind)
    except ValueError:
        raise MessageError(f"a message of the unknown kind {kind}") from None
    body = read_exactly(stream, length)
    return None if body is None else Message(known, device, body)


def encode_values(values: npt.ArrayLike) -> bytes:
    """Encode values (columns,); anything but a row of numbers becomes an empty body, a fault."""
    return as_row(values).astype("<f8").tobytes()


def as_row(values: Any) -> F64:
    """Row of numbers; empty for anything else, such as text, booleans or tables."""
    try:
        found = np.asarray(values)
        is_row = found.ndim == 1 and found.dtype.kind in "fiu"
        return found.astype(np.float64) if is_row else np.zeros(0)
    except (TypeError, ValueError, OverflowError):
        return np.zeros(0)


def decode_values(body: bytes) -> F64:
    """Decode values (columns,); an invalid body gives no values, which the guard rejects."""
    return np.frombuffer(body, "<f8") if len(body) % 8 == 0 else np.zeros(0)


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


def encode_arrays(content: dict[str, Any], arrays: dict[str, Array]) -> bytes:
    """Pack a JSON object and named arrays into one body."""
    parts = [np.ascontiguousarray(each, _dtype(each)) for each in arrays.values()]
    shapes = [
        [name, each.dtype.str, list(each.shape)] for name, each in zip(arrays, parts, strict=True)
    ]
    head = encode_json({"content": content, "arrays": shapes})
    return b"".join((_LENGTH.pack(len(head)), head, *(each.tobytes() for each in parts)))


def decode_arrays(body: bytes) -> tuple[dict[str, Any], dict[str, Array]]:
    """Unpack a body made by :func:`encode_arrays`.

    Raises
    ------
    MessageError
        The body is not such a one.
    """
    try:
        (length,) = _LENGTH.unpack_from(body)
        head = decode_json(body[_LENGTH.size : _LENGTH.size + length])
        place = _LENGTH.size + length
        arrays: dict[str, Array] = {}
        for name, dtype, shape in head["arrays"]:
            if dtype not in _DTYPES:
                raise MessageError(f"array '{name}' of type {dtype}")
            count = math.prod(shape)
            found = np.frombuffer(body, dtype, count, place)
            arrays[name] = found.reshape(shape)
            place += found.nbytes
        return dict(head["content"]), arrays
    except (struct.error, KeyError, ValueError, TypeError) as error:
        raise MessageError(f"not packed arrays: {error}") from None


def _dtype(array: Array) -> str:
    dtype = array.dtype.newbyteorder("<").str
    return dtype if dtype in _DTYPES else "<f8"
