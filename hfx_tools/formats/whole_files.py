# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation of tracks, pictures, drawings and Blender files by reading the whole file.

``formats.toml`` names one of these functions as ``read`` of a format. A function returns warnings,
and raises InputError for the first fault.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Final
from xml.parsers import expat

from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError
from hfx_blender.files import blend_paths
from hfx_blender.files.findings import Finding
from hfx_blender.files.strict_json import mapped, read_bytes, read_data
from hfx_blender.formats.pictures import png, texture_map

from .whole_zip import excess_of

_PNG_END: Final = b"\0\0\0\0IEND\xae\x42\x60\x82"
_ZSTD: Final = b"\x28\xb5\x2f\xfd"
_SEEK_TABLE: Final = b"\x5e\x2a\x4d\x18"  # begins the last frame of a zstd file of Blender


def read_track(path: Path) -> list[Finding]:
    """Read a whole track file, run by run in bounded memory; InputError if damaged, or with bytes
    outside of its archive. No warnings."""
    with TrackReader(path) as track:
        for _ in track.runs():
            pass
    with path.open("rb") as file, zipfile.ZipFile(file) as archive:
        if excess := excess_of(archive, file):
            raise InputError(f"{path}: not a whole HapticTrack ({excess}).")
    return []


def read_texture(path: Path) -> list[Finding]:
    """Read a texture map with its layers; InputError as of :func:`texture_map.read`. No
    warnings."""
    texture_map.read(path)
    return []


def read_picture(path: Path) -> list[Finding]:
    """Read a PNG file; a warning for bytes after its end, which readers ignore."""
    png.read(path)
    content = read_data(path)
    rest = len(content) - content.find(_PNG_END) - len(_PNG_END)
    message = f"{rest:,} bytes follow the end of the picture"
    return [Finding("PICTURE-END", "", message, "warning")] if rest else []


def read_blend(path: Path) -> list[Finding]:
    """Check the order of the blocks in a ``.blend`` file, plain or compressed by zstd or gzip, and
    the names of Blender's types in the block DNA1; the content of other blocks is not checked.
    Raises InputError for a damaged or cut file, and for bytes after its end. Returns a warning for
    a compressed file if the Python module ``zstandard`` is missing."""
    content = mapped(path)
    if not content[:7].startswith((b"BLENDER", _ZSTD, b"\x1f\x8b")):
        raise InputError(f"{path}: is no .blend file.")
    try:
        with blend_paths.opened(path) as file:
            blocks = {code: block for code, _, block in blend_paths.blocks(file, ())}
            blend_paths.structures_of(blocks[b"DNA1"])
            if file.read(1):
                raise InputError(f"{path}: is damaged: bytes follow its last block.")
    except ImportError:
        message = "the content is compressed, and was not read: Python's 'zstandard' is missing"
        return [Finding("SCENE-UNREAD", "", message, "warning")]
    except blend_paths.faults() as error:
        raise InputError(f"{path}: is cut or damaged: a block cannot be read.") from error
    # The seek table of a zstd file is no part of the content, and may be cut alone.
    table = content.rfind(_SEEK_TABLE, -(1 << 20)) if content[:4] == _ZSTD else -1
    if table >= 0:
        end = table + 8 + int.from_bytes(content[table + 4 : table + 8], "little")
        if end != len(content):
            raise InputError(f"{path}: is damaged: its end is not that of its last frame.")
    return []


def read_svg(path: Path) -> list[Finding]:
    """Check an SVG file; InputError for malformed XML or a root element other than ``svg``. The
    drawing is not interpreted. No warnings."""
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
    return []
