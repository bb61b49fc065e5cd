# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths that a .blend holds, read without Blender, which opens some of them with the file itself.

A .blend is a row of blocks, each a memory image of one C structure; its last but one block, DNA1,
describes all structures. Blender 5 has wider block heads.
"""

from __future__ import annotations

import gzip
import io
import math
import os
import re
import struct
import zlib
from collections.abc import Container, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from ..errors import InputError, is_endless
from ..files.hashes import is_elsewhere

_TITLES: Final = {
    "Library": "library",
    "Image": "image",
    "bSound": "sound",
    "MovieClip": "movie clip",
    "VFont": "font",
    "Volume": "volume",
    "CacheFile": "cache file",
    "MeshCacheModifierData": "mesh cache",
    "CustomDataExternal": "external data",
    "bNodeSocketValueString": "node",
}
"""Structures with paths of files that Blender reads by itself, as messages name them."""

_SHORTEST: Final = 768  # bytes of a path's field: Blender's FILE_MAXDIR
_PACKED: Final = ("*packedfile", "packedfiles")
_LARGEST: Final = 1 << 24
"""Bytes of a block that is looked into: DNA1 has a tenth of it."""

_FAULTS: Final = (
    *(OSError, EOFError, ValueError, LookupError, StopIteration),
    *(struct.error, zlib.error, ImportError),
)
"""Errors of reading a damaged file, or a compressed one without its decompressor."""


def refuse_endless(blend: Path, checked: set[Path] | None = None) -> None:
    """Refuse a .blend that names a pipe, a device or a socket, also by the libraries it links.

    Blender would wait for it for ever. A file that is damaged, or compressed in a way that is
    unknown here, is left to Blender; what is packed is not read from its path.

    Raises
    ------
    InputError
        Names the file, the path and its user.
    """
    checked = set() if checked is None else checked
    checked.add(blend)
    for kind, path in _paths_of(blend):
        if is_elsewhere(path, blend):
            continue
        if is_endless(path):
            title = _TITLES[kind]
            raise InputError(f"{blend}: '{path}' of its {title} is a pipe, a device or a socket.")
        if kind == "Library" and path.is_file() and path not in checked:
            refuse_endless(path, checked)


def _paths_of(blend: Path) -> list[tuple[str, Path]]:
    """Kind and full path of each file that a .blend names; none where it cannot be read here."""
    faults: tuple[type[Exception], ...] = _FAULTS
    with suppress(ImportError):  # it comes with Blender, but not with that of every distribution
        import zstandard

        faults = (*faults, zstandard.ZstdError)
    try:
        with _opened(blend) as file:
            dna = next(content for code, _, content in _blocks(file, ()) if code == b"DNA1")
        wanted = _structures(dna)
        with _opened(blend) as file:
            found = [
                (wanted[number].kind, os.fsdecode(raw))
                for code, number, content in _blocks(file, wanted)
                if code != b"DNA1"
                for raw in _texts(content, wanted[number])
            ]
    except faults:
        return []
    folder = os.path.dirname(os.path.abspath(blend))
    return [(kind, Path(_absolute(path, folder))) for kind, path in found]


def _absolute(path: str, folder: str) -> str:
    """Full path of a stored one; ``//`` begins one that is relative to the .blend."""
    return os.path.normpath(os.path.join(folder, path[2:]) if path.startswith("//") else path)


def _opened(blend: Path) -> BinaryIO:
    """Open a .blend for reading from its beginning, decompressed."""
    file = blend.open("rb")
    start = file.read(4)
    file.seek(0)
    if start == b"\x28\xb5\x2f\xfd":
        import zstandard

        whole = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        return io.BufferedReader(whole)
    return gzip.GzipFile(fileobj=file) if start[:2] == b"\x1f\x8b" else file  # type: ignore[return-value]


