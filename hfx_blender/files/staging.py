# SPDX-License-Identifier: GPL-3.0-or-later
"""Results come into their folder together and complete, or not at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ..errors import OutputError
from .atomic import move, passing, refuse_taken, unfinished
from .stage_folders import stage_folder, with_final_names


def make_folder(folder: Path) -> None:
    """Make the folder of the results, and its parents.

    Raises
    ------
    OutputError
        It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}).") from error


@contextmanager
def staging(folder: Path, name: str, within: Path | None = None) -> Iterator[Path]:
    """Context with a folder beside the results that is removed afterwards in any case.

    ``folder`` and its parents are made; those that are new and into which nothing came are gone
    as well. The new one is in it, or in ``within``, a folder of the same file system.

    Raises
    ------
    OutputError
        The folder cannot be written to, or something within the block could not be written.
    """
    made = ExitStack()
    new: list[Path] = []
    try:
        new = _missing(folder)
        for each in new:
            made.enter_context(unfinished(each, Path.rmdir))
        folder.mkdir(parents=True, exist_ok=True)
        stage = made.enter_context(stage_folder(within or folder, name))
    except (OSError, ValueError) as error:  # ValueError: a name with a zero in it
        made.close()
        _remove_empty(new)
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{folder}: cannot be written to ({reason}).") from error
    try:
        with made, passing(stage):
            yield stage
    except OSError as error:
        path = with_final_names(str(error.filename or folder), stage, folder)
        raise OutputError(f"{path}: {error.strerror}.") from error
    except OutputError as error:  # the user knows the file by its final name
        raise OutputError(with_final_names(str(error), stage, folder)) from error
    finally:
        _remove_empty(new)  # they hold the results, unless there are none


def _missing(folder: Path) -> list[Path]:
    """A folder and its parents that are not there, the outermost first."""
    return [each for each in (folder, *folder.parents) if not each.exists()][::-1]


def _remove_empty(folders: Sequence[Path]) -> None:
    """Remove folders, the last first, but those that hold something."""
    for folder in reversed(folders):
        with suppress(OSError):
            folder.rmdir()


def place(files: Sequence[Path], folder: Path, base: Path | None = None) -> tuple[Path, ...]:
    """Move finished files into their folder, in this order; see :func:`.atomic.move`.

    Raises
    ------
    OutputError
        One of the names is that of a folder, a device or a pipe, a folder cannot be made, or a
        file cannot be moved; none was, and no folder is new.
    """
    targets = [folder / (path.relative_to(base) if base else path.name) for path in files]
    for target in targets:
        refuse_taken(target)
    new: list[Path] = []
    try:
        for below in dict.fromkeys(target.parent for target in targets):
            new += _missing(below)
            make_folder(below)
        return move(files, folder, base)
    except (OSError, OutputError) as error:
        _remove_empty(new)
        if isinstance(error, OutputError):
            raise
        where = getattr(error, "filename2", None) or folder
        raise OutputError(f"{where}: cannot be written ({error.strerror or error}).") from error
