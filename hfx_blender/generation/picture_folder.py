# SPDX-License-Identifier: GPL-3.0-or-later
"""Back end ``folder``: surfaces from the pictures in a watched folder, by any generator."""

from __future__ import annotations

import stat
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..engine.arrays import F64
from ..engine.texture.haptic_map import NoticeableSteps
from ..engine.texture.mcha import MapSettings
from ..errors import InputError
from ..files.hashes import sha256_of
from ..formats.pictures import png
from .generated import RECORD, Generated, name_of
from .picture_conversion import WAYS, Way, surface_of
from .picture_prompts import prompt_of

NAME: Final = "folder"
SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".exr")
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
        """Poll the folder; return new pictures with equal size and time at two polls, sorted.

        Each picture is returned once, and again after a change.
        """
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
        self._seen = states
        self._done.update({path: states[path] for path in ready})
        return ready

    @property
    def is_waiting(self) -> bool:
        """Test for pictures that were found but not returned yet."""
        return any(self._done.get(path) != state for path, state in self._seen.items())


def generated_name(picture: Path, digest: str) -> str:
    """Name of a picture's surface: words of the stem, ``-``, 8 digits of ``digest`` (SHA-256)."""
    return name_of(picture.stem, digest[:8])


def is_made(picture: Path, folder: Path) -> bool:
    """Test that a folder contains the surface of a picture with this content."""
    return (folder / (generated_name(picture, sha256_of(picture)) + RECORD)).is_file()


def generate(
    picture: Path,
    pixels: Callable[[Path], F64],
    *,
    size_m: tuple[float, float] | None,
    depth_m: float,
    tiles: bool = False,
    way: Way = WAYS[0],
    steps: NoticeableSteps | None = None,
) -> Generated:
    """Generate the surface of a picture; the record has the picture's prompt, if there is one.

    Parameters
    ----------
    pixels : callable
        Reads a picture as (H, W, 3) sRGB 0..1, bottom row first.
    size_m : (float, float), optional
        Width and height of the shown surface; by default 0.1 m along the longer edge.
    depth_m : float
        Height of white over black for the way ``sobel``.
    tiles : bool
        Opposite edges match. A prompt with tiling has the same effect.

    Raises InputError: the picture cannot be read, or a size is not allowed.
    """
    srgb = pixels(picture)
    prompt = prompt_of(png.texts(picture))
    rows, columns = srgb.shape[:2]
    longest = max(rows, columns)
    size = size_m or (0.1 * columns / longest, 0.1 * rows / longest)
    surface = surface_of(srgb, size, depth_m=depth_m, tiles=tiles or prompt.is_tiling, way=way)
    digest = sha256_of(picture)
    notes = [surface.note]
    if not prompt.words:
        notes.append("the picture tells no words that it was made of")
    source: dict[str, Any] = {
        "file": picture.name,
        "sha256": digest,
        "generator": prompt.generator,
        "model": prompt.model,
        "settings": dict(prompt.settings),
    }
    record = {
        "words": prompt.words,
        "negative_words": prompt.negative,
        "seed": prompt.seed,
        "back_end": NAME,
        "conversion": surface.way,
        "source": source,
        "versions": {},
    }
    return Generated(
        generated_name(picture, digest),
        np.rint(255.0 * np.clip(srgb, 0.0, 1.0)).astype(np.uint8),
        surface.field,
        surface.roughness,
        surface.map(MapSettings(steps=steps)),
        record,
        slope=surface.slope,
        notes=tuple(notes),
    )
