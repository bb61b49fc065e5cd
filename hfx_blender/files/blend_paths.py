# SPDX-License-Identifier: GPL-3.0-or-later
"""File paths in a .blend, read without Blender, which opens some files while loading.

A .blend is a sequence of blocks, each a memory image of C structures of the same type. The block
DNA1 near the end describes the fields of all structures. Blender 5 has wider block heads.
"""

import gzip
import io
import math
import os
import re
import struct
import zlib
from collections.abc import Container, Iterator
from contextlib import suppress
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from ..errors import InputError, is_endless
from .hashes import is_elsewhere

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
"""Titles for messages of the structures with paths that Blender may open while loading."""

_SHORTEST: Final = 768  # bytes of a path's field: Blender's FILE_MAXDIR
_PACKED: Final = ("*packedfile", "packedfiles")
_LARGEST: Final = 1 << 24
"""Largest size of a parsed block, bytes: ten times that of DNA1."""


def faults() -> tuple[type[Exception], ...]:
    """Errors of reading a damaged file, or a compressed one without its decompressor."""
    expected = (OSError, EOFError, ValueError, LookupError, StopIteration, struct.error, zlib.error)
    with suppress(ImportError):  # bundled with Blender, except by some Linux distributions
        import zstandard

        return (*expected, zstandard.ZstdError)
    return (*expected, ImportError)


def refuse_endless(blend: Path, checked: set[Path] | None = None) -> None:
    """Raise InputError if a .blend, or a library linked from it, names a pipe, device or socket.
    Blender would wait forever on opening such a path. Paths of packed files are not opened. A
    damaged file, or unknown compression, passes here and is reported by Blender. Files in
    ``checked`` are skipped; ``blend`` and libraries are added."""
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
    """Structure name and absolute path of each unpacked file of a .blend; empty if unreadable."""
    try:
        with opened(blend) as file:
            dna = next(content for code, _, content in blocks(file, ()) if code == b"DNA1")
        structures = structures_of(dna)
        with opened(blend) as file:
            paths = [
                (structures[number].kind, os.fsdecode(raw))
                for code, number, content in blocks(file, structures)
                if code != b"DNA1"
                for raw in _raw_paths(content, structures[number])
            ]
    except faults():
        return []
    folder = os.path.dirname(os.path.abspath(blend))
    # A path that begins with // is relative to the folder of the .blend.
    stored = ((k, os.path.join(folder, p[2:]) if p.startswith("//") else p) for k, p in paths)
    return [(kind, Path(os.path.normpath(path))) for kind, path in stored]


def opened(blend: Path) -> BinaryIO:
    """Open a .blend for reading, decompressed if gzip or Zstandard by its first bytes."""
    file = blend.open("rb")
    start = file.read(4)
    file.seek(0)
    if start == b"\x28\xb5\x2f\xfd":
        import zstandard

        whole = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        return io.BufferedReader(whole)
    return gzip.GzipFile(fileobj=file) if start[:2] == b"\x1f\x8b" else file  # type: ignore[return-value]


def blocks(file: BinaryIO, structures: Container[int]) -> Iterator[tuple[bytes, int, bytes]]:
    """Yield code, structure number and content of DNA1 and of blocks of the given structures,
    without blocks above ``_LARGEST``. ValueError for an unknown format or a damaged block."""
    magic = _exactly(file, 12)
    # Blender 5: 64-bit block sizes, in another order of fields.
    if magic == b"BLENDER17-01":
        _exactly(file, 5)
        header, fields = struct.Struct("<4siQqq"), itemgetter(0, 1, 3)
    elif re.fullmatch(rb"BLENDER[-_]v\d{3}", magic):
        header = struct.Struct("<4siQii" if magic[7:8] == b"-" else "<4siIii")
        fields = itemgetter(0, 3, 1)
    else:
        raise ValueError("unknown .blend format")
    # A file of ten thousand objects has a quarter of a million blocks.
    can_seek, read, unpack, width = file.seekable(), file.read, header.unpack, header.size
    while True:
        code, number, size = fields(unpack(read(width)))
        if code == b"ENDB":
            return
        if size < 0 or not code[:2].isalnum():
            raise ValueError("no code or size of a block")
        if code == b"DNA1" or (number in structures and size <= _LARGEST):
            yield code, number, _exactly(file, size)
        # Decompressed streams cannot seek: unused blocks are read and dropped.
        elif can_seek:
            file.seek(size, os.SEEK_CUR)
        else:
            while size > 0:
                size -= len(_exactly(file, min(size, _LARGEST)))


