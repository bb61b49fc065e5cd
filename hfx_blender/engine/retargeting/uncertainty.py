# SPDX-License-Identifier: GPL-3.0-or-later
"""Uncertainty of named places of the body on a target avatar.

Uncertain are hinges where rig, skin weights and proportions differ, places of unusual shape, heels
above thick soles, and the torso of half a body. Factors were chosen on avatars with known answers
(``tests/engine/retargeting/strangers.py``).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from ..arrays import F64
from ..body.model import Avatar
from .bone_regions import REGIONS
from .joints import Skeletons, dominant

HINGE_MM: Final = 25.0
PLACE_MM: Final = 40.0
"""Smallest reported uncertainty of a hinge and of other places."""

# Place to canonical bone, and offset from its head on the left side, metres
_PLACES: Final = {
    "crown": ("head", (0.0, 0.05, 0.17)),
    "face": ("head", (0.0, -0.11, 0.02)),
    "chest": ("spine01", (0.0, -0.13, 0.0)),
    "belly": ("spine04", (0.0, -0.15, 0.03)),
    "upper back": ("spine01", (0.0, 0.1, 0.04)),
    "lower back": ("spine04", (0.0, 0.1, 0.04)),
    "shoulder": ("upperarm01", (0.05, 0.0, 0.05)),
    "wrist": ("wrist", (0.0, 0.0, 0.03)),
    "hip": ("upperleg01", (0.08, 0.0, 0.0)),
    "ankle": ("foot", (0.05, 0.0, 0.0)),
    "heel": ("foot", (0.0, 0.08, -0.05)),
    "toes": ("toe1-1", (0.0, -0.06, 0.0)),
}

_SKIN_OF: Final = {"elbow": ("upperarm", "forearm"), "knee": ("upperleg", "lowerleg")}
_TORSO: Final = ("chest", "belly", "upper back", "lower back")
_AROUND_M: Final = 0.05
_PER_ESTIMATE: Final = 1.25
_PER_SHAPE: Final = 1.5
_PER_PULL: Final = 1.2
_PER_SOLE: Final = 1.0
# Smallest uncertainty of a torso without legs (73 mm observed)
_HALF_BODY_M: Final = 0.08


def uncertain_m(
    avatar: Avatar,
    bodies: Skeletons,
    estimates_m: Mapping[str, F64],
    posed: F64,
    shaped: F64,
    pulled: F64,
) -> dict[str, float]:
    """Uncertainty by place ("belly", "heel.L"), metres at canonical size (1.8 m).

    ``estimates_m`` has the estimates of each hinge along the limb (:func:`.hinges.placed`);
    ``posed``, ``shaped`` and ``pulled`` (V, 3) are the canonical avatar after posing, after the
    shape fit, and on the target's skin. Absent hinges and places without skin are left out.
    """
    uncertainties = {
        name: _PER_ESTIMATE * float(np.abs(estimates - np.median(estimates)).max())
        for name, estimates in estimates_m.items()
        if not {f"{region}.{name[-1]}" for region in _SKIN_OF[name[:-2]]} & {*bodies.absent}
    }
    by_shape = np.linalg.norm(shaped - posed, axis=1)
    by_pull = np.linalg.norm(pulled - shaped, axis=1)
    points, heads = avatar.vertices.astype(np.float64), avatar.skeleton.heads
    parts = {
        **{f"heel.{side}": _PER_SOLE * _extra_sole_m(bodies, side) for side in "LR"},
        **dict.fromkeys(_TORSO, _half_body_m(bodies)),
    }
    for place, (bone, offset) in _PLACES.items():
        for side in ("",) if bone in heads else (".L", ".R"):
            if bone + side not in heads:
                continue
            middle = heads[bone + side] + offset * np.array([-1.0 if side == ".R" else 1.0, 1, 1])
            # Mean error of the skin around the vertex nearest to the place.
            distances = np.linalg.norm(points - middle, axis=1)
            is_near = np.linalg.norm(points - points[distances.argmin()], axis=1) < _AROUND_M
            is_near &= bodies.avatar_shares.any(axis=1)
            if not is_near.any():
                continue
            error_m = max(
                _PER_SHAPE * by_shape[is_near].mean(), _PER_PULL * by_pull[is_near].mean()
            )
            uncertainties[place + side] = max(float(error_m), parts.get(place + side, 0.0))
    return uncertainties


def _extra_sole_m(bodies: Skeletons, side: str) -> float:
    """Depth of the skin below the ankle beyond the canonical depth, metres; 0 without foot."""
    ankle = f"ankle.{side}"
    foot = bodies.points[dominant(bodies.target_shares) == REGIONS.index(f"foot.{side}")]
    if ankle not in bodies.joints or not len(foot):
        return 0.0
    depth = float(bodies.joints[ankle][2] - foot[:, 2].min())
    return max(depth - float(bodies.canonical[ankle][2]), 0.0)


def _half_body_m(bodies: Skeletons) -> float:
    """Uncertainty of a torso if both thighs are absent, at least 80 mm: difference of the trunk
    from that expected by the arms; else 0, metres."""
    if not {"upperleg.L", "upperleg.R"} <= {*bodies.absent}:
        return 0.0
    (own_trunk, own_arms), (trunk, arms) = (
        _trunk_and_arms(at, bodies.joints.keys()) for at in (bodies.canonical, bodies.joints)
    )
    expected = own_trunk * arms / own_arms if own_arms > 0.0 else trunk
    return max(_HALF_BODY_M, abs(trunk - expected))


def _trunk_and_arms(at: Mapping[str, F64], known: Collection[str]) -> tuple[float, float]:
    """Distance of the hips' from the shoulders' middle, and total length of upper arms and forearms
    with both joints in ``known``, metres."""
    hips, chest = ((at[f"{joint}.L"] + at[f"{joint}.R"]) / 2 for joint in ("hip", "shoulder"))
    arms = sum(
        float(np.linalg.norm(at[f"{first}.{side}"] - at[f"{last}.{side}"]))
        for side in "LR"
        for first, last in (("shoulder", "elbow"), ("elbow", "wrist"))
        if f"{first}.{side}" in known and f"{last}.{side}" in known
    )
    return float(np.linalg.norm(chest - hips)), arms


def sentence(uncertain_mm: Mapping[str, float]) -> list[str]:
    """List of one sentence with places uncertain by over 40 mm (knees, elbows 25 mm), most
    uncertain first; empty without any."""
    parts = []
    for name, error_mm in sorted(uncertain_mm.items(), key=lambda item: -item[1]):
        stem, _, side = name.partition(".")
        if error_mm > (HINGE_MM if stem in ("knee", "elbow") else PLACE_MM):
            words = {"L": "left ", "R": "right ", "": ""}[side]
            parts.append(f"{words}{stem} {error_mm:.0f} mm")
    return [f"these places are uncertain: {', '.join(parts)}"] if parts else []
