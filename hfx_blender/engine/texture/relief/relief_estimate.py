# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate of relief, slope and roughness of a material from one picture.

Slope is estimated separately from heights: under light from an unknown side a hill looks like a
hollow, so heights are uncertain where their slope is not.

``python -m hfx_blender.engine.texture.relief.relief_estimate INPUT.npz OUTPUT.npz`` estimates in a
process, while Blender stays usable: the input holds the arguments of :func:`estimate`, the output
heights in metres, slope and roughness.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from ....errors import HfxError, InputError
from ....processes.messages import json_message
from ....processes.worker import Owner
from ...arrays import F32, F64
from ..height_field import HeightField, check_texel, sample_grid
from ..mcha import blurred_slope
from .relief_network import STRIDE, Weights, estimated

LARGEST: Final = 2048  # largest edge of the network's input in texels; larger pictures are reduced


@dataclass(frozen=True, eq=False)
class EstimatedRelief:
    """Relief of a picture. ``field`` has the mean slope of ``slope`` (H, W), which is in metres per
    metre after a blur of a texel; ``roughness`` (H, W) is 0 glossy to 1 dull."""

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
    """Estimate the relief of a picture of a material, ``srgb`` (H, W, 3), 0..1, bottom row first.

    ``size_m`` is width and height of the pictured area; ``tiles``: picture and relief continue at
    the opposite edge; ``weights`` None: the stored network. Raises InputError for no picture of
    finite numbers, or without size.
    """
    colours = np.asarray(srgb, np.float64)
    if colours.ndim != 3 or colours.shape[2] < 3 or 0 in colours.shape:
        raise InputError(f"Picture: expected rows, columns and 3 colours, got {colours.shape}.")
    if not np.isfinite(colours).all():
        raise InputError("Picture: it has values that are no finite numbers.")
    rows, columns = colours.shape[:2]
    texel = size_m[0] / columns, size_m[1] / rows
    check_texel(texel, "Picture")
    # The network sees nearly square texels, and rows and columns in multiples of its stride.
    square_m = max(min(texel), max(size_m) / LARGEST)
    across, down = (max(1, round(size / square_m / STRIDE)) * STRIDE for size in size_m)
    network_shape = down, across
    inputs = np.clip(_resampled(colours[..., :3], network_shape, tiles), 0.0, 1.0)
    network = estimated(inputs, tiles=tiles, weights=weights)
    # The network's heights have no reliable scale: scale them to the mean of its slopes.
    pixels = HeightField(network.heights.astype(np.float64), (1.0, 1.0), tiles)
    steep = float(blurred_slope(pixels, 1.0).mean())
    scale = float(network.slope.mean()) / steep if steep > 0.0 else 0.0
    heights = network.heights * (
        scale * np.sqrt(size_m[0] / network_shape[1] * size_m[1] / network_shape[0])
    )
    layers = np.stack([heights - heights.min(), network.slope, network.roughness], -1)
    layers = _resampled(layers.astype(np.float64), (rows, columns), tiles)
    slope, roughness = (layers[..., k].astype(np.float32) for k in (1, 2))
    return EstimatedRelief(HeightField(layers[..., 0], texel, tiles), slope, roughness)


def _resampled(grid: F64, shape: tuple[int, int], tiles: bool) -> F64:
    """Grid (H, W, C) resampled linearly to ``shape``, rows and columns; blurred if reduced."""
    from scipy import ndimage

    rows, columns = grid.shape[:2]
    if (rows, columns) == shape:
        return grid
    step = rows / shape[0], columns / shape[1]
    # A texel of the result covers several of the grid, so blur before sampling against aliases.
    mode = "grid-wrap" if tiles else "nearest"
    sigma = [0.5 * np.sqrt(max(ratio**2 - 1.0, 0.0)) for ratio in step]
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


def main(source: str, target: str) -> None:
    """Estimate the relief of the file ``source`` into the file ``target``. An HfxError is sent to
    the owner process as a message ``{"error": text}``, without a file."""
    owner = Owner()
    with np.load(source) as file:
        srgb, size_m, tiles = file["srgb"], file["size_m"], bool(file["tiles"])
    try:
        relief = estimate(srgb, (float(size_m[0]), float(size_m[1])), tiles=tiles)
    except HfxError as error:
        owner.send(json_message({"error": str(error)}))
        return
    with Path(target).open("wb") as stream:
        np.savez(
            stream, heights_m=relief.field.heights_m, slope=relief.slope, roughness=relief.roughness
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
