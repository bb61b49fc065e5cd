# SPDX-License-Identifier: GPL-3.0-or-later
"""Atomic file writing: a file gets its name when its content is complete."""

import errno
import glob
import hashlib
import io
import json
import os
import platform
import re
import secrets
import shutil
import stat
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, Final

from ..errors import OutputError
from ..text import name_key
from . import limits
from .locks import LOCKED_BYTE, folder_locked, is_ownerless, locked, take_lock

_passing: set[Path] = set()
"""Active folders of :func:`passing`."""

unfinished_paths: dict[Path, Callable[[Path], object]] = {}
"""Unfinished files and folders, with the functions for their removal at a forced end."""

placing = threading.RLock()
"""Lock held while files get their final names, and while unfinished files are made and registered.
A forced end of the process waits for the lock and keeps it: no file is made afterwards."""

_LONGEST_NAME: Final = 100  # of a name within a longer name; a file system allows 255 bytes
_TOKEN_BYTES: Final = 8

_inputs: dict[tuple[int, int] | tuple[int, int, str], int] = {}
"""Number of open :func:`inputs_kept` blocks for each protected (device, inode), and for each
:func:`_place` of a protected file."""

_IS_WINDOWS: Final = os.name == "nt"
_BUSY_S: Final = 1.0
_PAUSE_S: Final = 0.01

_AT_ONCE: Final = 8  # parallel fsync calls: a disk writes several files in one pass


def remove_at_end(path: Path, remove: Callable[[Path], object]) -> None:
    """Register an unfinished file or folder for removal, by ``remove(path)``, at a forced end. To
    be called under :data:`placing`, together with the making of the file."""
    unfinished_paths[path] = remove


@contextmanager
def unfinished(
    path: Path, remove: Callable[[Path], object], make: Callable[[Path], object] = lambda path: None
) -> Iterator[None]:
    """Context with a file or folder, made by ``make(path)``, that a forced end removes."""
    with placing:
        make(path)
        remove_at_end(path, remove)
    try:
        yield
    finally:
        unfinished_paths.pop(path, None)


@contextmanager
def passing(folder: Path) -> Iterator[None]:
    """Context with a staging folder in which files are not forced to the disk. :func:`move` syncs
    the files on their way out; the caller removes the folder."""
    _passing.add(folder)
    try:
        yield
    finally:
        _passing.discard(folder)


def _is_passing(folder: Path) -> bool:
    """Test for a folder of :func:`passing` or a subfolder."""
    return folder in _passing or not _passing.isdisjoint(folder.parents)


def move(files: Sequence[Path], folder: Path, base: Path | None = None) -> tuple[Path, ...]:
    """Move finished files into a folder, in order, and return the new paths.

    Existing files are replaced. If a move fails, files already moved are moved back, and replaced
    files restored; the error is raised. ``base`` is the root
    of the relative paths to keep, with existing subfolders in ``folder``; without it all files go
    directly into ``folder``. All files are forced to the disk before the first move, except into
    folders of :func:`passing`. Raises OutputError for a file that cannot be
    forced to the disk, OSError for a failed move.
    """
    # Sync all contents before the first rename: after a power cut, a final name has its content.
    targets = [folder / (path.relative_to(base) if base else path.name) for path in files]
    # Results that stay in a staging folder are synced by the final move.
    is_durable = not _is_passing(folder)
    if is_durable and files:
        with ThreadPoolExecutor(min(len(files), _AT_ONCE)) as pool:
            list(pool.map(_sync_file, files))
    # Two exports into a folder take turns, so that their files never mix.
    with folder_locked(folder):
        _replace(files, targets, is_durable)
    return tuple(targets)


def _replace(files: Sequence[Path], targets: Sequence[Path], is_durable: bool) -> None:
    """Give files their final names; after an error, replaced files are restored and new ones moved
    back. ``is_durable`` forces the folders to the disk."""
    moved: list[tuple[Path, Path]] = []
    earlier: dict[Path, Path] = {}
    # All names change together from here on: a forced end of the process waits for the lock.
    placing.acquire()
    try:
        for file, target in zip(files, targets, strict=True):
            second_name = file.with_name(temporary_name(target.name))
            # A second name keeps a replaced file until all moves have succeeded.
            if os.path.lexists(target):
                earlier[target] = second_name
                try:
                    os.link(target, second_name, follow_symlinks=False)
                except OSError:  # a file system without hard links, such as FAT
                    shutil.copy2(target, second_name, follow_symlinks=False)
            # Atomic: other processes see the earlier or the new file, never a part.
            _rename(file, target)
            moved.append((file, target))
        for folder in dict.fromkeys(target.parent for target in targets) if is_durable else ():
            _sync_folder(folder)
    except BaseException:
        # Backwards: the newest move is undone first.
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


