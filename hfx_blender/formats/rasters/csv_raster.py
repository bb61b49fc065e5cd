# SPDX-License-Identifier: GPL-3.0-or-later
"""Raster as a CSV table: a row per time, a column per parameter of an actuator."""

from pathlib import Path
from typing import Final

from ...engine.rendering.raster import Column, Raster
from ...files.atomic import atomic_file
from ..registry import FORMATS
from ..written import single_file

SUFFIX: Final = FORMATS["csv"].suffix
_BLOCK_ROWS = 4096


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


export: Final = single_file(write, SUFFIX)
