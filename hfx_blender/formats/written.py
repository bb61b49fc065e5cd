# SPDX-License-Identifier: GPL-3.0-or-later
"""Result of a writer, and helpers for files and file names."""

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from ..files.atomic import atomic_file
from ..files.strict_json import clean, encoded
from ..text import UNSAFE, named

_LONGEST: Final = 100
_NOT_ALLOWED: Final = re.compile(rf'[%<>:"/\\|?*]|{UNSAFE.pattern}')


@dataclass(frozen=True)
class Written:
    """Result of a writer: files, losses and notes; ``+`` concatenates."""

    files: tuple[Path, ...] = ()
    left_out: tuple[str, ...] = ()  # losses, a sentence each without a full stop
    notes: tuple[str, ...] = ()  # simplification errors, silent actuators without a file

    def __add__(self, other: "Written") -> "Written":
        return Written(
            self.files + other.files, self.left_out + other.left_out, self.notes + other.notes
        )

    def prefixed(self, title: str) -> "Written":
        """Copy with a title and a colon before every sentence of ``left_out`` and ``notes``."""
        left_out = tuple(f"{title}: {loss}" for loss in self.left_out)
        return Written(self.files, left_out, tuple(f"{title}: {note}" for note in self.notes))


def single_file(write: Callable[[Any, Path], None], suffix: str) -> Callable[..., Written]:
    """Make a ``write_track`` or ``write_raster`` of a format that stores its content exactly, as
    ``stem<suffix>``; the arguments for devices and tolerance are not used."""

    def export(content: Any, _devices: Any, stem: Path, _tolerance: float) -> Written:
        path = stem.with_name(stem.name + suffix)
        write(content, path)
        return Written((path,))

    return export


def write_json(document: Any, path: Path) -> None:
    """Write a JSON document; OutputError for an unwritable file, no partial file remains."""
    with atomic_file(path) as file:
        file.write(encoded(document))


def rounded_s(seconds: float) -> float:
    """Round seconds to 0.1 us."""
    return round(float(seconds), 7)


def part_path(stem: Path, part: str, suffix: str) -> Path:
    """Path ``folder/stem.part<suffix>`` for any text ``part``, see :func:`name_part`."""
    return stem.with_name(f"{stem.name}.{name_part(part)}{suffix}")


def name_part(part: str) -> str:
    """Convert any text to a part of a file name on any system, 1 to 100 bytes of UTF-8; "_" for an
    empty text. Characters that a file system or a terminal does not allow are percent-encoded, and
    ``%``; a longer text ends with 8 digits of the SHA-256. Dots and spaces at the ends, and
    reserved names (CON), stay: no whole name."""
    safe = _NOT_ALLOWED.sub(lambda found: quote(found[0], safe=""), clean(part)) or "_"
    if len(safe.encode()) > _LONGEST:
        digest = hashlib.sha256(safe.encode()).hexdigest()[:8]
        start = safe.encode()[: _LONGEST - 9].decode(errors="ignore").rstrip("%")
        safe = f"{start}-{digest}"
    return safe


def silent_note(names: Sequence[str]) -> tuple[str, ...]:
    """Tuple of a note on silent actuators without a file; empty without names."""
    return (f"no file for silent actuators: {named(names)}",) if names else ()
