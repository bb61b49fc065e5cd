# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that appear under their name only when they are complete."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Final

from .errors import OutputError

_passing: set[Path] = set()
"""Staging folders of :func:`passing`: whoever moves files out of them forces these to the disk."""

PATIENCE_S: Final = 5.0
"""Longest wait for a lock, seconds."""

_RETRY_S: Final = 0.01

_AT_ONCE = 8  # files that are forced to the disk together: a disk takes them in one go


@contextmanager
def passing(folder: Path) -> Iterator[None]:
    """Context with a folder that is removed afterwards; :func:`move` files that are to be kept."""
    _passing.add(folder)
    try:
        yield
    finally:
        _passing.discard(folder)


def _is_passing(folder: Path) -> bool:
    return folder in _passing or not _passing.isdisjoint(folder.parents)


def move(files: Sequence[Path], folder: Path, base: Path | None = None) -> tuple[Path, ...]:
    """Move finished files into a folder, in this order, when all of them are on the disk.

    Parameters
    ----------
    files : sequence of Path
    folder : Path
    base : Path, optional
        Folder of the files: those below get folders below ``folder``, which are there.
        Without it, all come into ``folder`` itself.

    Raises
    ------
    OutputError
        One of them cannot be written to the disk; none was moved.
    OSError
        One of them cannot be moved.
    """
    targets = [folder / (path.relative_to(base) if base else path.name) for path in files]
    stays = not _is_passing(folder)
    if stays and files:
        with ThreadPoolExecutor(min(len(files), _AT_ONCE)) as pool:
            list(pool.map(_sync_file, files))
    with _locked(folder):
        moved = tuple(map(Path.replace, files, targets))
    if stays:
        for each in {folder, *(target.parent for target in targets)}:
            _sync_folder(each)
    return moved


def _sync_file(path: Path) -> None:
    try:
        with open(path, "r+b") as file:
            os.fsync(file.fileno())
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written ({error.strerror or error}).")


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file that replaces ``path`` when the ``with`` block ends well.

    The bytes go to ``path`` + ``.tmp``, are forced to the disk (but for a folder that is
    :func:`passing`) and moved into place. After any exception, Ctrl-C included, there is no
    ``.tmp`` and what ``path`` held before is untouched.

    Raises
    ------
    OutputError
        The file cannot be written (no such folder, not allowed, disk full, name of a folder or
        of a device).
        An ``OSError`` of the block that names another file is passed on as it is.
    """
    if not path.name:
        raise OutputError(f"'{path}' is no name of a file.")
    temporary = path.with_name(path.name + ".tmp")
    try:
        refuse_taken(path)
        with open(temporary, "w+b") as file:
            yield file
            file.flush()
            if not _is_passing(path.parent):
                os.fsync(file.fileno())
        os.replace(temporary, path)
        if not _is_passing(path.parent):
            _sync_folder(path.parent)
    except OSError as error:
        _remove(temporary)
        ours = {str(path), str(temporary), str(path.parent)}
        if error.filename is not None and str(error.filename) not in ours:
            raise
        raise _unwritable(path, error) from error
    except BaseException:
        _remove(temporary)
        raise


def refuse_taken(path: Path) -> None:
    """Refuse a name that a file cannot take: of a folder, a device, a pipe or an open file.

    A file moved to the name ``/dev/stdout`` would take that away from the whole machine.

    Raises
    ------
    OutputError
        There is something of that name that is no file.
    """
    if path.is_dir():
        raise OutputError(f"{path}: cannot be written (there is a folder of that name).")
    is_open_file = path.is_symlink() and os.readlink(path).startswith("/proc/")
    if is_open_file or (path.exists() and not path.is_file()):
        raise OutputError(f"{path}: cannot be written (it is a device or a pipe, not a file).")


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


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a file: other processes and threads that lock it wait outside the ``with`` block.

    The lock is a file ``path`` + ``.lock``, which stays; it is given back if its owner is killed.

    Raises
    ------
    OutputError
        Somebody else keeps it for longer than :data:`PATIENCE_S`, or there is no writing there.
    """
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
        os.close(descriptor)  # which gives it back


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Context in which no other process moves files into a folder: sets of files do not mix.

    Nobody waits longer than :data:`PATIENCE_S`, nor where there are no locks: what is finished is
    not lost for it.
    """
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


def amend_json(path: Path, content: Callable[[], Mapping[str, object]]) -> None:
    """Replace a JSON file that several processes write, each of which changes a part of it.

    Parameters
    ----------
    content : callable
        Reads the file and gives what it is to hold. Nobody else who amends the file writes it
        between the two; what it raises leaves the file as it was.

    Raises
    ------
    OutputError
        Somebody else keeps it for longer than :data:`PATIENCE_S`, or it cannot be written.
    """
    with locked(path):
        made = json.dumps(content(), indent=1).encode()
        with atomic_file(path) as file:
            file.write(made)


def _is_taken_in_time(descriptor: int) -> bool:
    """Lock a file, unless somebody else has it for longer than :data:`PATIENCE_S`."""
    until = time.monotonic() + PATIENCE_S
    while not (is_taken := _is_taken(descriptor)) and time.monotonic() <= until:
        time.sleep(_RETRY_S)
    return is_taken


def _is_taken(descriptor: int) -> bool:
    try:
        take_lock(descriptor)
    except OSError:
        return False
    return True


def take_lock(descriptor: int, place: int = 0) -> None:
    """Lock a file until it is closed; Windows locks the byte at a place.

    Raises
    ------
    OSError
        Somebody else has it, or there are no locks.
    """
    if sys.platform == "win32":
        import msvcrt

        os.lseek(descriptor, place, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
