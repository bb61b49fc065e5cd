# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of files by reading: tracks, drawings, Blender files."""

from __future__ import annotations

from pathlib import Path
from xml.parsers import expat

from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError
from hfx_blender.files.strict_json import mapped, read_bytes


def read_track(path: Path) -> None:
    """Read a whole track file, run by run in bounded memory, to check it; InputError if damaged.
    Returns nothing."""
    with TrackReader(path) as track:
        for _ in track.runs():
            pass


def read_blend(path: Path) -> None:
    """Raise InputError for a file without the first bytes of a ``.blend`` (plain or zstd)."""
    if not mapped(path)[:7].startswith((b"BLENDER", b"\x28\xb5\x2f\xfd")):
        raise InputError(f"{path}: is no .blend file.")


def read_svg(path: Path) -> None:
    """Check an SVG file; InputError for malformed XML or a root element other than ``svg``. Returns
    nothing; the drawing is not interpreted."""
    root = ""
    # expat resolves no external entities: a drawing cannot read other files.
    parser = expat.ParserCreate()

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal root
        root, parser.StartElementHandler = name, None

    parser.StartElementHandler = begin
    try:
        parser.Parse(read_bytes(path), True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: is not valid XML ({error}).") from None
    if root != "svg":
        raise InputError(f"{path}: begins with '{root[:60]}', expected is 'svg'.")
