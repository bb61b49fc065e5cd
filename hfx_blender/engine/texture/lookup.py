# SPDX-License-Identifier: GPL-3.0-or-later
"""Micro-collisions: exact lists of the texels of a haptic map on the path of a finger."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from .haptic_map import HapticMap
from .height_field import wrapped_cells
from .stroke import Stroke

_TEXEL_BITS: Final = 31  # bits of a texel's number

REST_M_S: Final = 1e-4  # speed below which a finger rests, m/s


@dataclass(frozen=True, eq=False)
class Crossings:
    """Texels entered along segments, in no order within a segment."""

    segment: I64  # (n,)
    share: F64  # (n,) share of the segment at the entry, 0..1
    texel: I64  # (n,) row * columns + column, wrapped or clamped into the map


def crossed_texels(
    starts_m: F64,
    ends_m: F64,
    shape: tuple[int, ...],
    texel_m: tuple[float, float],
    tiles: bool = True,
) -> Crossings:
    """Find all texels on straight segments, including the first.

    A texel is entered where the segment crosses a line between columns or rows; the remaining index
    there is rounded down. Nothing is sampled, so no texel is missed. Segments go from ``starts_m``
    to ``ends_m`` (M, 2), surface coordinates; ``shape`` are rows and columns of the map.
    """
    # Each segment owns two lists, by columns and by rows: both together are all of its entries.
    lines = _lines(starts_m.T, ends_m.T, texel_m)
    count = len(starts_m)
    segment = lines.owner % max(count, 1)
    per_line, base = (values.ravel().take(lines.owner) for values in (lines.per_line, lines.base))
    share = np.where(lines.step > 0, base + per_line * lines.step, 0.0)
    once = (lines.step > 0) | (lines.owner < count)  # begins are listed for both axes
    texel = _numbered(lines.texel, shape, tiles)
    return Crossings(segment[once], share[once], texel[once])


def strongest_crossed(
    starts_m: F64, ends_m: F64, map_: HapticMap
) -> tuple[npt.NDArray[np.float32], I64]:
    """Intensity and number of the strongest texel on each straight segment, (M,) each. Of equally
    strong texels the lowest number counts, so the direction does not matter. Segments go from
    ``starts_m`` to ``ends_m`` (2, M), surface coordinates, m."""
    if not starts_m.size:
        return np.zeros(0, np.float32), np.zeros(0, np.int64)
    lines = _lines(starts_m, ends_m, map_.texel_m)
    texel = _numbered(lines.texel, map_.intensity.shape, map_.tiles)
    # The bits of non-negative floats ascend with their values, so one integer maximum compares
    # intensity first and then the texel's number, the lower number winning.
    code = map_.intensity.ravel().take(texel).view(np.int32).astype(np.int64)
    code <<= _TEXEL_BITS
    code -= texel
    best = np.maximum.reduceat(code, lines.begins).reshape(2, -1).max(axis=0)
    bits = -(-best >> _TEXEL_BITS)
    return bits.astype(np.int32).view(np.float32), (bits << _TEXEL_BITS) - best


@dataclass(frozen=True, eq=False)
class _Lines:
    """Entries of segments into texels: a list for each segment by columns, then one by rows. Each
    of these 2 M lists starts with the first texel of its segment."""

    owner: I64  # (n,) index of the list
    step: I64  # (n,) count of the crossed line; 0: start of the segment
    begins: I64  # (2 M,)
    texel: I64  # (2, n) row and column, unwrapped
    per_line: F64  # (2, M) share of the segment from line to line
    base: F64  # (2, M) share at line 0


def _lines(starts_m: F64, ends_m: F64, texel_m: tuple[float, float]) -> _Lines:
    """Entries of M segments from ``starts_m`` to ``ends_m`` (2, M), x and y, into texels,
    unwrapped: M lists by columns, then M lists by rows, each from the first texel of the segment
    on."""
    per_texel = np.array([[1.0 / texel_m[0]], [1.0 / texel_m[1]]])
    a, b = starts_m * per_texel, ends_m * per_texel
    count = a.shape[1]
    first = np.floor(a)
    way = b - a
    crossed = np.abs(np.floor(b) - first)
    # Rightwards, line first + k leads into the column of that number; leftwards, line
    # first - k + 1 leads into the column below that number.
    back = way < 0.0
    sign = np.where(back, -1.0, 1.0)
    inverse = 1.0 / np.where(crossed > 0.0, way, np.inf)
    # Line k is crossed at share base + k per_line of the segment.
    per_line = sign * inverse
    base = (first - a + back) * inverse
    # Position along the remaining axis at each line, to be rounded down.
    across = a[::-1] + base * way[::-1]
    across_step = per_line * way[::-1]
    # Row and column at line 0, then their increments per line.
    table = np.zeros((4, 2 * count))
    columns, rows = slice(0, count), slice(count, None)
    table[0, columns], table[1, columns] = across[0], first[0]
    table[2, columns], table[3, columns] = across_step[0], sign[0]
    table[0, rows], table[1, rows] = first[1], across[1]
    table[2, rows], table[3, rows] = sign[1], across_step[1]
    counts = crossed.astype(np.int64).ravel() + 1
    begins = counts.cumsum() - counts
    owner = np.arange(2 * count).repeat(counts)
    number = np.arange(len(owner)) - begins.take(owner)
    lines = table.take(owner, axis=1)
    positions = lines[2:]
    positions *= number
    positions += lines[:2]
    texel = np.floor(positions, out=positions).astype(np.int64)
    texel[0][begins] = np.concatenate([first[1], first[1]])
    texel[1][begins] = np.concatenate([first[0], first[0]])
    return _Lines(owner, number, begins, texel, per_line, base)


def _numbered(texel: I64, shape: tuple[int, ...], tiles: bool) -> I64:
    """Numbers (n,) of texels (2, n), row * columns + column, wrapped or clamped into a map."""
    high, wide = shape
    row, column = wrapped_cells(texel, high, wide, tiles)
    number = row * wide
    number += column
    return number


def strongest_in_steps(
    map_: HapticMap, stroke: Stroke, step_s: float, count: int
) -> tuple[F64, F64]:
    """Intensity and sharpness (count,) of the strongest texel in each time step of a stroke.
    ``count`` steps begin at the start of the stroke. Intensity is 0 at rest; sharpness is that of
    the same texel, at rest of the last texel, 0 before any."""
    # Cut the stroke at its own positions and at the borders of steps, so that each segment lies in
    # a single step. Cuts closer than rounding would be segments without a direction.
    borders = stroke.times_s[0] + step_s * np.arange(count + 1)
    times = np.union1d(stroke.times_s, borders)
    times = times[np.concatenate([[True], np.diff(times) > 1e-12])]
    points = stroke.at(times)
    step = np.searchsorted(borders, 0.5 * (times[:-1] + times[1:]), "right") - 1
    speed = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(times)
    is_moving = (speed > REST_M_S) & (step < count)
    starts, ends = points[:-1][is_moving], points[1:][is_moving]
    crossings = crossed_texels(starts, ends, map_.intensity.shape, map_.texel_m, map_.tiles)
    step = step[is_moving][crossings.segment]
    levels = map_.intensity.ravel()[crossings.texel].astype(np.float64)
    # The first entry of each step, with the strongest level sorted first.
    order = np.lexsort((-levels, step))
    first = order[np.diff(step[order], prepend=-1) > 0]
    intensity, sharpness = np.zeros((2, count))
    intensity[step[first]] = levels[first]
    sharpness[step[first]] = map_.sharpness.ravel()[crossings.texel[first]]
    # Hold sharpness through silence, so that the frequency does not jump.
    latest = np.maximum.accumulate(np.where(intensity > 0.0, np.arange(count), -1))
    return intensity, np.where(latest >= 0, sharpness[latest], 0.0)
