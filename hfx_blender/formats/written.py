# SPDX-License-Identifier: GPL-3.0-or-later
"""Result of a writer: files, and what had to be left out."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from ..files.atomic import atomic_file
from ..files.strict_json import clean, encoded
from ..text import named

_LONGEST: Final = 100


@dataclass(frozen=True)
class Written:
    """The result of writing in one format."""

    files: tuple[Path, ...] = ()
    left_out: tuple[str, ...] = ()  # one sentence each, without a full stop
    notes: tuple[str, ...] = ()  # the error that simplification made, what needed no file

    def __add__(self, other: Written) -> Written:
        return Written(
            self.files + other.files, self.left_out + other.left_out, self.notes + other.notes
        )

    def of(self, title: str) -> Written:
        """The same, each sentence said of something."""
        left_out = tuple(f"{title}: {each}" for each in self.left_out)
        return Written(self.files, left_out, tuple(f"{title}: {each}" for each in self.notes))


def write_json(document: Any, path: Path) -> None:
    """Write a document.

    Raises
    ------
    OutputError
        The file cannot be written; nothing is left of it then.
    """
    with atomic_file(path) as file:
        file.write(encoded(document))


def beside(stem: Path, part: str, suffix: str) -> Path:
    """``folder/stem.part<suffix>``; the part may be any text, of any length."""
    return stem.with_name(f"{stem.name}.{name_part(part)}{suffix}")


def name_part(part: str) -> str:
    """Part of a file's name for any text, of 1 to 100 characters."""
    safe = quote(clean(part), safe="!,-_+()=@ ") or "_"
    if len(safe) > _LONGEST:
        digest = hashlib.sha256(safe.encode()).hexdigest()[:8]
        safe = f"{safe[: _LONGEST - 9].rstrip('%')}-{digest}"
    return safe


def silent_note(names: Sequence[str]) -> tuple[str, ...]:
    """Note on actuators that play nothing and got no file."""
    return (f"no file for what stays silent: {named(names)}",) if names else ()
