# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that appear under their name only when they are complete."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from .errors import OutputError


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file that replaces ``path`` when the ``with`` block ends well.

    The bytes go to ``path`` + ``.tmp``, are forced to the disk and moved into place. After any
    exception, Ctrl-C included, there is no ``.tmp`` and what ``path`` held before is untouched.

    Raises
    ------
    OutputError
        The file cannot be written (no such folder, not allowed, disk full, name of a folder).
        An ``OSError`` of the block that names another file is passed on as it is.
    """
    if not path.name:
        raise OutputError(f"'{path}' is no name of a file.")
    temporary = path.with_name(path.name + ".tmp")
    try:
        if path.is_dir():
            raise OutputError(f"{path}: cannot be written (there is a folder of that name).")
        with open(temporary, "w+b") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    except OSError as error:
        _remove(temporary)
        ours = {str(path), str(temporary), str(path.parent)}
        if error.filename is not None and str(error.filename) not in ours:
            raise
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}).") from error
    except BaseException:
        _remove(temporary)
        raise


def _remove(path: Path) -> None:
    # The folder may have become unwritable or vanished: the first error is the one to report.
    with suppress(OSError):
        path.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    if os.name == "nt":  # a folder cannot be opened there; NTFS journals the move itself
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network and FUSE file systems cannot; the file itself is safe and in place.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)
