# SPDX-License-Identifier: GPL-3.0-or-later
"""Training pairs of a touch decoder, made on demand: colour pictures and intensity maps.

Liu and Gu (2025, section 3.4) use 16,000 pairs of four materials in equal parts, with pictures of
Stable Diffusion. Here pictures come from the library, randomly steered, or from the user's folder.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from hfx_blender.engine.arrays import F32, F64
from hfx_blender.engine.texture.mcha import MapSettings, make_map
from hfx_blender.engine.texture.procedural import KINDS, MATERIALS
from hfx_blender.errors import InputError
from hfx_blender.generation.library_search import Steering, albedo, steered
from hfx_blender.generation.picture_folder import SUFFIXES, surface_of
from hfx_blender.generation.surface_words import COLOURS

COUNT: Final = 16_000
Truth = Literal["picture", "relief"]
_SIZE_M: Final = (0.1, 0.1)
_DEPTH_M: Final = 2e-3  # height of white above black, so that a map uses its whole range


@dataclass(frozen=True)
class LibraryPairs:
    """Pairs of the library; pair ``k`` depends on ``seed`` and ``k`` only.

    ``truth`` "picture" or "relief": map of the colour picture, as in the paper, or of the true
    relief.
    """

    texels: int
    count: int = COUNT
    truth: Truth = "picture"
    seed: int = 0

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, number: int) -> tuple[F32, F32]:
        """Make colours (3, H, W) and intensity (1, H, W), both -1..1, top row first."""
        rng = np.random.default_rng([self.seed, number])
        kind = KINDS[number % len(KINDS)]
        names = [name for name, candidate in MATERIALS.items() if candidate.kind == kind]
        material = MATERIALS[names[int(rng.integers(len(names)))]]
        steering = Steering(
            scale=float(2.0 ** rng.uniform(-1.0, 1.0)),
            depth=float(2.0 ** rng.uniform(-1.0, 1.0)),
            wear=float(rng.uniform(0.0, 0.8)),
            direction_deg=int(rng.choice([0, 45, 90])),
        )
        field, roughness = steered(material, steering, self.texels, number)
        colour = list(COLOURS.values())[int(rng.integers(len(COLOURS)))]
        light = float(rng.uniform(0.7, 1.3))
        picture = albedo(kind, field, colour, light, number, steering.direction_deg) / 255.0
        if self.truth == "relief":
            return as_pair(picture, make_map(field, roughness, MapSettings()).intensity)
        return as_pair(picture, map_of_picture(picture))


@dataclass(frozen=True)
class FolderPairs:
    """Pairs from the pictures of a folder.

    Raises
    ------
    InputError
        The folder has no pictures.
    """

    folder: Path
    texels: int
    pixels: Callable[[Path], F64]

    def __post_init__(self) -> None:
        if not self.paths:
            raise InputError(f"{self.folder}: has no pictures ({', '.join(SUFFIXES)}).")

    @property
    def paths(self) -> list[Path]:
        """Paths of the pictures, sorted by name."""
        entries = sorted(self.folder.iterdir()) if self.folder.is_dir() else []
        return [path for path in entries if path.suffix.lower() in SUFFIXES]

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, number: int) -> tuple[F32, F32]:
        """Make a pair like :class:`LibraryPairs`, of the middle of a picture.

        Raises
        ------
        InputError
            The picture is smaller than ``texels``.
        """
        srgb = self.pixels(self.paths[number])
        rows, columns = srgb.shape[:2]
        if min(rows, columns) < self.texels:
            raise InputError(
                f"{self.paths[number]}: {columns} x {rows} pixels; expected {self.texels} or more."
            )
        top, left = (rows - self.texels) // 2, (columns - self.texels) // 2
        srgb = srgb[top : top + self.texels, left : left + self.texels]
        return as_pair(srgb, map_of_picture(srgb))


def map_of_picture(srgb: F64) -> F32:
    """Intensity (H, W) of a picture by the paper's method, blur and Sobel."""
    size = (_SIZE_M[0] * srgb.shape[1] / 512.0, _SIZE_M[1] * srgb.shape[0] / 512.0)
    surface = surface_of(srgb, size, depth_m=_DEPTH_M, tiles=True, way="sobel")
    return make_map(surface.height, surface.roughness, MapSettings()).intensity


def as_pair(srgb: F64, intensity: F32) -> tuple[F32, F32]:
    """Convert colours (H, W, 3) and intensity (H, W), 0..1, to -1..1, channels and top first."""
    colours = np.ascontiguousarray(srgb[::-1].transpose(2, 0, 1), np.float32)
    return 2.0 * colours - 1.0, 2.0 * np.ascontiguousarray(intensity[::-1][None]) - 1.0
