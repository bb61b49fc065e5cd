# SPDX-License-Identifier: GPL-3.0-or-later
"""Journal of earlier exports: each scene's own report is its entry.

A report gets its name after all files that it lists, and says with sizes and hashes what was
written and what it was made from: files, options, versions. So an interrupted batch needs no
repair: what has a report that still holds is complete, whichever machine made it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...devices.configuration import find_file
from ...devices.configurations import surface_calibration
from ...devices.live.approval import script_of
from ...engine.body.model import load_model
from ...engine.native.library import library
from ...errors import HfxError, InputError
from ...files.hashes import FOLDER, NOT_READ, TOO_MANY, is_elsewhere, sha256_of, state_of
from ...version import __version__
from ..report import REPORT_SUFFIX, read
from ..result_files import listed
from .units import Unit

if TYPE_CHECKING:
    from ...blender.linked_files import LinkedFile


def tools() -> dict[str, str | bool]:
    """Versions that may affect the results, and the presence of the compiled library."""
    bpy = sys.modules.get("bpy")
    if bpy is not None:
        blender = ".".join(map(str, bpy.app.version))
    else:
        try:
            blender = ".".join(metadata.version("bpy").split(".")[:3])
        except metadata.PackageNotFoundError:
            blender = "unknown"
    return {"hfx": __version__, "blender": blender, "native": library() is not None}


def made_from(unit: Unit, devices: Iterable[str], models: Iterable[str]) -> dict[str, Any]:
    """Inputs of the export of the open file; plain data, for its report.

    Parameters
    ----------
    devices : iterable of str
        Names or files of the devices.
    models : iterable of str
        Ids of the body models.
    """
    files: dict[str, str | None] = {}
    if unit.input is not None:
        files[Path(unit.input).name] = sha256_of(Path(unit.input))
        from ...blender.linked_files import linked_files  # which needs Blender

        for name, each in linked_files().items():
            # None is a state, too: a missing file may come back.
            files[name] = _state(each, Path(unit.input))
    return {
        "files": files,
        "devices": {name: device_hash(name) for name in devices},
        "models": {model: load_model(model).content_hash for model in models},
        "calibration": surface_calibration.load(),
        "options": unit.options.as_json(),
        "tools": tools(),
    }


def is_still(recorded: Any, unit: Unit) -> bool:
    """Test that the recorded inputs of an export are those that ``unit`` has now."""
    if unit.input is None or not isinstance(recorded, dict):
        return False
    source = Path(unit.input)
    try:
        files = dict(recorded["files"])
        return (
            recorded["options"] == unit.options.as_json()
            and recorded["tools"] == tools()
            and recorded["calibration"] == surface_calibration.load()
            and source.name in files
            and sha256_of(source) == files.pop(source.name)
            and all(_has_state(name, source, known) for name, known in files.items())
            and all(device_hash(name) == known for name, known in recorded["devices"].items())
            and all(load_model(m).content_hash == known for m, known in recorded["models"].items())
        )
    except (KeyError, TypeError, ValueError, AttributeError, OSError, HfxError):
        return False  # not such a record, or a file has vanished


def _state(linked: LinkedFile, source: Path) -> str | None:
    if is_elsewhere(linked.path, source):
        return NOT_READ
    if linked.must_be and linked.path.is_dir():
        return FOLDER
    try:
        return state_of(linked.path, source)
    except InputError:  # a folder of more files than are hashed
        return TOO_MANY


def _has_state(name: str, source: Path, known: str | None) -> bool:
    """Test the state of a file that is named as in a .blend; ``//`` is the .blend's own folder."""
    path = source.parent / name.removeprefix("//") if name.startswith("//") else Path(name)
    if known in (TOO_MANY, NOT_READ) or is_elsewhere(path, source):
        return False
    return path.is_dir() if known == FOLDER else state_of(path, source) == known


def device_hash(name: str) -> str:
    """Hash of a device's configuration; with a script, of both, and of the script's approval."""
    path = find_file(name)
    if path is None:
        raise FileNotFoundError(name)
    script = script_of(name)
    if script is None:
        return sha256_of(path)
    return script.fingerprint if script.is_approved else f"{script.fingerprint} not approved"


def finished(unit: Unit) -> dict[str, Any] | None:
    """The report of an earlier export of ``unit``, if nothing has changed since.

    None if there is none, an input, an option or a version is another one, one of the files is
    missing or is not what was written, or a device was left out as its script did not run.
    """
    folder = Path(unit.folder)
    report = read(folder / (unit.stem + REPORT_SUFFIX))
    if report is None or not is_still(report.get("made_from"), unit):
        return None
    if report.get("silent_devices"):
        return None
    return report if has_files(report, folder) else None


def has_files(report: dict[str, Any], folder: Path) -> bool:
    """Test that all files that a report lists are present and unchanged."""
    try:
        return all(
            (path := listed(folder, each["name"])) is not None
            and path.stat().st_size == each["bytes"]
            and sha256_of(path) == each["sha256"]
            for each in report["files"]
        )
    except (KeyError, TypeError, ValueError, OSError):
        return False
