# SPDX-License-Identifier: GPL-3.0-or-later
"""Building blocks of tileable heights: noise, warping, scattered cells and shapes.

Grids are (N, N) float64 over a repeating unit square; places are rows and columns, 0 to 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.texture.height_field import bilinear
from hfx_blender.engine.texture.procedural import noise as band_noise


class Cells(NamedTuple):
    """Distance to the nearest and second nearest point (unit lengths), and id of the nearest."""

    first: F64
    second: F64
    index: I64


def noise(
    rng: np.random.Generator,
    texels: int,
    longest: float,
    shortest: float,
    *,
    stretch: float = 1.0,
    fall: float = 1.0,
) -> F64:
    """Tileable noise (N, N) of RMS 1; wavelengths as shares of the square."""
    return band_noise(rng, texels, 1.0, longest, shortest, stretch, fall)


def places(texels: int) -> tuple[F64, F64]:
    """Rows and columns (N, N) of all texel centres."""
    line = (np.arange(texels) + 0.5) / texels
    rows, columns = np.meshgrid(line, line, indexing="ij")
    return rows, columns


def warped_places(
    rng: np.random.Generator, texels: int, amount: float, longest: float = 0.5
) -> tuple[F64, F64]:
    """Rows and columns (N, N) of texel centres, displaced by smooth noise of RMS ``amount``."""
    rows, columns = places(texels)
    if amount > 0.0:
        shortest = max(longest / 4.0, 4.0 / texels)
        rows = rows + amount * noise(rng, texels, longest, shortest)
        columns = columns + amount * noise(rng, texels, longest, shortest)
    return rows, columns


def warped(grid: F64, rng: np.random.Generator, amount: float, longest: float = 0.5) -> F64:
    """Resample a grid at displaced places."""
    texels = len(grid)
    moved = np.stack(warped_places(rng, texels, amount, longest)) * texels - 0.5
    return bilinear(grid, moved, True)


def smooth_step(values: F64, low: float, high: float) -> F64:
    """0 below ``low``, 1 above ``high``, a smooth cubic in between."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def cells(
    rng: np.random.Generator,
    texels: int,
    per_side: int,
    *,
    jitter: float = 0.9,
    stretch: float = 1.0,
    moved: tuple[F64, F64] | None = None,
) -> Cells:
    """Compute tileable cells around one random point in each square of a grid.

    Parameters
    ----------
    per_side : int
        Points along an edge.
    jitter : float
        Largest displacement of a point, as a share of its square.
    stretch : float
        Width of cells relative to their height.
    moved : (rows, columns), optional
        Places of the distances; None: texel centres.
    """
    along = max(2, round(per_side / stretch))
    shift = rng.uniform(-0.5, 0.5, (2, per_side, along)) * jitter
    rows, columns = places(texels) if moved is None else moved
    rows, columns = rows * per_side, columns * along
    row, column = np.floor(rows).astype(np.int64), np.floor(columns).astype(np.int64)
    first = np.full(rows.shape, np.inf)
    second = np.full(rows.shape, np.inf)
    index = np.zeros(rows.shape, np.int64)
    ratio = per_side / along
    # The nearest points of a texel lie in its own square or the eight around it.
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            r, c = (row + down) % per_side, (column + right) % along
            dy = row + down + 0.5 + shift[0][r, c] - rows
            dx = (column + right + 0.5 + shift[1][r, c] - columns) * ratio / stretch
            distance = np.hypot(dy, dx)
            nearer = distance < first
            second = np.where(nearer, first, np.minimum(second, distance))
            index = np.where(nearer, r * along + c, index)
            first = np.where(nearer, distance, first)
    return Cells(first / per_side, second / per_side, index)


def random_by_cell(rng: np.random.Generator, index: I64) -> F64:
    """Random numbers 0..1 by cell, at the texels of a grid of ids."""
    return rng.random(int(index.max()) + 1)[index]


def scattered(
    rng: np.random.Generator,
    texels: int,
    count: int,
    half_length: float,
    half_width: float,
    *,
    profile: str = "round",
    angles: tuple[float, float] = (0.0, np.pi),
    piled: float = 0.0,
) -> F64:
    """Scatter ellipses, boxes or fibres over a plane; the maximum counts, heights 0 to about 1.

    Parameters
    ----------
    half_length, half_width : float
        Shares of the square.
    profile : "round", "box" or "cone"
    angles : (low, high)
        Range of directions of the lengths, radians.
    piled : float
        Largest base height of a shape, in units of its own height.
    """
    heights = np.zeros((texels, texels))
    reach = min(int(np.ceil(1.3 * max(half_length, half_width) * texels)), texels // 2)
    steps = np.arange(-reach, reach + 1)
    for _ in range(count):
        cy, cx = rng.integers(0, texels, 2)
        angle, size = rng.uniform(*angles), rng.uniform(0.7, 1.3)
        down, right = steps[:, None] / texels, steps[None, :] / texels
        u = (np.cos(angle) * right + np.sin(angle) * down) / (size * half_length)
        v = (np.cos(angle) * down - np.sin(angle) * right) / (size * half_width)
        if profile == "box":
            shape = np.clip((1.0 - np.maximum(np.abs(u), np.abs(v))) / 0.25, 0.0, 1.0)
        else:
            inside = np.maximum(1.0 - u * u - v * v, 0.0)
            shape = np.sqrt(inside) if profile == "round" else 1.0 - np.sqrt(1.0 - inside)
        lifted = np.where(shape > 0.0, shape + piled * rng.random(), 0.0)
        window = np.ix_((cy + steps) % texels, (cx + steps) % texels)
        heights[window] = np.maximum(heights[window], lifted)
    return heights
