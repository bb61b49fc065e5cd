# SPDX-License-Identifier: GPL-3.0-or-later
"""Scans of real surfaces as height fields: scattered points, and pictures with holes."""

from typing import Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64
from .height_field import HeightField, bilinear, sample_grid

MAX_TEXELS: Final = 1 << 24
_MAX_M: Final = 1e7  # about positions on Earth, metres
_MIN_SPAN: Final = 1e-9  # metres
_ROUNDS: Final = 4
_STEEP: Final = np.cos(np.radians(30.0))
_THICK: Final = 0.25  # largest thickness of a sheet, share of its width
_LINE: Final = 1e-7  # least width of a sheet, share of its length


def seen_from_above(points: npt.ArrayLike) -> F64:
    """Rotate points (N, 3) of a sheet so that z is the height.

    A sheet tilted by less than 30 degrees keeps x and y; a steeper sheet is rotated by the smallest
    angle that levels the plane of least squares, about the mean as origin. Raises InputError for
    fewer than three points, points in line or too far away, or no sheet.
    """
    positions = np.asarray(points, np.float64)
    if len(positions) < 3:
        raise InputError(f"Scan: {len(positions)} points; a surface needs three or more.")
    farthest_m = float(np.abs(positions).max())
    if not farthest_m <= _MAX_M:
        raise InputError(
            f"Scan: a coordinate is {farthest_m:g} m, allowed is up to {_MAX_M:g} m: is its unit "
            "the right one?"
        )
    # The least eigenvector of the covariance is the normal of the sheet.
    centred = positions - positions.mean(axis=0)
    spread, axes = np.linalg.eigh(centred.T @ centred / len(positions))
    if not spread[1] > _LINE**2 * spread[2]:
        raise InputError("Scan: its points are one place or on a line; a surface needs more.")
    if spread[0] > _THICK**2 * spread[1]:
        raise InputError("Scan: its points are no sheet; expected a piece of a surface.")
    up = axes[:, 0] * (1.0 if axes[2, 0] >= 0.0 else -1.0)
    if up[2] >= _STEEP:
        return positions
    # The axis least along the normal becomes x, projected into the sheet.
    x = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < _STEEP else np.array([0.0, 1.0, 0.0])
    x = x - up * (x @ up)
    x /= np.linalg.norm(x)
    return centred @ np.stack([x, np.cross(up, x), up]).T


def from_points(points_m: npt.ArrayLike, texel_m: float | None = None) -> HeightField:
    """Height field of the scattered points (N, 3) of a scan: x, y, height, m; does not tile.

    The mean plane is subtracted, and points that are not finite are dropped. Texels without a point
    (holes, corners) are filled smoothly. ``texel_m`` None: about one point per texel. Raises
    InputError for fewer than three points, points in line, or too many texels.
    """
    points = np.asarray(points_m, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"Scan: expected points (N, 3), got {points.shape}.")
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3:
        raise InputError(f"Scan: {len(points)} usable points; a surface needs three or more.")
    low = points[:, :2].min(axis=0)
    span = np.ptp(points[:, :2], axis=0)
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    # Standard deviation across the longest direction: 0 for points in line.
    thin = np.sqrt(max(float(np.linalg.eigvalsh(flat.T @ flat / len(flat))[0]), 0.0))
    if thin <= max(_MIN_SPAN, 1e-9 * float(span.max())):
        raise InputError("Scan: all of its points are on one line, seen from above.")
    texel = float(np.sqrt(np.prod(span) / len(points))) if texel_m is None else texel_m
    if not (np.isfinite(texel) and texel > 0.0):
        raise InputError(f"Scan: a texel of {1e3 * texel:g} mm; expected more than 0.")
    # The small share avoids a further texel by rounding.
    columns, rows = (max(int(np.ceil(s / texel * (1.0 - 1e-9))), 1) for s in span)
    if rows * columns > MAX_TEXELS:
        raise InputError(
            f"Scan: {columns} x {rows} texels of {1e3 * texel:g} mm are more than "
            f"{MAX_TEXELS}; choose larger ones."
        )
    # Subtract the plane of least squares; the scan is seldom level.
    design = np.column_stack([flat, np.ones(len(flat))])
    heights = points[:, 2] - design @ np.linalg.lstsq(design, points[:, 2], rcond=None)[0]
    positions = points[:, :2] - low
    grid = _averaged(positions, heights, (rows, columns), texel)
    # A texel's mean belongs to the centroid of its points, not to its centre; a few rounds add the
    # remaining error at the points.
    for _ in range(_ROUNDS):
        error = heights - sample_grid(grid, positions, (texel, texel), False)
        grid = grid + _averaged(positions, error, (rows, columns), texel)
    return HeightField(grid, (texel, texel), tiles=False)


def fill_holes(heights_m: npt.ArrayLike) -> F64:
    """Fill holes (non-finite values) of heights (H, W) smoothly from their borders. Known heights
    are averaged in a pyramid of halved pictures; holes take the next coarser value. Raises
    InputError without any known height. A picture without holes is returned itself."""
    heights = np.asarray(heights_m, np.float64)
    known = np.isfinite(heights)
    if known.all():
        return heights
    if not known.any():
        raise InputError("Scan: it has no height anywhere, only holes.")
    return _filled(np.where(known, heights, 0.0), known.astype(np.float64))


def _filled(values: F64, weights: F64) -> F64:
    """Copy of values (H, W) with smooth values at weight 0; ``values`` itself without any. Other
    values stay."""
    rows, columns = values.shape
    if (weights > 0.0).all() or values.size == 1:
        return values
    pad = ((0, rows % 2), (0, columns % 2))
    parts = np.pad(values * weights, pad), np.pad(weights, pad)
    # Weighted mean of each 2 x 2 block, recursively until a single texel is left.
    total, share = (
        part.reshape(part.shape[0] // 2, 2, part.shape[1] // 2, 2).sum(axis=(1, 3))
        for part in parts
    )
    coarse = _filled(total / np.where(share > 0.0, share, 1.0), np.minimum(share, 1.0))
    # Bilinear values of the coarse picture at the centres of these texels.
    places = [(np.arange(n) - 0.5) / 2.0 for n in (rows, columns)]
    smooth = bilinear(coarse, np.stack(np.meshgrid(*places, indexing="ij")), tiles=False)
    return np.where(weights > 0.0, values, smooth)


def _averaged(place: F64, values: F64, shape: tuple[int, int], texel: float) -> F64:
    """Mean value of the points ``place`` (N, 2), metres from the corner, in each texel, (H, W).
    Points beyond the upper ends count in the last texels; empty texels are filled by their
    surroundings."""
    rows, columns = shape
    i = np.minimum((place[:, 0] / texel).astype(np.int64), columns - 1)
    j = np.minimum((place[:, 1] / texel).astype(np.int64), rows - 1)
    which = j * columns + i
    count = np.bincount(which, minlength=rows * columns)
    total = np.bincount(which, values, rows * columns)
    grid = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return fill_holes(grid.reshape(shape))
