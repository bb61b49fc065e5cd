# SPDX-License-Identifier: GPL-3.0-or-later
"""Joints and skin regions of the canonical body and a target, in a common normalised space.

Rigs place knees up to 4 cm from the visible kneecap. Three estimates along the limb are combined
by the median: the rig's joint, the transition of skin weights from the upper to the lower bone, and
the canonical ratio of bone lengths. A single wrong estimate does no harm; the spread is the
uncertainty.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64, I64
from ..body.model import Avatar
from ..body.rigs.mapping import BoneMapping
from .bone_regions import JOINT_OF, REGIONS, known_regions, region_of
from .target import TargetAvatar, group_shares, owners_of, vertex_areas
from .turns import apply, similarity

_FRAME_JOINTS: Final = ("neck", "head", "hip", "shoulder", "knee", "ankle", "ball")
_TRUNK_JOINTS: Final = ("neck", "head", "hip", "shoulder")
_LEG: Final = ("hip", "knee", "ankle", "ball")
_BENT: Final = 0.75  # smallest cosine between a straight leg's bone and its direction when standing
_NEEDED: Final = ("hip.L", "hip.R", "shoulder.L", "shoulder.R")
# Largest RMS distance from canonical joints of torso, legs and head, fraction of the height
_LARGEST_MISFIT: Final = 0.12
# Largest cosine between legs and trunk of a human; -1 is straight, 0 a quadruped
_UPRIGHT: Final = -0.3
# Range of the distance between hips or shoulders, in lengths of the trunk
_WIDTHS: Final = (0.05, 3.0)
# Smallest fraction of a region's canonical area; below, the region is absent (a stump)
_LEAST_SKIN: Final = 0.25
# Smallest height of the skin above the head joint, metres; below, the head is absent
_LEAST_SKULL_M: Final = 0.03
_FINGERS: Final = ("finger2", "finger3", "finger4", "finger5")  # fingers joined in a mitten

# Hinge to first and last joint of its limb, and the regions above and below
_LIMBS: Final = {
    "elbow": ("shoulder", "wrist", "upperarm", "forearm"),
    "knee": ("hip", "ankle", "upperleg", "lowerleg"),
}

_AROUND_M: Final = 0.14  # largest distance of skin from a hinge for the estimate by weights
_ALONG_M: Final = 0.12
# Smallest correction; smaller differences also occur on avatars with correct joints
_LEAST_M: Final = 0.008
_FEWEST: Final = 6
_STEP_M: Final = 0.001


@dataclass(frozen=True, eq=False)
class Skeletons:
    """Joints of the canonical body and a target, in normalised space (canonical size and axes)."""

    to_target: F64  # (4, 4) normalised space to target space
    points: F64  # (A, 3) target vertices, normalised space
    canonical: dict[str, F64]  # joint -> (3,) on the canonical body, rest space
    joints: dict[str, F64]  # joint -> (3,) on the target, normalised space
    avatar_shares: F64  # (V, R) skin weights of the canonical avatar by region
    target_shares: F64  # (A, R) skin weights of the target by region
    feet_forward: float  # fraction of the target's feet pointing forward
    absent: tuple[str, ...] = ()  # regions without skin on the target


def skeletons_of(avatar: Avatar, target: TargetAvatar, mapping: BoneMapping) -> Skeletons:
    """Joints and regions of both bodies, and the similarity transform between them. Raises
    InputError: required joints are missing, proportions or posture are not human, or there is no
    torso."""
    known = {bone.name for bone in target.bones}
    unknown = [rig_bone for rig_bone in mapping.bones.values() if rig_bone not in known]
    if unknown:
        raise InputError(f"The armature has no bone '{unknown[0]}' that the bone mapping names.")
    mapped = _without_mittens(mapping.bones)
    canonical, in_target = _joints(avatar, target, mapped)
    # All later work is in normalised space: thresholds in metres hold for any unit and size.
    to_target = _normalisation(canonical, in_target)
    from_target = np.linalg.inv(to_target)
    joints = {joint: apply(from_target, point) for joint, point in in_target.items()}
    _check_posture(joints)
    # Even the best similarity leaves a misfit: its RMS shows whether proportions are human.
    own, aligned_target = _frame_joints(canonical, joints)
    misfit = apply(np.linalg.inv(similarity(own, aligned_target)), aligned_target) - own
    height_m = float(np.ptp(avatar.vertices[:, 2]))
    if np.sqrt(np.mean(np.sum(misfit**2, axis=1))) > _LARGEST_MISFIT * height_m:
        raise InputError(
            "The armature's joints do not stand to each other as a person's do: only a human "
            "avatar in an upright rest pose can become a haptic body."
        )
    points = apply(from_target, target.vertices)
    avatar_shares, target_shares = _regions(avatar, target, mapped, points)
    region = dominant(target_shares)
    # A region with less than a quarter of the canonical area is a stump, or missing.
    halves = avatar.faces[:, :3].astype(np.int64)
    own_skin = vertex_areas(avatar.vertices.astype(np.float64), halves)
    own_areas = np.einsum("v,vr->r", own_skin, avatar_shares)
    areas = np.einsum("v,vr->r", vertex_areas(points, target.triangles), target_shares)
    is_absent = areas < _LEAST_SKIN * (2.0 * own_areas)  # of quads, half was measured
    head = points[region == REGIONS.index("head")]
    if len(head) and "head" in joints:
        is_stump = head[:, 2].max() < joints["head"][2] + _LEAST_SKULL_M
        is_absent[REGIONS.index("head")] |= is_stump
    if is_absent[REGIONS.index("torso")]:
        raise InputError(
            "The selected meshes show no torso, so they are no body: select those that do as well."
        )
    avatar_shares[:, is_absent] = 0.0  # excluded from all searches
    avatar_shares[avatar_shares.sum(axis=1) < 0.5] = 0.0
    return Skeletons(
        to_target,
        points,
        canonical,
        joints,
        avatar_shares,
        target_shares,
        _feet_forward(points, region, joints),
        tuple(region for region, absent in zip(REGIONS, is_absent, strict=True) if absent),
    )


def _normalisation(canonical: Mapping[str, F64], joints: Mapping[str, F64]) -> F64:
    """Similarity transform (4, 4) from canonical joints to a target's, with bent legs straightened.
    Raises InputError: hips or shoulders are missing, or all joints coincide."""
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
    """Points (J, 3) of the common joints of torso, legs and head on both bodies, each in the space
    of its joints."""
    used = [joint for joint in joints if joint.partition(".")[0] in _FRAME_JOINTS]
    return np.array([canonical[j] for j in used]), np.array([joints[j] for j in used])


def _regions(
    avatar: Avatar, target: TargetAvatar, mapped: Mapping[str, str], points: F64
) -> tuple[F64, F64]:
    """Skin weights by region of the canonical avatar (V, R) and a target (A, R). ``points`` (A, 3)
    are target vertices in normalised space. Target vertices without triangle get 0."""
    from scipy.spatial import cKDTree

    stands_for = known_regions(mapped)
    number = {region: k for k, region in enumerate(REGIONS)}
    avatar_regions = np.array(
        [number[stands_for[region_of(bone)]] for bone in avatar.skeleton.bone_names]
    )
    owner_bones = owners_of(target, {rig_bone: bone for bone, rig_bone in mapped.items()})
    target_regions = np.array(
        [-1 if o is None else number[region_of(o)] for o in owner_bones], np.int64
    )
    target_shares = group_shares(target.weights, target_regions, len(REGIONS))
    # Vertices without a region (unweighted, helpers) take that of the nearest vertex with one.
    is_bare = target_shares.sum(axis=1) == 0.0
    if is_bare.any() and not is_bare.all():
        nearest = cKDTree(points[~is_bare]).query(points[is_bare])[1]
        target_shares[is_bare] = target_shares[~is_bare][nearest]
    is_shown = np.zeros(len(points), np.bool_)
    is_shown[target.triangles] = True
    target_shares *= is_shown[:, None]
    return group_shares(avatar.weights, avatar_regions, len(REGIONS)), target_shares


def _straightened(canonical: Mapping[str, F64], joints: Mapping[str, F64]) -> dict[str, F64]:
    """Copy of the joints with bent legs stretched below the trunk, lengths unchanged. Bent are
    thighs or shanks more than 41 degrees off. The legs of a sitting avatar would tilt the
    alignment."""
    straight = dict(joints)
    trunk = [joint for joint in joints if joint.partition(".")[0] in _TRUNK_JOINTS]
    canonical_trunk, target_trunk = (
        np.array([body[joint] for joint in trunk]) for body in (canonical, joints)
    )
    turn = similarity(canonical_trunk, target_trunk)[:3, :3]
    if not np.linalg.det(turn) > 0.0:
        return straight
    # Without the scale of the similarity a pure rotation is left.
    turn /= np.cbrt(np.linalg.det(turn))
    for side in "LR":
        leg = [f"{joint}.{side}" for joint in _LEG if f"{joint}.{side}" in joints]
        bones = list(pairwise(leg))
        ways = [turn @ (canonical[end] - canonical[start]) for start, end in bones]
        ways = [way / np.linalg.norm(way) for way in ways]
        own = [joints[end] - joints[start] for start, end in bones]
        cosines = [
            float(way @ bone) / max(float(np.linalg.norm(bone)), 1e-12)
            for way, bone in zip(ways, own, strict=True)
        ]
        if min(cosines[:2], default=1.0) < _BENT:  # of thigh and shank
            for (start, end), way, bone in zip(bones, ways, own, strict=True):
                straight[end] = straight[start] + np.linalg.norm(bone) * way
    return straight


def _check_posture(joints: Mapping[str, F64]) -> None:
    """Reject joints impossible for an upright human. Raises InputError: names all faults: legs
    across the trunk, low head, narrow or wide hips or shoulders."""
    hips, chest = (
        (joints[f"{joint}.L"] + joints[f"{joint}.R"]) / 2 for joint in ("hip", "shoulder")
    )
    trunk, faults = chest - hips, []
    length = float(np.linalg.norm(trunk))
    # Ankles are below the hips even of a sitting person; knees stand in without ankles.
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
    # Sitting people also have thighs across the trunk, but broader shoulders than quadrupeds.
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


def _feet_forward(points: F64, region: I64, joints: Mapping[str, F64]) -> float:
    """Fraction of feet that reach farther to the front (-Y) of the ankle than behind; 1 without a
    foot of more than 10 vertices with an ankle."""
    forward = []
    for side in "LR":
        foot = points[region == REGIONS.index(f"foot.{side}")]
        if len(foot) > 10 and f"ankle.{side}" in joints:
            reach = foot[:, 1] - joints[f"ankle.{side}"][1]
            forward.append(-reach.min() > reach.max())
    return float(np.mean(forward)) if forward else 1.0


def _without_mittens(mapped: Mapping[str, str]) -> dict[str, str]:
    """Copy of ``mapped``, rig bones by canonical bone, without the finger bones of a side where one
    finger besides the thumb has all."""
    bones = dict(mapped)
    for side in "LR":
        fingers = [bone for bone in mapped if bone[:7] in _FINGERS and bone.endswith(f".{side}")]
        if len({bone[6] for bone in fingers}) == 1:
            for bone in fingers:
                del bones[bone]
    return bones


def _joints(
    avatar: Avatar, target: TargetAvatar, mapped: Mapping[str, str]
) -> tuple[dict[str, F64], dict[str, F64]]:
    """Points (3,) of the joints on the canonical body (all) and the target (mapped joints only).
    Rest and target space. The ball of a foot is the mean of the first toe joints."""
    heads = avatar.skeleton.heads
    rig_heads = {bone.name: np.asarray(bone.head, np.float64) for bone in target.bones}
    canonical = {joint: heads[bone] for bone, joint in JOINT_OF.items()}
    joints = {joint: rig_heads[mapped[bone]] for bone, joint in JOINT_OF.items() if bone in mapped}
    for side in "LR":
        toes = [f"toe{number}-1.{side}" for number in range(1, 6)]
        toe_bones = sorted({mapped[bone] for bone in toes if bone in mapped})
        canonical[f"ball.{side}"] = np.mean([heads[bone] for bone in toes], axis=0)
        if toe_bones:
            joints[f"ball.{side}"] = np.mean([rig_heads[bone] for bone in toe_bones], axis=0)
        # Fingers are named after their bones: joint and bone begin at the same place.
        for finger in range(1, 6):
            for phalanx in range(1, 4):
                bone = f"finger{finger}-{phalanx}.{side}"
                canonical[bone] = heads[bone]
                if bone in mapped:
                    joints[bone] = rig_heads[mapped[bone]]
    return canonical, joints


def dominant(shares: F64) -> I64:
    """Region (N,) of largest share per row; -1 for rows of 0."""
    return np.asarray(np.where(shares.max(axis=1) > 0.0, shares.argmax(axis=1), -1))


@dataclass(frozen=True)
class _Limb:
    """Joints (3,) of one limb."""

    start: F64
    hinge: F64
    end: F64

    @classmethod
    def of(cls, joints: Mapping[str, F64], hinge: str) -> "_Limb | None":
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
        weights of points (N, 3)."""
        units = self.ways / self.lengths[:, None]
        # A plane across the bisector separates the two bones of a bent limb.
        axis = units.sum(axis=0)
        length = float(np.linalg.norm(axis))
        if length < 0.5:  # folded: no plane separates the bones
            return None
        axis /= length
        is_limb = upper + lower > 0.5
        offset, shares = points[is_limb] - self.hinge, lower[is_limb] / (upper + lower)[is_limb]
        along = np.einsum("ni,i->n", offset, axis)
        radius = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        is_near = (np.abs(along) < _ALONG_M) & (radius < _AROUND_M)
        share, positions = shares[is_near], along[is_near]
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


