# SPDX-License-Identifier: GPL-3.0-or-later
"""Micro-collisions: the texels of a haptic map that a finger crosses, each and every one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from .haptic_map import HapticMap
from .height_field import wrapped_cells
from .stroke import Stroke

_TEXEL_BITS: Final = 31  # a number of a texel has no more

REST_M_S: Final = 1e-4
"""Slower than this, a finger rests: a tenth of a millimetre per second."""


@dataclass(frozen=True, eq=False)
class Crossings:
    """Texels entered along some segments, in no order within a segment."""

    segment: I64  # (n,)
    share: F64  # (n,) where on the segment the texel is entered, 0..1
    texel: I64  # (n,) row * columns + column, wrapped or clamped into the map


def crossed_texels(
    starts_m: F64,
    ends_m: F64,
    shape: tuple[int, ...],
    texel_m: tuple[float, float],
    tiles: bool = True,
) -> Crossings:
    """Find every texel on straight segments, the first one included.

    A texel is entered where the segment crosses a line between columns or between rows; the
    other index there is a rounding down. So nothing is sampled and nothing can be missed.

    Parameters
    ----------
    starts_m, ends_m : (M, 2) float64
        Surface coordinates, metres.
    shape : (int, int)
        Rows and columns of the map.
    """
    lines = _lines(starts_m.T, ends_m.T, texel_m)
    count = len(starts_m)
    segment = lines.owner % max(count, 1)
    per_line, base = (each.ravel().take(lines.owner) for each in (lines.per_line, lines.base))
    share = np.where(lines.step > 0, base + per_line * lines.step, 0.0)
    once = (lines.step > 0) | (lines.owner < count)  # begins are listed for both axes
    texel = _numbered(lines.texel, shape, tiles)
    return Crossings(segment[once], share[once], texel[once])


def strongest_crossed(
    starts_m: F64, ends_m: F64, map_: HapticMap
) -> tuple[npt.NDArray[np.float32], I64]:
    """The intensity of the strongest texel on each straight segment, and its number.

    Of equally strong ones, it is the texel with the lowest number, whatever the direction.

    Parameters
    ----------
    starts_m, ends_m : (2, M) float64
        Surface coordinates, metres.
    """
    if not starts_m.size:
        return np.zeros(0, np.float32), np.zeros(0, np.int64)
    lines = _lines(starts_m, ends_m, map_.texel_m)
    texel = _numbered(lines.texel, map_.intensity.shape, map_.tiles)
    # The bits of a float that is not negative rise with its value.
    code = map_.intensity.ravel().take(texel).view(np.int32).astype(np.int64)
    code <<= _TEXEL_BITS
    code -= texel
    best = np.maximum.reduceat(code, lines.begins).reshape(2, -1).max(axis=0)
    bits = -(-best >> _TEXEL_BITS)
    return bits.astype(np.int32).view(np.float32), (bits << _TEXEL_BITS) - best


@dataclass(frozen=True, eq=False)
class _Lines:
    """Places at which segments enter texels: for each segment by columns, then for each by rows.

    Each of these 2 M lists begins with the texel in which the segment begins.
    """

    owner: I64  # (n,) which list
    step: I64  # (n,) which line between texels was crossed to enter; 0: the begin
    begins: I64  # (2 M,)
    texel: I64  # (2, n) row and column, not yet brought into the map
    per_line: F64  # (2, M) share of the segment from line to line
    base: F64  # (2, M) of "line 0"


def _lines(starts_m: F64, ends_m: F64, texel_m: tuple[float, float]) -> _Lines:
    per_texel = np.array([[1.0 / texel_m[0]], [1.0 / texel_m[1]]])
    a, b = starts_m * per_texel, ends_m * per_texel
    count = a.shape[1]
    first = np.floor(a)
    way = b - a
    crossed = np.abs(np.floor(b) - first)
    # To the right, line first + k leads into the column of that number; to the left, line
    # first - k + 1 leads into the column before it.
    back = way < 0.0
    sign = np.where(back, -1.0, 1.0)
    one = 1.0 / np.where(crossed > 0.0, way, np.inf)
    per_line = sign * one
    base = (first - a + back) * one
    # The other index there is a rounding down of its place at the line.
    other = a[::-1] + base * way[::-1]
    other_step = per_line * way[::-1]
    # Row and column of "line 0", then what a line adds to them.
    table = np.zeros((4, 2 * count))
    columns, rows = slice(0, count), slice(count, None)
    table[0, columns], table[1, columns] = other[0], first[0]
    table[2, columns], table[3, columns] = other_step[0], sign[0]
    table[0, rows], table[1, rows] = first[1], other[1]
    table[2, rows], table[3, rows] = sign[1], other_step[1]
    counts = crossed.astype(np.int64).ravel() + 1
    begins = counts.cumsum() - counts
    owner = np.arange(2 * count).repeat(counts)
    number = np.arange(len(owner)) - begins.take(owner)
    lines = table.take(owner, axis=1)
    place = lines[2:]
    place *= number
    place += lines[:2]
    texel = np.floor(place, out=place).astype(np.int64)
    texel[0][begins] = np.concatenate([first[1], first[1]])
    texel[1][begins] = np.concatenate([first[0], first[0]])
    return _Lines(owner, number, begins, texel, per_line, base)


def _numbered(texel: I64, shape: tuple[int, ...], tiles: bool) -> I64:
    """Row times columns plus column, wrapped or clamped into a map."""
    high, wide = shape
    row, column = wrapped_cells(texel, high, wide, tiles)
    number = row * wide
    number += column
    return number


def strongest_in_steps(
    map_: HapticMap, stroke: Stroke, step_s: float, count: int
) -> tuple[F64, F64]:
    """Intensity and sharpness of the strongest texel crossed in each step of time.

    Parameters
    ----------
    count : int
        Steps from the stroke's begin.

    Returns
    -------
    intensity : (count,) float64
        0 where the finger rests.
    sharpness : (count,) float64
        Of the same texel; where nothing is felt, of the step before.
    """
    borders = stroke.times_s[0] + step_s * np.arange(count + 1)
    times = np.union1d(stroke.times_s, borders)
    times = times[np.concatenate([[True], np.diff(times) > 1e-12])]
    points = stroke.at(times)
    step = np.searchsorted(borders, 0.5 * (times[:-1] + times[1:]), "right") - 1
    speed = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(times)
    kept = (speed > REST_M_S) & (step < count)
    found = crossed_texels(
        points[:-1][kept], points[1:][kept], map_.intensity.shape, map_.texel_m, map_.tiles
    )
    levels = map_.intensity.ravel()[found.texel].astype(np.float64)
    return _strongest(step[kept][found.segment], levels, map_.sharpness.ravel()[found.texel], count)


def _strongest(
    step: I64, levels: F64, sharpness: npt.NDArray[np.float32], count: int
) -> tuple[F64, F64]:
    order = np.lexsort((-levels, step))
    first = order[np.concatenate([[True], np.diff(step[order]) > 0])] if len(order) else order
    intensity = np.zeros(count)
    sharp = np.zeros(count)
    intensity[step[first]] = levels[first]
    sharp[step[first]] = sharpness[first]
    felt = intensity > 0.0
    latest = np.maximum.accumulate(np.where(felt, np.arange(count), -1))
    return intensity, np.where(latest >= 0, sharp[latest], 0.0)
