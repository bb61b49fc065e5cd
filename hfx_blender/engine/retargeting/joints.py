# SPDX-License-Identifier: GPL-3.0-or-later
"""The joints and regions of the canonical body and of a target, brought to one size and heading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64, I64, Bool
from ..body.model import Avatar
from .bone_regions import JOINT_OF, REGIONS, known_regions, region_of
from .target import RigMapping, TargetAvatar, areas_of, group_shares, owners_of
from .turns import apply, similarity

_FRAME_JOINTS: Final = ("neck", "head", "hip", "shoulder", "knee", "ankle", "ball")
_TRUNK_JOINTS: Final = ("neck", "head", "hip", "shoulder")
_LEG: Final = ("hip", "knee", "ankle", "ball")
_BENT: Final = 0.75
"""Cosine between a thigh or shank and where it stands below the trunk, below which it is bent."""

_NEEDED: Final = ("hip.L", "hip.R", "shoulder.L", "shoulder.R")
_LARGEST_MISFIT: Final = 0.12
"""RMS distance of the joints of torso, legs and head from a person's, as a share of the height."""

_UPRIGHT: Final = -0.3
"""Largest cosine between legs and trunk of a person; -1 stands straight, 0 is a quadruped."""

_WIDTHS: Final = (0.05, 3.0)
"""Range of the distance between both hips or shoulders, in lengths of the trunk."""

_LEAST_SKIN: Final = 0.25
"""Share of a region's area on the canonical body below which an avatar has none of it: a stump."""

_LEAST_SKULL_M: Final = 0.03
"""Height over a head's joint below which there is a neck only."""

_FINGERS: Final = ("finger2", "finger3", "finger4", "finger5")
"""Fingers that a rig may have as a single one."""


@dataclass(frozen=True, eq=False)
class Skeletons:
    """Joints of both bodies, and the target brought to the canonical one's size and heading."""

    to_target: F64  # (4, 4) normalised space (canonical size, canonical axes) to target space
    points: F64  # (A, 3) target vertices, normalised space
    canonical: dict[str, F64]  # joint -> place
    joints: dict[str, F64]  # joint -> place, normalised space
    avatar_shares: F64  # (V, R) regions of the canonical avatar's vertices
    target_shares: F64  # (A, R) regions of the target's vertices
    feet_forward: float  # share of the target's feet that point where its body faces
    absent: tuple[str, ...] = ()  # regions that the target has no skin of


def skeletons_of(avatar: Avatar, target: TargetAvatar, mapping: RigMapping) -> Skeletons:
    """Find the joints of both, and the turn, scale and shift between them.

    Raises
    ------
    InputError
        Needed joints are missing, or stand to each other as no person's do; there is no torso.
    """
    mapped = _without_mittens(_known_bones(target, mapping))
    canonical, in_target = _joints(avatar, target, mapped)
    to_target = _normalisation(canonical, in_target)
    from_target = np.linalg.inv(to_target)
    joints = {joint: apply(from_target, place) for joint, place in in_target.items()}
    _check_posture(joints)
    _check_proportions(canonical, joints, float(np.ptp(avatar.vertices[:, 2])))
    points = apply(from_target, target.vertices)
    avatar_shares, target_shares = _regions(avatar, target, mapped, points)
    region = dominant(target_shares)
    is_absent = _absent_regions(avatar, avatar_shares, points, target.triangles, target_shares)
    head = points[region == REGIONS.index("head")]
    if len(head) and "head" in joints:
        is_stump = head[:, 2].max() < joints["head"][2] + _LEAST_SKULL_M
        is_absent[REGIONS.index("head")] |= is_stump
    if is_absent[REGIONS.index("torso")]:
        raise InputError(
            "The selected meshes show no torso, so they are no body: select those that do as well."
        )
    avatar_shares[:, is_absent] = 0.0  # nothing is looked for there
    avatar_shares[avatar_shares.sum(axis=1) < 0.5] = 0.0
    return Skeletons(
        to_target,
        points,
        canonical,
        joints,
        avatar_shares,
        target_shares,
        _feet_forward(points, region, joints),
        tuple(region for region, gone in zip(REGIONS, is_absent, strict=True) if gone),
    )


def _known_bones(target: TargetAvatar, mapping: RigMapping) -> Mapping[str, str]:
    """Canonical bone -> the target's; refused if the target has no such bone."""
    known = {bone.name for bone in target.bones}
    unknown = [rig_bone for rig_bone in mapping.bones.values() if rig_bone not in known]
    if unknown:
        raise InputError(f"The armature has no bone '{unknown[0]}' that the bone mapping names.")
    return mapping.bones