def _rename(path: Path, target: Path) -> None:
    """Rename a file in place of ``target``. Tried for 1 s on Windows, where virus scanners and
    indexers open each new file for a moment. Raises OSError."""
    until = time.monotonic() + _BUSY_S
    while True:
        try:
            return os.replace(path, target)
        except PermissionError:
            if not _IS_WINDOWS or time.monotonic() > until:
                raise
        time.sleep(_PAUSE_S)


def _sync_file(path: Path) -> None:
    """Force the content of a file to the disk; OutputError for a failure."""
    try:
        with open(path, "r+b") as file:
            os.fsync(file.fileno())
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError) -> OutputError:
    """Return, not raise, the error of an unwritable file with the system's reason."""
    return OutputError(f"{path}: cannot be written ({error.strerror or error}).")


class WatchedFile(io.FileIO):
    """Unbuffered file that raises only the first write error, and stores the error in ``fault``.
    Later writes report success and write nothing, so that an archive can be closed without a second
    error."""

    fault: OSError | None = None

    def write(self, content: Any) -> int:
        if self.fault is not None:
            return memoryview(content).nbytes
        try:
            return super().write(content)
        except OSError as error:
            # Stored for atomic_file(): closing an archive hides this error behind a second error.
            self.fault = error
            raise


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a binary file that replaces ``path`` when the ``with`` block ends without an exception.

    The content goes to a hidden file in the same folder, is forced to the disk (except in folders
    of :func:`passing`) and moved into place. Any exception, Ctrl-C included, removes the hidden
    file and leaves ``path`` as before. A symbolic link itself is replaced.

    Raises OutputError for an unwritable file: no folder, no permission, full disk, name of a folder
    or device, a file of :func:`inputs_kept`, an existing file in a folder of :func:`passing`. An
    ``OSError`` of the block about another file is raised unchanged.
    """
    if not path.name:
        raise OutputError(f"'{path}' is no name of a file.")
    try:
        os.fsencode(path)
    except UnicodeEncodeError as error:  # a ValueError, as for faults of content
        reason = f"file names are {error.encoding} here, allowed is UTF-8: set LC_ALL=C.UTF-8"
        raise OutputError(f"{path}: cannot be written ({reason}).") from error
    is_durable = not _is_passing(path.parent)
    temporary = path.with_name(temporary_name(path.name) if is_durable else f"{path.name}.tmp")
    raw: WatchedFile | None = None
    try:
        refuse_taken(path)
        if is_durable:
            _remove_abandoned(path)
        elif path.exists():
            raise OutputError(f"{path}: cannot be written (two results have this name).")
        # "x": two threads can never write to one hidden file.
        with placing:
            raw = WatchedFile(temporary, "xb+")
            remove_at_end(temporary, Path.unlink)
        if is_durable:
            with suppress(OSError):  # file system without locks: an abandoned file stays
                take_lock(raw.fileno(), LOCKED_BYTE)
        with io.BufferedRandom(raw) as file:
            yield file
            file.flush()
            if raw.fault is not None:
                raise raw.fault
            # Before the rename: a rename may reach the disk earlier than the content.
            if is_durable:
                os.fsync(file.fileno())
        _replace([temporary], [path], is_durable)
    except BaseException as error:
        if raw is not None:
            _remove(temporary)
        # The block may hide the write error behind a second error; report the write error.
        fault = raw.fault if raw is not None and isinstance(error, Exception) else None
        if fault is None and isinstance(error, OSError):
            # An error without a name, such as that of a full disk, is about this file too.
            own_names = {str(path), str(temporary), str(path.parent)}
            if error.filename is None or str(error.filename) in own_names:
                fault = error
        if fault is None:
            raise
        raise _unwritable(path, fault) from error
    finally:
        unfinished_paths.pop(temporary, None)


def temporary_name(name: str) -> str:
    """Make a random hidden name ``.name.machine-token.tmp`` of an unfinished file or folder."""
    return f"{_temporary_start(name)}{secrets.token_hex(_TOKEN_BYTES)}.tmp"


def temporary_pattern(name: str | None = None) -> str:
    """Glob pattern of :func:`temporary_name` on this machine, for one name or all names (None)."""
    start = f".*.{_machine()}-" if name is None else glob.escape(_temporary_start(name))
    return f"{start}{'[0-9a-f]' * 2 * _TOKEN_BYTES}.tmp"


def _temporary_start(name: str) -> str:
    """Start of a :func:`temporary_name`: at most 100 bytes of ``name``; "_" for characters that
    Windows does not allow, so that an error is about the result itself."""
    short = os.fsencode(re.sub(r'[<>:"|?*]', "_", name))[:_LONGEST_NAME].decode(errors="ignore")
    return f".{short}.{_machine()}-"


def _machine() -> str:
    """Eight hexadecimal digits that differ between machines with different host names."""
    return hashlib.sha256(platform.node().encode(errors="replace")).hexdigest()[:8]


def _remove_abandoned(path: Path) -> None:
    """Remove hidden files of :func:`atomic_file` for ``path`` without a lock, which killed
    processes have left; errors are ignored."""
    with suppress(OSError):
        for abandoned in path.parent.glob(temporary_pattern(path.name)):
            with suppress(OSError):
                if stat.S_ISREG(abandoned.lstat().st_mode) and is_ownerless(abandoned):
                    abandoned.unlink()


@contextmanager
def inputs_kept(paths: Iterable[Path]) -> Iterator[None]:
    """Context that forbids results in place of the given files, found by device and inode. Missing
    files are ignored. Contexts may be nested."""
    identities: list[tuple[int, int] | tuple[int, int, str]] = []
    for path in paths:
        with suppress(OSError, ValueError):
            state = path.stat()
            # File systems without inodes report 0, which would match every file.
            if state.st_ino:
                identities += [(state.st_dev, state.st_ino), _place(path)]
    for identity in identities:
        _inputs[identity] = _inputs.get(identity, 0) + 1
    try:
        yield
    finally:
        for identity in identities:
            _inputs[identity] -= 1
            if not _inputs[identity]:
                del _inputs[identity]


def refuse_taken(path: Path) -> None:
    """Raise OutputError for a path that no result may take. Rejected: folders, devices, pipes, open
    files (``/dev/stdout``: a move would replace the name for the whole machine) and files of
    :func:`inputs_kept`. Returns nothing."""
    if path.is_dir():
        raise OutputError(f"{path}: cannot be written (there is a folder of that name).")
    with suppress(OSError):  # a missing file is free
        state = path.stat()
        # Some file systems without regard to case have an inode for each spelling of a name.
        is_kept = (state.st_dev, state.st_ino) in _inputs
        if is_kept or (_place(path) in _inputs and path.name not in os.listdir(path.parent)):
            raise OutputError(
                f"{path}: cannot be written (it is a file that is read for it; choose another "
                "name)."
            )
    refuse_device(path)


def _place(path: Path) -> tuple[int, int, str]:
    """Device and inode of the folder of a file, and :func:`.text.name_key` of the file's name."""
    folder = path.parent.stat()
    return folder.st_dev, folder.st_ino, name_key(path.name)


