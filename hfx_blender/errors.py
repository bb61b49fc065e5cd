# SPDX-License-Identifier: GPL-3.0-or-later
"""Faults that a user can cause, worded so that they can be shown as they are."""

from .printable import printable


class HfxError(Exception):
    """Base of every fault that is shown to the user as one sentence.

    Pure code raises it (or a subclass); operators, the command line and the frame handlers
    catch it. ``exit_code`` is what the command line ends with.
    """

    exit_code = 3

    def __str__(self) -> str:
        """The sentence; names in it cannot steer the terminal that it is shown on."""
        return printable(super().__str__())


class UsageError(HfxError):
    """The command or the arguments are wrong; nothing was tried."""

    exit_code = 2


class InputError(HfxError):
    """A file or a scene cannot be used as it is; nothing was written for it."""


class OutputError(HfxError):
    """A result cannot be written (unwritable folder, full disk)."""


class ScriptError(HfxError):
    """A device's script does not run, or not to its end; nothing was written for its device."""

    exit_code = 5


class DeviceError(HfxError):
    """A device failed while it was driven."""

    exit_code = 4


def fault_of_file(error: OSError) -> InputError:
    """Word a file that the system refuses, such as one whose name is too long."""
    return InputError(f"{error.filename}: {error.strerror or error}.")