def _normalisation(canonical: Mapping[str, F64], joints: Mapping[str, F64]) -> F64:
    """Turn, scale and shift (4, 4) of the canonical joints to a target's, bent legs stretched."""
    missing = [joint for joint in _NEEDED if joint not in joints]
    if missing:
        raise InputError(
            f"The armature has no bone that begins at: {', '.join(missing)}; "
            "a body needs at least two hips and two shoulders."
        )
    to_target = similarity(*_frame_joints(canonical, _straightened(canonical, joints)))
    if not np.linalg.det(to_target[:3, :3]) > 0.0:
        raise InputError("The armature's joints all lie at one place, or are not numbers.")
    return to_target


def _frame_joints(canonical: Mapping[str, F64], joints: Mapping[str, F64]) -> tuple[F64, F64]:
    """Places (J, 3) of the joints of torso, legs and head, on the canonical body and a target."""
    used = [joint for joint in joints if joint.partition(".")[0] in _FRAME_JOINTS]
    return np.array([canonical[j] for j in used]), np.array([joints[j] for j in used])


def _check_proportions(
    canonical: Mapping[str, F64], joints: Mapping[str, F64], height_m: float
) -> None:
    """Refuse joints that are farther from a person's than people differ, as they stand or sit."""
    ours, theirs = _frame_joints(canonical, joints)
    misfit = apply(np.linalg.inv(similarity(ours, theirs)), theirs) - ours
    if np.sqrt(np.mean(np.sum(misfit**2, axis=1))) > _LARGEST_MISFIT * height_m:
        raise InputError(
            "The armature's joints do not stand to each other as a person's do: only a human "
            "avatar in an upright rest pose can become a haptic body."
        )


def _regions(
    avatar: Avatar, target: TargetAvatar, mapped: Mapping[str, str], points: F64
) -> tuple[F64, F64]:
    """Regions of the canonical avatar's vertices (V, R), and of a target's that are shown (A, R).

    ``points`` are those of the target in normalised space.
    """
    stands_for = known_regions(mapped)
    number = {region: k for k, region in enumerate(REGIONS)}
    of_canonical = np.array(
        [number[stands_for[region_of(bone)]] for bone in avatar.skeleton.bone_names]
    )
    owners = owners_of(target, {rig_bone: bone for bone, rig_bone in mapped.items()})
    of_target = np.array([-1 if o is None else number[region_of(o)] for o in owners], np.int64)
    target_shares = _filled(group_shares(target.weights, of_target, len(REGIONS)), points)
    is_shown = np.zeros(len(points), np.bool_)
    is_shown[target.triangles] = True
    target_shares *= is_shown[:, None]
    return group_shares(avatar.weights, of_canonical, len(REGIONS)), target_shares


def _absent_regions(
    avatar: Avatar, avatar_shares: F64, points: F64, triangles: I64, target_shares: F64
) -> Bool:
    """Regions (R,) of which a target has too little skin."""
    own = _region_areas(points, triangles, target_shares)
    halves = avatar.faces[:, :3].astype(np.int64)  # of quads
    ours = 2.0 * _region_areas(avatar.vertices.astype(np.float64), halves, avatar_shares)
    is_absent: Bool = own < _LEAST_SKIN * ours
    return is_absent


def _region_areas(points: F64, triangles: I64, shares: F64) -> F64:
    """Area (R,) of each region on a surface."""
    found: F64 = areas_of(points, triangles) @ shares[triangles].mean(axis=1)
    return found


def _straightened(canonical: Mapping[str, F64], joints: Mapping[str, F64]) -> dict[str, F64]:
    """Joints with bent legs stretched below the trunk: a person who sits is not tilted back."""
    straight = dict(joints)
    trunk = [joint for joint in joints if joint.partition(".")[0] in _TRUNK_JOINTS]
    ours, theirs = (np.array([of[joint] for joint in trunk]) for of in (canonical, joints))
    turn = similarity(ours, theirs)[:3, :3]
    if not np.linalg.det(turn) > 0.0:
        return straight
    turn /= np.cbrt(np.linalg.det(turn))
    for side in "LR":
        leg = [f"{joint}.{side}" for joint in _LEG if f"{joint}.{side}" in joints]
        bones = list(pairwise(leg))
        ways = [turn @ (canonical[end] - canonical[start]) for start, end in bones]
        ways = [way / np.linalg.norm(way) for way in ways]
        own = [joints[end] - joints[start] for start, end in bones]
        cosines = [
            float(way @ each) / max(float(np.linalg.norm(each)), 1e-12)
            for way, each in zip(ways, own, strict=True)
        ]
        if min(cosines[:2], default=1.0) < _BENT:  # of thigh and shank
            for (start, end), way, each in zip(bones, ways, own, strict=True):
                straight[end] = straight[start] + np.linalg.norm(each) * way
    return straight


