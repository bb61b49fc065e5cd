# SPDX-License-Identifier: GPL-3.0-or-later
"""Relief of a picture of a material: the one place that chooses between the ways there are."""

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
"""Ways of conversion, the best first."""

_TOLD: Final = {
    "relief": "the relief was estimated from the picture by a network",
    "sobel": "the picture's brightness was taken as heights (the map paper's way): prints and "
    "shadows are felt as ridges",
}


@dataclass(frozen=True, eq=False)
class PictureSurface:
    """Surface of a picture: heights, roughness (H, W) of 0 to 1, and how it was found."""

    field: HeightField
    roughness: F64
    way: Way
    note: str
    slope: F32 | None = None  # estimated by itself, on the heights' grid

    def map(self, settings: MapSettings) -> HapticMap:
        """Haptic map; an estimated slope takes the place of the heights' own."""
        return make_map(self.field, self.roughness, settings, self.slope)


def surface_of(
    srgb: npt.ArrayLike,
    size_m: tuple[float, float],
    *,
    depth_m: float,
    tiles: bool,
    way: Way = WAYS[0],
) -> PictureSurface:
    """Surface of a picture (H, W, 3) of sRGB 0..1, bottom row first.

    Parameters
    ----------
    size_m : (float, float)
        Width and height of what it shows.
    depth_m : float
        Of white over black, for the way ``sobel``; the network states heights of its own.

    Raises
    ------
    InputError
        It is no picture, or has no size.
    """
    if way == "relief":
        made = estimate(srgb, size_m, tiles=tiles)
        roughness = np.asarray(made.roughness, np.float64)
        return PictureSurface(made.field, roughness, way, _TOLD[way], made.slope)
    field = from_image(height_from_colour(srgb), depth_m, size_m, tiles=tiles)
    roughness = np.full(field.heights_m.shape, MapSettings().default_roughness)
    return PictureSurface(field, roughness, way, _TOLD[way])
