# SPDX-License-Identifier: GPL-3.0-or-later
"""Left, back and up of a rest pose; recognition of a human by the bone hierarchy alone."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from ...arrays import F64
from .assignment import spine_counterparts
from .rig import Rig

_PAIRED: Final = ("upperleg01", "upperarm01", "lowerleg01", "lowerarm01", "foot", "clavicle")
_ARM: Final = ("clavicle", "upperarm01", "lowerarm01", "wrist")
_LEG: Final = ("pelvis", "upperleg01", "lowerleg01", "foot", "toe2-1")
_LIKE_LENGTH: Final = 0.1  # largest relative difference of length within a pair of limbs
_FOOT_MIN: Final = 0.02  # shortest foot with a direction, fraction of the trunk's length
_SOLE_MIN: Final = 0.05  # for directions from soles; larger, because of robes


def named_left(heads: Mapping[str, F64]) -> F64 | None:
    """Unit vector from right to left, armature space, by the mean direction of the bone pairs
    present in ``heads``; None without pairs or if all coincide."""
    total = np.zeros(3)
    for bone in _PAIRED:
        if f"{bone}.L" in heads and f"{bone}.R" in heads:
            across = heads[f"{bone}.L"] - heads[f"{bone}.R"]
            total += across / max(float(np.linalg.norm(across)), 1e-12)
    return _unit(total)


def geometric_left(heads: Mapping[str, F64], least: float = _FOOT_MIN) -> F64 | None:
    """Unit vector to the body's left: across the body's up and the mean direction, normal to up,
    from ankles to toes. None without feet and toes, for feet shorter than ``least`` times the
    trunk, or feet 90 degrees or more apart."""
    up = _up(heads)
    if up is None:
        return None
    trunk = float(np.linalg.norm(_high(heads) - _low(heads)))
    steps = []
    for side in "LR":
        foot = heads.get(f"foot.{side}")
        toes = [p for n, p in heads.items() if n.startswith("toe") and n.endswith(f"-1.{side}")]
        if foot is None or not toes:
            return None
        # Horizontal part of the way from ankle to toes.
        step = np.mean(toes, axis=0) - foot
        steps.append(step - (step @ up) * up)
    if min(np.linalg.norm(step) for step in steps) < least * trunk:
        return None
    forward = _unit(sum((step / np.linalg.norm(step) for step in steps), np.zeros(3)))
    if forward is None or float(steps[0] @ steps[1]) <= 0:
        return None
    return np.cross(up, forward)


def left_by_soles(
    rig: Rig, bone_of: Mapping[str, str], heads: Mapping[str, F64], skin: Mapping[str, F64]
) -> F64 | None:
    """Unit vector to the body's left from the soles' offsets to the ankles, armature space; None if
    unclear.

    ``bone_of`` and ``heads`` map a canonical bone to the avatar bone and to its head (3,); ``skin``
    maps an avatar bone to points (n, 3) of its skin.
    """
    points_of, up = dict(heads), _up(heads)
    # The lowest part of the skin below the ankle is the sole; its centre serves as toe joint.
    for side in "LR":
        knee, foot = bone_of.get(f"lowerleg01.{side}"), heads.get(f"foot.{side}")
        if knee is None or up is None:
            return None
        below = [n for n in skin if n in rig.parent and knee in (n, *rig.ancestors(n))]
        if not below:
            return None
        points = np.concatenate([skin[name] for name in below])
        start = rig.head(knee) if foot is None else foot
        depth = (points - start) @ (-up if foot is None else foot - rig.head(knee))
        if not depth.max() > 0.0:  # no skin below the foot's joint
            return None
        sole = points[depth > (0.9 if foot is None else 0.5) * depth.max()]
        points_of[f"toe1-1.{side}"] = sole.mean(axis=0)
        if foot is None:
            points_of[f"foot.{side}"] = points[depth < 0.8 * depth.max()].mean(axis=0)
    return geometric_left(points_of, _SOLE_MIN)


def assigned_by_geometry(rig: Rig) -> dict[str, str] | None:
    """Canonical bone to avatar bone by the shape of the hierarchy; None unless one body fits. A
    body has a pelvis with two legs of equal shape and a trunk, and a chest on the trunk with two
    arms of equal shape and a neck. The left follows from the feet, so legs need a toe joint."""
    # Every bone is tried as pelvis with every pair of legs; two possible bodies are ambiguous.
    reach = _reaches(rig)
    found_bodies = []
    for pelvis in rig.bones:
        for legs in _pairs(rig, reach, pelvis):
            for first in rig.children[pelvis]:
                trunk = [] if first in legs else _trunk(rig, reach, first)
                if trunk:
                    body = _body(rig, reach, pelvis, legs, trunk)
                    found_bodies += [] if body is None else [body]
    return found_bodies[0] if len(found_bodies) == 1 else None


def _body(
    rig: Rig, reach: Mapping[str, float], pelvis: str, legs: tuple[str, str], trunk: Sequence[str]
) -> dict[str, str] | None:
    """Canonical bones of a body with the given legs and trunk (pelvis to chest), sides by the feet.
    None without one pair of arms and one neck, with other numbers of joints, or limbs not
    across."""
    chest = trunk[-1]
    # Two pairs at the chest, such as wings, leave open which are arms.
    arm_pairs = _pairs(rig, reach, chest)
    if len(arm_pairs) != 1:
        return None
    # Joint counts are fixed; a chain with more or fewer bones is ambiguous, so no human.
    arms = arm_pairs[0]
    necks = [child for child in rig.children[chest] if child not in arms]
    if len(necks) != 1:
        return None
    neck = _straight(rig, necks[0])
    bone_of = {"root": pelvis, "head": neck[min(1, len(neck) - 1)]}
    if len(neck) > 1:
        bone_of["neck01"] = neck[0]
    for side, leg, arm in zip("LR", legs, arms, strict=True):
        joints = _straight(rig, leg)
        if len(joints) not in (4, 5):  # the fifth only marks the end of the toes
            return None
        for bone, name in zip(_LEG[1:], joints, strict=False):
            bone_of[f"{bone}.{side}"] = name
        joints = _straight(rig, arm)
        if len(joints) not in (3, 4):
            return None
        for bone, name in zip(_ARM[4 - len(joints) :], joints, strict=True):
            bone_of[f"{bone}.{side}"] = name
    heads = {canonical: rig.head(name) for canonical, name in bone_of.items()}
    left = geometric_left(heads)
    if left is None or not _is_across(heads, left):
        return None
    for limb in (_ARM, _LEG):
        across = heads[f"{limb[1]}.L"] - heads[f"{limb[1]}.R"]
        if float(across @ left) < 0:  # the order of the pair was arbitrary
            for bone in limb:
                if f"{bone}.L" in bone_of:
                    pair = bone_of[f"{bone}.R"], bone_of[f"{bone}.L"]
                    bone_of[f"{bone}.L"], bone_of[f"{bone}.R"] = pair
    return bone_of | spine_counterparts(rig, trunk, _low(heads), rig.head(neck[0]))


def _is_across(heads: Mapping[str, F64], left: F64) -> bool:
    """True if thighs and upper arms lie apart along ``left`` (cosine 0.8, a tenth of the trunk),
    and feet lie below the thighs by half a trunk, along the body's up."""
    trunk = _high(heads) - _low(heads)
    for bone in ("upperleg01", "upperarm01"):
        across = heads[f"{bone}.L"] - heads[f"{bone}.R"]
        width = abs(float(across @ left))
        if width < 0.8 * float(np.linalg.norm(across)) or width < 0.1 * np.linalg.norm(trunk):
            return False
    down = (heads["foot.L"] + heads["foot.R"] - heads["upperleg01.L"] - heads["upperleg01.R"]) / 2
    return float(down @ trunk) < -0.5 * float(trunk @ trunk)


