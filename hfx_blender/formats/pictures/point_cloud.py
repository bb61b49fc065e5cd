# SPDX-License-Identifier: GPL-3.0-or-later
"""Point clouds of scanners: PLY (text or binary) and XYZ (a point per line)."""

import codecs
import io
import warnings
from pathlib import Path
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ...errors import InputError
from ...files.strict_json import read_data

SUFFIXES: Final = (".ply", ".xyz", ".txt", ".csv", ".asc")
MOST_POINTS: Final = 50_000_000
_MOST_HEADER = 65_536

_TYPES: Final = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


def read(path: Path) -> F64:
    """Read the points (N, 3) of a file in the file's unit, without non-finite points. Raises
    InputError for a missing, unknown or damaged file, or fewer than three points."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: expected a point cloud ({', '.join(SUFFIXES)}).")
    content = read_data(path).removeprefix(codecs.BOM_UTF8)
    points = _ply(content, path) if path.suffix.lower() == ".ply" else _lines(content, path)
    # Scanners write NaN where nothing was measured.
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3:
        raise InputError(f"{path}: {len(points)} points; a surface needs three at least.")
    return points


def _lines(content: bytes, path: Path) -> F64:
    """First three columns (N, 3) of text lines, separated by spaces, commas or semicolons. Comments
    begin with # or //; N may be 0. Raises InputError for another line."""
    text = content.replace(b",", b" ").replace(b";", b" ")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty file is reported by the caller
            table = np.loadtxt(
                io.BytesIO(text), np.float64, comments=("#", "//"), usecols=(0, 1, 2), ndmin=2
            )
    except (ValueError, IndexError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0][:200]
        raise InputError(f"{path}: expected x, y and z in each line ({reason}).") from error
    return table.reshape(-1, 3)


def _ply(content: bytes, path: Path) -> F64:
    """Vertices (N, 3) of a PLY file, not all finite; N may be 0. Raises InputError for another
    file, vertices without x, y and z, data before the vertices, and fewer or other vertices than
    the header states."""
    head, mark, body = content.partition(b"end_header")
    if not content.startswith(b"ply") or not mark or len(head) > _MOST_HEADER:
        raise InputError(f"{path}: is no PLY file.")
    body = body.partition(b"\n")[2]
    order, before, count, columns = _header(head.decode("ascii", "replace").split("\n"), path)
    if before:
        raise InputError(f"{path}: its points do not come first; save it with vertices first.")
    names = [name for name, _ in columns]
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path}: its vertices have no x, y and z.")
    if order == "":
        lines = body.split(b"\n", count)[:count]
        if len(lines) < count or (count and not lines[-1].strip()):
            raise InputError(f"{path}: ends early; {count} points were announced.")
        places = [names.index(axis) for axis in "xyz"]
        try:
            return np.loadtxt(lines, np.float64, usecols=places, ndmin=2).reshape(-1, 3)
        except (ValueError, IndexError) as error:
            reason = str(error).splitlines()[0][:200]
            raise InputError(f"{path}: a point is no three numbers ({reason}).") from error
    # A binary vertex is a packed record of the header's properties.
    record = np.dtype([(name, order + kind) for name, kind in columns])
    if len(body) < count * record.itemsize:
        raise InputError(f"{path}: ends early; {count} points were announced.")
    table = np.frombuffer(body, record, count)
    with np.errstate(invalid="ignore"):  # any kind of NaN: it is left out
        return np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _header(lines: list[str], path: Path) -> tuple[str, bool, int, list[tuple[str, str]]]:
    """Parse a PLY header: byte order ("" for text), data before the vertices, count, columns.
    Columns are (name, numpy type) of the vertex. Raises InputError for a broken header, list
    properties of vertices, or too many vertices."""
    orders = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    order, count, columns, element, before = None, -1, [], "", False
    try:
        for words in (line.split() for line in lines):
            if words[:1] == ["format"]:
                order = orders.get(words[1])
            # Elements before the vertices have rows of unknown length, unless they are empty.
            elif words[:1] == ["element"]:
                element, size = words[1], int(words[2])
                if element == "vertex":
                    count = size
                elif count < 0 and size:
                    before = True
            elif words[:1] == ["property"] and element == "vertex":
                columns.append((words[2], _TYPES[words[1]]))  # a list has no such type
    except (IndexError, ValueError, KeyError) as error:
        raise InputError(f"{path}: its PLY header is broken ({error}).") from error
    if order is None or not 0 <= count <= MOST_POINTS or len(dict(columns)) != len(columns):
        raise InputError(
            f"{path}: expected a PLY header with a format and up to {MOST_POINTS} vertices."
        )
    return order, before, count, columns
