# SPDX-License-Identifier: GPL-3.0-or-later
"""Back end ``folder``: pictures that any generator puts into a watched folder, as they come."""

from __future__ import annotations

import stat
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..engine.arrays import F64
from ..engine.texture.device_range import NoticeableSteps
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
    """Folder of pictures, each of which is new once: when its writer has ended.

    Attributes
    ----------
    passed_over : list of Path
        What has the name of a picture and no content, at the last look.

    Raises
    ------
    InputError
        There is no such folder.
    """

    folder: Path
    passed_over: list[Path] = field(default_factory=list, init=False)
    _seen: dict[Path, tuple[int, int]] = field(default_factory=dict)
    _done: dict[Path, tuple[int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: there is no such folder.")

    def settled(self) -> list[Path]:
        """Pictures that are as they were at the last call, and were not given out before.

        A picture that changes later is given out again.
        """
        now: dict[Path, tuple[int, int]] = {}
        self.passed_over = []
        for path in sorted(self.folder.iterdir())[:_MOST_FILES]:
            if path.suffix.lower() not in SUFFIXES or path.name.startswith("."):
                continue
            try:
                state = path.stat()
            except OSError:
                if path.is_symlink():  # to nothing; else it is gone meanwhile
                    self.passed_over.append(path)
                continue
            if stat.S_ISREG(state.st_mode) and state.st_size:
                now[path] = (state.st_size, state.st_mtime_ns)
            else:
                self.passed_over.append(path)
        ready = [
            path
            for path, state in now.items()
            if self._seen.get(path) == state and self._done.get(path) != state
        ]
        self._seen = now
        self._done.update({path: now[path] for path in ready})
        return ready

    @property
    def is_waiting(self) -> bool:
        """Test for pictures that were seen, but not yet twice alike."""
        return any(self._done.get(path) != state for path, state in self._seen.items())


def generated_name(picture: Path, digest: str) -> str:
    """Name of the surface of a picture: the same for the same file, another for other content."""
    return name_of(picture.stem, digest[:8])


def is_made(picture: Path, folder: Path) -> bool:
    """Test that the surface of a picture is in a folder already."""
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
    """Surface of a picture, with the words that it was made of where it tells them.

    Parameters
    ----------
    pixels : callable
        Reads a picture: (H, W, 3) of sRGB 0..1, bottom row first.
    size_m : (float, float), optional
        Width and height of what is shown; by default 0.1 m along the longer edge.
    tiles : bool
        Opposite edges match; so they do where the picture tells that it was made like that.

    Raises
    ------
    InputError
        It cannot be read.
    """
    srgb = pixels(picture)
    prompt = prompt_of(png.texts(picture))
    rows, columns = srgb.shape[:2]
    longest = max(rows, columns)
    size = size_m or (0.1 * columns / longest, 0.1 * rows / longest)
    made = surface_of(srgb, size, depth_m=depth_m, tiles=tiles or prompt.is_tiling, way=way)
    digest = sha256_of(picture)
    notes = [made.note]
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
        "conversion": made.way,
        "source": source,
        "versions": {},
    }
    return Generated(
        generated_name(picture, digest),
        np.rint(255.0 * np.clip(srgb, 0.0, 1.0)).astype(np.uint8),
        made.field,
        made.roughness,
        made.map(MapSettings(steps=steps)),
        record,
        slope=made.slope,
        notes=tuple(notes),
    )
