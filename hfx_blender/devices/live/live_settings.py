# SPDX-License-Identifier: GPL-3.0-or-later
"""Connection settings of this user's devices, stored in the user's data folder, never in a .blend.

A .blend brings names of devices only; a stranger's file so can open no port.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from typing import Any

from ...files import resources
from ...files.atomic import amend_json

MAX_OFFSET_MS = 1000.0


@dataclass(frozen=True)
class LiveSettings:
    """Connection settings of one device."""

    kind: str = "SIMULATOR"  # or DEVICE, AUDIO, CSV
    port: str = ""  # serial: empty is found by its USB ids; network: empty as configured; a card
    host: str = ""
    path: str = ""  # of a log
    offset_ms: float = 0.0
    unit: str = ""  # which of several: a name at a server, or the serial number of a port's device


def load() -> dict[str, LiveSettings]:
    """Load the settings by device; unreadable ones count as never set."""
    try:
        found = json.loads(resources.live_settings().read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(found, dict):
        return {}
    return {str(name): _one(each) for name, each in found.items() if isinstance(each, dict)}


def store(name: str, settings: LiveSettings) -> None:
    """Remember how a device is connected; what another process remembers meanwhile stays.

    Raises
    ------
    OutputError
        It cannot be stored.
    """
    if load().get(name) == settings:
        return

    def content() -> dict[str, Any]:
        known = {**load(), name: settings}
        return {each: asdict(known[each]) for each in sorted(known)}

    amend_json(resources.live_settings(), content)


def _one(found: dict[str, Any]) -> LiveSettings:
    taken: dict[str, Any] = {}
    for field in fields(LiveSettings):
        value = found.get(field.name, field.default)
        if isinstance(field.default, str):
            taken[field.name] = value if isinstance(value, str) else field.default
        else:
            is_number = isinstance(value, int | float) and math.isfinite(value)
            taken[field.name] = min(max(float(value), 0.0), MAX_OFFSET_MS) if is_number else 0.0
    return LiveSettings(**taken)
