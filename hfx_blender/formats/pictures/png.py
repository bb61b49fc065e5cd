# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG pictures of 8 and 16 bits, and their texts (ISO/IEC 15948), with numpy and zlib only.

Blender's writer would apply colour management to 16 bits, and image data needs Blender; the layers
of haptic maps have to be exact in any process.
"""

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import U8
from ...errors import InputError
from ...files import limits
from ...files.atomic import atomic_file
from ...files.strict_json import read_data

Grey = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_CHANNELS: Final = {0: 1, 2: 3, 4: 2, 6: 4}  # by supported colour type
_LONGEST: Final = 1 << 15  # pixels of an edge
_LONGEST_TEXT: Final = 4 << 20  # bytes


def write(values: Grey, path: Path) -> None:
    """Write the picture of :func:`encoded`. Raises OutputError for an unwritable file (no partial
    file remains), and ValueError for another shape or type."""
    content = encoded(values)
    with atomic_file(path) as file:
        file.write(content)


def encoded(values: Grey) -> bytes:
    """Encode a picture, top row first: grey (H, W) of uint8 or uint16, or RGB (H, W, 3) of uint8.
    Grey values are marked as linear (gAMA 1), colours as sRGB. Raises ValueError for another shape
    or type."""
    is_deep = values.dtype == np.uint16
    is_coloured = values.ndim == 3 and values.shape[2] == 3 and not is_deep
    if not (values.ndim == 2 or is_coloured) or values.size == 0:
        raise ValueError(f"expected (H, W) or (H, W, 3), got {values.shape} {values.dtype}")
    if values.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"expected uint8 or uint16, got {values.dtype}")
    rows, columns = values.shape[:2]
    data = np.ascontiguousarray(values, ">u2").view(np.uint8) if is_deep else values
    data = data.reshape(rows, -1)
    lines = np.zeros((rows, data.shape[1] + 1), np.uint8)
    lines[:, 0] = 2  # filter Up: differences of rows compress smooth maps well
    lines[0, 1:] = data[0]
    # Wraps at 256, as the filter demands.
    np.subtract(data[1:], data[:-1], out=lines[1:, 1:])
    kind = 2 if is_coloured else 0
    header = struct.pack(">IIBBBBB", columns, rows, 16 if is_deep else 8, kind, 0, 0, 0)
    space = (b"sRGB", b"\0") if is_coloured else (b"gAMA", struct.pack(">I", 100_000))
    data_chunk = _chunk(b"IDAT", zlib.compress(lines.tobytes(), 4))
    return _SIGNATURE + _chunk(b"IHDR", header) + _chunk(*space) + data_chunk + _chunk(b"IEND", b"")


def read(path: Path) -> tuple[Grey, bool]:
    """Read a picture as grey values (H, W), top row first; second, True for a coloured picture.
    Colours become the mean of red, green and blue; transparency is dropped. Raises InputError for
    an unreadable file, and for palettes, interlacing or other depths than 8 and 16 bits."""
    content = read_data(path)
    try:
        return decode(content, str(path))
    except InputError:
        raise
    except (ValueError, struct.error, zlib.error) as error:
        raise InputError(f"{path}: is not a PNG picture that can be read ({error}).") from error


def decode(content: bytes, name: str) -> tuple[Grey, bool]:
    """Decode the bytes of :func:`read`. Raises ValueError, struct.error or zlib.error for damaged
    content."""
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
    # Sizes are checked before unpacking: a small file may claim gigabytes.
    limits.PIXELS.check(rows * columns, name, f"{columns} x {rows} are")
    unit = _CHANNELS[colour] * depth // 8
    most_bytes = 5.0 * rows * columns * unit  # packed rows, and rows, and sums in 16 bits
    limits.MEMORY.check(most_bytes, name, "its rows would take")
    size = rows * (columns * unit + 1)
    # At most the bytes of the rows are unpacked.
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
    """Texts of a picture by keyword (tEXt, zTXt, iTXt; PNG 11.3.4), the first for each keyword.
    Damaged texts, and all texts after a damaged chunk, are skipped; texts are cut at 4 MiB. Empty
    for files of another kind. Raises InputError for an unreadable file."""
    content = read_data(path)
    texts_by_keyword: dict[str, str] = {}
    if not content.startswith(_SIGNATURE):
        return texts_by_keyword
    with suppress(ValueError):  # truncation is reported by the reader of the pixels
        for name, data in _chunks(content):
            with suppress(ValueError, IndexError, zlib.error):
                if name in (b"tEXt", b"zTXt", b"iTXt"):
                    keyword, text = _text(name, data)
                    texts_by_keyword.setdefault(keyword, text)
    return texts_by_keyword


def _text(name: bytes, data: bytes) -> tuple[str, str]:
    """Keyword and text of a chunk; ValueError, IndexError or zlib.error for a damaged chunk."""
    keyword, rest = data.split(b"\0", 1)
    if name == b"tEXt":
        is_packed, body = False, rest
    elif name == b"zTXt":
        is_packed, body = True, rest[1:]  # after the number of the packing
    else:  # iTXt: whether packed, number of the packing, language, translated keyword, text
        is_packed = bool(rest[0])
        _, _, body = rest[2:].split(b"\0", 2)
    # A limit on the output: a small chunk may unpack to gigabytes.
    body = zlib.decompressobj().decompress(body, _LONGEST_TEXT) if is_packed else body
    body = body[:_LONGEST_TEXT]
    try:
        text = body.decode("utf-8", "replace" if name == b"iTXt" else "strict")
    except UnicodeDecodeError:
        # The standard says Latin-1; AUTOMATIC1111 and other programs write UTF-8.
        text = body.decode("latin-1")
    return keyword.decode("latin-1"), text


def _chunk(name: bytes, data: bytes) -> bytes:
    """Encode a chunk: length, name, data, CRC."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def _chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield (name, data) of the chunks up to IEND; ValueError for a damaged or missing chunk."""
    offset = len(_SIGNATURE)
    while offset + 12 <= len(content):
        (size,) = struct.unpack_from(">I", content, offset)
        name, data = content[offset + 4 : offset + 8], content[offset + 8 : offset + 8 + size]
        end = offset + 12 + size
        if end > len(content):
            raise ValueError("it ends too early")
        if struct.unpack_from(">I", content, end - 4)[0] != zlib.crc32(name + data):
            raise ValueError(f"a damaged part '{name.decode('latin-1')}'")
        yield name, data
        if name == b"IEND":
            return
        offset = end
    raise ValueError("it ends too early")


