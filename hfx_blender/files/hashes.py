# SPDX-License-Identifier: GPL-3.0-or-later
"""Content hashes of files, folders and numbered rows of files."""

from __future__ import annotations

import errno
import hashlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ..errors import InputError

FRAMES: Final = "<FRAMES>"
"""Stands for the number of a frame in the name of a row of files."""

MOST_FILES: Final = 100_000
"""Largest number of files in one folder: a .blend may name any folder there is."""

FOLDER: Final = "a folder"
"""State of a folder that stands where a file should be; what is in it does not matter."""

TOO_MANY: Final = "too many files"
"""State of a folder of more than :data:`MOST_FILES`; it never equals a later one."""

NOT_READ: Final = "not read"
"""State of a file of no kind of :data:`KINDS`, or on another machine; never that of a later one."""

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
"""Suffixes of the files that a .blend may be made of: others are not opened, whoever names them."""

_NUMBERS: Final = {FRAMES: r"\d+", "<UDIM>": r"\d{4}", "<UVTILE>": r"u\d+_v\d+"}


def sha256_of(path: Path) -> str:
    """SHA-256 of a file of any size, in hexadecimal digits.

    Raises
    ------
    OSError
        It cannot be read, or is no file with an end (a device, a pipe).
    """
    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def is_of_a_kind(path: Path) -> bool:
    """Test the suffix of a path for one of :data:`KINDS`; backups such as .blend1 count."""
    return path.suffix.lower().rstrip("0123456789") in KINDS or path.suffix.lower() in KINDS


def is_elsewhere(path: Path, beside: Path | None) -> bool:
    """Test for a path on a machine of the network that is not the one of ``beside``.

    Opening it would tell that machine who we are.
    """
    host = _host_of(path)
    return bool(host) and (beside is None or host != _host_of(beside))


def _host_of(path: Path) -> str:
    text = str(path).replace("\\", "/")
    if text.startswith("//"):
        return text[2:].partition("/")[0].casefold()
    scheme = re.match(r"[a-zA-Z][\w+.-]+:/", text)  # Windows' drives are single letters
    return scheme[0].casefold() if scheme else ""


def state_of(path: Path, beside: Path | None = None) -> str | None:
    """SHA-256 of a file, of all of a folder, or of a numbered row of files.

    Files of no kind of :data:`KINDS` are not opened.

    Parameters
    ----------
    path : Path
        Its name may hold :data:`FRAMES`, ``<UDIM>`` or ``<UVTILE>``: all files of such names.
    beside : Path, optional
        The .blend: a path of another machine is read only where this is on the same one.

    Returns
    -------
    str or None
        None: there is nothing. Names and contents count, not the times of files.

    Raises
    ------
    InputError
        A folder holds more than :data:`MOST_FILES`.
    OSError
        Something is there and cannot be read.
    """
    if is_elsewhere(path, beside):
        return NOT_READ
    if path.is_file():
        return sha256_of(path) if is_of_a_kind(path) else NOT_READ
    found = sorted(_files_in(path) if path.is_dir() else _row_of(path))
    if not found:
        return None
    sums = hashlib.sha256()
    for each in found:
        name = each.relative_to(path if path.is_dir() else path.parent).as_posix()
        sums.update(f"{sha256_of(each)} {name}\n".encode(errors="surrogateescape"))
    return sums.hexdigest()


def holds_too_many(folder: Path) -> bool:
    """Test a path for a folder of more than :data:`MOST_FILES`."""
    try:
        _files_in(folder)  # none, where it is no folder
    except InputError:
        return True
    return False


def _files_in(folder: Path) -> list[Path]:
    found: list[Path] = []
    count = 0
    for place, _, names in os.walk(folder):
        files = (Path(place, name) for name in names)
        found += (file for file in files if is_of_a_kind(file) and file.is_file())
        count += len(names)
        if count > MOST_FILES:
            raise InputError(f"{folder}: it holds more than {MOST_FILES} files.")
    return found


def _row_of(path: Path) -> Iterator[Path]:
    pattern = re.escape(path.name)
    for token, digits in _NUMBERS.items():
        pattern = pattern.replace(re.escape(token), digits, 1)
    if pattern != re.escape(path.name) and path.parent.is_dir():
        names = re.compile(pattern)
        yield from (
            each
            for each in path.parent.iterdir()
            if names.fullmatch(each.name) and is_of_a_kind(each) and each.is_file()
        )
