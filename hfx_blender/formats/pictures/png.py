# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG pictures of 8 and 16 bits, and their texts, in numpy and zlib only.

Blender's own writer would put 16 bits through colour management, and its image data needs
Blender; the layers of haptic maps must arrive bit by bit anywhere. (PNG: ISO/IEC 15948.)
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import U8
from ...errors import InputError, refuse_no_file
from ...files import limits
from ...files.atomic import atomic_file

Grey = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_CHANNELS: Final = {0: 1, 2: 3, 4: 2, 6: 4}  # of the colour types that are read
_LONGEST: Final = 1 << 15  # pixels of an edge
_LONGEST_TEXT: Final = 4 << 20  # bytes


def write(values: Grey, path: Path) -> None:
    """Write a picture, top row first: grey (H, W), uint8 or uint16, or colours (H, W, 3), uint8.

    The file says that grey values are linear (gAMA 1), so that no reader takes them for sRGB, and
    that colours are sRGB.

    Raises
    ------
    OutputError
        The file cannot be written; nothing is left of it then.
    """
    deep = values.dtype == np.uint16
    coloured = values.ndim == 3 and values.shape[2] == 3 and not deep
    if not (values.ndim == 2 or coloured) or values.size == 0:
        raise ValueError(f"expected (H, W) or (H, W, 3), got {values.shape} {values.dtype}")
    if values.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"expected uint8 or uint16, got {values.dtype}")
    rows, columns = values.shape[:2]
    data = np.ascontiguousarray(values, ">u2").view(np.uint8) if deep else values
    data = data.reshape(rows, -1)
    lines = np.zeros((rows, data.shape[1] + 1), np.uint8)
    lines[:, 0] = 2  # each row as its difference to the one above: small for smooth maps
    lines[0, 1:] = data[0]
    np.subtract(data[1:], data[:-1], out=lines[1:, 1:])
    kind = 2 if coloured else 0
    header = struct.pack(">IIBBBBB", columns, rows, 16 if deep else 8, kind, 0, 0, 0)
    space = (b"sRGB", b"\0") if coloured else (b"gAMA", struct.pack(">I", 100_000))
    with atomic_file(path) as file:
        file.write(_SIGNATURE)
        file.write(_chunk(b"IHDR", header))
        file.write(_chunk(*space))
        file.write(_chunk(b"IDAT", zlib.compress(lines.tobytes(), 4)))
        file.write(_chunk(b"IEND", b""))


def read(path: Path) -> tuple[Grey, bool]:
    """Read a picture (H, W), top row first, as it is stored, and whether it had colours.

    Of a coloured picture the mean of red, green and blue is taken; transparency is left out.

    Raises
    ------
    InputError
        The file cannot be read, or is no picture of 8 or 16 bits a channel.
    """
    content = _content(path)
    try:
        return decode(content, str(path))
    except InputError:
        raise
    except (ValueError, struct.error, zlib.error) as error:
        raise InputError(f"{path}: is not a PNG picture that can be read ({error}).") from error


def _content(path: Path) -> bytes:
    refuse_no_file(path)
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: no system has a file of such a name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason}).") from error


def decode(content: bytes, name: str) -> tuple[Grey, bool]:
    """:func:`read` from bytes; raises ``ValueError`` and its like for a damaged file."""
    if not content.startswith(_SIGNATURE):
        raise ValueError("no PNG signature")
    chunks = list(_chunks(content))
    if not chunks or chunks[0][0] != b"IHDR" or len(chunks[0][1]) != 13:
        raise ValueError("no header")
    columns, rows, depth, colour, packing, filtering, interlace = struct.unpack(
        ">IIBBBBB", chunks[0][1]
    )
    if depth not in (8, 16) or colour not in _CHANNELS:
        raise ValueError(f"{depth} bits of colour type {colour}; read are 8 and 16, no palette")
    if packing or filtering or interlace:
        raise ValueError("an interlaced or unknown packing")
    if not (0 < rows <= _LONGEST and 0 < columns <= _LONGEST):
        raise ValueError(f"{columns} x {rows} pixels, allowed are edges of 1 to {_LONGEST}")
    limits.PIXELS.check(rows * columns, name, f"{columns} x {rows} are")
    unit = _CHANNELS[colour] * depth // 8
    most_bytes = 5.0 * rows * columns * unit  # packed rows, and rows, and sums in 16 bits
    limits.MEMORY.check(most_bytes, name, "its rows would take")
    size = rows * (columns * unit + 1)
    unpacker = zlib.decompressobj()
    packed = b"".join(data for name, data in chunks if name == b"IDAT")
    raw = unpacker.decompress(packed, size)
    if len(raw) != size:
        raise ValueError(f"{len(raw)} bytes of rows, expected {size}")
    lines = np.frombuffer(raw, np.uint8).reshape(rows, -1)
    data = _unfiltered(lines[:, 0], lines[:, 1:], unit)
    channels: npt.NDArray[Any] = data if depth == 8 else data.view(">u2").astype(np.uint16)
    channels = channels.reshape(rows, columns, _CHANNELS[colour])
    if colour in (0, 4):
        return np.ascontiguousarray(channels[:, :, 0]), False
    mean = np.rint(channels[:, :, :3].mean(axis=2))
    return mean.astype(channels.dtype), True


