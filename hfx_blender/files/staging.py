# SPDX-License-Identifier: GPL-3.0-or-later
"""Moves all results of a command into their folder at once, or none.

Unfinished files are in hidden staging folders. A staging folder belongs to the process that locks
its file ``owner``; the system releases the lock at any end of that process. Staging folders of
ended processes are removed. Locks may not reach other machines that share the folder, so a folder's
name contains the machine, and only folders of this machine are removed.
"""

import os
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Final

from ..errors import InputError, OutputError
from . import atomic
from .locks import LOCKED_BYTE, NEW_S, is_ownerless, take_lock

_OWNER: Final = "owner"
_LOCKED: Final = b"locked\n"
_TRIES: Final = 20
_PAUSE_S: Final = 0.01


def with_final_names(text: str, stage: Path, folder: Path) -> str:
    """Replace paths in a staging folder by the final paths in ``folder`` in a message."""
    beside = "" if folder == Path() else f"{folder}{os.sep}"
    return text.replace(f"{stage}{os.sep}", beside).replace(str(stage), str(folder))


@contextmanager
def stage_folder(parent: Path, name: str) -> Iterator[Path]:
    """Context with a hidden folder in an existing ``parent``; removes abandoned folders first.
    ``name``, shortened, becomes part of the folder's name. Raises OSError if the folder cannot be
    made, and ValueError for a name with a NUL character."""
    remove_abandoned(parent)
    stage = parent / atomic.temporary_name(name)
    owner: int | None = None
    # The folder is locked by its file "owner"; the text "locked" in it states a taken lock.
    with atomic.unfinished(stage, remove_tree, partial(Path.mkdir, mode=0o700)):
        try:
            flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            owner = os.open(stage / _OWNER, flags, 0o600)
            with suppress(OSError):  # without locks on a network file system, the folder stays
                take_lock(owner, LOCKED_BYTE)
                os.write(owner, _LOCKED)  # last; fails on a full disk
            yield stage
        finally:
            if owner is not None:
                with suppress(OSError):
                    os.close(owner)
            _remove(stage)


def _remove(stage: Path) -> None:
    """Remove a staging folder; errors are ignored. Windows removes no file that is open in another
    program: such a file stays, with an ``owner`` that no process locks."""
    shutil.rmtree(stage, ignore_errors=True)
    with suppress(OSError):  # usually the folder is gone
        (stage / _OWNER).write_bytes(_LOCKED)


def remove_tree(stage: Path) -> None:
    """Remove a staging folder, if present. Up to 20 tries with pauses of 10 ms, as other threads
    may write into the folder; remaining files stay with ``owner``, without an error."""
    for _ in range(_TRIES):
        _remove(stage)
        if not stage.exists():
            return
        time.sleep(_PAUSE_S)


def remove_abandoned(parent: Path) -> None:
    """Remove folders of :func:`stage_folder` in ``parent`` of ended processes of this machine, and
    empty ones older than 60 s; errors are ignored."""
    with suppress(OSError):
        for stage in parent.glob(atomic.temporary_pattern()):
            with suppress(OSError):
                if not stage.is_dir() or stage.is_symlink():
                    continue
                if is_ownerless(stage / _OWNER, _LOCKED):
                    _remove(stage)
                elif time.time() - stage.stat().st_mtime > NEW_S:
                    stage.rmdir()  # fails unless empty: the maker was killed before the lock


def make_folder(folder: Path) -> None:
    """Make a folder with its parents, unless it exists; raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}).") from error


@contextmanager
def staging(folder: Path, name: str, within: Path | None = None) -> Iterator[Path]:
    """Context with a staging folder for ``name``, in ``folder`` or in ``within`` on the same file
    system; the caller moves finished files to their final places within the block.

    The staging folder is always removed, with the files left in it. ``folder`` and its parents are
    made, and removed if they are new and empty afterwards. Messages of InputError and OutputError
    within the block get final paths; an OSError becomes an OutputError. Raises OutputError for an
    unwritable folder.
    """
    contexts = ExitStack()
    new: list[Path] = []
    try:
        with atomic.placing:
            new = _missing(folder, contexts)
            folder.mkdir(parents=True, exist_ok=True)
        stage = contexts.enter_context(stage_folder(within or folder, name))
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        contexts.close()
        _remove_empty(new)
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{folder}: cannot be written to ({reason}).") from error
    try:
        with contexts, atomic.passing(stage):
            yield stage
    except OSError as error:
        path = with_final_names(str(error.filename or folder), stage, folder)
        raise OutputError(f"{path}: {error.strerror}.") from error
    except (InputError, OutputError) as error:  # name the file by the final name
        # The hidden folder is gone when the message is read.
        text = with_final_names(str(error), stage, folder)
        if text == str(error):
            raise
        raise type(error)(text) from error
    finally:
        _remove_empty(new)  # folders with results are not empty and stay


def _missing(folder: Path, contexts: ExitStack) -> list[Path]:
    """Missing folders among a folder and its parents, outermost first. A forced end during
    ``contexts`` removes them if empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()][::-1]
    for path in missing:
        contexts.enter_context(atomic.unfinished(path, Path.rmdir))
    return missing


def _remove_empty(folders: Sequence[Path]) -> None:
    """Remove the empty folders, in reverse order."""
    for folder in reversed(folders):
        # A folder with a result is not empty, and stays.
        with suppress(OSError):
            folder.rmdir()


def place(files: Sequence[Path], folder: Path, base: Path | None = None) -> tuple[Path, ...]:
    """Move finished files into a folder, all or none, in order; see :func:`.atomic.move`. Returns
    the final paths. Raises OutputError for the name of a folder, a device or a pipe, and for a
    failed move; new folders are removed in this case."""
    targets = [folder / (path.relative_to(base) if base else path.name) for path in files]
    for target in targets:
        atomic.refuse_taken(target)
    new: list[Path] = []
    try:
        with ExitStack() as contexts:
            for below in dict.fromkeys(target.parent for target in targets):
                with atomic.placing:
                    new += _missing(below, contexts)
                    make_folder(below)
            return atomic.move(files, folder, base)
    except (OSError, OutputError) as error:
        _remove_empty(new)
        # It names the file already.
        if isinstance(error, OutputError):
            raise
        where = getattr(error, "filename2", None) or folder
        raise OutputError(f"{where}: cannot be written ({error.strerror or error}).") from error
