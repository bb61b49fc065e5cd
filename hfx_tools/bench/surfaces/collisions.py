# SPDX-License-Identifier: GPL-3.0-or-later
"""Micro-collisions of a stroke one by one, where a renderer only takes the strongest of a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hfx_blender.engine.arrays import F64, I64, Bool
from hfx_blender.engine.texture.haptic_map import HapticMap
from hfx_blender.engine.texture.lookup import REST_M_S, crossed_texels
from hfx_blender.engine.texture.stroke import Stroke


@dataclass(frozen=True, eq=False)
class Collisions:
    """Collisions of a finger with texels, in the order of time."""

    times_s: F64  # (n,)
    intensity: F64  # (n,) 0..1
    sharpness: F64  # (n,) 0..1

    def __len__(self) -> int:
        return len(self.times_s)

    def only(self, chosen: I64 | Bool) -> Collisions:
        """Select some collisions."""
        return Collisions(self.times_s[chosen], self.intensity[chosen], self.sharpness[chosen])


def trace(map_: HapticMap, stroke: Stroke) -> Collisions:
    """Find every texel that a stroke enters, in order; none where the finger rests."""
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
    """Find the micro-collisions of a stroke: local maxima of the intensity along it."""
    texels = trace(map_, stroke)
    change = np.flatnonzero(np.diff(texels.intensity) != 0.0)
    begins = np.concatenate([np.zeros(min(len(texels), 1), np.int64), change + 1])
    level = texels.intensity[begins]
    padded = np.concatenate([[0.0], level, [0.0]])
    is_peak = (level > padded[:-2]) & (level > padded[2:])
    ends = np.concatenate([begins[1:] - 1, [len(texels) - 1]])[: len(begins)]
    return texels.only(((begins + ends) // 2)[is_peak])


def most_salient(found: Collisions, gap_s: float) -> Collisions:
    """Select the collisions that a device can still play, the most salient first.

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
