# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of a picture of a material to a relief, by a network or by brightness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from ..engine.arrays import F32, F64
from ..engine.texture.haptic_map import HapticMap
from ..engine.texture.height_field import HeightField, from_image
from ..engine.texture.mcha import MapSettings, make_map
from ..engine.texture.relief.linear_light import height_from_colour
from ..engine.texture.relief.relief_estimate import estimate

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
    """Convert a picture (H, W, 3), sRGB 0..1, bottom row first, to a surface.

    Parameters
    ----------
    size_m : (float, float)
        Width and height of the shown surface.
    depth_m : float
        Height of white over black, for the way ``sobel`` only.
    tiles : bool
        Opposite edges match.

    Raises InputError: the array is no picture, or a size is not allowed.
    """
    if way == "relief":
        relief = estimate(srgb, size_m, tiles=tiles)
        roughness = np.asarray(relief.roughness, np.float64)
        return PictureSurface(relief.field, roughness, way, _NOTES[way], relief.slope)
    field = from_image(height_from_colour(srgb), depth_m, size_m, tiles=tiles)
    roughness = np.full(field.heights_m.shape, MapSettings().default_roughness)
    return PictureSurface(field, roughness, way, _NOTES[way])
