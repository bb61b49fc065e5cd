# SPDX-License-Identifier: GPL-3.0-or-later
"""Every reader with its checks: what a file of a stranger goes through."""

from __future__ import annotations

import sys
from collections.abc import Callable

from hfx_blender.errors import InputError
from hfx_blender.formats import csv_raster, files, npz_raster
from hfx_blender.formats.hjif import reader, text, to_signals

Reader = Callable[[bytes], None]


def readers() -> dict[str, Reader]:
    """By format; each raises ``InputError`` for a bad file, anything else is a fault."""
    found = {name: _checked(kind) for name, kind in files.FILE_FORMATS.items()}
    found["npz"] = _npz
    found["csv"] = _csv
    found["hjif"] = _hjif
    return found


def _checked(kind: files.FileFormat) -> Reader:
    def read(content: bytes) -> None:
        findings = kind.validate(content, "x")
        if kind.signals is None:
            return
        try:
            kind.signals(content, "x")
        except InputError:
            # Too much at once, or too deep: valid, but not of a sane tool.
            is_valid = not any(each.severity == "error" for each in findings)
            if is_valid and "too many" not in str(sys.exc_info()[1]):
                raise AssertionError("valid, but not read") from None

    return read


def _npz(content: bytes) -> None:
    npz_raster.decode(content, "x")


def _csv(content: bytes) -> None:
    csv_raster.decode(content, "x")


def _hjif(content: bytes) -> None:
    """Read, write again, read again: the same; and unfold."""
    document = reader.decode(content, "x")
    assert reader.decode(text.encode(document), "x") == document
    for each in to_signals.envelopes(document):
        assert len(each.strength) > 0
    to_signals.decode(content, "x")
