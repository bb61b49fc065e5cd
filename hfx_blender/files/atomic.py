# SPDX-License-Identifier: GPL-3.0-or-later
"""Atomic writing: files get their final names only when complete."""

from __future__ import annotations

import errno
import glob
import hashlib
import io
import json
import os
import platform
import secrets
import stat
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, Final

from ..errors import OutputError
from .locks import LOCKED_BYTE, folder_locked, is_ownerless, locked, take_lock

_passing: set[Path] = set()
"""Staging folders of :func:`passing`; files are synchronised to disk when moved out of them."""

_unfinished: dict[Path, Callable[[Path], object]] = {}
"""Unfinished files and folders, with the functions that remove them after a signal."""

placing = threading.Lock()
"""Lock held while files get their final names; a forced end of the process waits for it."""

_LONGEST_NAME: Final = 100  # of a name that becomes part of another; a file system allows 255 bytes
_TOKEN_BYTES: Final = 8

_inputs: dict[tuple[int, int], int] = {}
"""Device and inode of protected input files, with the number of :func:`inputs_kept` blocks."""

_AT_ONCE = 8  # files that are forced to the disk together: a disk takes them in one go


def remove_at_end(path: Path, remove: Callable[[Path], object]) -> None:
    """Register a file or folder for removal by ``remove`` when a signal ends the process."""
    _unfinished[path] = remove


@contextmanager
def unfinished(path: Path, remove: Callable[[Path], object]) -> Iterator[None]:
    """Context with a file or folder that is removed if a signal ends the process."""
    remove_at_end(path, remove)
    try:
        yield
    finally:
        _unfinished.pop(path, None)


def remove_unfinished() -> None:
    """Remove all registered files and folders, newest first, before the process ends."""
    for path, remove in reversed(list(_unfinished.items())):
        with suppress(OSError):
            remove(path)


@contextmanager
def passing(folder: Path) -> Iterator[None]:
    """Context with a temporary staging folder; :func:`move` results out of the folder."""
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
    with folder_locked(folder):
        _replace(files, targets, stays)
    return tuple(targets)


def _replace(files: Sequence[Path], targets: Sequence[Path], stays: bool) -> None:
    """Give files their final names, all or none: after an error, the earlier files are back.

    ``stays``: the folders are forced to the disk as well. An earlier file cannot come back where
    the file system knows no hard links.
    """
    moved: list[tuple[Path, Path]] = []
    earlier: dict[Path, Path] = {}
    placing.acquire()
    try:
        for file, target in zip(files, targets, strict=True):
            second_name = file.with_name(temporary_name(target.name))
            with suppress(OSError):  # there is none, or no hard links
                os.link(target, second_name, follow_symlinks=False)
                earlier[target] = second_name
            os.replace(file, target)
            moved.append((file, target))
        for folder in dict.fromkeys(target.parent for target in targets) if stays else ():
            _sync_folder(folder)
    except BaseException:
        for file, target in reversed(moved):
            with suppress(OSError):
                if target in earlier:
                    os.replace(earlier[target], target)
                else:
                    os.replace(target, file)
        raise
    finally:
        for second_name in earlier.values():
            _remove(second_name)
        placing.release()


def _sync_file(path: Path) -> None:
    try:
        with open(path, "r+b") as file:
            os.fsync(file.fileno())
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written ({error.strerror or error}).")


