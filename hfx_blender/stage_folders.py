# SPDX-License-Identifier: GPL-3.0-or-later
"""Hidden folders for unfinished results; those of killed runs are removed.

A folder belongs to the process that holds the lock of its file ``owner``. The system lets go of
the lock when that process ends, however it does. A lock may be unknown to other machines that
share the folder, so only a folder of a machine of this name is ever removed.
"""

from __future__ import annotations

import os
import platform
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Final

from .atomic_files import take_lock

_OWNER: Final = "owner"
_SUFFIX: Final = ".tmp"
_LOCKED_BYTE: Final = 4096  # behind the text: what is locked cannot be read on Windows
_LONGEST_NAME: Final = 100  # a file system allows 255 bytes


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
    short = name.encode()[:_LONGEST_NAME].decode(errors="ignore")
    stage = Path(tempfile.mkdtemp(prefix=f".{short}.", suffix=_SUFFIX, dir=parent))
    owner: BinaryIO | None = None
    try:
        owner = open(stage / _OWNER, "xb")
        with suppress(OSError):  # some network file systems have no locks: then it is not removed
            take_lock(owner.fileno(), _LOCKED_BYTE)
            owner.write(_machine())  # last: without it, nobody else touches the folder
            owner.flush()
        yield stage
    finally:
        if owner is not None:
            owner.close()
        shutil.rmtree(stage, ignore_errors=True)


def remove_abandoned(parent: Path) -> None:
    """Remove the folders of :func:`stage_folder` whose owners have gone."""
    with suppress(OSError):
        for path in parent.glob(f".*{_SUFFIX}/{_OWNER}"):
            if _is_abandoned(path):
                shutil.rmtree(path.parent, ignore_errors=True)


def _is_abandoned(owner: Path) -> bool:
    try:
        with open(owner, "r+b") as file:
            if file.read(_LOCKED_BYTE) != _machine():
                return False  # of another machine, or just being made
            take_lock(file.fileno(), _LOCKED_BYTE)
            return True
    except OSError:  # the lock is held, or it is not ours to change
        return False


def _machine() -> bytes:
    return f"{platform.node()}\n".encode()
