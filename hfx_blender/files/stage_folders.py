# SPDX-License-Identifier: GPL-3.0-or-later
"""Hidden folders for unfinished results; those of killed runs are removed.

A folder belongs to the process that holds the lock of its file ``owner``. The system lets go of
the lock when that process ends, however it does. A lock may be unknown to other machines that
share the folder, so the name of a folder tells the machine, and only folders with such a name of
this machine are ever removed.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from .atomic import (
    LOCKED_BYTE,
    NEW_S,
    is_ownerless,
    take_lock,
    temporary_name,
    temporary_pattern,
    unfinished,
)

_OWNER: Final = "owner"
_LOCKED: Final = b"locked\n"
_TRIES: Final = 20
_PAUSE_S: Final = 0.01


def with_final_names(text: str, stage: Path, folder: Path) -> str:
    """A message as its reader knows the files: by the names that they get in ``folder``."""
    beside = "" if folder == Path() else f"{folder}{os.sep}"
    return text.replace(f"{stage}{os.sep}", beside).replace(str(stage), str(folder))


@contextmanager
def stage_folder(parent: Path, name: str) -> Iterator[Path]:
    """Context with a hidden folder; removes those of killed runs first.

    Parameters
    ----------
    parent : Path
        Is there.
    name : str
        Becomes part of its name, shortened.

    Raises
    ------
    OSError
        It cannot be made.
    ValueError
        A name has a zero in it.
    """
    remove_abandoned(parent)
    stage = parent / temporary_name(name)
    stage.mkdir(0o700)
    owner: int | None = None
    with unfinished(stage, remove_tree):
        try:
            owner = os.open(stage / _OWNER, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
            with suppress(OSError):  # some network file systems have no locks: it is not removed
                take_lock(owner, LOCKED_BYTE)
                os.write(owner, _LOCKED)  # last; a full disk cannot take it
            yield stage
        finally:
            if owner is not None:
                with suppress(OSError):
                    os.close(owner)
            shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def temporary_folder(prefix: str = "hfx-") -> Iterator[Path]:
    """Context with a folder of the system's temporary folder; removed as well where a signal ends
    the process.
    """
    with tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True) as name:
        with unfinished(Path(name), remove_tree):
            yield Path(name)


def remove_tree(folder: Path) -> None:
    """Remove a folder of this process into which other threads may still be writing."""
    for _ in range(_TRIES):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(_PAUSE_S)


def remove_abandoned(parent: Path) -> None:
    """Remove the folders of :func:`stage_folder` whose owners have gone."""
    with suppress(OSError):
        for stage in parent.glob(temporary_pattern()):
            with suppress(OSError):
                if not stage.is_dir() or stage.is_symlink():
                    continue
                if is_ownerless(stage / _OWNER, _LOCKED):
                    shutil.rmtree(stage, ignore_errors=True)
                elif time.time() - stage.stat().st_mtime > NEW_S:
                    stage.rmdir()  # only if it is empty: its maker was killed at once