def _exactly(file: BinaryIO, count: int) -> bytes:
    """Next ``count`` bytes of a file; raises EOFError if fewer are left, or above 16 MiB."""
    content = file.read(count) if count <= _LARGEST else b""
    if len(content) != count:
        raise EOFError
    return content


class _Structure(NamedTuple):
    """Offsets of paths in a C structure."""

    kind: str
    size: int  # bytes of the structure
    paths: list[tuple[int, int]]  # (offset, size in bytes)
    packed: list[int]  # offsets of pointers that are non-zero for a packed file


def structures_of(dna: bytes) -> dict[int, _Structure]:
    """Layouts of the structures named in :data:`_TITLES`, by number, from the content of DNA1;
    paths are char arrays of 768 bytes or more."""
    # SDNA: names of fields, names of types, sizes of types, then structures by number.
    file = io.BytesIO(dna[4:])
    names = _strings(file, b"NAME")
    types = _strings(file, b"TYPE")
    sizes = _numbers(file, b"TLEN", f"<{len(types)}H")
    (count,) = _numbers(file, b"STRC", "<i")
    pointer = 8 if sizes[types.index("ListBase")] == 16 else 4
    structures = {}
    for number in range(count):
        kind, fields = struct.unpack("<HH", _exactly(file, 4))
        members = _exactly(file, 4 * fields)
        if types[kind] not in _TITLES:
            continue
        structure = structures[number] = _Structure(types[kind], sizes[kind], [], [])
        # DNA1 gives field sizes but no offsets. Offsets are sums of sizes, as Blender's structures
        # have explicit padding.
        offset = 0
        for type_number, name_number in struct.iter_unpack("<HH", members):
            name = names[name_number]
            # Names include stars of pointers and sizes of arrays.
            size = pointer if name.startswith(("*", "(")) else sizes[type_number]
            size *= math.prod(map(int, re.findall(r"\[(\d+)\]", name)))
            if types[type_number] == "char" and size >= _SHORTEST and not name.startswith("*"):
                structure.paths.append((offset, size))
            if name in _PACKED:
                structure.packed.append(offset)
            offset += size
    return structures


def _numbers(file: BinaryIO, mark: bytes, layout: str) -> tuple[int, ...]:
    """Numbers by a struct layout at the next part of DNA1, which must begin with ``mark``. Parts
    are aligned to four bytes. Raises ValueError or EOFError for damaged data."""
    file.seek(-file.tell() % 4, os.SEEK_CUR)
    if _exactly(file, 4) != mark:
        raise ValueError(f"DNA1 has no {mark!r}")
    return struct.unpack(layout, _exactly(file, struct.calcsize(layout)))


def _strings(file: io.BytesIO, mark: bytes) -> list[str]:
    """ASCII strings of the part ``mark`` of DNA1; EOFError or ValueError if damaged."""
    (count,) = _numbers(file, mark, "<i")
    texts = re.match(rb"(?:[^\0]*\0){%d}" % count, file.getbuffer()[file.tell() :])
    if texts is None:
        raise EOFError
    file.seek(texts.end(), os.SEEK_CUR)
    return texts[0].decode("ascii").split("\0")[:-1]


def _raw_paths(content: bytes, structure: _Structure) -> Iterator[bytes]:
    """Yield the non-empty paths in a block of structures, without structures of packed files."""
    for start in range(0, len(content) - structure.size + 1, structure.size):
        # A non-zero pointer means packed data; the first four bytes suffice.
        if any(
            content[start + offset : start + offset + 4] != bytes(4) for offset in structure.packed
        ):
            continue
        for offset, size in structure.paths:
            raw = content[start + offset : start + offset + size].split(b"\0", 1)[0]
            if raw:
                yield raw
