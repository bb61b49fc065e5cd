# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads HJIF, our own files and those of others."""

from __future__ import annotations

from pathlib import Path

from ..checking import parse, read_bytes, refuse_errors
from .model import Hjif, from_json
from .rules import findings


def read(path: Path) -> Hjif:
    """A file's content.

    Raises
    ------
    InputError
        It cannot be read or breaks the standard; unknown members are left out.
    """
    return decode(read_bytes(path), str(path))


def decode(content: bytes, name: str) -> Hjif:
    """:func:`read` from bytes."""
    found = parse(content, name)
    refuse_errors([each for each in findings(found) if each.code != "HJIF-UNKNOWN"], name)
    document: Hjif = from_json(found)
    return document
