# SPDX-License-Identifier: GPL-3.0-or-later
"""Description of the measuring machine, and the history file of measurements."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hfx_blender.engine.native import library
from hfx_blender.errors import InputError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.version import __version__

_PACKAGES = ("numpy", "scipy", "trimesh", "embreex", "libigl")


def describe() -> dict[str, Any]:
    """Describe machine, versions and UTC time; None for an unknown load, Blender or package."""
    bpy = sys.modules.get("bpy")
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "hfx": __version__,
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "processors": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "blender": None if bpy is None else str(bpy.app.version_string),
        "engine": library.state(),
        **{name: _version(name) for name in _PACKAGES},
    }


def as_line(machine: dict[str, Any]) -> str:
    """Format a result of :func:`describe` as one line, for a terminal or a caption."""
    blender = f", Blender {machine['blender']}" if machine["blender"] else ""
    load = "" if machine["load"] is None else f", load {machine['load']:.0f}"
    engine = f", engine: {machine['engine']}" if "engine" in machine else ""  # in older histories
    return (
        f"hfx {machine['hfx']}{blender}, Python {machine['python']}, "
        f"numpy {machine['numpy']}{engine}, "
        f"{machine['processors']} x {machine['processor']}, {machine['system']}, "
        f"{machine['date'].partition('T')[0]}{load}"
    )


def as_one_line(machines: Sequence[dict[str, Any]]) -> str:
    """Format several descriptions as one line; differing values are listed, the load is left out.

    Machines without a value (such as Blender's version) do not count for that value.
    """
    together: dict[str, Any] = {}
    for key in dict.fromkeys(key for machine in machines for key in machine):
        values = [machine[key] for machine in machines if machine.get(key) is not None]
        if key == "date":
            values = sorted(date.partition("T")[0] for date in values)
        together[key] = " and ".join(dict.fromkeys(map(str, values))) or None
    return as_line({**together, "load": None})


def append(path: Path, record: dict[str, Any]) -> int:
    """Append a measurement to a history, one JSON object a line; returns the number of lines.

    Raises
    ------
    InputError
        The existing file is no history of measurements; the file stays unchanged.
    OutputError
        The file cannot be written; its content stays unchanged.
    """
    try:
        before = path.read_bytes() if path.exists() else b""
        lines = before.decode().splitlines()
        for line in lines:
            if not isinstance(json.loads(line), dict):
                raise ValueError("not an object")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a history of measurements ({error}).") from error
    if before and not before.endswith(b"\n"):
        before += b"\n"
    with atomic_file(path) as file:
        file.write(before + json.dumps(record, sort_keys=True).encode() + b"\n")
    return len(lines) + 1


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    except OSError:
        pass
    return platform.processor() or "unknown processor"


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
