# SPDX-License-Identifier: GPL-3.0-or-later
"""A raster as a CSV table: one row a time, one column a parameter of an actuator."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..atomic_files import atomic_file
from ..engine.rendering.raster import Raster

SUFFIX = ".csv"
_BLOCK_ROWS = 4096


def header_line(raster: Raster) -> str:
    """Column names with units: ``time_s,r1c1.amplitude_m_s2 [m/s^2],...``."""
    names = [f"{each.actuator}.{each.parameter} [{each.unit}]" for each in raster.columns]
    return ",".join(["time_s", *names])


def write(raster: Raster, path: Path) -> None:
    """Write a raster as CSV (RFC 4180, UTF-8, no comments, a dot before decimals).

    Values have nine significant digits, times twelve: finer than any device, and a time on
    a 1 kHz clock reads as it is meant (``0.003``).

    Raises
    ------
    OutputError
        The file cannot be written; nothing is left of it then.
    """
    row_format = ",".join(["%.12g", *["%.9g"] * len(raster.columns)]) + "\r\n"
    with atomic_file(path) as file:
        file.write((header_line(raster) + "\r\n").encode())
        for first in range(0, len(raster.times_s), _BLOCK_ROWS):
            part = slice(first, first + _BLOCK_ROWS)
            rows = np.column_stack([raster.times_s[part], raster.values[part] + 0.0])
            file.write((row_format * len(rows) % tuple(rows.ravel().tolist())).encode())
