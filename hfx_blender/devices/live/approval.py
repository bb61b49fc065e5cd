# SPDX-License-Identifier: GPL-3.0-or-later
"""Approval of device scripts: shipped ones, and those that the user has approved, may run.

An approval is for the bytes of script and configuration and for the version of the interface;
a changed byte asks again. The process that runs a script asks :func:`may_run` of the very bytes
it has read, whoever has it run; all others ask only to tell people sooner. It is not a sandbox:
an approved script has its user's rights.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ...errors import InputError
from ...files import resources
from ...files.atomic import amend_json
from ..configuration import find_file, script_beside
from ..workers.haptics import API_VERSION

_FINGERPRINT: Final = re.compile(r"[0-9a-f]{64}")
_MOST_BYTES: Final = 16 << 20


@dataclass(frozen=True)
class DeviceScript:
    """Script beside a device's configuration, in its present state."""

    path: Path
    configuration: Path
    fingerprint: str
    is_approved: bool

    def as_request(self) -> dict[str, str]:
        """Entry of :meth:`LiveClient.connect` for the script."""
        return {
            "path": str(self.path),
            "configuration": str(self.configuration),
            "fingerprint": self.fingerprint,
        }


def how_to_approve(name_or_path: str | Path) -> str:
    """Instructions to approve a device's script."""
    device = shlex.quote(str(name_or_path))
    return (
        f"read it and approve it by 'hfx device approve {device}', or under Live Devices in Blender"
    )


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
    return DeviceScript(path, configuration, mark, may_run(path, mark))


def may_run(script: Path, mark: str) -> bool:
    """Test that a script of this fingerprint may run."""
    return is_shipped(script) or mark in approved()


def is_shipped(script: Path) -> bool:
    """Test for a script of the release, which needs no approval and cannot lose it."""
    return script.resolve().parent == resources.device_configs().resolve()


def fingerprint(script: Path, configuration: Path) -> str:
    """Fingerprint that an approval refers to.

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
    """:func:`fingerprint` of content that has been read already."""
    digest = hashlib.sha256(f"hfx-script {API_VERSION}".encode())
    for content in (script, configuration):
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content)
    return digest.hexdigest()


def approve(script: DeviceScript) -> None:
    """Approve the script with its present bytes.

    Raises
    ------
    InputError
        They have changed since they were shown, or the list of approvals cannot be read.
    OutputError
        It cannot be stored.
    """
    if fingerprint(script.path, script.configuration) != script.fingerprint:
        raise InputError(f"{script.path}: has just changed; read it again.")
    path = str(script.path.absolute())
    amend_json(resources.approved_scripts(), lambda: {**_read(), script.fingerprint: path})


def revoke(script: DeviceScript) -> None:
    """Revoke an approval; a live script is stopped.

    Whatever of this very file was approved before, with other bytes, is withdrawn as well.

    Raises
    ------
    InputError
        The list of approvals cannot be read.
    OutputError
        It cannot be stored.
    """
    path = str(script.path.absolute())
    amend_json(
        resources.approved_scripts(),
        lambda: {m: p for m, p in _read().items() if m != script.fingerprint and p != path},
    )


def revoke_fingerprint(mark: str) -> None:
    """Revoke an approval by its fingerprint, even if its files are gone.

    Raises
    ------
    InputError
        It is not on the list, or the list cannot be read.
    OutputError
        It cannot be stored.
    """

    def content() -> dict[str, str]:
        found = _read()
        if mark not in found:
            raise InputError(f"{resources.approved_scripts()}: '{mark[:64]}' is not approved.")
        return {m: path for m, path in found.items() if m != mark}

    amend_json(resources.approved_scripts(), content)


def approved() -> dict[str, str]:
    """Paths of approved scripts by fingerprint; a list that cannot be read approves nothing.

    Those of older versions are names of files only.
    """
    try:
        return _read()
    except InputError:
        return {}


def fault_of_list() -> str:
    """Fault of the list of approvals; empty if it can be read."""
    try:
        _read()
    except InputError as error:
        return str(error)
    return ""


class Approval:
    """Approval under which a running script was started.

    Parameters
    ----------
    mark : str
        The script's fingerprint.
    """

    def __init__(self, mark: str) -> None:
        self._mark = mark
        self._seen = _stamp()
        self.was_given = mark in approved()  # shipped scripts are on no list
        self._is_withdrawn = False

    def is_withdrawn(self) -> bool:
        """Test for a withdrawn approval; reads the list only after it has changed."""
        seen = _stamp()
        if self.was_given and seen != self._seen:
            self._seen, self._is_withdrawn = seen, self._mark not in approved()
        return self._is_withdrawn


def _stamp() -> tuple[int, ...] | None:
    try:
        found = resources.approved_scripts().stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _read() -> dict[str, str]:
    """Paths by fingerprint.

    Raises
    ------
    InputError
        There is a list, but it cannot be read.
    """
    path = resources.approved_scripts()
    try:
        with open(path, "rb") as file:
            found = json.loads(file.read(_MOST_BYTES))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise _unreadable(path, str(error)) from None
    if not isinstance(found, dict):
        raise _unreadable(path, "it is no JSON object")
    for mark, script in found.items():
        if not (isinstance(script, str) and _FINGERPRINT.fullmatch(mark)):
            raise _unreadable(path, f"'{mark[:64]}' is no approval")
    return found


def _unreadable(path: Path, why: str) -> InputError:
    return InputError(
        f"{path}: the list of approved scripts cannot be read ({why}), so none is approved; "
        "repair it or move it away."
    )
