# SPDX-License-Identifier: GPL-3.0-or-later
"""Micro-collisions: the texels of a haptic map that a finger crosses, each and every one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..indexing import ramp
from .haptic_map import HapticMap
from .height_field import wrapped
from .stroke import Stroke

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

REST_M_S: Final = 1e-4
"""Slower than this, a finger rests: a tenth of a millimetre per second."""


@dataclass(frozen=True, eq=False)
class Crossings:
    """Texels entered on the way along some segments, in no order within a segment."""

    segment: I64  # (n,)
    share: F64  # (n,) where on the segment the texel is entered, 0..1
    texel: I64  # (n,) row * columns + column, wrapped or clamped into the map


@dataclass(frozen=True, eq=False)
class Collisions:
    """What a finger hits on its way, in the order of time."""

    times_s: F64  # (n,)
    intensity: F64  # (n,) 0..1
    sharpness: F64  # (n,) 0..1

    def __len__(self) -> int:
        return len(self.times_s)

    def only(self, chosen: I64 | Bool) -> Collisions:
        """Those that are chosen."""
        return Collisions(self.times_s[chosen], self.intensity[chosen], self.sharpness[chosen])


def crossed_texels(
    starts_m: F64,
    ends_m: F64,
    shape: tuple[int, ...],
    texel_m: tuple[float, float],
    tiles: bool = True,
) -> Crossings:
    """Every texel on the way along straight segments, the first one included.

    A texel is entered where the segment crosses a line between columns or between rows; the
    other index there is a rounding down. So nothing is sampled and nothing can be missed.

    Parameters
    ----------
    starts_m, ends_m : (M, 2) float64
        Surface coordinates, metres.
    shape : (int, int)
        Rows and columns of the map.
    """
    a, b = (np.ascontiguousarray((each / np.asarray(texel_m)).T) for each in (starts_m, ends_m))
    first, last = np.floor(a), np.floor(b)
    way = b - a
    crossed = np.abs(last - first).astype(np.int64)
    share = [np.zeros(a.shape[1])]
    which = [np.arange(a.shape[1])]
    texel = [_texel(first[0], first[1], shape, tiles)]
    for axis in (0, 1):
        # To the right, line first + 1 + k leads into the column of that number; to the left,
        # line first - k leads into the column before it.
        count = crossed[axis]
        sign = np.where(way[axis] < 0.0, -1.0, 1.0)
        line = np.where(way[axis] < 0.0, first[axis], first[axis] + 1.0) - a[axis]
        per_line = 1.0 / np.where(count > 0, way[axis], 1.0)
        step, owner = ramp(count)
        at = np.repeat(line * per_line, count) + step * np.repeat(sign * per_line, count)
        mine = np.repeat(first[axis] + sign, count) + step * np.repeat(sign, count)
        other = np.floor(np.repeat(a[1 - axis], count) + at * np.repeat(way[1 - axis], count))
        columns, rows = (mine, other) if axis == 0 else (other, mine)
        share.append(at)
        which.append(owner)
        texel.append(_texel(columns, rows, shape, tiles))
    return Crossings(np.concatenate(which), np.concatenate(share), np.concatenate(texel))


def _texel(column: F64, row: F64, shape: tuple[int, ...], tiles: bool) -> I64:
    high, wide = shape
    j = wrapped(row.astype(np.int64), high, tiles)
    return j * wide + wrapped(column.astype(np.int64), wide, tiles)


def trace(map_: HapticMap, stroke: Stroke) -> Collisions:
    """Every texel that a stroke enters, in order; where the finger rests there is none."""
    moving = stroke.speeds_m_s > REST_M_S
    times, points = stroke.times_s, stroke.points_m
    starts, ends = points[:-1][moving], points[1:][moving]
    found = crossed_texels(starts, ends, map_.intensity.shape, map_.texel_m, map_.tiles)
    begin = times[:-1][moving][found.segment]
    entered = begin + found.share * (times[1:][moving][found.segment] - begin)
    order = np.lexsort((found.share, found.segment))
    texel = found.texel[order]
    return Collisions(
        entered[order],
        map_.intensity.ravel()[texel].astype(np.float64),
        map_.sharpness.ravel()[texel].astype(np.float64),
    )


def collisions(map_: HapticMap, stroke: Stroke) -> Collisions:
    """The micro-collisions of a stroke: where the intensity on the way has a local maximum."""
    texels = trace(map_, stroke)
    change = np.flatnonzero(np.diff(texels.intensity) != 0.0)
    begins = np.concatenate([np.zeros(min(len(texels), 1), np.int64), change + 1])
    level = texels.intensity[begins]
    padded = np.concatenate([[0.0], level, [0.0]])
    is_peak = (level > padded[:-2]) & (level > padded[2:])
    ends = np.concatenate([begins[1:] - 1, [len(texels) - 1]])[: len(begins)]
    return texels.only(((begins + ends) // 2)[is_peak])


def most_salient(found: Collisions, gap_s: float) -> Collisions:
    """Those that a device can still play, the most salient first.

    The strongest collision is kept, all that are nearer to it than ``gap_s`` are dropped, then
    the strongest of the rest, and so on. Equally strong ones: the earlier first.
    """
    kept = np.zeros(len(found), np.bool_)
    free = np.ones(len(found), np.bool_)
    times = found.times_s
    low = np.searchsorted(times, times - gap_s * (1.0 - 1e-9), "right")
    high = np.searchsorted(times, times + gap_s * (1.0 - 1e-9), "left")
    for k in np.argsort(-found.intensity, kind="stable").tolist():
        if free[k]:
            kept[k] = True
            free[low[k] : high[k]] = False
    return found.only(kept)


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
