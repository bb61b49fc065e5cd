# SPDX-License-Identifier: GPL-3.0-or-later
"""Back end ``folder``: surfaces from pictures of any generator.

A picture is converted to a relief by a network, or by brightness.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from ..engine.arrays import F32, F64
from ..engine.texture.haptic_map import HapticMap, NoticeableSteps
from ..engine.texture.height_field import HeightField, from_image
from ..engine.texture.mcha import MapSettings, make_map
from ..engine.texture.relief.linear_light import height_from_colour
from ..engine.texture.relief.relief_estimate import estimate
from ..files.hashes import sha256_of
from ..formats.pictures import png
from .generated import Generated, name_of
from .picture_prompts import prompt_of

NAME: Final = "folder"
SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".exr")

Way = Literal["relief", "sobel"]

WAYS: Final[tuple[Way, ...]] = ("relief", "sobel")
"""Ways of conversion, the best one first."""

_NOTES: Final = {
    "relief": "the relief was estimated from the picture by a network",
    "sobel": "the picture's brightness was taken as heights (the map paper's way): prints and "
    "shadows are felt as ridges",
}


@dataclass(frozen=True, eq=False)
class PictureSurface:
    """Surface of a picture."""

    field: HeightField
    roughness: F64  # (H, W) 0..1
    way: Way
    note: str  # sentence about the way
    slope: F32 | None = None  # (H, W) estimated slope; None: the slope of the heights

    def map(self, settings: MapSettings) -> HapticMap:
        """Haptic map of heights and roughness; an estimated slope replaces the heights' own."""
        return make_map(self.field, self.roughness, settings, self.slope)


def surface_of(
    srgb: npt.ArrayLike,
    size_m: tuple[float, float],
    *,
    depth_m: float,
    tiles: bool,
    way: Way = WAYS[0],
) -> PictureSurface:
    """Convert a picture (H, W, 3), sRGB 0..1, bottom row first, to a surface of ``size_m``.

    ``depth_m`` is the height of white over black, for the way ``sobel`` only; ``tiles``: opposite
    edges match. Raises InputError if the array is no picture, or a size is not allowed.
    """
    if way == "relief":
        relief = estimate(srgb, size_m, tiles=tiles)
        roughness = np.asarray(relief.roughness, np.float64)
        return PictureSurface(relief.field, roughness, way, _NOTES[way], relief.slope)
    field = from_image(height_from_colour(srgb), depth_m, size_m, tiles=tiles)
    # Brightness says nothing about roughness.
    roughness = np.full(field.heights_m.shape, MapSettings().default_roughness)
    return PictureSurface(field, roughness, way, _NOTES[way])


def generated_name(picture: Path, digest: str) -> str:
    """Name of a picture's surface: words of the stem, ``-``, 8 digits of ``digest`` (SHA-256)."""
    return name_of(picture.stem, digest[:8])


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

    ``pixels`` reads a picture as for :func:`surface_of`. ``size_m`` None: 0.1 m along the longer
    edge. A prompt with tiling has the same effect as ``tiles``. Raises InputError if the picture
    cannot be read, or a size is not allowed.
    """
    srgb = pixels(picture)
    prompt = prompt_of(png.texts(picture))
    rows, columns = srgb.shape[:2]
    longest = max(rows, columns)
    size = size_m or (0.1 * columns / longest, 0.1 * rows / longest)
    surface = surface_of(srgb, size, depth_m=depth_m, tiles=tiles or prompt.is_tiling, way=way)
    # Part of the name: a changed picture of the same name gives a new surface.
    digest = sha256_of(picture)
    notes = [surface.note]
    if not prompt.words:
        notes.append("the picture tells no words that it was made of")
    record = {
        "words": prompt.words,
        "negative_words": prompt.negative,
        "seed": prompt.seed,
        "back_end": NAME,
        "conversion": surface.way,
        "source": {
            "file": picture.name,
            "sha256": digest,
            "generator": prompt.generator,
            "model": prompt.model,
            "settings": dict(prompt.settings),
        },
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
