# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface as a grid of heights, sampled anywhere, with or without tiling.

Surface coordinates are metres. The texel of row ``j`` and column ``i`` has its centre at
``((i + 1/2) * texel_x, (j + 1/2) * texel_y)``; row 0 is at the bottom, as in Blender's images.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F32, F64, I64, Weights

Order = Literal["linear", "cubic"]

_STEEPEST: Final = 0.05  # smallest z of a unit normal; steeper normals are faults of a map
_AT_ONCE: Final = 1 << 13  # points looked up at a time, to stay in the processor's cache


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights over a rectangle of a plane, in metres. Raises InputError without texels or size, or
    for non-finite heights (see :mod:`.scan`)."""

    heights_m: F64  # (H, W)
    texel_m: tuple[float, float]  # size of a texel along x and y
    tiles: bool = True  # repeat the rectangle; else its edge continues outwards

    def __post_init__(self) -> None:
        heights = np.asarray(self.heights_m, np.float64)
        if heights.ndim != 2 or heights.size == 0:
            raise InputError(
                f"Height field: expected rows and columns of heights, got {heights.shape}."
            )
        check_texel(self.texel_m, "Height field")
        bad_count = int(heights.size - np.count_nonzero(np.isfinite(heights)))
        if bad_count:
            raise InputError(
                f"Height field: {bad_count} of {heights.size} heights are not finite numbers. "
                "Fill the holes of a scan first."
            )
        object.__setattr__(self, "heights_m", np.ascontiguousarray(heights))

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the rectangle, metres."""
        rows, columns = self.heights_m.shape
        return columns * self.texel_m[0], rows * self.texel_m[1]

    @cached_property
    def _pairs(self) -> npt.NDArray[np.complex128]:
        """Flat array of heights (real) and right neighbours (imaginary), padded above and right.
        One memory access then reads two corners of a cell, without wrapping."""
        mode: Literal["wrap", "edge"] = "wrap" if self.tiles else "edge"
        more = np.pad(self.heights_m, ((0, 1), (0, 2)), mode)
        # A view of overlapping pairs: complex numbers at the distance of real numbers.
        return np.ndarray((more.size - 1,), np.complex128, more, 0, (more.itemsize,))

    def at_places(self, places: F64, order: Order = "linear") -> F64:
        """Heights (...), m, at rows and columns (2, ...), 0 at the centre of the first texel.
        Faster than :meth:`sample`; may overwrite ``places``."""
        if order == "cubic":
            return cubic(self.heights_m, places, self.tiles)
        rows, columns = self.heights_m.shape
        if not self.tiles:
            last = np.array([rows - 1.0, columns - 1.0]).reshape(2, *[1] * (places.ndim - 1))
            places = np.minimum(np.maximum(places, 0.0), last)
        low = np.floor(places)
        places -= low
        row, column = wrapped_cells(low.astype(np.int64), rows, columns, self.tiles)
        # Index into the padded grid; each complex number is a height with its right neighbour.
        row *= columns + 2
        row += column
        lower = self._pairs[row]
        row += columns + 2
        upper = self._pairs[row]
        upper -= lower
        upper *= places[0]
        lower += upper
        height = lower.imag - lower.real
        height *= places[1]
        height += lower.real
        return height

    def sample(self, points_m: F64, order: Order = "linear") -> F64:
        """Heights (...) in metres at points (..., 2), surface coordinates. ``cubic`` is
        Catmull-Rom: smooth, and exact at texels."""
        return sample_grid(self.heights_m, points_m, self.texel_m, self.tiles, order)


@dataclass(frozen=True, eq=False)
class SurfaceRelief:
    """Relief of a surface, input of the haptic map; all layers cover the same rectangle."""

    height: HeightField
    roughness: Weights | None = None  # (h, w) 0 smooth to 1 rough, own resolution; None: default
    notes: tuple[str, ...] = ()
    slope: F32 | None = None  # (H, W) estimated, after a blur of a texel; None: that of the heights