def with_placed_hinges(
    bodies: Skeletons, points: F64, triangles: I64, target_triangles: I64
) -> tuple[Skeletons, dict[str, F64]]:
    """Copy of skeletons with knees and elbows at the median of the estimates.

    Hinges without an estimate by weights, or closer than 8 mm to the median, stay. ``points`` (V,
    3) and ``triangles`` are of the canonical avatar. Also returns the estimates (2 or 3,) of each
    hinge, metres along the limb relative to the rig's joint; the first is 0.
    """
    joints, estimates = dict(bodies.joints), {}
    skins = (
        (_middles(points, triangles), bodies.avatar_shares, triangles),
        (_middles(bodies.points, target_triangles), bodies.target_shares, target_triangles),
    )
    for stem, (_, _, upper, lower) in _LIMBS.items():
        for side in "LR":
            name = f"{stem}.{side}"
            own, target = (_Limb.of(at, name) for at in (bodies.canonical, bodies.joints))
            if own is None or target is None:
                continue
            both = [REGIONS.index(f"{region}.{side}") for region in (upper, lower)]
            crossings = [
                limb.crossing_m(places, *(_middles(shares[:, r], corners) for r in both))
                for limb, (places, shares, corners) in zip((own, target), skins, strict=True)
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


def _middles(values: F64, triangles: I64) -> F64:
    """Means (2 F, ...) of the values (N, ...) at both ends, of two edges of each of F triangles."""
    return (values[triangles[:, :2].T.ravel()] + values[triangles[:, 1:].T.ravel()]) / 2
