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

from .errors import InputError

FRAMES: Final = "<FRAMES>"
"""Stands for the number of a frame in the name of a row of files."""

MOST_FILES: Final = 100_000
"""Largest number of files in one folder: a .blend may name any folder there is."""

FOLDER: Final = "a folder"
"""State of a folder that stands where a file should be; what is in it does not matter."""

TOO_MANY: Final = "too many files"
"""State of a folder of more than :data:`MOST_FILES`; it never equals a later one."""

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


def state_of(path: Path) -> str | None:
    """SHA-256 of a file, of all of a folder, or of a numbered row of files.

    Parameters
    ----------
    path : Path
        Its name may hold :data:`FRAMES`, ``<UDIM>`` or ``<UVTILE>``: all files of such names.

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
    if path.is_file():
        return sha256_of(path)
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
    for place, _, names in os.walk(folder):
        found += (Path(place, name) for name in names if os.path.isfile(os.path.join(place, name)))
        if len(found) > MOST_FILES:
            raise InputError(f"{folder}: it holds more than {MOST_FILES} files.")
    return found


def _row_of(path: Path) -> Iterator[Path]:
    pattern = re.escape(path.name)
    for token, digits in _NUMBERS.items():
        pattern = pattern.replace(re.escape(token), digits, 1)
    if pattern != re.escape(path.name) and path.parent.is_dir():
        names = re.compile(pattern)
        yield from (p for p in path.parent.iterdir() if names.fullmatch(p.name) and p.is_file())