def from_image(
    grey: npt.ArrayLike, depth_m: float, size_m: tuple[float, float], *, tiles: bool = True
) -> HeightField:
    """Height field of a picture of heights.

    ``grey`` (H, W) are linear values, 0 lowest and 1 highest, bottom row first; convert sRGB
    pictures by :func:`.linear_light.height_from_colour`. ``depth_m`` is the height of white over
    black and may be negative; ``size_m`` is that of the whole picture. Raises InputError for a
    picture without texels, or an unusable depth or size.
    """
    values = np.asarray(grey, np.float64)
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"Height picture: expected rows and columns, got {values.shape}.")
    if not np.isfinite(depth_m):
        raise InputError(f"Height picture: a depth of {depth_m} m; expected a number.")
    rows, columns = values.shape
    return HeightField(values * depth_m, (size_m[0] / columns, size_m[1] / rows), tiles)


def check_texel(texel_m: tuple[float, float], what: str) -> None:
    """Raise InputError unless a size is two positive numbers; ``what`` begins the message."""
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
    """Values (...) of a grid (H, W) of texels at points (..., 2), x then y, m. ``order``: bilinear
    or Catmull-Rom; ``tiles``: wrapped, else the edge continues."""
    points = np.asarray(points_m, np.float64)
    flat = points.reshape(-1, 2)
    interpolated = bilinear if order == "linear" else cubic
    values = np.zeros(len(flat))
    for first in range(0, len(flat), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        places = np.ascontiguousarray(flat[part, ::-1].T)
        places *= np.array([[1.0 / texel_m[1]], [1.0 / texel_m[0]]])
        values[part] = interpolated(grid, places - 0.5, tiles)
    return values.reshape(points.shape[:-1])


def cubic(grid: npt.NDArray[np.floating[Any]], places: F64, tiles: bool) -> F64:
    """Catmull-Rom values of a grid (H, W) at rows and columns (2, ...); see :func:`bilinear`."""
    rows, columns = grid.shape
    low = np.floor(places)
    y, x = places - low
    j, i = low.astype(np.int64)
    flat = grid.ravel()
    shares_x, shares_y = _catmull_rom(x), _catmull_rom(y)
    columns_at = [wrapped(i + k, columns, tiles) for k in (-1, 0, 1, 2)]
    # Separable: four rows, each a weighted sum of four columns.
    total = np.zeros(x.shape)
    for k, share_y in zip((-1, 0, 1, 2), shares_y, strict=True):
        start = wrapped(j + k, rows, tiles) * columns
        line = np.zeros(x.shape)
        for column_at, share_x in zip(columns_at, shares_x, strict=True):
            line += share_x * flat[start + column_at]
        total += share_y * line
    return total


def bilinear(grid: npt.NDArray[np.floating[Any]], places: F64, tiles: bool) -> F64:
    """Bilinear values of a grid (H, W) at rows and columns (2, ...), 0 at the first texel's centre.
    Beyond the grid wrapped for ``tiles``, else the edge continues. Overwrites ``places``."""
    rows, columns = grid.shape
    low = np.floor(places)
    places -= low
    index = low.astype(np.int64)
    row, column = wrapped_cells(index, rows, columns, tiles)
    index += 1
    above, right = wrapped_cells(index, rows, columns, tiles)
    row = row * columns
    above = above * columns
    flat = grid.ravel()
    lower = _between(flat.take(row + column), flat.take(row + right), places[1])
    upper = _between(flat.take(above + column), flat.take(above + right), places[1])
    return np.asarray(_between(lower, upper, places[0]), np.float64)


def _between(
    first: npt.NDArray[np.floating[Any]], second: npt.NDArray[np.floating[Any]], share: F64
) -> npt.NDArray[np.floating[Any]]:
    """Values ``first`` at share 0 to ``second`` at share 1, (...) each."""
    way = second - first
    way = way * share
    way += first
    return way


def wrapped_cells(index: I64, rows: int, columns: int, tiles: bool) -> I64:
    """Row and column indices (2, ...) wrapped, or clamped without tiling, into a grid."""
    # A power of two, as of most pictures: one mask for both axes instead of two divisions.
    if tiles and rows & (rows - 1) == 0 and columns & (columns - 1) == 0:
        last = np.array([rows - 1, columns - 1]).reshape(2, *[1] * (index.ndim - 1))
        return np.asarray(index & last)
    return np.stack([wrapped(index[0], rows, tiles), wrapped(index[1], columns, tiles)])


def wrapped(index: I64, count: int, tiles: bool) -> I64:
    """Indices (...) wrapped, or clamped without tiling, into 0 to ``count`` - 1."""
    if not tiles:
        return np.clip(index, 0, count - 1)
    if count & (count - 1) == 0:  # a power of two: a mask costs a tenth of a division
        return index & (count - 1)
    return index % count


def _catmull_rom(t: F64) -> tuple[F64, F64, F64, F64]:
    """Weights (...) each of the texels -1, 0, 1 and 2 for positions (...), 0..1 from texel 0."""
    squared = t * t
    cubed = squared * t
    return (
        0.5 * (2.0 * squared - cubed - t),
        0.5 * (3.0 * cubed - 5.0 * squared + 2.0),
        0.5 * (4.0 * squared - 3.0 * cubed + t),
        0.5 * (cubed - squared),
    )


def heights_of_normals(
    normals: npt.ArrayLike, texel_m: tuple[float, float], *, tiles: bool = False
) -> F64:
    """Heights (H, W) in metres, of mean 0, whose slopes fit a normal map best.

    Least squares in the Fourier domain: Frankot and Chellappa (1988), "A method for enforcing
    integrability in shape from shading algorithms". Normals (H, W, 3) are unit vectors in tangent
    space: x along columns, y along rows, z outwards; non-finite vectors count as flat. ``texel_m``
    is the size of a texel along columns and rows, m. ``tiles``: continue at the opposite edge; else
    mirror at the edges.
    """
    n = np.array(normals, np.float64)
    flat = ~np.isfinite(n).all(axis=2)
    n[flat] = (0.0, 0.0, 1.0)
    up = np.maximum(n[..., 2], _STEEPEST)
    # Slopes along each axis, metres per texel.
    along_x, along_y = -n[..., 0] / up * texel_m[0], -n[..., 1] / up * texel_m[1]
    rows, columns = up.shape
    # The Fourier transform repeats the surface, so without tiling the surface is mirrored:
    # slopes are even across their axis and odd along it, as derivatives of a mirrored surface.
    if not tiles:
        along_x = np.block([[along_x, -along_x[:, ::-1]], [along_x[::-1], -along_x[::-1, ::-1]]])
        along_y = np.block([[along_y, along_y[:, ::-1]], [-along_y[::-1], -along_y[::-1, ::-1]]])
    # Differentiation multiplies by the frequency, in radians per texel.
    fx = 2.0 * np.pi * np.fft.rfftfreq(along_x.shape[1])[None, :]
    fy = 2.0 * np.pi * np.fft.fftfreq(along_x.shape[0])[:, None]
    # At the Nyquist frequency the sign of a slope is undefined.
    fx = np.where(np.isclose(np.abs(fx), np.pi), 0.0, fx)
    fy = np.where(np.isclose(np.abs(fy), np.pi), 0.0, fy)
    power = (fx / texel_m[0]) ** 2 + (fy / texel_m[1]) ** 2
    spectrum = -1j * (
        fx / texel_m[0] ** 2 * np.fft.rfft2(along_x) + fy / texel_m[1] ** 2 * np.fft.rfft2(along_y)
    )
    spectrum = np.divide(spectrum, power, out=np.zeros_like(spectrum), where=power > 0.0)
    heights = np.fft.irfft2(spectrum, s=along_x.shape)[:rows, :columns]
    return np.asarray(heights - heights.mean())


def gaussian_waviness(field: HeightField, cutoff_m: float) -> F64:
    """Waviness (H, W) of a surface in metres: areal Gaussian low-pass at a cut-off. Transmission at
    wavelength l is ``2 ** -((cutoff / l) ** 2)``, by Fourier transform; a surface without tiling is
    mirrored at its edges."""
    heights = field.heights_m
    rows, columns = heights.shape
    if not field.tiles:
        # Mirrored, so that the repeating surface of the transform has no step at its edges.
        heights = np.concatenate([heights, heights[::-1]])
        heights = np.concatenate([heights, heights[:, ::-1]], axis=1)
    across = np.fft.rfftfreq(heights.shape[1], field.texel_m[0])
    along = np.fft.fftfreq(heights.shape[0], field.texel_m[1])
    transmission = np.exp2(-((cutoff_m * along[:, None]) ** 2)) * np.exp2(
        -((cutoff_m * across) ** 2)
    )
    waves = np.fft.irfft2(np.fft.rfft2(heights) * transmission, heights.shape)
    return np.asarray(waves[:rows, :columns])
