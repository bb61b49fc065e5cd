# SPDX-License-Identifier: GPL-3.0-or-later
"""Raster as a CSV table: a row per time, a column per parameter of an actuator."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...engine.rendering.device_config import DeviceConfig
from ...engine.rendering.raster import Column, Raster
from ...engine.stepwise import tell
from ...errors import InputError
from ...files import limits
from ...files.atomic import atomic_file
from ...files.findings import Finding, decoding_findings
from ...files.strict_json import read_data
from ..registry import FORMATS
from ..written import Written
from . import raster_rules

SUFFIX: Final = FORMATS["csv"].suffix
_BLOCK_ROWS = 4096
_COLUMN: Final = re.compile(r"([^\n,]{1,400})\.([a-z0-9_]{1,60}) \[([^\n,\]]{1,20})\]")
_MAX_COLUMNS: Final = 100_000


def column_name(column: Column) -> str:
    """Name of a column in the first line: ``r1c1.amplitude_m_s2 [m/s^2]``."""
    return f"{column.actuator}.{column.parameter} [{column.unit}]"


def write(raster: Raster, path: Path) -> None:
    """Write a raster as CSV (RFC 4180, UTF-8, no comments, decimal points). Values have nine
    significant digits and times twelve, finer than any device; times of a 1 kHz clock are exact
    (``0.003``). Raises OutputError for an unwritable file; no partial file remains."""
    row_format = ",".join(["%.9g"] * len(raster.columns))
    with atomic_file(path) as file:
        file.write((",".join(["time_s", *map(column_name, raster.columns)]) + "\r\n").encode())
        for first in range(0, len(raster.times_s), _BLOCK_ROWS):
            part = slice(first, first + _BLOCK_ROWS)
            known: dict[bytes, str] = {}  # most rows repeat (silence, holds): format each once
            lines = []
            rows = raster.values[part] + 0.0  # -0.0 becomes 0.0
            for time_s, row in zip(raster.times_s[part].tolist(), rows, strict=True):
                key = row.tobytes()
                if key not in known:
                    known[key] = row_format % tuple(row.tolist())
                lines.append(f"{time_s:.12g},{known[key]}\r\n")
            file.write("".join(lines).encode())


def export(raster: Raster, device: DeviceConfig, stem: Path, tolerance: float) -> Written:
    """Write the output of a device exactly as ``stem.csv``; ``tolerance`` is not used."""
    path = stem.with_name(stem.name + SUFFIX)
    write(raster, path)
    return Written((path,))


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the first fault of a file as a finding, or none."""
    return decoding_findings("CSV", decode, content, name)


def read(path: Path) -> Raster:
    """Read a raster with empty device and body, and the first row as neutral, for conversion.
    Raises InputError for an unreadable file or another table."""
    return decode(read_data(path), str(path))


def facts(path: Path) -> dict[str, Any]:
    """Rows, rate, actuators and columns of a file for ``hfx info``; InputError if invalid."""
    return raster_rules.facts(read(path))


def decode(content: bytes, name: str) -> Raster:
    """Decode a raster: the first row gives the neutral values, the times the rate. The rate is the
    mean of ascending times, as a fraction with a denominator of at most 1001; 100 Hz for a single
    time. Raises InputError, with ``name``, as :func:`read`."""
    first, _, rest = content.partition(b"\n")
    try:
        names = first.decode("utf-8-sig").rstrip("\r").split(",")
        text = rest.decode("ascii")
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: is not text ({error.reason}).") from None
    matches = [_COLUMN.fullmatch(column) for column in names[1:_MAX_COLUMNS]]
    if names[0] != "time_s" or not all(matches) or len(names) > _MAX_COLUMNS:
        raise InputError(
            f"{name}: line 1 is not 'time_s,actuator.parameter [unit],...', which rasters have."
        )
    columns = tuple(Column(match[1], match[2], match[3]) for match in matches if match)
    if not text.strip():
        raise InputError(f"{name}: has no rows.")
    # An upper bound of the numbers, before numpy allocates them.
    numbers = text.count(",") + max(text.count("\n"), text.count("\r"))
    limits.MEMORY.check(8.0 * numbers, name, "its values would take")
    try:
        table = np.loadtxt(_lines_of(rest), np.float64, delimiter=",", ndmin=2, comments=None)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{name}: not a table of numbers ({error}).") from None
    if table.size == 0 or table.shape[1] != len(names):
        raise InputError(f"{name}: expected {len(names)} numbers in each line.")
    times = table[:, 0]
    # Uneven times are refused below, whatever their rate is.
    rate_hz = Fraction(100)
    if len(times) > 1 and np.isfinite(times).all():
        lasts = float(times[-1]) - float(times[0])
        rate = (len(times) - 1) / lasts if lasts > 0.0 else 0.0
        if 0.0 < rate < math.inf:
            rate_hz = Fraction(rate).limit_denominator(1001)  # 1001: of 29.97 Hz, 30000/1001
    raster = Raster(
        device_id="",
        body_id="",
        actuators=tuple(dict.fromkeys(column.actuator for column in columns)),
        columns=columns,
        times_s=times,
        rate_hz=rate_hz,
        values=table[:, 1:],
        neutral=table[0, 1:].copy(),
        shortfalls=(),
        felt=(),
    )
    raster_rules.refuse(raster, name)
    return raster


def _lines_of(content: bytes) -> Iterator[str]:
    """Yield the lines of a text in ASCII, with reports of progress."""
    source = io.BytesIO(content)
    for k, line in enumerate(io.TextIOWrapper(source, "ascii"), start=1):
        if k % _BLOCK_ROWS == 0:
            tell(source.tell() / len(content))
        yield line
