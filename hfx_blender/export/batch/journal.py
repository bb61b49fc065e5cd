# SPDX-License-Identifier: GPL-3.0-or-later
"""Journal of earlier exports; a report of a scene is an entry.

A report gets the final name after all listed files, and contains sizes and hashes of results and
inputs, options and versions. A scene with a report that still matches is therefore complete,
whichever machine exported the scene, and an interrupted batch needs no repair.
"""

import sys
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

from ...devices.configuration import find_file
from ...devices.configurations import surface_calibration
from ...devices.live.approval import script_of
from ...engine.body.model import load_model
from ...engine.native.library import library
from ...errors import HfxError, InputError
from ...files.atomic import stored_json
from ...files.hashes import FOLDER, NOT_READ, TOO_MANY, is_elsewhere, sha256_of, state_of
from ...files.kinds import REPORT_SUFFIX
from ...version import __version__
from ..result_files import listed
from .units import Unit


def tools() -> dict[str, str | bool]:
    """Versions that may affect the results ("unknown" without Blender), and the presence of the
    compiled library."""
    # The process that reads the journal need not load Blender: the package states its version.
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
    """Inputs of the export of the open file, as plain data for a report. ``devices`` are names or
    files, ``models`` ids of body models."""
    files: dict[str, str | None] = {}
    if unit.input is not None:
        files[Path(unit.input).name] = sha256_of(Path(unit.input))
        from ...blender.linked_files import linked_files  # needs Blender

        for name, linked in linked_files().items():
            if is_elsewhere(linked.path, Path(unit.input)):
                files[name] = NOT_READ
            elif linked.must_be and linked.path.is_dir():
                files[name] = FOLDER
            else:
                try:
                    # None counts as a state, because a missing file may come back.
                    files[name] = state_of(linked.path, Path(unit.input))
                except InputError:  # too many files for a hash
                    files[name] = TOO_MANY
    return {
        "files": files,
        "devices": {name: device_hash(name) for name in devices},
        "models": {model: load_model(model).content_hash for model in models},
        "calibration": surface_calibration.load(),
        "options": unit.options.as_json(),
        "tools": tools(),
    }


def is_still(recorded: Any, unit: Unit) -> bool:
    """Test that recorded inputs equal those of ``unit``: the .blend, linked files, options,
    versions, devices, models and calibration. False for an invalid record and for linked files that
    are not read, or that are on another machine."""
    if unit.input is None or not isinstance(recorded, dict):
        return False
    source = Path(unit.input)

    def has_state(name: str, known: str | None) -> bool:
        """Test a linked file for a state; a name with ``//`` is relative to the .blend."""
        path = source.parent / name.removeprefix("//") if name.startswith("//") else Path(name)
        if known in (TOO_MANY, NOT_READ) or is_elsewhere(path, source):
            return False  # a state that was not read cannot be compared
        return path.is_dir() if known == FOLDER else state_of(path, source) == known

    try:
        # Cheap comparisons come first: files are hashed only with equal options and versions.
        files = dict(recorded["files"])
        return (
            recorded["options"] == unit.options.as_json()
            and recorded["tools"] == tools()
            and recorded["calibration"] == surface_calibration.load()
            and source.name in files
            and sha256_of(source) == files.pop(source.name)
            and all(has_state(name, known) for name, known in files.items())
            and all(device_hash(name) == known for name, known in recorded["devices"].items())
            and all(load_model(m).content_hash == known for m, known in recorded["models"].items())
        )
    except (KeyError, TypeError, ValueError, AttributeError, OSError, HfxError):
        return False  # not such a record, or a file has vanished


def device_hash(name: str) -> str:
    """Hash of a device's configuration, and of its script with the state of the approval. Raises
    FileNotFoundError for an unknown device."""
    path = find_file(name)
    if path is None:
        raise FileNotFoundError(name)
    script = script_of(name)
    if script is None:
        return sha256_of(path)
    return script.fingerprint if script.is_approved else f"{script.fingerprint} not approved"


def finished(unit: Unit) -> dict[str, Any] | None:
    """Report of an earlier export of ``unit`` with equal inputs, options, versions and results.
    None without one, and if a device was left out because its script did not run."""
    folder = Path(unit.folder)
    report = stored_json(folder / (unit.stem + REPORT_SUFFIX))
    if report is None or not is_still(report.get("made_from"), unit):
        return None
    # The script of a silent device may run today.
    if report.get("silent_devices"):
        return None
    return report if has_files(report, folder) else None


def has_files(report: dict[str, Any], folder: Path) -> bool:
    """Test that all files of a report exist unchanged; False for an invalid report."""
    try:
        return all(
            (path := listed(folder, file["name"])) is not None
            and path.stat().st_size == file["bytes"]
            and sha256_of(path) == file["sha256"]
            for file in report["files"]
        )
    except (KeyError, TypeError, ValueError, OSError):
        return False
