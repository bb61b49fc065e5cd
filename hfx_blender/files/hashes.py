# SPDX-License-Identifier: GPL-3.0-or-later
"""Content hashes of files, folders and numbered file sequences."""

import errno
import hashlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ..errors import InputError

FRAMES: Final = "<FRAMES>"  # placeholder of the frame number in the name of a file sequence
MOST_FILES: Final = 100_000  # largest number of files in one folder: a .blend may name any folder
FOLDER: Final = "a folder"  # state of a folder in the place of a file, regardless of its content

TOO_MANY: Final = "too many files"
"""State of a folder of more than :data:`MOST_FILES`; counts as changed in every comparison."""

NOT_READ: Final = "not read"
"""State of a file with a suffix outside :data:`KINDS`, or on another machine; counts as changed."""

KINDS: Final = frozenset(
    (
        # pictures, videos and sounds
        ".bmp .cin .dds .dpx .exr .hdr .j2c .jp2 .jpeg .jpg .pdd .png .psb .psd .rgb .rgba .sgi "
        ".tga .tif .tiff .tx .webp .avi .avs .divx .dv .flc .flv .gif .m2t .m2ts .m2v .m4v .mkv "
        ".mov .movie .mp4 .mpeg .mpg .mpg2 .mts .mv .mxf .ogg .ogv .r3d .ts .vob .webm .wmv .xvid "
        ".aac .ac3 .aif .aiff .eac3 .flac .m4a .mka .mp2 .mp3 .oga .opus .wav .wma "
        # libraries, fonts, lamps, shaders
        ".blend .ttf .otf .ttc .pfb .pfm .woff .woff2 .ies .osl .oso "
        # geometry: caches, bakes, imports, scans
        ".abc .usd .usda .usdc .usdz .vdb .mdd .pc2 .bphys .uni .raw .gz .bobj .json .blob .obj "
        ".mtl .ply .stl .csv .txt .xyz .npz .fbx .gltf .glb "
        # tracks
        ".hfxtrack"
    ).split()
)
"""Suffixes of possible input files of a .blend; files with any other suffix are not opened."""

_NUMBERS: Final = {FRAMES: r"\d+", "<UDIM>": r"\d{4}", "<UVTILE>": r"u\d+_v\d+"}


def sha256_of(path: Path) -> str:
    """SHA-256 of a file of any size, in hexadecimal digits. Raises OSError for an unreadable file,
    a folder, a device or a pipe."""
    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def is_of_a_kind(path: Path) -> bool:
    """Test for a suffix in :data:`KINDS`, in any case; numbered backups such as .blend1 count."""
    return path.suffix.lower().rstrip("0123456789") in KINDS or path.suffix.lower() in KINDS


def is_elsewhere(path: Path, reference: Path | None) -> bool:
    """Test for a network path on another machine than ``reference`` (None: on any machine). Opening
    such a path would send the user's credentials to the other machine."""
    host = _host_of(path)
    return bool(host) and (reference is None or host != _host_of(reference))


def _host_of(path: Path) -> str:
    text = str(path).replace("\\", "/")
    if text.startswith("//"):
        return text[2:].partition("/")[0].casefold()
    scheme = re.match(r"[a-zA-Z][\w+.-]+:/", text)  # Windows' drives are single letters
    return scheme[0].casefold() if scheme else ""


def state_of(path: Path, reference: Path | None = None) -> str | None:
    """SHA-256 of names and contents of a file, a folder tree, or a numbered file sequence.

    None for a missing file, an empty folder or an empty sequence; :data:`NOT_READ` for suffixes
    outside :data:`KINDS`, which are not opened, and for network paths on another machine than the
    .blend ``reference``. :data:`FRAMES`, ``<UDIM>`` or ``<UVTILE>`` in the name stands for all
    matching files. Raises InputError for a folder of more than :data:`MOST_FILES`, OSError for an
    unreadable file.
    """
    if is_elsewhere(path, reference):
        return NOT_READ
    if path.is_file():
        return sha256_of(path) if is_of_a_kind(path) else NOT_READ
    # Sorted: the order of a folder differs between file systems.
    files = sorted(_files_in(path) if path.is_dir() else _row_of(path))
    if not files:
        return None
    # Names count as well: exchanged contents are a change.
    sums = hashlib.sha256()
    for file in files:
        name = file.relative_to(path if path.is_dir() else path.parent).as_posix()
        sums.update(f"{sha256_of(file)} {name}\n".encode(errors="surrogateescape"))
    return sums.hexdigest()


def holds_too_many(folder: Path) -> bool:
    """Test for a folder of more than :data:`MOST_FILES`; False for missing folders and files."""
    try:
        _files_in(folder)
    except InputError:
        return True
    return False


def _files_in(folder: Path) -> list[Path]:
    """Files of a folder and its subfolders with suffixes in :data:`KINDS`, unsorted; empty for no
    folder. InputError for more than :data:`MOST_FILES` files of any kind."""
    files: list[Path] = []
    count = 0
    for subfolder, _, names in os.walk(folder):
        paths = (Path(subfolder, name) for name in names)
        files += (path for path in paths if is_of_a_kind(path) and path.is_file())
        # The walk ends early: a .blend may name the root of a disk.
        count += len(names)
        if count > MOST_FILES:
            raise InputError(f"{folder}: it holds more than {MOST_FILES} files.")
    return files


def _row_of(path: Path) -> Iterator[Path]:
    """Yield the files in the folder of ``path`` that match its name with <FRAMES> (digits),
    <UDIM> or <UVTILE> as placeholder; nothing without placeholder."""
    pattern = re.escape(path.name)
    for token, digits in _NUMBERS.items():
        pattern = pattern.replace(re.escape(token), digits, 1)
    if pattern != re.escape(path.name) and path.parent.is_dir():
        names = re.compile(pattern)
        yield from (
            file
            for file in path.parent.iterdir()
            if names.fullmatch(file.name) and is_of_a_kind(file) and file.is_file()
        )
