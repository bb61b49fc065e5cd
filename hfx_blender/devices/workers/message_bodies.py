# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies of messages for devices: float64 values, or JSON followed by plain arrays."""

from __future__ import annotations

import math
import struct
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...processes.messages import MessageError, decode_json, encode_json

Array = npt.NDArray[Any]

_LENGTH: Final = struct.Struct("<I")
_DTYPES: Final = ("<f8", "<f4", "<i4", "<i8")


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
