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
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

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
    import zstandard  # Blender's own

    faults = (OSError, EOFError, ValueError, LookupError, StopIteration, struct.error)
    try:
        with _opened(blend) as file:
            dna = next(content for code, _, content in _blocks(file, ()) if code == b"DNA1")
        wanted = _structures(dna)
        with _opened(blend) as file:
            found = [
                (wanted[which].kind, raw)
                for code, which, content in _blocks(file, wanted)
                if code != b"DNA1"
                for raw in _texts(content, wanted[which])
            ]
    except (*faults, zlib.error, zstandard.ZstdError):
        return []
    folder = os.path.dirname(os.path.abspath(blend))
    return [(kind, Path(_absolute(os.fsdecode(raw), folder))) for kind, raw in found]


def _absolute(raw: str, folder: str) -> str:
    """Full path of a stored one; ``//`` begins one that is relative to the .blend."""
    return os.path.normpath(os.path.join(folder, raw[2:]) if raw.startswith("//") else raw)


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


def _blocks(file: BinaryIO, which: Container[int]) -> Iterator[tuple[bytes, int, bytes]]:
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
        code, structure, size = (values[k] for k in order)
        if code == b"ENDB":
            return
        if size < 0:
            raise ValueError("no block is so short")
        is_wanted = code == b"DNA1" or (structure in which and size <= _LARGEST)
        if is_wanted:
            yield code, structure, _exactly(file, size)
        else:
            _skip(file, size)


def _exactly(file: BinaryIO, count: int) -> bytes:
    if count > _LARGEST:
        raise ValueError("longer than what is looked for")
    found = file.read(count)
    if len(found) != count:
        raise EOFError
    return found


def _skip(file: BinaryIO, count: int) -> None:
    if file.seekable():
        file.seek(count, os.SEEK_CUR)
        return
    while count > 0:
        read = len(file.read(min(count, _LARGEST)))
        if not read:
            raise EOFError
        count -= read


@dataclass(frozen=True)
class _Paths:
    """Places of paths in a structure."""

    kind: str
    size: int  # bytes of the structure
    paths: tuple[tuple[int, int], ...]  # (offset, bytes) each
    packed: tuple[int, ...]  # offsets of pointers that are not zero where the file is packed


def _structures(dna: bytes) -> dict[int, _Paths]:
    """Structures of :data:`_TITLES` by their number, from the block DNA1."""
    names, at = _strings(dna, 4, b"NAME")
    types, at = _strings(dna, at, b"TYPE")
    at = _after(dna, at, b"TLEN")
    sizes = struct.unpack_from(f"<{len(types)}H", dna, at)
    at = _after(dna, (at + 2 * len(types) + 3) & ~3, b"STRC")
    (count,) = struct.unpack_from("<i", dna, at)
    pointer = 8 if sizes[types.index("ListBase")] == 16 else 4
    at, found = at + 4, {}
    for number in range(count):
        kind, fields = struct.unpack_from("<HH", dna, at)
        members = struct.iter_unpack("<HH", dna[at + 4 : at + 4 + 4 * fields])
        if types[kind] in _TITLES:
            found[number] = _structure(members, types, names, sizes, pointer, kind)
        at += 4 + 4 * fields
    return found


def _structure(
    members: Iterator[tuple[int, ...]],
    types: list[str],
    names: list[str],
    sizes: tuple[int, ...],
    pointer: int,
    kind: int,
) -> _Paths:
    offset, paths, packed = 0, [], []
    for type_number, name_number in members:
        name = names[name_number]
        size = pointer if name.startswith(("*", "(")) else sizes[type_number]
        size *= math.prod(map(int, re.findall(r"\[(\d+)\]", name)))
        if types[type_number] == "char" and size >= _SHORTEST and not name.startswith("*"):
            paths.append((offset, size))
        if name in _PACKED:
            packed.append(offset)
        offset += size
    return _Paths(types[kind], sizes[kind], tuple(paths), tuple(packed))


def _strings(dna: bytes, at: int, mark: bytes) -> tuple[list[str], int]:
    """Texts of a part of DNA1, and where the next part begins."""
    at = _after(dna, at, mark)
    (count,) = struct.unpack_from("<i", dna, at)
    *texts, _ = dna[at + 4 :].split(b"\0", count) if count else [b""]
    if len(texts) != count:
        raise EOFError
    at += 4 + sum(map(len, texts)) + count
    return [text.decode("ascii") for text in texts], (at + 3) & ~3


def _after(dna: bytes, at: int, mark: bytes) -> int:
    if dna[at : at + 4] != mark:
        raise ValueError(f"DNA1 has no {mark!r}")
    return at + 4


def _texts(content: bytes, where: _Paths) -> Iterator[bytes]:
    """Paths of the structures in a block, but of those whose files are packed."""
    for start in range(0, len(content) - where.size + 1, where.size):
        if any(content[start + at : start + at + 4] != bytes(4) for at in where.packed):
            continue
        for at, size in where.paths:
            raw = content[start + at : start + at + size].split(b"\0", 1)[0]
            if raw:
                yield raw
