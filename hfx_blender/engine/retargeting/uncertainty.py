# SPDX-License-Identifier: GPL-3.0-or-later
"""Uncertainty of named places of the body on a target avatar.

A fit is uncertain at a hinge where rig, skin weights and proportions tell different places, at
other places where the target has another shape than people have, at the heel over a thick sole,
and at the torso of half a body, whose length only the rig's hips tell. The factors were chosen on
figures whose truth is known (``tests/engine/retargeting/strangers.py``).
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
"""Uncertainty from which a hinge, or another place, is named."""

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
"""Place: canonical bone at whose head it is, and its offset on the left side, metres."""

_SKIN_OF: Final = {"elbow": ("upperarm", "forearm"), "knee": ("upperleg", "lowerleg")}
_TORSO: Final = ("chest", "belly", "upper back", "lower back")
_AROUND_M: Final = 0.05
_PER_ESTIMATE: Final = 1.25
_PER_SHAPE: Final = 1.5
_PER_PULL: Final = 1.2
_PER_SOLE: Final = 1.0
_HALF_BODY_M: Final = 0.08
"""Uncertainty of a torso without legs: seen up to 73 mm."""


def uncertain_m(
    avatar: Avatar,
    bodies: Skeletons,
    estimates_m: Mapping[str, F64],
    posed: F64,
    shaped: F64,
    pulled: F64,
) -> dict[str, float]:
    """Uncertainty of each place in metres of a body 1.8 m tall, by place or place and side.

    Parameters
    ----------
    estimates_m : mapping
        By hinge, estimates of its place along the limb (:func:`.hinges.placed`).
    posed, shaped, pulled : (V, 3) float64
        The canonical avatar's vertices on the target's joints, in the shape of people, and on the
        target's skin.
    """
    found = {
        name: _PER_ESTIMATE * float(np.abs(estimates - np.median(estimates)).max())
        for name, estimates in estimates_m.items()
        if not {f"{region}.{name[-1]}" for region in _SKIN_OF[name[:-2]]} & {*bodies.absent}
    }
    by_shape = np.linalg.norm(shaped - posed, axis=1)
    by_pull = np.linalg.norm(pulled - shaped, axis=1)
    points, heads = avatar.vertices.astype(np.float64), _heads(avatar)
    parts = {
        **{f"heel.{side}": _PER_SOLE * _extra_sole_m(bodies, side) for side in "LR"},
        **dict.fromkeys(_TORSO, _half_body_m(bodies)),
    }
    for place, (bone, offset) in _PLACES.items():
        for side in ("",) if bone in heads else (".L", ".R"):
            if bone + side not in heads:
                continue
            middle = heads[bone + side] + offset * np.array([-1.0 if side == ".R" else 1.0, 1, 1])
            near = np.linalg.norm(points - middle, axis=1)
            skin = np.linalg.norm(points - points[near.argmin()], axis=1) < _AROUND_M
            skin &= bodies.avatar_shares.any(axis=1)
            if not skin.any():
                continue
            off = max(_PER_SHAPE * by_shape[skin].mean(), _PER_PULL * by_pull[skin].mean())
            found[place + side] = max(float(off), parts.get(place + side, 0.0))
    return found


def _heads(avatar: Avatar) -> dict[str, F64]:
    rest = avatar.skeleton.rest[:, :3, 3].astype(np.float64)
    return dict(zip(avatar.skeleton.bone_names, rest, strict=True))


def _extra_sole_m(bodies: Skeletons, side: str) -> float:
    """Thickness of a sole below the foot: how much deeper the skin is below the ankle than ours."""
    ankle = f"ankle.{side}"
    foot = bodies.points[dominant(bodies.target_shares) == REGIONS.index(f"foot.{side}")]
    if ankle not in bodies.joints or not len(foot):
        return 0.0
    depth = float(bodies.joints[ankle][2] - foot[:, 2].min())
    return max(depth - float(bodies.canonical[ankle][2]), 0.0)


def _half_body_m(bodies: Skeletons) -> float:
    """Uncertainty of a torso that ends above the legs: its length against that of the arms."""
    if not {"upperleg.L", "upperleg.R"} <= {*bodies.absent}:
        return 0.0
    (our_trunk, our_arms), (trunk, arms) = (
        _trunk_and_arms(at, bodies.joints.keys()) for at in (bodies.canonical, bodies.joints)
    )
    expected = our_trunk * arms / our_arms if our_arms > 0.0 else trunk
    return max(_HALF_BODY_M, abs(trunk - expected))


def _trunk_and_arms(at: Mapping[str, F64], known: Collection[str]) -> tuple[float, float]:
    """Length of the trunk, and of all known upper arms and forearms together."""
    hips, chest = ((at[f"{joint}.L"] + at[f"{joint}.R"]) / 2 for joint in ("hip", "shoulder"))
    arms = sum(
        float(np.linalg.norm(at[f"{first}.{side}"] - at[f"{last}.{side}"]))
        for side in "LR"
        for first, last in (("shoulder", "elbow"), ("elbow", "wrist"))
        if f"{first}.{side}" in known and f"{last}.{side}" in known
    )
    return float(np.linalg.norm(chest - hips)), arms


def sentence(uncertain_mm: Mapping[str, float]) -> list[str]:
    """Sentence that names uncertain places, the most uncertain first, if there are any."""
    found = []
    for name, off_mm in sorted(uncertain_mm.items(), key=lambda item: -item[1]):
        place, _, side = name.partition(".")
        if off_mm > (HINGE_MM if place in ("knee", "elbow") else PLACE_MM):
            words = {"L": "left ", "R": "right ", "": ""}[side]
            found.append(f"{words}{place} {off_mm:.0f} mm")
    return [f"these places are uncertain: {', '.join(found)}"] if found else []
