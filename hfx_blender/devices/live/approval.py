# SPDX-License-Identifier: GPL-3.0-or-later
"""Approval of device scripts: shipped scripts and scripts approved by the user may run.

An approval is valid for the exact bytes of script and configuration and for one version of the
interface. The script worker checks :func:`may_run` for the bytes before running them; all earlier
checks only serve for early messages. Not a sandbox: an approved script has all rights of the user.
"""

import hashlib
import json
import re
import shlex
import warnings
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Final

from ...errors import InputError
from ...files import resources
from ...files.atomic import amend_json
from ..configuration import find_file, load_device, script_beside
from ..workers.haptics import API_VERSION

_FINGERPRINT: Final = re.compile(r"[0-9a-f]{64}")
_MOST_BYTES: Final = 16 << 20


@dataclass(frozen=True)
class DeviceScript:
    """Script of a device, with the present fingerprint."""

    path: Path
    configuration: Path
    fingerprint: str
    is_approved: bool

    def as_request(self) -> dict[str, str]:
        """Path, configuration and fingerprint as texts, for :meth:`.client.LiveClient.connect`."""
        return {
            "path": str(self.path),
            "configuration": str(self.configuration),
            "fingerprint": self.fingerprint,
        }


def how_to_approve(name_or_path: str | Path) -> str:
    """End of a sentence: read and approve a device's script, by command or in Blender."""
    device = shlex.quote(str(name_or_path))
    return (
        f"read it and approve it by 'hfx device approve {device}', or under Live Devices in Blender"
    )


def script_of(name_or_path: str | Path, folder: Path | None = None) -> DeviceScript | None:
    """Script of a device, ``<device>.py`` next to the configuration, or None.

    Raises InputError: one of the files cannot be read.
    """
    configuration = find_file(name_or_path, folder)
    path = None if configuration is None else script_beside(configuration)
    if configuration is None or path is None:
        return None
    mark = fingerprint(path, configuration)
    return DeviceScript(path, configuration, mark, may_run(path, mark))


def may_run(script: Path, mark: str) -> bool:
    """Test that a script is shipped, or the fingerprint ``mark`` is in the list of approvals."""
    # Shipped scripts are part of the extension, like its own code.
    return is_shipped(script) or mark in approved()


def is_shipped(script: Path) -> bool:
    """Test that a script lies in the folder of shipped configurations, links resolved."""
    return script.resolve().parent == resources.device_configs().resolve()


def fingerprint(script: Path, configuration: Path) -> str:
    """Fingerprint of the present bytes of script and configuration.

    Raises InputError: one of the files cannot be read.
    """
    try:
        return fingerprint_of(script.read_bytes(), configuration.read_bytes())
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror}).") from None


def fingerprint_of(script: bytes, configuration: bytes) -> str:
    """Hexadecimal SHA-256 of the script API's version, and of length and content of both files."""
    digest = hashlib.sha256(f"hfx-script {API_VERSION}".encode())
    # With lengths: bytes moved from a file to the next change the fingerprint.
    for content in (script, configuration):
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content)
    return digest.hexdigest()


def approve(script: DeviceScript) -> None:
    """Approve a script in the state of ``script``.

    Raises InputError: a file has changed since then, the script does not compile, or the
    configuration or the list of approvals cannot be read.
    Raises OutputError: the list cannot be written.
    """
    # The user approves the bytes that were shown, not a later version.
    if fingerprint(script.path, script.configuration) != script.fingerprint:
        raise InputError(f"{script.path}: has just changed; read it again.")
    compiled(script.path.read_bytes(), script.path)
    load_device(script.configuration)
    path = str(script.path.absolute())
    amend_json(resources.approved_scripts(), lambda: {**_read(), script.fingerprint: path})


def compiled(source: bytes, path: Path) -> CodeType:
    """Compile a script, which runs none of its code; InputError for a script that is no Python."""
    try:
        with warnings.catch_warnings(action="ignore"):  # invalid escapes, such as "\d"
            return compile(source, str(path), "exec")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        place = f"{path}, line {line}" if line else str(path)
        reason = getattr(error, "msg", "") or str(error) or "it is too complex"
    raise InputError(f"{place}: is no Python: {reason.rstrip('.')}.")


def revoke(script: DeviceScript) -> None:
    """Revoke the approvals of a script's fingerprint and path, also of earlier bytes.

    A running script is stopped.

    Raises InputError: the list of approvals cannot be read.
    Raises OutputError: the list cannot be written.
    """
    path = str(script.path.absolute())
    amend_json(
        resources.approved_scripts(),
        lambda: {m: p for m, p in _read().items() if m != script.fingerprint and p != path},
    )


def revoke_fingerprint(mark: str) -> None:
    """Revoke an approval by fingerprint; the files of the script may be missing.

    Raises InputError: the fingerprint is not approved, or the list cannot be read.
    Raises OutputError: the list cannot be written.
    """

    def content() -> dict[str, str]:
        paths = _read()
        if mark not in paths:
            raise InputError(f"{resources.approved_scripts()}: '{mark[:64]}' is not approved.")
        return {m: path for m, path in paths.items() if m != mark}

    amend_json(resources.approved_scripts(), content)


def approved() -> dict[str, str]:
    """Paths of approved scripts by fingerprint; empty if the list cannot be read.

    Entries of older versions have file names in place of paths.
    """
    try:
        return _read()
    except InputError:
        # Without a readable list no script is approved.
        return {}


def fault_of_list() -> str:
    """Message about an unreadable list of approvals; "" for a readable or missing list."""
    try:
        _read()
    except InputError as error:
        return str(error)
    return ""


class Approval:
    """Watch for the withdrawal of a running script's approval, by fingerprint."""

    def __init__(self, mark: str) -> None:
        self._mark = mark
        # The stamp first: a change between both reads is then seen by the next check.
        self._seen = _stamp()
        self.was_given = mark in approved()  # False for shipped scripts
        self._is_withdrawn = False

    def is_withdrawn(self) -> bool:
        """Test that an approval on the list at first is missing now; reads a changed list only."""
        seen = _stamp()
        if self.was_given and seen != self._seen:
            self._seen, self._is_withdrawn = seen, self._mark not in approved()
        return self._is_withdrawn


def _stamp() -> tuple[int, ...] | None:
    """Inode, size and time of the list of approvals, for detecting changes; None without a file."""
    try:
        state = resources.approved_scripts().stat()
    except OSError:
        return None
    return state.st_ino, state.st_size, state.st_mtime_ns


def _read() -> dict[str, str]:
    """Paths of scripts by fingerprint from the list of approvals; empty without a file.
    Raises InputError: the list is unreadable, no JSON object, or has an invalid entry."""
    path = resources.approved_scripts()
    try:
        with open(path, "rb") as file:
            paths = json.loads(file.read(_MOST_BYTES))
        if not isinstance(paths, dict):
            raise ValueError("it is no JSON object")
        for mark, script in paths.items():
            if not (isinstance(script, str) and _FINGERPRINT.fullmatch(mark)):
                raise ValueError(f"'{mark[:64]}' is no approval")
        return paths
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(
            f"{path}: the list of approved scripts cannot be read ({error}), so none is approved; "
            "repair it or move it away."
        ) from None
