# SPDX-License-Identifier: GPL-3.0-or-later
"""Rasters of NumPy archives: reader, check and facts."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import NPZ_DAMAGE
from hfx_blender.engine.rendering.raster import Column, FeltStream, Raster, Reason, Shortfall
from hfx_blender.engine.samples import Stream
from hfx_blender.errors import InputError
from hfx_blender.files import limits
from hfx_blender.files.findings import Finding, Report, refuse_errors
from hfx_blender.files.json_shapes import Anything, Items, Number, Record, Text, check, strict
from hfx_blender.files.strict_json import parse, read_data
from hfx_blender.formats.rasters.npz_raster import FELT_ARRAYS, FORMAT, SIZE_WORDS

from . import raster_rules
from .whole_zip import excess_of

_MOST_ENTRIES: Final = 10_000
_META: Final = 64 << 20
_HEAD_BYTES: Final = 1 << 12  # first bytes of an array, with its shape
_Head = tuple[tuple[int, ...], np.dtype[Any]]  # shape and type of an array
_TEXT = Text()
_DOCUMENT = strict(
    {
        "format": Text((FORMAT,)),
        "version": Number(1, 1, is_whole=True),
        "device": _TEXT,
        "body": _TEXT,
        "rate_hz": Items(Number(1, 2**63 - 1, is_whole=True), least=2, most=2),
        "actuators": Items(_TEXT),
        "columns": Items(Record({"actuator": _TEXT, "parameter": _TEXT, "unit": _TEXT})),
        "shortfalls": Items(
            Record(
                {
                    "effect_id": _TEXT,
                    "body_id": _TEXT,
                    "modality": _TEXT,
                    "reason": Text(get_args(Reason)),
                    "samples": Number(0, is_whole=True),
                    "share": Number(0.0, 1.0),
                    "seconds": Number(0.0),
                }
            )
        ),
        "felt": Items(Items(_TEXT, least=4, most=4)),
    },
    {"tools": Anything()},
)


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the first fault as a finding, or else a warning for a raster without columns."""
    read: list[Raster] = []
    findings = raster_rules.decoding_findings(
        "NPZ", lambda *of: read.append(decode(*of)), content, name
    )
    if read and not read[0].columns:
        message = "there are no columns to play"
        findings.append(Finding("NPZ-COLUMNS", "columns", message, "warning"))
    return findings


def read(path: Path) -> Raster:
    """Read the raster of a file; InputError if unreadable, damaged or of another kind."""
    return decode(read_data(path), str(path))


def facts(path: Path) -> dict[str, Any]:
    """Device, body, rows, rate, actuators and columns for ``hfx info``; InputError if invalid."""
    raster = read(path)
    return {"device": raster.device_id, "body": raster.body_id, **raster_rules.facts(raster)}


def decode(content: bytes, name: str) -> Raster:
    """Decode a raster archive; InputError, with ``name``, for another or damaged file."""
    try:
        with io.BytesIO(content) as file, zipfile.ZipFile(file) as archive:
            if excess := excess_of(archive, file):
                raise ValueError(excess)
            return _decoded(archive, name)
    except NPZ_DAMAGE as error:
        raise InputError(f"{name}: not a raster archive, or damaged ({error}).") from error


