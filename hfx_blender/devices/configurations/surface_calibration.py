# SPDX-License-Identifier: GPL-3.0-or-later
"""Calibration constant c_v of the textile paper, stored by device in the user's data folder.

Not in a .blend, which is passed on to users with other devices.
"""

import math

from ...engine.texture.surface_names import DRIVE_PER_M
from ...errors import InputError
from ...files import resources
from ...files.atomic import amend_json, stored_json

ANY_DEVICE = ""  # key of the value for devices without a value
_MOST_PER_M = 1e9


def load() -> dict[str, float]:
    """Load c_v, 1/m, by device; invalid values and an unreadable file are ignored."""
    content = stored_json(resources.surface_calibration()) or {}
    return {str(name): value for name, value in content.items() if _is_valid(value)}


def drive_per_m(device: str = ANY_DEVICE) -> float:
    """c_v of a device, 1/m: its own value, else that of :data:`ANY_DEVICE`, else the default."""
    known = load()
    return known.get(device, known.get(ANY_DEVICE, DRIVE_PER_M))


def of_device(*names: str) -> float | None:
    """c_v, 1/m, of the first of a device's names with a value; None without any."""
    known = load()
    return next((known[name] for name in names if name and name in known), None)


def store(value_per_m: float, device: str = ANY_DEVICE) -> None:
    """Store c_v of a device; entries of concurrent processes are kept.

    Raises InputError: the value is no number above zero.
    Raises OutputError: the file cannot be written.
    """
    if not _is_valid(value_per_m):
        raise InputError(f"Calibration: {value_per_m} per metre; expected a number above 0.")
    amend_json(
        resources.surface_calibration(),
        lambda: dict(sorted({**load(), device: float(value_per_m)}.items())),
    )


def _is_valid(value: object) -> bool:
    """Test for a finite number above 0, at most 1e9."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value) and 0.0 < value <= _MOST_PER_M
