# SPDX-License-Identifier: GPL-3.0-or-later
"""Units of work as messages to worker processes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from hfx_blender.export.batch.units import ExportOptions, Unit
from hfx_blender.processes.messages import decode_json, json_message


def encode_unit(unit: Unit) -> bytes:
    """Encode a unit as a message; options with default values are left out."""
    return json_message({**asdict(unit), "options": unit.options.as_json()})


def decode_unit(body: bytes) -> Unit:
    """Unit of the body of :func:`encode_unit`; TypeError for unknown options or members."""
    data = decode_json(body)
    options = ExportOptions(**_with_tuples(data.pop("options")))
    return Unit(options=options, **_with_tuples(data))


def _with_tuples(members: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(v) if isinstance(v, list) else v for key, v in members.items()}