def _check_posture(joints: Mapping[str, F64]) -> None:
    """Refuse joints that no upright person has, whatever they are called."""
    hips, chest = (
        (joints[f"{joint}.L"] + joints[f"{joint}.R"]) / 2 for joint in ("hip", "shoulder")
    )
    trunk, faults = chest - hips, []
    length = float(np.linalg.norm(trunk))
    for joint in ("ankle", "knee"):
        if f"{joint}.L" in joints and f"{joint}.R" in joints:
            legs = (joints[f"{joint}.L"] + joints[f"{joint}.R"]) / 2 - hips
            if float(legs @ trunk) > _UPRIGHT * length * float(np.linalg.norm(legs)):
                faults.append("its legs do not stand below its trunk")
            break
    widths = {
        joint: float(np.linalg.norm(joints[f"{joint}.L"] - joints[f"{joint}.R"]))
        for joint in ("hip", "shoulder")
    }
    if {"knee.L", "knee.R"} <= joints.keys() and widths["shoulder"] < widths["hip"]:
        thighs = (joints["knee.L"] + joints["knee.R"]) / 2 - hips
        if float(thighs @ trunk) > _UPRIGHT * length * float(np.linalg.norm(thighs)):
            faults.append("it stands on four legs: shoulders narrower than hips, thighs across")
    top = joints.get("head", joints.get("neck", chest + trunk))
    if float((top - hips) @ trunk) < length * length:
        faults.append("its head is not above its shoulders")
    for joint, width in widths.items():
        if not _WIDTHS[0] * length <= width <= _WIDTHS[1] * length:
            faults.append(f"its {joint}s are {width / max(length, 1e-12):.2g} trunks apart")
    if faults:
        raise InputError(
            f"The armature is not that of an upright person: {' and '.join(faults)}. Only a human "
            "avatar that stands or sits in rest pose can become a haptic body; if it is one, "
            "correct its bones in the table, or its rest pose."
        )


def _filled(shares: F64, points: F64) -> F64:
    """Assign skin that follows no bone to the region of the nearest skin that does."""
    from scipy.spatial import cKDTree

    bare = shares.sum(axis=1) == 0.0
    if not bare.any() or bare.all():
        return shares
    filled = shares.copy()
    filled[bare] = shares[~bare][cKDTree(points[~bare]).query(points[bare])[1]]
    return filled


def _feet_forward(points: F64, region: I64, joints: Mapping[str, F64]) -> float:
    """Share of the feet that reach farther forward than back from the ankle; 1 without feet."""
    forward = []
    for side in "LR":
        foot = points[region == REGIONS.index(f"foot.{side}")]
        if len(foot) > 10 and f"ankle.{side}" in joints:
            reach = foot[:, 1] - joints[f"ankle.{side}"][1]
            forward.append(-reach.min() > reach.max())
    return float(np.mean(forward)) if forward else 1.0


def _without_mittens(mapped: Mapping[str, str]) -> dict[str, str]:
    """Leave out a finger that represents all of them: it tells no single finger's place."""
    found = dict(mapped)
    for side in "LR":
        fingers = [bone for bone in mapped if bone[:7] in _FINGERS and bone.endswith(f".{side}")]
        if len({bone[6] for bone in fingers}) == 1:
            for bone in fingers:
                del found[bone]
    return found


def _joints(
    avatar: Avatar, target: TargetAvatar, mapped: Mapping[str, str]
) -> tuple[dict[str, F64], dict[str, F64]]:
    heads = dict(
        zip(avatar.skeleton.bone_names, avatar.skeleton.rest[:, :3, 3].astype(float), strict=True)
    )
    rig = {bone.name: np.asarray(bone.head, np.float64) for bone in target.bones}
    canonical = {joint: heads[bone] for bone, joint in JOINT_OF.items()}
    joints = {joint: rig[mapped[bone]] for bone, joint in JOINT_OF.items() if bone in mapped}
    for side in "LR":
        toes = [f"toe{number}-1.{side}" for number in range(1, 6)]
        found = sorted({mapped[bone] for bone in toes if bone in mapped})
        canonical[f"ball.{side}"] = np.mean([heads[bone] for bone in toes], axis=0)
        if found:
            joints[f"ball.{side}"] = np.mean([rig[bone] for bone in found], axis=0)
        for finger in range(1, 6):
            for phalanx in range(1, 4):
                bone = f"finger{finger}-{phalanx}.{side}"
                canonical[bone] = heads[bone]
                if bone in mapped:
                    joints[bone] = rig[mapped[bone]]
    return canonical, joints


def dominant(shares: F64) -> I64:
    """Region of each vertex: the one with the largest share, -1 without any."""
    found: I64 = np.where(shares.max(axis=1) > 0.0, shares.argmax(axis=1), -1)
    return found
