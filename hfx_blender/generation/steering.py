# SPDX-License-Identifier: GPL-3.0-or-later
"""Steering of a library material: its size, depth, wear, direction and weave."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..engine.arrays import F64
from ..engine.texture.height_field import HeightField
from ..engine.texture.procedural import ProceduralMaterial, noise
from ..engine.texture.weave import Weave, woven

_LEAST: Final = 0.03
_MOST: Final = 30.0
"""Bounds of the factors of size and depth."""

_THREADS: Final = 40  # of a square whose weave was asked for
_WORN_FLAT: Final = 0.85  # of the height above the median that full wear takes away


@dataclass(frozen=True)
class Steering:
    """Differences from a library material.

    Parameters
    ----------
    scale : float
        Factor of all lengths, heights included: the slopes stay.
    depth : float
        Factor of the heights besides.
    wear : float
        0 new to 1: what is above the median height is worn flat; below 0 it is raised.
    roughness : float
        Added to the roughness 0..1.
    direction_deg : int
        0, 45 or 90: the tile is turned, and stays without a seam.
    draft : str, optional
        A key of :data:`.weave.DRAFTS`, instead of the material's own relief.
    """

    scale: float = 1.0
    depth: float = 1.0
    wear: float = 0.0
    roughness: float = 0.0
    direction_deg: int = 0
    draft: str | None = None

    def clipped(self) -> Steering:
        """The same within the bounds of what a material bears."""
        return replace(
            self,
            scale=float(np.clip(self.scale, _LEAST, _MOST)),
            depth=float(np.clip(self.depth, _LEAST, _MOST)),
            wear=float(np.clip(self.wear, -1.0, 1.0)),
            roughness=float(np.clip(self.roughness, -1.0, 1.0)),
        )


def steered(
    material: ProceduralMaterial, steering: Steering, texels: int, seed: int
) -> tuple[HeightField, F64]:
    """Heights and roughness 0..1 (N, N) of a steered material; it tiles.

    Raises
    ------
    InputError
        Fewer than 16 texels.
    """
    wanted = steering.clipped()
    field, roughness = material.make(texels, seed)
    if wanted.draft is not None:
        field = _with_weave(field, wanted.draft, texels, seed)
    heights = field.heights_m
    middle = float(np.median(heights))
    above = np.maximum(heights - middle, 0.0)
    heights = heights - _WORN_FLAT * wanted.wear * above
    heights = heights * (wanted.scale * wanted.depth)
    texel = field.texel_m[0] * wanted.scale
    heights, roughness = (turned(each, wanted.direction_deg) for each in (heights, roughness))
    if wanted.direction_deg == 45:
        texel *= float(np.sqrt(2.0))
    heights = heights - heights.min()
    rough = np.clip(roughness + wanted.roughness, 0.0, 1.0)
    return HeightField(heights, (texel, texel)), rough


def _with_weave(field: HeightField, draft: str, texels: int, seed: int) -> HeightField:
    """A cloth as deep as a field's relief, with its texels, in another weave."""
    size = field.size_m[0]
    depth = float(np.ptp(np.quantile(field.heights_m, (0.02, 0.98))))
    cloth = woven(Weave(draft, size / _THREADS, max(depth, 1e-6)), size, texels)
    rng = np.random.default_rng([seed, *draft.encode()])
    fibres = 0.04 * depth * noise(rng, texels, size, 8.0 * size / _THREADS, 0.3 * size / _THREADS)
    return HeightField(cloth.heights_m + fibres, cloth.texel_m)


def turned(values: F64, direction_deg: int) -> F64:
    """A tile (N, N) turned by 0, 45 or 90 degrees, exactly: each texel of it is one of the tile.

    Turned by 45 degrees its rows cross the tile along a diagonal, so that it holds the tile twice,
    and a texel is longer by the root of 2.
    """
    if direction_deg == 90:
        return values.T
    if direction_deg != 45:
        return values
    count = len(values)
    i, j = np.meshgrid(np.arange(count), np.arange(count))
    return np.asarray(values[(j - i) % count, (i + j) % count])