def _blocks(file: BinaryIO, wanted: Container[int]) -> Iterator[tuple[bytes, int, bytes]]:
    """Code, structure and content of the blocks of some structures, and of DNA1."""
    start = _exactly(file, 12)
    if start == b"BLENDER17-01":
        _exactly(file, 5)
        head, order = struct.Struct("<4siQqq"), (0, 1, 3)
    elif re.fullmatch(rb"BLENDER[-_]v\d{3}", start):
        head = struct.Struct("<4siQii" if start[7:8] == b"-" else "<4siIii")
        order = (0, 3, 1)
    else:
        raise ValueError("neither of today's formats")
    while True:
        values = head.unpack(_exactly(file, head.size))
        code, number, size = (values[k] for k in order)
        if code == b"ENDB":
            return
        if size < 0:
            raise ValueError("no block is so short")
        if code == b"DNA1" or (number in wanted and size <= _LARGEST):
            yield code, number, _exactly(file, size)
        elif file.seekable():
            file.seek(size, os.SEEK_CUR)
        else:
            while size > 0:
                size -= len(_exactly(file, min(size, _LARGEST)))


def _exactly(file: BinaryIO, count: int) -> bytes:
    content = file.read(count) if count <= _LARGEST else b""
    if len(content) != count:
        raise EOFError
    return content


class _Structure(NamedTuple):
    """Places of paths in a structure."""

    kind: str
    size: int  # bytes of the structure
    paths: list[tuple[int, int]]  # (offset, bytes) each
    packed: list[int]  # offsets of pointers that are not zero where the file is packed


def _structures(dna: bytes) -> dict[int, _Structure]:
    """Structures of :data:`_TITLES` by their number, from the block DNA1."""
    file = io.BytesIO(dna[4:])
    names = _strings(file, b"NAME")
    types = _strings(file, b"TYPE")
    sizes = _numbers(file, b"TLEN", f"<{len(types)}H")
    (count,) = _numbers(file, b"STRC", "<i")
    pointer = 8 if sizes[types.index("ListBase")] == 16 else 4
    found = {}
    for number in range(count):
        kind, fields = struct.unpack("<HH", _exactly(file, 4))
        members = _exactly(file, 4 * fields)
        if types[kind] not in _TITLES:
            continue
        structure = found[number] = _Structure(types[kind], sizes[kind], [], [])
        offset = 0
        for type_number, name_number in struct.iter_unpack("<HH", members):
            name = names[name_number]
            size = pointer if name.startswith(("*", "(")) else sizes[type_number]
            size *= math.prod(map(int, re.findall(r"\[(\d+)\]", name)))
            if types[type_number] == "char" and size >= _SHORTEST and not name.startswith("*"):
                structure.paths.append((offset, size))
            if name in _PACKED:
                structure.packed.append(offset)
            offset += size
    return found


def _numbers(file: BinaryIO, mark: bytes, layout: str) -> tuple[int, ...]:
    """Numbers at the beginning of a part of DNA1; parts begin at multiples of four bytes."""
    file.seek(-file.tell() % 4, os.SEEK_CUR)
    if _exactly(file, 4) != mark:
        raise ValueError(f"DNA1 has no {mark!r}")
    return struct.unpack(layout, _exactly(file, struct.calcsize(layout)))


def _strings(file: io.BytesIO, mark: bytes) -> list[str]:
    """Texts of a part of DNA1."""
    (count,) = _numbers(file, mark, "<i")
    texts = re.match(rb"(?:[^\0]*\0){%d}" % count, file.getbuffer()[file.tell() :])
    if texts is None:
        raise EOFError
    file.seek(texts.end(), os.SEEK_CUR)
    return texts[0].decode("ascii").split("\0")[:-1]


def _texts(content: bytes, where: _Structure) -> Iterator[bytes]:
    """Paths of the structures in a block, but of those whose files are packed."""
    for start in range(0, len(content) - where.size + 1, where.size):
        if any(content[start + at : start + at + 4] != bytes(4) for at in where.packed):
            continue
        for at, size in where.paths:
            raw = content[start + at : start + at + size].split(b"\0", 1)[0]
            if raw:
                yield raw