def _unfiltered(kinds: U8, lines: U8, unit: int) -> U8:
    """Undo the row filters ``kinds`` (H,) of ``lines`` (H, bytes); ``unit``: bytes per pixel.
    Returns new rows (H, bytes). Raises ValueError for a filter above 4."""
    if kinds.max() > 4:
        raise ValueError(f"row filter {kinds.max()}")
    rows, width = lines.shape
    if kinds.max() <= 2:
        # Filters None, Sub and Up need no loop over pixels: bytes are sums modulo 256.
        unfiltered = np.zeros_like(lines)
        above = np.zeros(width, np.uint8)
        for k, kind in enumerate(kinds.tolist()):
            if kind == 1:
                row = lines[k].reshape(-1, unit)
                above = np.cumsum(row, axis=0, dtype=np.uint8).ravel()
            else:
                above = lines[k] + above if kind == 2 else lines[k]
            unfiltered[k] = above
        return unfiltered
    pixels = lines.reshape(rows, width // unit, unit)
    columns = pixels.shape[1]
    done = np.zeros((rows + 1, columns + 1, unit), np.int16)  # a border of zeros above and left
    # Average and Paeth depend on the pixels to the left, above, and above left: these are on
    # earlier anti-diagonals, so each anti-diagonal is one array operation.
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
        # Filters of PNG: 1 Sub, 2 Up, 3 Average, 4 Paeth.
        kind = kinds[i][:, None]
        added = np.select(
            [kind == 1, kind == 2, kind == 3, kind == 4],
            [left, up, (left + up) >> 1, paeth],
            np.int16(0),
        )
        done[i + 1, j + 1] = (pixels[i, j] + added) & 255
    return np.ascontiguousarray(done[1:, 1:].astype(np.uint8).reshape(rows, width))
