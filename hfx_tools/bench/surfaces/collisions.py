# SPDX-License-Identifier: GPL-3.0-or-later
"""All micro-collisions of a stroke; a renderer uses only the strongest of each step."""

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
        """Collisions by indices or mask."""
        return Collisions(self.times_s[chosen], self.intensity[chosen], self.sharpness[chosen])


def trace(map_: HapticMap, stroke: Stroke) -> Collisions:
    """Find every texel entered by a stroke, in order of time; none at rest."""
    moving = stroke.speeds_m_s > REST_M_S
    times, points = stroke.times_s, stroke.points_m
    starts, ends = points[:-1][moving], points[1:][moving]
    crossings = crossed_texels(starts, ends, map_.intensity.shape, map_.texel_m, map_.tiles)
    begin = times[:-1][moving][crossings.segment]
    entered = begin + crossings.share * (times[1:][moving][crossings.segment] - begin)
    order = np.lexsort((crossings.share, crossings.segment))
    texel = crossings.texel[order]
    return Collisions(
        entered[order],
        map_.intensity.ravel()[texel].astype(np.float64),
        map_.sharpness.ravel()[texel].astype(np.float64),
    )


def collisions(map_: HapticMap, stroke: Stroke) -> Collisions:
    """Find the micro-collisions of a stroke: local maxima of the intensity along it."""
    texels = trace(map_, stroke)
    # A run of equal intensities is one level; the middle of a locally highest run is the hit.
    change = np.flatnonzero(np.diff(texels.intensity) != 0.0)
    begins = np.concatenate([np.zeros(min(len(texels), 1), np.int64), change + 1])
    level = texels.intensity[begins]
    padded = np.concatenate([[0.0], level, [0.0]])
    is_peak = (level > padded[:-2]) & (level > padded[2:])
    ends = np.concatenate([begins[1:] - 1, [len(texels) - 1]])[: len(begins)]
    return texels.only(((begins + ends) // 2)[is_peak])


def most_salient(candidates: Collisions, gap_s: float) -> Collisions:
    """Select collisions at least ``gap_s`` seconds apart, greedily by strength.

    The strongest collision drops all nearer ones, then the strongest of the rest, and so on.
    Between equal strengths the earlier wins. The result is in order of time.
    """
    is_chosen = np.zeros(len(candidates), np.bool_)
    free = np.ones(len(candidates), np.bool_)
    times = candidates.times_s
    low = np.searchsorted(times, times - gap_s * (1.0 - 1e-9), "right")
    high = np.searchsorted(times, times + gap_s * (1.0 - 1e-9), "left")
    for k in np.argsort(-candidates.intensity, kind="stable").tolist():
        if free[k]:
            is_chosen[k] = True
            free[low[k] : high[k]] = False
    return candidates.only(is_chosen)
