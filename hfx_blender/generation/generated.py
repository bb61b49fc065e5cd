# SPDX-License-Identifier: GPL-3.0-or-later
"""Generated surface as files: pictures of colour, height and roughness, haptic map, record."""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..engine.arrays import F32, F64, U8
from ..engine.texture.haptic_map import HapticMap
from ..engine.texture.height_field import HeightField, SurfaceRelief, from_image
from ..errors import InputError, refuse_no_file
from ..files import kinds, staging
from ..files.hashes import sha256_of
from ..files.json_shapes import Anything, Flag, Items, Number, Record, Table, Text, numbers
from ..files.json_shapes import read as read_json
from ..files.kinds import refuse_another
from ..formats.pictures import png, texture_map
from ..formats.written import Written, write_json
from .surface_words import tokens

RECORD: Final = kinds.GENERATED_SUFFIX
FORMAT: Final = "hfx-generated-texture"
VERSION: Final = 1
_LONGEST_NAME: Final = 48
_FULL: Final = 65535
_MOST_BYTES: Final = 8 << 20  # of a record, which may contain a ComfyUI workflow
_RECORD: Final = Record(
    {
        "format": Text((FORMAT,)),
        "version": Number(VERSION, VERSION, is_whole=True),
        "name": Text(pattern=r"[^/\\:\x00-\x1f]{1,200}", note="1 to 200 characters, no path"),
        "size_mm": numbers(2, 1e-3, 1e6, "mm"),
        "height_mm": Number(0.0, 1e5, "mm"),
        "tiles": Flag(),
        "files": Table(Anything(), title="files with their SHA-256"),
    },
    {"full_slope": Anything(), "notes": Items(Anything(), 0, 1000), "is_metal": Flag()},
    unknown="ignore",
)


@dataclass(frozen=True, eq=False)
class Generated:
    """Surface of a back end, before the writing of files."""

    name: str  # stem of the file names
    colour: U8  # (H, W, 3) sRGB, bottom row first
    height: HeightField
    roughness: F64  # (H, W) 0 smooth, 1 rough
    map: HapticMap  # of this height and roughness
    record: Mapping[str, Any]  # JSON data to generate the surface again: words, seed, back end ...
    is_metal: bool = False  # for the material's look
    notes: tuple[str, ...] = ()
    slope: F32 | None = None  # (H, W) estimated slope; None: the slope of the heights


@dataclass(frozen=True, eq=False)
class GeneratedFiles:
    """Generated surface as read from files; fields as of :class:`Generated`."""

    path: Path  # of the record
    name: str
    relief: SurfaceRelief
    map: HapticMap
    is_metal: bool
    words: str  # "" for pictures without words


def name_of(words: str, mark: str) -> str:
    """File name: ASCII words and numbers joined by ``-``, 48 letters at most, then ``-`` and
    ``mark``. Where that changes the words, 8 digits of a hash come before the mark."""
    parts = [token for token in tokens(words) if token.isalnum() and token.isascii()]
    name = "-".join(parts)[:_LONGEST_NAME].strip("-")
    # Different words must not overwrite each other's files.
    if name != re.sub(r"[\s,_-]+", "-", words.lower()).strip("-"):
        digest = hashlib.sha256(words.encode("utf-8", "surrogatepass")).hexdigest()
        name = f"{name or 'texture'}-{digest[:8]}"
    return f"{name}-{mark}"


