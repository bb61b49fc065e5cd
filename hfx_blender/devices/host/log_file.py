# SPDX-License-Identifier: GPL-3.0-or-later
"""Log files of outputs: new regular files, or logs of the same kind of output.

Only logs are overwritten. Pipes and device nodes are not opened: opening a pipe may block, and
opening a device node may have effects.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from .output import OutputLostError

MOST_BYTES: Final = 1 << 28
"""Largest existing log that is read and overwritten, bytes; outputs write smaller ones."""

_FLAGS: Final = (
    getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NOCTTY", 0)  # never the controlling terminal
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)


class LogFile:
    """Unbuffered writer of a log; :meth:`close` removes a new file after a failed write.

    Parameters and errors as of :func:`open_log`.
    """

    def __init__(self, path: Path, is_ours: Callable[[bytes], bool] | None = None) -> None:
        self._path = path
        self._is_new = not os.path.lexists(path)
        self._fault: OSError | None = None
        self._file = os.fdopen(open_log(path, is_ours), "wb", 0)

    @property
    def is_closed(self) -> bool:
        return self._file.closed

    def write(self, content: bytes) -> None:
        """Write ``content`` completely.

        Raises OutputLostError: this write or an earlier write has failed.
        """
        rest = memoryview(content)
        try:
            while rest and self._fault is None:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._fault = error
        if self._fault is not None:
            raise OutputLostError(f"{self._path} cannot be written ({self._fault.strerror}).")

    def empty(self) -> None:
        """Truncate the log to 0 bytes."""
        self._file.seek(0)
        self._file.truncate()

    def close(self) -> None:
        """Close the file, and remove a new file after a failed write; idempotent."""
        with suppress(OSError):
            # The path may lead to another file by now, which must stay.
            state = os.fstat(self._file.fileno()) if not self.is_closed else None
            self._file.close()
            if self._fault is not None and self._is_new and state is not None:
                if os.path.samestat(state, os.lstat(self._path)):
                    self._path.unlink()


def open_log(path: Path, is_ours: Callable[[bytes], bool] | None = None) -> int:
    """Create or truncate a log and return a descriptor.

    Parameters
    ----------
    is_ours : callable, optional
        Tests the content of an existing file; True permits overwriting. Empty files are always
        overwritten. None: the file must not exist.

    Raises
    ------
    OutputLostError
        The file exists and may not be overwritten, is no regular file, or cannot be written.
    """
    try:
        return _opened(path, is_ours)
    except FileExistsError:
        raise OutputLostError(f"{path} exists already; a log starts a new file.") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise OutputLostError(f"{path} cannot be written ({reason}).") from None


def _opened(path: Path, is_ours: Callable[[bytes], bool] | None) -> int:
    if is_ours is None or not os.path.lexists(path):
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | _FLAGS, 0o644)
    # Before the opening, which may have effects, and after, as the path may have changed.
    _require_regular(path, os.lstat(path))
    descriptor = os.open(path, os.O_RDWR | _FLAGS)
    try:
        _require_regular(path, os.fstat(descriptor))
        size = os.fstat(descriptor).st_size
        with os.fdopen(os.dup(descriptor), "rb") as file:
            is_known = size <= MOST_BYTES and (not size or is_ours(file.read(MOST_BYTES)))
        if not is_known:
            raise OutputLostError(
                f"{path} is no log of this output; it is not overwritten: name another file."
            )
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.ftruncate(descriptor, 0)
    except BaseException:
        with suppress(OSError):
            os.close(descriptor)
        raise
    return descriptor


def _require_regular(path: Path, state: os.stat_result) -> None:
    """Raise ``OutputLostError`` unless ``state`` is of a regular file with a single name."""
    if stat.S_ISREG(state.st_mode):
        if state.st_nlink > 1:
            raise OutputLostError(
                f"{path} has another name as well (a hard link); a log needs a file of its own."
            )
        return
    kinds = {stat.S_IFLNK: "a link", stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe"}
    kind = kinds.get(stat.S_IFMT(state.st_mode), "no regular file")
    raise OutputLostError(f"{path} is {kind}; a log is written to a regular file only.")
