# SPDX-License-Identifier: GPL-3.0-or-later
"""Advisory locks on files and folders; the system releases the locks of a process that ends."""

import hashlib
import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from ..errors import OutputError

PATIENCE_S: Final = 5.0  # time limit for taking a lock that another process holds, seconds
_RETRY_S: Final = 0.01

NEW_S: Final = 60.0
"""Largest age of an unlocked unfinished file of a possibly running process, seconds."""

LOCKED_BYTE: Final = 2**31 - 2
"""Offset of the locked byte, behind the content: on Windows no other descriptor can read a locked
byte. The largest offset that ``msvcrt.locking`` takes is a signed 32-bit number."""


def is_ownerless(path: Path, ready: bytes | None = None) -> bool:
    """Test for an unfinished file that no process has locked or is about to lock. A file younger
    than :data:`NEW_S` counts as owned until its content is ``ready`` (None: always). False for
    links, missing files and anything but regular files."""
    # A link could lead to a file of another program, and the opening of a pipe would wait.
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    try:
        descriptor = os.open(path, os.O_RDWR | flags)
    except OSError:
        return False
    try:
        state = os.fstat(descriptor)
        # Its maker may be between the creation of a file and its lock: only a file with complete
        # content, or an old one, can be without an owner.
        is_new = time.time() - state.st_mtime < NEW_S
        if not stat.S_ISREG(state.st_mode):
            return False
        if is_new and (ready is None or os.read(descriptor, len(ready) + 1) != ready):
            return False
        take_lock(descriptor, LOCKED_BYTE)
        return True
    except OSError:  # the lock is held
        return False
    finally:
        os.close(descriptor)


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Context with an exclusive lock, between processes and threads, for a file. The lock file
    ``path`` + ``.lock`` is made with its folder, and stays. Raises OutputError for an unwritable
    folder, and for a lock that is held for longer than :data:`PATIENCE_S`."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path.with_name(path.name + ".lock"), os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}).") from None
    try:
        if not _is_taken_in_time(descriptor):
            raise OutputError(f"{path}: another process is writing it; try again.")
        yield
    finally:
        os.close(descriptor)  # releases the lock


@contextmanager
def folder_locked(folder: Path) -> Iterator[None]:
    """Context with an exclusive lock on a folder, so that sets of moved files do not mix. Entered
    without the lock after :data:`PATIENCE_S`, and on file systems without locks: finished results
    are moved in any case."""
    descriptor = None
    with suppress(OSError):
        if os.name == "nt":  # a folder cannot be opened there
            name = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:16]
            lock = Path(tempfile.gettempdir()) / f"hfx-{name}.lock"
            descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        else:
            descriptor = os.open(folder, os.O_RDONLY)
    try:
        if descriptor is not None:
            _is_taken_in_time(descriptor)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _is_taken_in_time(descriptor: int) -> bool:
    """Lock a file within :data:`PATIENCE_S`; False if another process holds the lock for longer."""
    # Waiting locks of the system have no time limit, hence repeated tries.
    until = time.monotonic() + PATIENCE_S
    while True:
        with suppress(OSError):
            take_lock(descriptor)
            return True
        if time.monotonic() > until:
            return False
        time.sleep(_RETRY_S)


def take_lock(descriptor: int, place: int = 0) -> None:
    """Lock a file until it is closed; on Windows the byte at offset ``place``. Raises OSError for a
    lock held by another process, and on file systems without locks."""
    if sys.platform == "win32":
        import msvcrt

        # Windows locks from the current position on.
        os.lseek(descriptor, place, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
