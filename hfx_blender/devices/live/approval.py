# SPDX-License-Identifier: GPL-3.0-or-later
"""Which device scripts may run: shipped ones, and those that the user has approved.

An approval is for the bytes of script and configuration and for the version of the interface;
a changed byte asks again. It is not a sandbox: an approved script has its user's rights.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from ... import resources
from ...atomic_files import atomic_file
from ...errors import InputError
from ..configuration import find_file, script_beside
from .haptics import API_VERSION


@dataclass(frozen=True)
class DeviceScript:
    """The script beside a device's configuration, as it is now."""

    path: Path
    configuration: Path
    fingerprint: str
    is_approved: bool

    def as_wish(self) -> dict[str, str]:
        """What :meth:`LiveClient.connect` takes."""
        return {
            "path": str(self.path),
            "configuration": str(self.configuration),
            "fingerprint": self.fingerprint,
        }


def script_of(name_or_path: str | Path, folder: Path | None = None) -> DeviceScript | None:
    """The script of a device: ``<device>.py`` beside its configuration; None: it has none.

    Raises
    ------
    InputError
        One of the files cannot be read.
    """
    configuration = find_file(name_or_path, folder)
    path = None if configuration is None else script_beside(configuration)
    if configuration is None or path is None:
        return None
    mark = fingerprint(path, configuration)
    is_shipped = path.resolve().parent == resources.device_configs().resolve()
    return DeviceScript(path, configuration, mark, is_shipped or mark in _approved())


def fingerprint(script: Path, configuration: Path) -> str:
    """What an approval is for.

    Raises
    ------
    InputError
        One of the files cannot be read.
    """
    try:
        return fingerprint_of(script.read_bytes(), configuration.read_bytes())
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror}).") from None


def fingerprint_of(script: bytes, configuration: bytes) -> str:
    """The same, of what has been read already."""
    digest = hashlib.sha256(f"hfx-script {API_VERSION}".encode())
    for content in (script, configuration):
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content)
    return digest.hexdigest()


def approve(script: DeviceScript) -> None:
    """Remember that the user allows these very bytes.

    Raises
    ------
    InputError
        They have changed since they were shown.
    OutputError
        It cannot be stored.
    """
    if fingerprint(script.path, script.configuration) != script.fingerprint:
        raise InputError(f"{script.path}: has changed just now; look at it again.")
    _store({**_approved(), script.fingerprint: script.path.name})


def revoke(script: DeviceScript) -> None:
    """Ask again next time.

    Raises
    ------
    OutputError
        It cannot be stored.
    """
    _store({mark: name for mark, name in _approved().items() if mark != script.fingerprint})


def _approved() -> dict[str, str]:
    """File names by fingerprint; what cannot be read approves nothing."""
    try:
        found = json.loads(resources.approved_scripts().read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(found, dict):
        return {}
    return {str(mark): str(name) for mark, name in found.items()}


def _store(approved: dict[str, str]) -> None:
    path = resources.approved_scripts()
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        file.write(json.dumps(approved, indent=1).encode())