def refuse_device(path: Path) -> None:
    """Raise OutputError for a folder, a device, a pipe or a link to an open file."""
    # os.path reports too long names as missing; writing raises their error.
    is_open_file = os.path.islink(path) and os.readlink(path).startswith("/proc/")
    if is_open_file or (os.path.exists(path) and not os.path.isfile(path)):
        if os.path.isdir(path):
            raise OutputError(f"{path}: cannot be written (it is a folder, not a file).")
        raise OutputError(f"{path}: cannot be written (it is a device or a pipe, not a file).")


def _remove(path: Path) -> None:
    """Remove a file, if present; errors are ignored, as the caller reports an earlier error."""
    with suppress(OSError):
        path.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """Force the names in a folder to the disk; does nothing on Windows and on file systems that
    cannot sync folders. Raises OSError for any other failure."""
    if _IS_WINDOWS:  # folders cannot be opened; NTFS journals the move itself
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network and FUSE file systems cannot sync folders; the file is in place already.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def stored_json(path: Path) -> dict[str, Any] | None:
    """Read a JSON object of this program; None for a missing or invalid file, or one above the
    limit :data:`.limits.MEMORY`."""
    try:
        # Opening a pipe would block without an end, even against signals.
        if not path.is_file() or path.stat().st_size > limits.MEMORY.default:
            return None
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def amend_json(path: Path, content: Callable[[], Mapping[str, object]]) -> None:
    """Replace a JSON file under a lock against all processes that use this function.

    ``content`` reads the file and returns the new document, while the lock is held; an exception
    leaves the file unchanged. Raises OutputError for an unwritable file, and for a lock that is
    held for longer than :data:`.locks.PATIENCE_S`.
    """
    with locked(path):
        data = json.dumps(content(), indent=1).encode()
        with atomic_file(path) as file:
            file.write(data)
