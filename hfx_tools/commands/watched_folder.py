# SPDX-License-Identifier: GPL-3.0-or-later
"""Folder watched for pictures of other generators."""

from __future__ import annotations

import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from hfx_blender.errors import InputError
from hfx_blender.files.hashes import sha256_of
from hfx_blender.generation.generated import RECORD, name_of
from hfx_blender.generation.picture_folder import SUFFIXES

_MOST_FILES: Final = 100_000


@dataclass
class WatchedFolder:
    """Folder of pictures, watched by polling for files that are completely written.

    Raises InputError: the folder does not exist.
    """

    folder: Path
    # Of the last poll, with a picture's suffix: empty or no regular files, broken links.
    passed_over: list[Path] = field(default_factory=list, init=False)
    _seen: dict[Path, tuple[int, int]] = field(default_factory=dict)
    _done: dict[Path, tuple[int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: there is no such folder.")

    def settled(self) -> list[Path]:
        """Poll the folder; return new pictures with equal size and time at two polls, sorted. Each
        picture is returned once, and again after a change. Empty files and broken links are in
        ``passed_over``."""
        states: dict[Path, tuple[int, int]] = {}
        self.passed_over = []
        for path in sorted(self.folder.iterdir())[:_MOST_FILES]:
            if path.suffix.lower() not in SUFFIXES or path.name.startswith("."):
                continue
            try:
                state = path.stat()
            except OSError:
                if path.is_symlink():  # broken; a regular file was removed since the listing
                    self.passed_over.append(path)
                continue
            if stat.S_ISREG(state.st_mode) and state.st_size:
                states[path] = (state.st_size, state.st_mtime_ns)
            else:
                self.passed_over.append(path)
        # A picture that is still being written changes its size or time between two polls.
        ready = [
            path
            for path, state in states.items()
            if self._seen.get(path) == state and self._done.get(path) != state
        ]
        # Removed pictures are forgotten with the old states; a new one of the name counts again.
        self._seen = states
        self._done.update({path: states[path] for path in ready})
        return ready

    @property
    def is_waiting(self) -> bool:
        """Test for pictures that were found but not returned yet."""
        return any(self._done.get(path) != state for path, state in self._seen.items())


def is_made(picture: Path, folder: Path) -> bool:
    """Test that a folder contains the surface of a picture with this content."""
    return (folder / (name_of(picture.stem, sha256_of(picture)[:8]) + RECORD)).is_file()