def write(surface: Generated, folder: Path, version: str) -> Written:
    """Write all files of a surface into a folder; the last one is the record, with file hashes.

    ``version`` is the version of this package, for the record.

    Raises OutputError: a file cannot be written; no file is left then.
    """
    heights = surface.height.heights_m
    low, high = float(heights.min()), float(heights.max())
    # The full range of codes for the range of heights, which the record names.
    share = (heights - low) / (high - low) if high > low else np.zeros_like(heights)
    # All files are written to a hidden folder first, and moved together.
    with staging.staging(folder, surface.name) as stage:
        stem = stage / surface.name
        pictures = {
            # A PNG stores the top row first, the arrays begin at the bottom.
            "colour": surface.colour[::-1],
            "height": _codes(share),
            "roughness": _codes(np.clip(surface.roughness, 0.0, 1.0)),
        }
        # 16 bits cover 0..full_slope, which the record names.
        full_slope = 0.0 if surface.slope is None else max(float(surface.slope.max()), 1e-9)
        if surface.slope is not None:
            pictures["slope"] = _codes(surface.slope / full_slope)
        paths = [stem.with_name(f"{stem.name}.{part}.png") for part in pictures]
        for path, values in zip(paths, pictures.values(), strict=True):
            png.write(values, path)
        written = texture_map.write(surface.map, stem, name=surface.name)
        files = [*paths, *written.files]
        record = stem.with_name(stem.name + RECORD)
        document = {
            "format": FORMAT,
            "version": VERSION,
            "name": surface.name,
            # Measured values below replace entries of the same name.
            **surface.record,
            "size_mm": [1e3 * length for length in surface.height.size_m],
            "height_mm": 1e3 * (high - low),
            "full_slope": full_slope or None,
            "tiles": surface.height.tiles,
            "is_metal": surface.is_metal,
            "notes": list(surface.notes),
            "versions": {"hfx": version, "numpy": np.__version__, **surface.record["versions"]},
            "files": {path.name: sha256_of(path) for path in files},
        }
        write_json(document, record)
        placed = staging.place([*files, record], folder)
    return Written(placed, notes=surface.notes)


def read(path: Path) -> GeneratedFiles:
    """Read a generated surface by the path of the record. Raises InputError: a file is missing,
    damaged, or differs from the hash in the record."""
    document = read_json(path, _MOST_BYTES)
    refuse_another(document.value, document.file, FORMAT)
    record = document.hold(_RECORD)
    name, files = record.get("name"), record.get("files")
    has_slope = record.get("full_slope") is not None
    pictures = ("colour", "height", "roughness", *(("slope",) if has_slope else ()))
    # All files are checked before any is decoded: a surface is complete, or refused.
    for part in pictures:
        picture = path.with_name(f"{name}.{part}.png")
        if picture.name not in files:
            raise InputError(f"{path}: files: '{picture.name}' is missing.")
        refuse_no_file(picture)
        # An edited picture would no longer fit the haptic map.
        if sha256_of(picture) != files[picture.name]:
            raise InputError(
                f"{picture}: is not the picture that {path.name} names; its hash differs."
            )
    width, height = record.numbers("size_mm")
    share, rough = (
        _share(path.with_name(f"{name}.{part}.png")) for part in ("height", "roughness")
    )
    slope = None
    if has_slope:
        record["full_slope"].hold(Number(0.0, 1e6))
        full = record.number("full_slope")
        slope = (full * _share(path.with_name(f"{name}.slope.png"))).astype(np.float32)
    size_m, depth_m = (1e-3 * width, 1e-3 * height), 1e-3 * record.number("height_mm")
    field = from_image(share, depth_m, size_m, tiles=record.get("tiles"))
    notes = tuple(map(str, record.get("notes", ())))
    return GeneratedFiles(
        path,
        name,
        SurfaceRelief(field, rough, notes, slope),
        texture_map.read(path.with_name(name + texture_map.SUFFIX)),
        record.get("is_metal", False),
        str(record.get("words", "")),
    )


def _codes(share: F64) -> png.Grey:
    """Grey picture of 16 bits, top row first, of values 0..1, bottom row first."""
    return np.rint(share[::-1] * _FULL).astype(np.uint16)


def _share(path: Path) -> F64:
    """Read a grey PNG as values 0..1 (H, W), bottom row first; 1 is the largest code."""
    codes, _ = png.read(path)
    return np.asarray(codes[::-1].astype(np.float64) / np.iinfo(codes.dtype).max)
