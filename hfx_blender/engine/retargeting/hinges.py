# SPDX-License-Identifier: GPL-3.0-or-later
"""Knees and elbows of a target, from its rig, its skin weights and a person's proportions.

Rigs place a knee up to 4 cm beside the kneecap that is seen. Three estimates tell where along the
limb it is: the rig's joint, the place where the skin passes from the upper to the lower bone, and
the ratio of both bones of a person. Their median is right where one of them is wrong; their
differences tell how uncertain it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..arrays import F64, I64
from .bone_regions import REGIONS
from .joints import Skeletons

_LIMBS: Final = {
    "elbow": ("shoulder", "wrist", "upperarm", "forearm"),
    "knee": ("hip", "ankle", "upperleg", "lowerleg"),
}
"""Hinge: first and last joint of its limb, and the regions above and below."""

_AROUND_M: Final = 0.14
"""Farthest that skin is from a hinge whose weights tell where the hinge is."""

_ALONG_M: Final = 0.12
_LEAST_M: Final = 0.008
"""Distance by which estimates differ on avatars of which the rig is right."""

_FEWEST: Final = 6
_STEP_M: Final = 0.001


@dataclass(frozen=True)
class _Limb:
    """Joints of one limb."""

    start: F64
    hinge: F64
    end: F64

    @classmethod
    def of(cls, joints: Mapping[str, F64], hinge: str) -> _Limb | None:
        stem, side = hinge.split(".")
        names = (f"{_LIMBS[stem][0]}.{side}", hinge, f"{_LIMBS[stem][1]}.{side}")
        if not joints.keys() >= set(names):
            return None
        limb = cls(*(joints[name] for name in names))
        return limb if min(limb.lengths) > 1e-6 else None

    @property
    def ways(self) -> F64:
        """Upper and lower bone from their beginnings to their ends, (2, 3)."""
        return np.array([self.hinge - self.start, self.end - self.hinge])

    @property
    def lengths(self) -> F64:
        """Lengths of upper and lower bone, (2,) metres."""
        lengths: F64 = np.linalg.norm(self.ways, axis=1)
        return lengths

    def crossing_m(self, points: F64, upper: F64, lower: F64) -> float | None:
        """Place along the limb where its skin passes to the lower bone; 0 is at the hinge."""
        units = self.ways / self.lengths[:, None]
        axis = units.sum(axis=0)
        length = float(np.linalg.norm(axis))
        if length < 0.5:  # folded together: no plane parts the two
            return None
        axis /= length
        offset = points - self.hinge
        along = offset @ axis
        off = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        both = upper + lower
        near = (np.abs(along) < _ALONG_M) & (off < _AROUND_M) & (both > 0.5)
        share, at = lower[near] / both[near], along[near]
        if len(at) < _FEWEST or not (share < 0.5).any() or not (share > 0.5).any():
            return None
        steps = np.arange(-_ALONG_M, _ALONG_M, _STEP_M)
        misfit = np.abs(share - (at > steps[:, None])).sum(axis=1)
        half = 0.5 * length  # cosine of half the bend
        return float(steps[misfit <= misfit.min() + 1e-9].mean()) / half

    def moved(self, along_m: float) -> F64:
        """Place of the hinge moved along the lower bone, or back along the upper one."""
        way, length = self.ways[int(along_m > 0.0)], self.lengths[int(along_m > 0.0)]
        found: F64 = self.hinge + along_m * way / length
        return found


def placed(
    bodies: Skeletons, points: F64, triangles: I64, target_triangles: I64
) -> tuple[Skeletons, dict[str, F64]]:
    """Skeletons with knees and elbows at the median of the estimates.

    Parameters
    ----------
    points, triangles : (V, 3) float64, (F, 3) int64
        Of the canonical avatar.

    Returns
    -------
    bodies : Skeletons
    estimates_m : dict
        By joint, the estimates (2 or 3,) along the limb from the rig's joint, its own 0 first.
    """
    joints, estimates = dict(bodies.joints), {}
    skins = (
        _middles(points, bodies.avatar_shares, triangles),
        _middles(bodies.points, bodies.target_shares, target_triangles),
    )
    for stem, (_, _, upper, lower) in _LIMBS.items():
        for side in "LR":
            name = f"{stem}.{side}"
            ours, theirs = (_Limb.of(at, name) for at in (bodies.canonical, bodies.joints))
            if ours is None or theirs is None:
                continue
            first, second = (REGIONS.index(f"{region}.{side}") for region in (upper, lower))
            crossings = [
                limb.crossing_m(places, shares[:, first], shares[:, second])
                for limb, (places, shares) in zip((ours, theirs), skins, strict=True)
            ]
            share = ours.lengths[0] / ours.lengths.sum()
            found = [0.0, share * float(theirs.lengths.sum()) - float(theirs.lengths[0])]
            if crossings[0] is not None and crossings[1] is not None:
                found.append(crossings[1] - crossings[0])
                along_m = float(np.median(found))
                if abs(along_m) > _LEAST_M:
                    joints[name] = theirs.moved(along_m)
            estimates[name] = np.array(found)
    return replace(bodies, joints=joints), estimates


def _middles(points: F64, shares: F64, triangles: I64) -> tuple[F64, F64]:
    """Middles of edges (N, 3) and their regions (N, R): coarse meshes have few vertices."""
    edges = np.concatenate((triangles[:, :2], triangles[:, 1:]))
    return points[edges].mean(axis=1), shares[edges].mean(axis=1)
