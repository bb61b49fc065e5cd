# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors that a user can cause, worded so that they can be shown as they are."""

import stat
from pathlib import Path

from .text import printable


class HfxError(Exception):
    """Base of all errors that are shown to the user as one sentence.

    Pure code raises it (or a subclass); operators, the command line and the frame handlers
    catch it. ``exit_code`` is what the command line ends with.
    """

    exit_code = 3

    def __str__(self) -> str:
        """Text of the error, with names escaped so that they cannot steer a terminal."""
        return printable(super().__str__())


class UsageError(HfxError):
    """Error in the command or its arguments; nothing was tried."""

    exit_code = 2


class InputError(HfxError):
    """Error in a file or a scene that cannot be used as it is; nothing was written for it."""


class NothingFeltError(InputError):
    """Error of a format that cannot hold a track in which nothing is felt."""


class OutputError(HfxError):
    """Error in writing a result (unwritable folder, full disk)."""


class ScriptError(HfxError):
    """Error of a device's script, which cannot run to its end; nothing was written for its
    device.
    """

    exit_code = 5


class DeviceError(HfxError):
    """Error of a device while it was driven."""

    exit_code = 4


def fault_of_file(error: OSError) -> InputError:
    """Error message for a file that the system rejects, such as one with too long a name."""
    return InputError(f"{error.filename}: {error.strerror or error}.")


def is_endless(path: Path) -> bool:
    """Test for a pipe, a device or a socket: reading it might never end."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def refuse_no_file(path: Path) -> None:
    """Refuse a path of which nothing can be read: a pipe would be waited for without an end.

    Raises
    ------
    InputError
        It is missing, no plain file, or cannot be asked for.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file.") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"{path}: cannot be read ({error}).") from error
    if not stat.S_ISREG(mode):
        found = "a folder" if stat.S_ISDIR(mode) else "no plain file"
        raise InputError(f"{path}: it is {found}.")
