# SPDX-License-Identifier: GPL-3.0-or-later
"""Rasters of CSV tables: reader, check and facts."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.engine.rendering.raster import Column, Raster
from hfx_blender.engine.stepwise import tell
from hfx_blender.errors import InputError
from hfx_blender.files import limits
from hfx_blender.files.findings import Finding
from hfx_blender.files.strict_json import read_data

from . import raster_rules

_LINES_BETWEEN: Final = 4096  # lines between two reports of progress
_COLUMN: Final = re.compile(r"([^\n,]{1,400})\.([a-z0-9_]{1,60}) \[([^\n,\]]{1,20})\]")
_MAX_COLUMNS: Final = 100_000


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the first fault of a file as a finding, or else a warning for a last line without an
    end: a file cut within its last number has none."""
    findings = raster_rules.decoding_findings("CSV", decode, content, name)
    if not findings and not content.endswith((b"\n", b"\r")):
        message = "the last line has no line end: the file may be cut within a number"
        findings.append(Finding("CSV-END", "", message, "warning"))
    return findings


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
        if k % _LINES_BETWEEN == 0:
            tell(source.tell() / len(content))
        yield line
