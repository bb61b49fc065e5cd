# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors with messages for the user."""

import stat
from pathlib import Path

from .text import printable


class HfxError(Exception):
    """Base of all errors with a one-sentence message for the user.

    Raised by pure code; operators, the command line and the frame handlers catch HfxError.
    ``exit_code`` is that of the command line.
    """

    exit_code = 3

    def __str__(self) -> str:
        """Message with control characters of names escaped."""
        return printable(super().__str__())


class UsageError(HfxError):
    """Error in the command or an argument; nothing was started."""

    exit_code = 2


class InputError(HfxError):
    """Error in an unusable file or scene, which gets no result."""


class NothingFeltError(InputError):
    """Error of a format that cannot hold a track without any sample."""


class OutputError(HfxError):
    """Error in writing a result (unwritable folder, full disk)."""


class ScriptError(HfxError):
    """Error of a device script that did not finish; the device gets no result."""

    exit_code = 5


class DeviceError(HfxError):
    """Error of a device during playback."""

    exit_code = 4


def fault_of_file(error: OSError) -> InputError:
    """InputError "file name: reason" of an OSError, for the caller to raise."""
    return InputError(f"{error.filename}: {error.strerror or error}.")


def is_endless(path: Path) -> bool:
    """Test for a pipe, device or socket: reading might never end. False for a missing path."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def refuse_no_file(path: Path) -> None:
    """Raise InputError for a missing path, a folder, pipe, device or socket, or if ``stat`` fails.

    The file is not opened: a file without read permission passes. Links are followed.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file.") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"{path}: cannot be read ({error}).") from error
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "no plain file"
        raise InputError(f"{path}: it is {kind}.")