class WatchedFile(io.FileIO):
    """Unbuffered file that remembers why it could not be written, and fails only once.

    Whoever writes into it can close what it has begun then, such as an archive, without a second
    error; the file is removed anyway.
    """

    fault: OSError | None = None

    def write(self, content: Any) -> int:
        if self.fault is not None:
            return memoryview(content).nbytes
        try:
            return super().write(content)
        except OSError as error:
            self.fault = error
            raise


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file that replaces ``path`` when the ``with`` block ends well.

    The bytes go to a new hidden file beside it, are forced to the disk (but for a folder that is
    :func:`passing`) and moved into place. After any exception, Ctrl-C included, there is no
    hidden file and what ``path`` held before is untouched. A link of that name is replaced, not
    what it leads to.

    Raises
    ------
    OutputError
        The file cannot be written (no such folder, not allowed, disk full, name of a folder or
        of a device, a file of :func:`inputs_kept`; in a folder that is :func:`passing`, there is
        such a file).
        An ``OSError`` of the block that names another file is passed on as it is.
    """
    if not path.name:
        raise OutputError(f"'{path}' is no name of a file.")
    stays = not _is_passing(path.parent)
    temporary = path.with_name(temporary_name(path.name) if stays else f"{path.name}.tmp")
    raw: WatchedFile | None = None
    try:
        refuse_taken(path)
        if stays:
            _remove_abandoned(path)
        elif path.exists():
            raise OutputError(f"{path}: cannot be written (two results have this name).")
        raw = WatchedFile(temporary, "xb+")
        remove_at_end(temporary, Path.unlink)
        if stays:
            with suppress(OSError):  # no locks: then it is never removed
                take_lock(raw.fileno(), LOCKED_BYTE)
        with io.BufferedRandom(raw) as file:
            yield file
            file.flush()
            if raw.fault is not None:
                raise raw.fault
            if stays:
                os.fsync(file.fileno())
        _replace([temporary], [path], stays)
    except BaseException as error:
        if raw is not None:
            _remove(temporary)
        fault = raw.fault if raw is not None and isinstance(error, Exception) else None
        if fault is None and isinstance(error, OSError):
            ours = {str(path), str(temporary), str(path.parent)}
            if error.filename is None or str(error.filename) in ours:
                fault = error
        if fault is None:
            raise
        raise _unwritable(path, fault) from error
    finally:
        _unfinished.pop(temporary, None)


def temporary_name(name: str) -> str:
    """New hidden name for an unfinished file or folder, with a hash of the machine's name."""
    return f"{_temporary_start(name)}{secrets.token_hex(_TOKEN_BYTES)}.tmp"


def temporary_pattern(name: str | None = None) -> str:
    """Glob pattern of the :func:`temporary_name` of ``name`` (None: any name) on this machine."""
    start = f".*.{_machine()}-" if name is None else glob.escape(_temporary_start(name))
    return f"{start}{'[0-9a-f]' * 2 * _TOKEN_BYTES}.tmp"


def _temporary_start(name: str) -> str:
    short = os.fsencode(name)[:_LONGEST_NAME].decode(errors="ignore")
    return f".{short}.{_machine()}-"


def _machine() -> str:
    return hashlib.sha256(platform.node().encode(errors="replace")).hexdigest()[:8]


def _remove_abandoned(path: Path) -> None:
    """Remove unfinished files of ended processes for ``path``."""
    with suppress(OSError):
        for left in path.parent.glob(temporary_pattern(path.name)):
            with suppress(OSError):
                if stat.S_ISREG(left.lstat().st_mode) and is_ownerless(left):
                    left.unlink()


@contextmanager
def inputs_kept(paths: Iterable[Path]) -> Iterator[None]:
    """Context in which no result may replace these files, under any name or link."""
    known = []
    for path in paths:
        with suppress(OSError, ValueError):
            state = path.stat()
            if state.st_ino:
                known.append((state.st_dev, state.st_ino))
    for each in known:
        _inputs[each] = _inputs.get(each, 0) + 1
    try:
        yield
    finally:
        for each in known:
            _inputs[each] -= 1
            if not _inputs[each]:
                del _inputs[each]


def _is_input(path: Path) -> bool:
    try:
        state = path.stat()
    except OSError:
        return False
    return (state.st_dev, state.st_ino) in _inputs


def refuse_taken(path: Path) -> None:
    """Refuse a name that a file cannot take: of a folder, a device, a pipe or an open file, or of
    a file of :func:`inputs_kept`.

    A file moved to the name ``/dev/stdout`` would take that away from the whole machine.

    Raises
    ------
    OutputError
        There is something of that name that is no file, or is being read.
    """
    if path.is_dir():
        raise OutputError(f"{path}: cannot be written (there is a folder of that name).")
    if _is_input(path):
        raise OutputError(
            f"{path}: cannot be written (it is a file that is read for it; choose another name)."
        )
    refuse_device(path)


def refuse_device(path: Path) -> None:
    """Refuse the name of a device, a pipe or an open file.

    Raises
    ------
    OutputError
        It is.
    """
    # os.path takes names that are too long as names of nothing; writing reports these.
    is_open_file = os.path.islink(path) and os.readlink(path).startswith("/proc/")
    if is_open_file or (os.path.exists(path) and not os.path.isfile(path)):
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


def amend_json(path: Path, content: Callable[[], Mapping[str, object]]) -> None:
    """Replace a JSON file in which several processes change parts.

    Parameters
    ----------
    content : callable
        Reads the file and gives what it is to hold. Nobody else who amends the file writes it
        between the two; what it raises leaves the file as it was.

    Raises
    ------
    OutputError
        Somebody else keeps it for longer than :data:`.locks.PATIENCE_S`, or it cannot be written.
    """
    with locked(path):
        made = json.dumps(content(), indent=1).encode()
        with atomic_file(path) as file:
            file.write(made)
