# SPDX-License-Identifier: GPL-3.0-or-later
"""Relief, slope and roughness of a material, estimated from one picture of it.

The slope is estimated beside the heights: where light may come from either side, a hill and a
hollow look alike, so heights are uncertain where their slope is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ....errors import InputError
from ...arrays import F32, F64
from ..height_field import HeightField, check_texel, sample_grid
from ..mcha import blurred_slope
from .relief_network import STRIDE, Weights, estimated

LARGEST: Final = 2048
"""Texels along an edge that the network looks at; a larger picture is estimated from fewer."""


@dataclass(frozen=True, eq=False)
class EstimatedRelief:
    """Relief of a picture.

    Parameters
    ----------
    field : HeightField
        As steep as ``slope`` on average.
    slope : (H, W) float32
        Metres per metre, after a blur of a texel.
    roughness : (H, W) float32
        0 glossy to 1 dull.
    """

    field: HeightField
    slope: F32
    roughness: F32


def estimate(
    srgb: npt.ArrayLike,
    size_m: tuple[float, float],
    *,
    tiles: bool = False,
    weights: Weights | None = None,
) -> EstimatedRelief:
    """Relief of a picture of a material.

    Parameters
    ----------
    srgb : (H, W, 3)
        sRGB 0..1, bottom row first.
    size_m : (float, float)
        Width and height of what the picture shows.
    tiles : bool
        Whether it goes on at its opposite edge; the relief does so, too.

    Raises
    ------
    InputError
        It is no picture, or has no size.
    """
    colours = np.asarray(srgb, np.float64)
    if colours.ndim != 3 or colours.shape[2] < 3 or 0 in colours.shape:
        raise InputError(f"Picture: expected rows, columns and 3 colours, got {colours.shape}.")
    if not np.isfinite(colours).all():
        raise InputError("Picture: it has values that are no finite numbers.")
    rows, columns = colours.shape[:2]
    texel = size_m[0] / columns, size_m[1] / rows
    check_texel(texel, "Picture")
    seen = _seen(size_m, min(texel))
    inputs = np.clip(_resampled(colours[..., :3], seen, tiles), 0.0, 1.0)
    found = estimated(inputs, tiles=tiles, weights=weights)
    pixels = HeightField(found.heights.astype(np.float64), (1.0, 1.0), tiles)
    steep = float(blurred_slope(pixels, 1.0).mean())
    scale = float(found.slope.mean()) / steep if steep > 0.0 else 0.0
    heights = found.heights * (scale * np.sqrt(size_m[0] / seen[1] * size_m[1] / seen[0]))
    layers = np.stack([heights - heights.min(), found.slope, found.roughness], -1)
    layers = _resampled(layers.astype(np.float64), (rows, columns), tiles)
    slope, roughness = (layers[..., k].astype(np.float32) for k in (1, 2))
    return EstimatedRelief(HeightField(layers[..., 0], texel, tiles), slope, roughness)


def _seen(size_m: tuple[float, float], texel_m: float) -> tuple[int, int]:
    """Rows and columns that the network looks at: texels nearly square, multiples of its stride."""
    texel_m = max(texel_m, max(size_m) / LARGEST)
    across, down = (max(1, round(size / texel_m / STRIDE)) * STRIDE for size in size_m)
    return down, across


def _resampled(grid: F64, shape: tuple[int, int], tiles: bool) -> F64:
    """A grid (H, W, C) with other numbers of rows and columns; averaged where there are fewer."""
    from scipy import ndimage

    rows, columns = grid.shape[:2]
    if (rows, columns) == shape:
        return grid
    step = rows / shape[0], columns / shape[1]
    mode = "grid-wrap" if tiles else "nearest"
    sigma = [0.5 * np.sqrt(max(each**2 - 1.0, 0.0)) for each in step]
    line = [(np.arange(n) + 0.5) / n for n in shape]
    x, y = np.meshgrid(line[1] * columns, line[0] * rows)
    points = np.stack([x, y], -1)
    return np.stack(
        [
            sample_grid(
                ndimage.gaussian_filter(grid[..., k], sigma, mode=mode), points, (1.0, 1.0), tiles
            )
            for k in range(grid.shape[2])
        ],
        -1,
    )
