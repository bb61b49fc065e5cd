# SPDX-License-Identifier: GPL-3.0-or-later
"""Calibration constant c_v of the textile paper, set per user and device.

It is kept beside the user's data, by device: never in a .blend, which others open.
"""

from __future__ import annotations

import json
import math

from ...engine.texture.surface_names import DRIVE_PER_M
from ...errors import InputError
from ...files import resources
from ...files.atomic import amend_json

ANY_DEVICE = ""
"""Key of the value for devices that were not calibrated."""

_MOST_PER_M = 1e9


def load() -> dict[str, float]:
    """Load c_v in 1/m by device; unreadable values count as never set."""
    try:
        found = json.loads(resources.surface_calibration().read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(found, dict):
        return {}
    return {str(name): value for name, value in found.items() if _is_good(value)}


def drive_per_m(device: str = ANY_DEVICE) -> float:
    """Drive constant c_v of a device: its own, else the one for any, else the default."""
    known = load()
    return known.get(device, known.get(ANY_DEVICE, DRIVE_PER_M))


def of_device(*names: str) -> float | None:
    """Calibrated c_v in 1/m of a device itself, by the first of its names that has one."""
    known = load()
    return next((known[name] for name in names if name and name in known), None)


def store(value_per_m: float, device: str = ANY_DEVICE) -> None:
    """Remember c_v for a device; what another process remembers meanwhile stays.

    Raises
    ------
    InputError
        It is no number above zero.
    OutputError
        It cannot be stored.
    """
    if not _is_good(value_per_m):
        raise InputError(f"Calibration: {value_per_m} per metre; expected a number above 0.")
    amend_json(
        resources.surface_calibration(),
        lambda: dict(sorted({**load(), device: float(value_per_m)}.items())),
    )


def _is_good(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value) and 0.0 < value <= _MOST_PER_M
