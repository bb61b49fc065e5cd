# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies of messages for devices: float64 values, or JSON with arrays."""

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
    """Encode values (columns,) as float64; anything but a row of numbers as an empty body.

    An empty body stops the device with a fault.
    """
    return as_row(values).astype("<f8").tobytes()


def as_row(values: Any) -> F64:
    """Convert a row of numbers to float64 (n,); anything else, as text or booleans, to (0,)."""
    try:
        row = np.asarray(values)
        is_row = row.ndim == 1 and row.dtype.kind in "fiu"
        return row.astype(np.float64) if is_row else np.zeros(0)
    except (TypeError, ValueError, OverflowError):
        return np.zeros(0)


def decode_values(body: bytes) -> F64:
    """Decode values (columns,); an invalid length gives (0,), which a device thread rejects."""
    return np.frombuffer(body, "<f8") if len(body) % 8 == 0 else np.zeros(0)


def encode_arrays(content: dict[str, Any], arrays: dict[str, Array]) -> bytes:
    """Encode a JSON object and named arrays as a body.

    Arrays of types other than float32, float64, int32 and int64 are converted to float64.
    """
    # Arrays are sent as raw memory: JSON would cost most of the time of a frame.
    parts, shapes = [], []
    for name, array in arrays.items():
        dtype = array.dtype.newbyteorder("<").str
        parts.append(np.ascontiguousarray(array, dtype if dtype in _DTYPES else "<f8"))
        shapes.append([name, parts[-1].dtype.str, list(parts[-1].shape)])
    # Length of the JSON head, head, then all arrays without gaps.
    head = encode_json({"content": content, "arrays": shapes})
    return b"".join((_LENGTH.pack(len(head)), head, *(part.tobytes() for part in parts)))


def decode_arrays(body: bytes) -> tuple[dict[str, Any], dict[str, Array]]:
    """Decode a body of :func:`encode_arrays`; arrays are read-only. MessageError if invalid."""
    try:
        (length,) = _LENGTH.unpack_from(body)
        head = decode_json(body[_LENGTH.size : _LENGTH.size + length])
        offset = _LENGTH.size + length
        arrays: dict[str, Array] = {}
        for name, dtype, shape in head["arrays"]:
            if dtype not in _DTYPES:
                raise MessageError(f"array '{name}' of type {dtype}")
            count = math.prod(shape)
            flat = np.frombuffer(body, dtype, count, offset)
            arrays[name] = flat.reshape(shape)
            offset += flat.nbytes
        return dict(head["content"]), arrays
    except (struct.error, KeyError, ValueError, TypeError) as error:
        raise MessageError(f"not packed arrays: {error}") from None
