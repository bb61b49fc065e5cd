# SPDX-License-Identifier: GPL-3.0-or-later
"""A small uncompressed AVI file, generated: pictures, and optional sound."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

SOUND_HZ = 8000

_HAS_INDEX = _KEY_FRAME = 0x10


def write_movie(
    path: Path, pictures: np.ndarray, rate: int, sound: np.ndarray | None = None
) -> Path:
    """Write a file of the RIFF AVI format.

    Parameters
    ----------
    path : Path
    pictures : (n, height, width, 3) uint8
        Red, green, blue, from the top; the width is a multiple of 4.
    rate : int
        Pictures a second; divides 8000 if there is a sound.
    sound : (m,) int16, optional
        8000 samples a second.
    """
    count, height, width, _ = pictures.shape
    size = width * height * 3
    streams = 1 if sound is None else 2
    main = struct.pack(
        "<14I",
        *(round(1e6 / rate), size * rate, 0, _HAS_INDEX, count, 0, streams),
        *(size, width, height, 0, 0, 0, 0),
    )
    bitmap = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, size, 0, 0, 0, 0)
    heads = [_stream(b"vidsDIB ", 1, rate, count, size, 0, (width, height), bitmap)]
    if sound is not None:
        wave = struct.pack("<HHIIHH", 1, 1, SOUND_HZ, 2 * SOUND_HZ, 2, 16)
        heads.append(
            _stream(b"auds\0\0\0\0", 2, 2 * SOUND_HZ, len(sound), 2 * SOUND_HZ, 2, (0, 0), wave)
        )
    chunks, index, position = [], [], 4
    step = SOUND_HZ // rate
    for k in range(count):
        parts = [(b"00db", pictures[k][::-1, :, ::-1].tobytes())]  # blue first, from the bottom
        if sound is not None:
            parts.append((b"01wb", sound[k * step : (k + 1) * step].astype("<i2").tobytes()))
        for name, data in parts:
            index.append(name + struct.pack("<III", _KEY_FRAME, position, len(data)))
            chunks.append(_chunk(name, data))
            position += len(chunks[-1])
    body = (
        b"AVI "
        + _list(b"hdrl", _chunk(b"avih", main), *heads)
        + _list(b"movi", *chunks)
        + _chunk(b"idx1", b"".join(index))
    )
    path.write_bytes(_chunk(b"RIFF", body))
    return path


def _stream(
    kind: bytes,
    scale: int,
    rate: int,
    length: int,
    buffer: int,
    sample: int,
    corner: tuple[int, int],
    form: bytes,
) -> bytes:
    numbers = (0, 0, 0, 0, scale, rate, 0, length, buffer, -1, sample)
    header = kind + struct.pack("<IHHIIIIIIiI4H", *numbers, 0, 0, *corner)
    return _list(b"strl", _chunk(b"strh", header), _chunk(b"strf", form))


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2)


def _list(kind: bytes, *parts: bytes) -> bytes:
    return _chunk(b"LIST", kind + b"".join(parts))