def texts(path: Path) -> dict[str, str]:
    """Texts of a picture by their keywords (PNG 11.3.4: tEXt, zTXt, iTXt); the first of each.

    What is damaged or longer than 4 MB is passed over; a file that is no PNG has none.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    content = _content(path)
    found: dict[str, str] = {}
    if not content.startswith(_SIGNATURE):
        return found
    with suppress(ValueError):  # of a picture that ends too early; its pixels tell that
        for name, data in _chunks(content):
            with suppress(ValueError, IndexError, zlib.error):
                if name in (b"tEXt", b"zTXt", b"iTXt"):
                    keyword, text = _text(name, data)
                    found.setdefault(keyword, text)
    return found


def _text(name: bytes, data: bytes) -> tuple[str, str]:
    """Keyword and text of a chunk; raises ``ValueError`` and its like for a damaged one."""
    keyword, rest = data.split(b"\0", 1)
    if name == b"tEXt":
        # Latin-1 by the standard; AUTOMATIC1111 and others write UTF-8 there.
        return keyword.decode("latin-1"), _utf8_or_latin(rest[:_LONGEST_TEXT])
    if name == b"zTXt":
        return keyword.decode("latin-1"), _utf8_or_latin(_unpacked(rest[1:]))
    is_packed, rest = rest[0], rest[2:]
    _, _, body = rest.split(b"\0", 2)
    body = _unpacked(body) if is_packed else body[:_LONGEST_TEXT]
    return keyword.decode("latin-1"), body.decode("utf-8", "replace")


def _unpacked(data: bytes) -> bytes:
    return zlib.decompressobj().decompress(data, _LONGEST_TEXT)


def _utf8_or_latin(data: bytes) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def _chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = len(_SIGNATURE)
    while place + 12 <= len(content):
        (size,) = struct.unpack_from(">I", content, place)
        name, data = content[place + 4 : place + 8], content[place + 8 : place + 8 + size]
        end = place + 12 + size
        if end > len(content):
            raise ValueError("it ends too early")
        if struct.unpack_from(">I", content, end - 4)[0] != zlib.crc32(name + data):
            raise ValueError(f"a damaged part '{name.decode('latin-1')}'")
        yield name, data
        if name == b"IEND":
            return
        place = end
    raise ValueError("it ends too early")


def _unfiltered(kinds: U8, lines: U8, unit: int) -> U8:
    """Undo the filters of rows (H, bytes); ``unit`` bytes a pixel."""
    if kinds.max() > 4:
        raise ValueError(f"row filter {kinds.max()}")
    if kinds.max() <= 2:
        done = np.zeros_like(lines)
        above = np.zeros(lines.shape[1], np.uint8)
        for k, kind in enumerate(kinds.tolist()):
            if kind == 1:
                row = lines[k].reshape(-1, unit)
                above = np.cumsum(row, axis=0, dtype=np.uint8).ravel()
            else:
                above = lines[k] + above if kind == 2 else lines[k]
            done[k] = above
        return done
    return _by_diagonals(kinds, lines, unit)


def _by_diagonals(kinds: U8, lines: U8, unit: int) -> U8:
    """Undo filters that look left and up: all pixels of a diagonal are independent."""
    rows, width = lines.shape
    pixels = lines.reshape(rows, width // unit, unit)
    columns = pixels.shape[1]
    done = np.zeros((rows + 1, columns + 1, unit), np.int16)  # a border of zeros above and left
    for diagonal in range(rows + columns - 1):
        i = np.arange(max(0, diagonal - columns + 1), min(rows, diagonal + 1))
        j = diagonal - i
        left, up, corner = done[i + 1, j], done[i, j + 1], done[i, j]
        guess = left + up - corner
        to_left, to_up, to_corner = abs(guess - left), abs(guess - up), abs(guess - corner)
        paeth = np.where(
            (to_left <= to_up) & (to_left <= to_corner),
            left,
            np.where(to_up <= to_corner, up, corner),
        )
        kind = kinds[i][:, None]
        added = np.select(
            [kind == 1, kind == 2, kind == 3, kind == 4],
            [left, up, (left + up) >> 1, paeth],
            np.int16(0),
        )
        done[i + 1, j + 1] = (pixels[i, j] + added) & 255
    return np.ascontiguousarray(done[1:, 1:].astype(np.uint8).reshape(rows, width))
