# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour picture of a generated material: its colour, varied as its kind is, darker in the gaps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..engine.arrays import F64, U8
from ..engine.texture.height_field import HeightField
from ..engine.texture.procedural import noise
from ..engine.texture.relief.linear_light import linear_to_srgb, srgb_to_linear
from .steering import turned


@dataclass(frozen=True)
class _Look:
    """Variation of a kind's colour, as shares of its linear light."""

    gaps: float  # how much darker the lowest is
    patches: float  # RMS, of patches about as large as its features
    tint: float  # RMS, of warm against cool
    speckle: float  # RMS, of single texels
    stretch: float  # of the patches along x


_LOOKS: Final = {
    "gravel": _Look(0.75, 0.22, 0.05, 0.08, 1.0),
    "metal": _Look(0.3, 0.04, 0.01, 0.02, 1.0),
    "fabric": _Look(0.55, 0.06, 0.01, 0.06, 1.0),
    "wood": _Look(0.45, 0.12, 0.05, 0.05, 12.0),
}
_WARM: Final = (1.0, 0.0, -1.0)


def albedo(
    kind: str,
    field: HeightField,
    srgb: tuple[float, float, float],
    light: float,
    seed: int,
    direction_deg: int = 0,
) -> U8:
    """Colours (N, N, 3) of a surface, sRGB in 8 bits, bottom row first; they tile.

    Parameters
    ----------
    kind : str
        One of :data:`.procedural.KINDS`.
    srgb : (float, float, float)
        Its colour, 0..1.
    light : float
        Factor of the linear light.
    direction_deg : int
        By which the grain is turned: 0, 45 or 90.
    """
    look = _LOOKS[kind]
    rng = np.random.default_rng([seed, 17, *kind.encode()])
    texels, size = field.heights_m.shape[0], field.size_m[0]
    patches = noise(rng, texels, size, 0.12 * size, 0.02 * size, stretch=look.stretch)
    warmth = noise(rng, texels, size, 0.4 * size, 0.04 * size, stretch=look.stretch)
    patches, warmth = turned(patches, direction_deg), turned(warmth, direction_deg)
    speckle = rng.standard_normal((texels, texels))
    shade = 1.0 - look.gaps * (1.0 - _share(field.heights_m))
    shade = shade * np.exp(look.patches * patches + look.speckle * speckle) * light
    tinted = 1.0 + look.tint * warmth[..., None] * np.array(_WARM)
    linear = srgb_to_linear(np.array(srgb)) * shade[..., None] * tinted
    return np.rint(255.0 * linear_to_srgb(np.clip(linear, 0.0, 1.0))).astype(np.uint8)


def _share(heights: F64) -> F64:
    """Heights as 0..1 between their second and 98th percentile."""
    low, high = np.quantile(heights, (0.02, 0.98))
    if high <= low:
        return np.ones_like(heights)
    return np.asarray(np.clip((heights - low) / (high - low), 0.0, 1.0))
