# SPDX-License-Identifier: GPL-3.0-or-later
"""Machine that a measurement was made on, and the file that measurements are stored in."""

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
    """Machine, versions, and the time."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "hfx": __version__,
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "processors": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "blender": _blender(),
        "engine": library.state(),
        **{name: _version(name) for name in _PACKAGES},
    }


def as_line(found: dict[str, Any]) -> str:
    """Description of the machine for a terminal or a caption, in one line."""
    blender = f", Blender {found['blender']}" if found["blender"] else ""
    load = "" if found["load"] is None else f", load {found['load']:.0f}"
    engine = f", engine: {found['engine']}" if "engine" in found else ""  # in older histories
    return (
        f"hfx {found['hfx']}{blender}, Python {found['python']}, numpy {found['numpy']}{engine}, "
        f"{found['processors']} x {found['processor']}, {found['system']}, "
        f"{found['date'].partition('T')[0]}{load}"
    )


def as_one_line(machines: Sequence[dict[str, Any]]) -> str:
    """The same of measurements that are shown together: what differs is listed, without the load.

    A process that did not start Blender tells of none.
    """
    together: dict[str, Any] = {}
    for key in dict.fromkeys(key for each in machines for key in each):
        values = [each[key] for each in machines if each.get(key) is not None]
        if key == "date":
            values = sorted(each.partition("T")[0] for each in values)
        together[key] = " and ".join(dict.fromkeys(map(str, values))) or None
    return as_line({**together, "load": None})


def append(path: Path, record: dict[str, Any]) -> int:
    """Append a measurement to a history, one JSON object a line; returns their number.

    Raises
    ------
    InputError
        The file is there and is something else: nothing is added to it.
    OutputError
        It cannot be written; it is as it was.
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


def _blender() -> str | None:
    bpy = sys.modules.get("bpy")
    return None if bpy is None else str(bpy.app.version_string)


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