def _decoded(archive: zipfile.ZipFile, name: str) -> Raster:
    """Decode an open archive; array shapes are compared before any array is unpacked. Raises
    InputError for a wrong description, shapes or raster, and TooLargeError for arrays above the
    memory limit."""
    # A zip may name an entry twice; readers disagree on which counts.
    entries = {item.filename.removesuffix(".npy"): item for item in archive.infolist()}
    if len(archive.infolist()) > _MOST_ENTRIES or len(entries) != len(archive.infolist()):
        raise InputError(f"{name}: not a raster archive: it has too many entries, or one twice.")
    # No limit on the packing ratio: deflate packs a silent raster up to 1,030 times.
    limits.MEMORY.check(sum(entry.file_size for entry in entries.values()), name, SIZE_WORDS)
    heads = {key: _head(archive, item) for key, item in entries.items()}
    if "meta" not in heads or heads["meta"][1] != np.uint8 or entries["meta"].file_size > _META:
        raise InputError(f"{name}: not a raster archive: it has no 'meta'.")
    meta = parse(_array(archive, entries["meta"]).tobytes(), name)
    report = Report("NPZ")
    check(_DOCUMENT, meta, report)
    refuse_errors(report.findings, name)
    _refuse_shapes(heads, meta, name)
    arrays = {key: _array(archive, item) for key, item in entries.items()}
    raster = Raster(
        device_id=meta["device"],
        body_id=meta["body"],
        actuators=tuple(meta["actuators"]),
        columns=tuple(Column(**column) for column in meta["columns"]),
        times_s=arrays["times_s"],
        rate_hz=Fraction(*meta["rate_hz"]),
        values=arrays["values"],
        neutral=arrays["neutral"],
        shortfalls=tuple(Shortfall(**shortfall) for shortfall in meta["shortfalls"]),
        felt=tuple(
            FeltStream(Stream(*item), *(arrays[f"felt.{k}.{key}"] for key in FELT_ARRAYS))  # type: ignore[arg-type]
            for k, item in enumerate(meta["felt"])
        ),
    )
    raster_rules.refuse(raster, name)
    for k, stream in enumerate(raster.felt):
        indices, rows = stream.indices, len(raster.times_s)
        is_bad = (indices < 0) | (indices >= rows) | (np.diff(indices, prepend=-1) <= 0)
        if is_bad.any():
            place = int(np.argmax(is_bad))
            raise InputError(
                f"{name}: 'felt.{k}.indices' is {indices[place]} at {place}, allowed are ascending "
                f"rows from 0 to {rows - 1}."
            )
        if not np.isfinite(stream.strengths).all():
            raise InputError(f"{name}: 'felt.{k}.strengths' has numbers that are not finite.")
    return raster


def _refuse_shapes(heads: Mapping[str, _Head], meta: Mapping[str, Any], name: str) -> None:
    """Raise InputError for missing arrays, or shapes and types contradicting ``meta``; returns
    nothing. ``heads`` are shape and type of each array by name."""
    rows = heads["times_s"][0][:1] if "times_s" in heads else (0,)
    columns = (len(meta["columns"]),)
    # Shapes follow from the number of rows and of described columns.
    shapes = {"times_s": rows, "values": rows + columns, "neutral": columns}
    for key, shape in shapes.items():
        head = heads.get(key)
        if head is None:
            raise InputError(f"{name}: not a raster archive: it has no '{key}'.")
        if head != (shape, np.dtype(np.float64)) or not rows:
            raise InputError(
                f"{name}: '{key}' is {head[1]} of the shape {head[0]}, "
                f"allowed is float64 of {shape}."
            )
    for k in range(len(meta["felt"])):
        first = heads.get(f"felt.{k}.indices")
        for array_name, kind in FELT_ARRAYS.items():
            head = heads.get(f"felt.{k}.{array_name}")
            if not head or not first or len(first[0]) != 1 or head != (first[0], np.dtype(kind)):
                raise InputError(f"{name}: the arrays 'felt.{k}' are missing or do not fit.")


def _head(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> _Head:
    """Read shape and type of an array; ValueError for objects, records or a wrong size."""
    with archive.open(entry) as packed:
        file = io.BytesIO(packed.read(_HEAD_BYTES))
    version = np.lib.format.read_magic(file)  # type: ignore[no-untyped-call]
    if version != (1, 0):
        raise ValueError("an array of an unknown version")
    header = np.lib.format.read_array_header_1_0(file)  # type: ignore[no-untyped-call]
    shape, _, kind = header
    if kind.hasobject or kind.itemsize == 0 or kind.fields or kind.subdtype:
        raise ValueError("an array of an unknown kind")
    if any(type(length) is not int or length < 0 for length in shape):
        raise ValueError("an array of an unknown shape")
    if math.prod(shape) * kind.itemsize != entry.file_size - file.tell():
        raise ValueError("an array of the wrong size")
    return shape, kind


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> npt.NDArray[Any]:
    """Unpack an array into C order; zipfile.BadZipFile for a wrong checksum."""
    with archive.open(entry) as packed:
        array = np.lib.format.read_array(packed)  # type: ignore[no-untyped-call]
        packed.read(1)  # reading the end makes zipfile compare the checksum
    return np.ascontiguousarray(array)
