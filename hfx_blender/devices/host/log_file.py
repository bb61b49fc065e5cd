# SPDX-License-Identifier: GPL-3.0-or-later
"""Logs of outputs: regular files that are new, or that were written by the same kind of output.

Nobody else's file is overwritten, and nothing that is no file is opened: a pipe would make us
wait, a device node might do anything.
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
"""Largest log, bytes; our own logs begin anew long before."""

_FLAGS: Final = (
    getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NOCTTY", 0)  # without a controlling terminal, an opened one would become it
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)


class LogFile:
    """Log that is written without a buffer; a new file that cannot be written is removed.

    Parameters
    ----------
    path : Path
    is_ours : callable, optional
        See :func:`open_log`.

    Raises
    ------
    OutputLostError
        The file cannot be opened.
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
        """Write all of ``content``.

        Raises
        ------
        OutputLostError
            It cannot be written, or something before it could not.
        """
        left = memoryview(content)
        try:
            while left and self._fault is None:
                left = left[self._file.write(left) :]
        except OSError as error:
            self._fault = error
        if self._fault is not None:
            raise OutputLostError(f"{self._path} cannot be written ({self._fault.strerror}).")

    def empty(self) -> None:
        """Remove the content of the log file."""
        self._file.seek(0)
        self._file.truncate()

    def close(self) -> None:
        """Close the file, and remove it if it is new and could not be written."""
        with suppress(OSError):
            state = os.fstat(self._file.fileno()) if not self.is_closed else None
            self._file.close()
            if self._fault is not None and self._is_new and state is not None:
                if os.path.samestat(state, os.lstat(self._path)):
                    self._path.unlink()


def open_log(path: Path, is_ours: Callable[[bytes], bool] | None = None) -> int:
    """Open an empty file, and only that: its descriptor.

    Parameters
    ----------
    is_ours : callable, optional
        Tells from all that an old file holds whether it may be overwritten; None: none may. An
        empty one may.

    Raises
    ------
    OutputLostError
        It is there and is not ours, is no regular file, or cannot be written.
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
    _require_regular(path, os.lstat(path))  # opening some things has effects already
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


def _require_regular(path: Path, found: os.stat_result) -> None:
    if stat.S_ISREG(found.st_mode):
        if found.st_nlink > 1:
            raise OutputLostError(
                f"{path} has another name as well (a hard link); a log needs a file of its own."
            )
        return
    kinds = {stat.S_IFLNK: "a link", stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe"}
    kind = kinds.get(stat.S_IFMT(found.st_mode), "no regular file")
    raise OutputLostError(f"{path} is {kind}; a log is written to a regular file only.")
