# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions of a target's knees and elbows from rig, skin weights and proportions.

Rigs place knees up to 4 cm from the visible kneecap. Three estimates along the limb are combined
by the median: the rig's joint, the transition of skin weights from the upper to the lower bone, and
the canonical ratio of bone lengths. A single wrong estimate does no harm; the spread is the
uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..arrays import F64, I64
from .bone_regions import REGIONS
from .joints import Skeletons

# Hinge to first and last joint of its limb, and the regions above and below
_LIMBS: Final = {
    "elbow": ("shoulder", "wrist", "upperarm", "forearm"),
    "knee": ("hip", "ankle", "upperleg", "lowerleg"),
}

# Largest distance of skin from a hinge for the estimate by weights
_AROUND_M: Final = 0.14
_ALONG_M: Final = 0.12
# Smallest correction; smaller differences also occur on avatars with correct joints
_LEAST_M: Final = 0.008
_FEWEST: Final = 6
_STEP_M: Final = 0.001


@dataclass(frozen=True)
class _Limb:
    """Joints (3,) of one limb."""

    start: F64
    hinge: F64
    end: F64

    @classmethod
    def of(cls, joints: Mapping[str, F64], hinge: str) -> _Limb | None:
        """Limb around a hinge; None without a joint or with a bone of no length."""
        stem, side = hinge.split(".")
        names = (f"{_LIMBS[stem][0]}.{side}", hinge, f"{_LIMBS[stem][1]}.{side}")
        if not joints.keys() >= set(names):
            return None
        limb = cls(*(joints[name] for name in names))
        return limb if min(limb.lengths) > 1e-6 else None

    @property
    def ways(self) -> F64:
        """Vectors (2, 3) from start to hinge and from hinge to end."""
        return np.array([self.hinge - self.start, self.end - self.hinge])

    @property
    def lengths(self) -> F64:
        """Lengths (2,) of upper and lower bone, metres."""
        return np.asarray(np.linalg.norm(self.ways, axis=1))

    def crossing_m(self, points: F64, upper: F64, lower: F64) -> float | None:
        """Position along the limb of the transition from upper to lower weights; 0 at the hinge.

        None if folded, or without enough skin of both bones. ``upper`` and ``lower`` (N,) are the
        weights of points (N, 3).
        """
        units = self.ways / self.lengths[:, None]
        axis = units.sum(axis=0)
        length = float(np.linalg.norm(axis))
        if length < 0.5:  # folded: no plane separates the bones
            return None
        axis /= length
        offset = points - self.hinge
        along = offset @ axis
        radius = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        both = upper + lower
        is_near = (np.abs(along) < _ALONG_M) & (radius < _AROUND_M) & (both > 0.5)
        share, positions = lower[is_near] / both[is_near], along[is_near]
        if len(positions) < _FEWEST or not (share < 0.5).any() or not (share > 0.5).any():
            return None
        steps = np.arange(-_ALONG_M, _ALONG_M, _STEP_M)
        # Best step function through the shares; the mean of equally good positions.
        misfit = np.abs(share - (positions > steps[:, None])).sum(axis=1)
        half = 0.5 * length  # cosine of half the bend
        return float(steps[misfit <= misfit.min() + 1e-9].mean()) / half

    def moved(self, along_m: float) -> F64:
        """Hinge (3,) moved along the lower bone, or (negative) back along the upper bone."""
        way, length = self.ways[int(along_m > 0.0)], self.lengths[int(along_m > 0.0)]
        return np.asarray(self.hinge + along_m * way / length)


def placed(
    bodies: Skeletons, points: F64, triangles: I64, target_triangles: I64
) -> tuple[Skeletons, dict[str, F64]]:
    """Copy of skeletons with knees and elbows at the median of the estimates.

    Hinges without an estimate by weights, or closer than 8 mm to the median, stay. ``points`` (V,
    3) and ``triangles`` are of the canonical avatar. Also returns the estimates (2 or 3,) of each
    hinge, metres along the limb relative to the rig's joint; the first is 0.
    """
    joints, estimates = dict(bodies.joints), {}
    skins = (
        _middles(points, bodies.avatar_shares, triangles),
        _middles(bodies.points, bodies.target_shares, target_triangles),
    )
    for stem, (_, _, upper, lower) in _LIMBS.items():
        for side in "LR":
            name = f"{stem}.{side}"
            own, target = (_Limb.of(at, name) for at in (bodies.canonical, bodies.joints))
            if own is None or target is None:
                continue
            first, second = (REGIONS.index(f"{region}.{side}") for region in (upper, lower))
            crossings = [
                limb.crossing_m(places, shares[:, first], shares[:, second])
                for limb, (places, shares) in zip((own, target), skins, strict=True)
            ]
            share = own.lengths[0] / own.lengths.sum()
            # Relative to the rig's joint: the rig's own (0), by bone lengths, by skin weights. The
            # canonical crossing is subtracted, because weights cross off the joint there too.
            positions = [0.0, share * float(target.lengths.sum()) - float(target.lengths[0])]
            if crossings[0] is not None and crossings[1] is not None:
                positions.append(crossings[1] - crossings[0])
                along_m = float(np.median(positions))
                if abs(along_m) > _LEAST_M:
                    joints[name] = target.moved(along_m)
            estimates[name] = np.array(positions)
    return replace(bodies, joints=joints), estimates


def _middles(points: F64, shares: F64, triangles: I64) -> tuple[F64, F64]:
    """Midpoints (2 F, 3) and mean region weights (2 F, R) of two edges of each of F triangles."""
    edges = np.concatenate((triangles[:, :2], triangles[:, 1:]))
    return points[edges].mean(axis=1), shares[edges].mean(axis=1)