def _trunk(rig: Rig, reach: Mapping[str, float], first: str) -> list[str]:
    """Chain of only children from ``first`` to the first bone with a pair of arms, inclusive; empty
    if the chain branches or ends before."""
    chain = [first]
    while not _pairs(rig, reach, chain[-1]):
        if len(rig.children[chain[-1]]) != 1:
            return []
        chain += rig.children[chain[-1]]
    return chain


def _straight(rig: Rig, first: str) -> list[str]:
    """Chain of only children from ``first`` on; the last bone has no child or several."""
    chain = [first]
    while len(rig.children[chain[-1]]) == 1:
        chain += rig.children[chain[-1]]
    return chain


def _pairs(rig: Rig, reach: Mapping[str, float], name: str) -> list[tuple[str, str]]:
    """Pairs of children of a bone with reach equal to 10 % and equal numbers of joints, both
    reaching over a fifth of the rig's longest. ``reach`` as of :func:`_reaches`."""
    longest = max(reach.values(), default=0.0)
    return [
        (a, b)
        for a, b in combinations(rig.children[name], 2)
        if min(reach[a], reach[b]) > 0.2 * longest
        and abs(reach[a] - reach[b]) < _LIKE_LENGTH * max(reach[a], reach[b])
        and len(_straight(rig, a)) == len(_straight(rig, b))
    ]


def _reaches(rig: Rig) -> dict[str, float]:
    """Length from each bone's head along the longest path down the hierarchy, metres; 0 without
    children."""
    reach: dict[str, float] = {}
    for name in sorted(rig.bones, key=rig.depth, reverse=True):
        below = [
            float(np.linalg.norm(rig.head(child) - rig.head(name))) + reach.get(child, 0.0)
            for child in rig.children[name]
        ]
        reach[name] = max(below, default=0.0)
    return reach


def _low(heads: Mapping[str, F64]) -> F64:
    """Middle of the thighs' heads (3,); without both, the head of the lowest known trunk bone, else
    of the first bone."""
    thighs = [heads[n] for n in ("upperleg01.L", "upperleg01.R") if n in heads]
    if len(thighs) == 2:
        return np.asarray(np.mean(thighs, axis=0))
    return next(heads[n] for n in ("spine05", "spine04", "spine03", "root", *heads) if n in heads)


def _high(heads: Mapping[str, F64]) -> F64:
    """Head (3,) of neck, head or upper spine, the first known; else of the last bone."""
    return next(
        heads[n]
        for n in ("neck01", "head", "spine01", "spine02", *reversed(list(heads)))
        if n in heads
    )


def _up(heads: Mapping[str, F64]) -> F64 | None:
    """Unit vector from :func:`_low` to :func:`_high`; None without bones or length."""
    return _unit(_high(heads) - _low(heads)) if heads else None


def _unit(vector: F64) -> F64 | None:
    """Unit vector; None for length 0."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else None
