# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface as a grid of heights, sampled anywhere, with or without end.

Surface coordinates are metres; the texel of row ``j`` and column ``i`` has its middle at
``((i + 1/2) * texel_x, (j + 1/2) * texel_y)``, so row 0 is at the bottom, as in Blender's images.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ...errors import InputError

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

Order = Literal["linear", "cubic"]

_AT_ONCE: Final = 1 << 13
"""Points looked up together: more, and what is in between leaves the processor's cache."""


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights over a rectangle of a plane, all in metres.

    Parameters
    ----------
    heights_m : (H, W) float64
    texel_m : (float, float)
        Size of a texel along x and along y; need not be square.
    tiles : bool
        Repeat without end; else the edge goes on for ever.

    Raises
    ------
    InputError
        No texels, no size, or heights that are not numbers (see :mod:`.scan` for holes).
    """

    heights_m: F64
    texel_m: tuple[float, float]
    tiles: bool = True

    def __post_init__(self) -> None:
        heights = np.asarray(self.heights_m, np.float64)
        if heights.ndim != 2 or heights.size == 0:
            raise InputError(
                f"Height field: expected rows and columns of heights, got {heights.shape}."
            )
        check_texel(self.texel_m, "Height field")
        wrong = int(heights.size - np.count_nonzero(np.isfinite(heights)))
        if wrong:
            raise InputError(
                f"Height field: {wrong} of {heights.size} heights are not finite numbers. "
                "Fill the holes of a scan first."
            )
        object.__setattr__(self, "heights_m", np.ascontiguousarray(heights))

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the rectangle, metres."""
        rows, columns = self.heights_m.shape
        return columns * self.texel_m[0], rows * self.texel_m[1]

    @cached_property
    def slopes(self) -> F64:
        """Slope along x and y at the texels' middles, metres per metre, (2, H, W)."""
        return np.stack(
            [
                _difference(self.heights_m, axis, self.texel_m[1 - axis], self.tiles)
                for axis in (1, 0)
            ]
        )

    def sample(self, points_m: F64, order: Order = "linear") -> F64:
        """Heights at any points.

        Parameters
        ----------
        points_m : (..., 2) float64
            Surface coordinates, metres.
        order : "linear" or "cubic"
            Cubic is Catmull-Rom: through the texels, and smooth.

        Returns
        -------
        (...) float64
            Metres.
        """
        return sample_grid(self.heights_m, points_m, self.texel_m, self.tiles, order)

    def gradient(self, points_m: F64) -> F64:
        """Slope along x and y at any points, metres per metre: (..., 2) to (..., 2)."""
        parts = [sample_grid(s, points_m, self.texel_m, self.tiles) for s in self.slopes]
        return np.stack(parts, axis=-1)


def from_image(
    grey: npt.ArrayLike,
    depth_m: float,
    size_m: tuple[float, float],
    *,
    tiles: bool = True,
) -> HeightField:
    """A height field from a picture of heights.

    Parameters
    ----------
    grey : (H, W) float
        Linear values, 0 lowest and 1 highest, bottom row first. What comes from an sRGB picture
        must go through :func:`.linear_light.height_from_colour` first.
    depth_m : float
        Height of white over black; may be negative.
    size_m : (float, float)
        Size of the whole picture.

    Raises
    ------
    InputError
    """
    values = np.asarray(grey, np.float64)
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"Height picture: expected rows and columns, got {values.shape}.")
    if not np.isfinite(depth_m):
        raise InputError(f"Height picture: a depth of {depth_m} m; expected a number.")
    rows, columns = values.shape
    return HeightField(values * depth_m, (size_m[0] / columns, size_m[1] / rows), tiles)


def check_texel(texel_m: tuple[float, float], what: str) -> None:
    """Refuse a size that is none.

    Raises
    ------
    InputError
    """
    if len(texel_m) != 2 or not all(np.isfinite(t) and t > 0.0 for t in texel_m):
        shown = " x ".join(f"{1e3 * t:g}" for t in texel_m)
        raise InputError(f"{what}: a texel of {shown} mm; expected more than 0 both ways.")


def sample_grid(
    grid: npt.NDArray[np.floating[Any]],
    points_m: F64,
    texel_m: tuple[float, float],
    tiles: bool,
    order: Order = "linear",
) -> F64:
    """Values of a grid (H, W) at points (..., 2), interpolated; coordinates as in this module."""
    points = np.asarray(points_m, np.float64)
    return sample_at(grid, points[..., 0], points[..., 1], texel_m, tiles, order)


def sample_at(
    grid: npt.NDArray[np.floating[Any]],
    x_m: F64,
    y_m: F64,
    texel_m: tuple[float, float],
    tiles: bool,
    order: Order = "linear",
) -> F64:
    """As :func:`sample_grid`, x and y apart."""
    if x_m.size > _AT_ONCE:
        flat_x, flat_y = x_m.reshape(-1), y_m.reshape(-1)
        found = np.zeros(x_m.size)
        for first in range(0, x_m.size, _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            found[part] = sample_at(grid, flat_x[part], flat_y[part], texel_m, tiles, order)
        return found.reshape(x_m.shape)
    rows, columns = grid.shape
    x = x_m * (1.0 / texel_m[0])
    y = y_m * (1.0 / texel_m[1])
    x -= 0.5
    y -= 0.5
    left, low = np.floor(x), np.floor(y)
    x -= left
    y -= low
    i, j = left.astype(np.int64), low.astype(np.int64)
    flat = grid.ravel()
    if order == "linear":
        column, right = wrapped(i, columns, tiles), wrapped(i + 1, columns, tiles)
        row, above = wrapped(j, rows, tiles), wrapped(j + 1, rows, tiles)
        row *= columns
        above *= columns
        lower = flat.take(row + column)
        lower += x * (flat.take(row + right) - lower)
        upper = flat.take(above + column)
        upper += x * (flat.take(above + right) - upper)
        return np.asarray(lower + y * (upper - lower), np.float64)
    shares_x, shares_y = _catmull_rom(x), _catmull_rom(y)
    columns_at = [wrapped(i + k, columns, tiles) for k in (-1, 0, 1, 2)]
    total = np.zeros(x.shape)
    for k, share_y in zip((-1, 0, 1, 2), shares_y, strict=True):
        start = wrapped(j + k, rows, tiles) * columns
        line = np.zeros(x.shape)
        for column_at, share_x in zip(columns_at, shares_x, strict=True):
            line += share_x * flat[start + column_at]
        total += share_y * line
    return total


def wrapped(index: I64, count: int, tiles: bool) -> I64:
    """Indices brought into 0 to ``count`` - 1: around, or to the edge."""
    if not tiles:
        return np.clip(index, 0, count - 1)
    if count & (count - 1) == 0:  # a power of two: a mask costs a tenth of a division
        return index & (count - 1)
    return index % count


def _catmull_rom(t: F64) -> tuple[F64, F64, F64, F64]:
    squared = t * t
    cubed = squared * t
    return (
        0.5 * (2.0 * squared - cubed - t),
        0.5 * (3.0 * cubed - 5.0 * squared + 2.0),
        0.5 * (4.0 * squared - 3.0 * cubed + t),
        0.5 * (cubed - squared),
    )


def _difference(heights: F64, axis: int, spacing: float, tiles: bool) -> F64:
    if tiles:
        return (np.roll(heights, -1, axis) - np.roll(heights, 1, axis)) / (2.0 * spacing)
    if heights.shape[axis] < 2:
        return np.zeros_like(heights)
    return np.asarray(np.gradient(heights, spacing, axis=axis))
