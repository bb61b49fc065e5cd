# SPDX-License-Identifier: GPL-3.0-or-later
"""A raster as a NumPy archive: everything of it, to the last bit.

``docs/formats/index.md`` names the arrays; ``numpy.load`` reads them without this package.
"""

from __future__ import annotations

import io
import json
import tokenize
import zipfile
import zlib
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..atomic_files import atomic_file
from ..engine.rendering.raster import Column, Felt, Raster, Shortfall
from ..engine.samples import Stream
from ..errors import InputError
from .checking import (
    MAX_BYTES,
    Anything,
    Finding,
    Items,
    Number,
    Record,
    Report,
    Text,
    check,
    decoding_findings,
    parse,
    read_bytes,
    refuse_errors,
)

SUFFIX: Final = ".raster.npz"
FORMAT: Final = "hfx-raster"
MAX_ARRAY_BYTES: Final = 4 << 30
"""All arrays together: a day at 100 Hz of 60 columns."""

_TEXT = Text()
_DOCUMENT = Record(
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
                    "reason": Text(
                        ("modality", "place", "device", "frequency", "limit", "threshold")
                    ),
                    "samples": Number(0, is_whole=True),
                    "share": Number(),
                    "seconds": Number(),
                }
            )
        ),
        "felt": Items(Items(_TEXT, least=4, most=4)),
    },
    {"tools": Anything()},
    unknown="error",
)
_FELT: Final = {"indices": np.int64, "strengths": np.float64, "is_rendered": np.bool_}
_DAMAGE: Final = (
    OSError,
    EOFError,
    ValueError,
    KeyError,
    IndexError,
    RuntimeError,
    NotImplementedError,
    tokenize.TokenError,  # numpy takes an array's header apart with it
    zipfile.BadZipFile,
    zlib.error,
)


def write(raster: Raster, path: Path) -> None:
    """Write a raster; the same bytes for the same raster.

    Raises
    ------
    OutputError
        The file cannot be written; nothing is left of it then.
    """
    meta = {
        "format": FORMAT,
        "version": 1,
        "device": raster.device_id,
        "body": raster.body_id,
        "rate_hz": list(raster.rate_hz.as_integer_ratio()),
        "actuators": list(raster.actuators),
        "columns": [
            {"actuator": c.actuator, "parameter": c.parameter, "unit": c.unit}
            for c in raster.columns
        ],
        "shortfalls": [vars(each) for each in raster.shortfalls],
        "felt": [
            [each.stream.effect_id, each.stream.body_id, each.stream.modality, each.stream.model_id]
            for each in raster.felt
        ],
    }
    arrays: dict[str, npt.NDArray[Any]] = {
        "meta": np.frombuffer(json.dumps(meta).encode(), np.uint8),
        "times_s": raster.times_s,
        "values": raster.values,
        "neutral": raster.neutral,
    }
    for k, each in enumerate(raster.felt):
        arrays |= {f"felt.{k}.{name}": getattr(each, name) for name in _FELT}
    with atomic_file(path) as file:
        np.savez_compressed(file, **arrays)


def validate(content: bytes, name: str) -> list[Finding]:
    """Faults of a file."""
    return decoding_findings("NPZ", decode, content, name)


def read(path: Path) -> Raster:
    """The raster of a file.

    Raises
    ------
    InputError
        It cannot be read, is no raster, or is damaged.
    """
    return decode(read_bytes(path, 16 * MAX_BYTES), str(path))


def decode(content: bytes, name: str) -> Raster:
    """:func:`read` from bytes."""
    try:
        arrays = _arrays(content)
    except _DAMAGE as error:
        raise InputError(f"{name}: not a raster archive, or damaged ({error}).") from error
    if "meta" not in arrays or arrays["meta"].dtype != np.uint8:
        raise InputError(f"{name}: not a raster archive: it has no 'meta'.")
    meta = parse(arrays["meta"].tobytes(), name)
    report = Report("NPZ")
    check(_DOCUMENT, meta, report)
    refuse_errors(report.findings, name)
    expected = {
        "times_s": (len(arrays.get("times_s", ())),),
        "values": (len(arrays.get("times_s", ())), len(meta["columns"])),
        "neutral": (len(meta["columns"]),),
    }
    for each, shape in expected.items():
        found = arrays.get(each)
        if found is None or found.dtype != np.float64 or found.shape != shape:
            raise InputError(f"{name}: '{each}' is not float64 of the shape {shape}.")
        if not np.isfinite(found).all():
            raise InputError(f"{name}: '{each}' has numbers that are not finite.")
    return Raster(
        device_id=meta["device"],
        body_id=meta["body"],
        actuators=tuple(meta["actuators"]),
        columns=tuple(Column(**each) for each in meta["columns"]),
        times_s=arrays["times_s"],
        rate_hz=Fraction(*meta["rate_hz"]),
        values=arrays["values"],
        neutral=arrays["neutral"],
        shortfalls=tuple(Shortfall(**each) for each in meta["shortfalls"]),
        felt=tuple(_felt(arrays, k, Stream(*each), name) for k, each in enumerate(meta["felt"])),
    )


def _felt(arrays: dict[str, npt.NDArray[Any]], k: int, stream: Stream, name: str) -> Felt:
    columns = [arrays.get(f"felt.{k}.{each}") for each in _FELT]
    for column, kind in zip(columns, _FELT.values(), strict=True):
        first = columns[0]
        if column is None or first is None or column.dtype != kind or column.shape != first.shape:
            raise InputError(f"{name}: the arrays 'felt.{k}' are missing or do not fit.")
    return Felt(stream, *columns)  # type: ignore[arg-type]


def _arrays(content: bytes) -> dict[str, npt.NDArray[Any]]:
    """All arrays; a small file that would unpack to a huge one is refused before it does."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_ARRAY_BYTES or size > 2048 * len(content) + (1 << 20):
            raise ValueError(f"its arrays would be {size} bytes")
        found = {}
        for entry in archive.infolist():
            with archive.open(entry) as file:
                found[entry.filename.removesuffix(".npy")] = _array(file.read(), entry.file_size)
    return found


def _array(content: bytes, size: int) -> npt.NDArray[Any]:
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)  # type: ignore[no-untyped-call]
    if version != (1, 0):
        raise ValueError("an array of an unknown version")
    header = np.lib.format.read_array_header_1_0(file)  # type: ignore[no-untyped-call]
    shape, is_fortran, kind = header
    if kind.hasobject or is_fortran or kind.itemsize == 0:
        raise ValueError("an array of an unknown kind")
    count = 1
    for each in shape:
        count *= each
    if count < 0 or count * kind.itemsize != size - file.tell():
        raise ValueError("an array of the wrong size")
    return np.frombuffer(content, kind, offset=file.tell()).reshape(shape).copy()
