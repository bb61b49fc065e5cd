# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules, findings and facts of rasters, for any file format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.errors import InputError
from hfx_blender.files.findings import Finding, Report
from hfx_blender.formats.rasters.csv_raster import column_name
from hfx_blender.formats.writing import refuse_large

_MOST_HZ: Final = 10**6
_UNEVEN: Final = 0.01  # largest timing error, a share of a row
_BLOCK_ROWS: Final = 1 << 16
_PARAMETERS: Final = {
    parameter.name: parameter for each in MODALITIES.values() for parameter in each.controls
}


def refuse(raster: Raster, name: str) -> None:
    """Raise InputError, with file and field, for a raster breaking a rule; returns nothing. Rules:
    columns that differ, parameters of modalities in their units; a row or more, finite values (T,
    columns), 0 or more of parameters without negative values; rate up to 1 MHz, times ascending and
    evenly spaced within 1 % of a row (and rounding); the limits of duration and memory."""
    _refuse_columns(raster, name)
    times, rate = raster.times_s, raster.rate_hz
    if not len(times):
        raise InputError(f"{name}: 'times_s' has no rows.")
    shape = (len(times), len(raster.columns))
    if raster.values.shape != shape:
        raise InputError(
            f"{name}: 'values' has the shape {raster.values.shape}, allowed is {shape}."
        )
    if not 0 < rate <= _MOST_HZ:
        raise InputError(f"{name}: 'rate_hz' is {float(rate):g}, allowed is up to {_MOST_HZ} Hz.")
    refuse_large(raster, name)
    parts = [slice(first, first + _BLOCK_ROWS) for first in range(0, len(times), _BLOCK_ROWS)]
    for key, array in (("times_s", times), ("values", raster.values), ("neutral", raster.neutral)):
        if not all(np.isfinite(array[part]).all() for part in parts):
            raise InputError(f"{name}: '{key}' has numbers that are not finite.")
    for k, column in enumerate(raster.columns):
        values = raster.values[:, k]
        parameter = _PARAMETERS.get(column.parameter)
        if parameter is not None and parameter.minimum >= 0.0 and values.min() < 0.0:
            row = int(np.argmax(values < 0.0)) + 1
            raise InputError(
                f"{name}: '{column_name(column)}' is {values[row - 1]:g} in row {row}, allowed is "
                "0 or more."
            )
    with np.errstate(over="ignore"):  # an infinite gap fails the spacing rule below
        gaps = np.diff(times)
    if (gaps <= 0.0).any():
        row = int(np.flatnonzero(gaps <= 0.0)[0]) + 1
        raise InputError(f"{name}: 'times_s' does not ascend in row {row}.")
    # Rounding of times grows with their distance from 0, without making the spacing uneven.
    slack = _UNEVEN + 4.0 * float(rate) * float(np.spacing(np.abs(times[[0, -1]]).max()))
    with np.errstate(over="ignore"):
        off = np.abs(gaps * float(rate) - 1.0)
    if len(gaps) and off.max() > slack:
        row = int(np.argmax(off)) + 1
        raise InputError(
            f"{name}: 'times_s' is not evenly spaced in row {row}, allowed is one row every "
            f"{1.0 / float(rate):g} s."
        )


def _refuse_columns(raster: Raster, name: str) -> None:
    """Raise InputError for two equal columns, an actuator named twice, a column of an unlisted
    actuator, and a parameter of a modality in another unit; returns nothing."""
    for key, items in (
        ("actuators", raster.actuators),
        ("columns", [(column.actuator, column.parameter) for column in raster.columns]),
    ):
        twice = [item for item, count in Counter(items).items() if count > 1]
        if twice:
            found = twice[0] if isinstance(twice[0], str) else ".".join(twice[0])
            raise InputError(f"{name}: '{key}' has '{found[:60]}' twice, allowed is once.")
    for column in raster.columns:
        if column.actuator not in raster.actuators:
            raise InputError(
                f"{name}: the column '{column_name(column)}' is of an actuator that 'actuators' "
                "lacks."
            )
        parameter = _PARAMETERS.get(column.parameter)  # None: of a device's own
        if parameter is not None and column.unit != parameter.unit:
            raise InputError(
                f"{name}: the column '{column_name(column)}' has the unit '{column.unit[:20]}', "
                f"allowed is '{parameter.unit}'."
            )


def facts(raster: Raster) -> dict[str, Any]:
    """Rows, rate, duration, counts of actuators and columns, and sorted parameters with units."""
    return {
        "rows": len(raster.times_s),
        "rate_hz": float(raster.rate_hz),
        "seconds": len(raster.times_s) / float(raster.rate_hz),
        "actuators": len(raster.actuators),
        "columns": len(raster.columns),
        "parameters": sorted({f"{column.parameter} [{column.unit}]" for column in raster.columns}),
    }


def decoding_findings(
    format_name: str, decode: Callable[[bytes, str], object], content: bytes, name: str
) -> list[Finding]:
    """Decode a file; the decoding error is its only finding, without an error the list is empty."""
    report = Report(format_name)
    try:
        decode(content, name)
    except InputError as error:
        report.error("CONTENT", None, str(error).removeprefix(f"{name}: ").rstrip("."))
    return report.findings
