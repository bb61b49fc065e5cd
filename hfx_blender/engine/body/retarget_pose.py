# SPDX-License-Identifier: GPL-3.0-or-later
"""The canonical avatar, posed and proportioned like a target's rest pose.

Each segment of the canonical skeleton gets one affine transform: turned from its parent's
turn by the least that points it at the target's next joint (turns that do not build on the parent's
twist the limbs), stretched along to the target's length and across to the target's girth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from .model import Avatar
from .retarget_regions import JOINT_OF, REGIONS, known_regions, region_of
from .retarget_target import RigMapping, TargetAvatar, group_shares, owners_of

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

_FRAME_JOINTS: Final = ("neck", "head", "hip", "shoulder", "knee", "ankle", "ball")
_NEEDED: Final = ("hip.L", "hip.R", "shoulder.L", "shoulder.R")
_LARGEST_MISFIT: Final = 0.12
"""RMS distance of the joints of torso, legs and head from a person's, as a share of the height."""

_GIRTHS: Final = (0.4, 2.5)
"""Smallest and largest change of a girth that is believed."""

_FINGERS: Final = ("finger2", "finger3", "finger4", "finger5")

_SKULL_M: Final = 0.13
"""Height of the part of the canonical head that is skull, from its top to the ears."""

_UP: Final = np.array([0.0, 0.0, 1.0])


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


def skeletons_of(avatar: Avatar, target: TargetAvatar, mapping: RigMapping) -> Skeletons:
    """Find the joints of both, and the turn, scale and shift between them.

    Raises
    ------
    InputError
        Needed joints are missing, or stand to each other as no person's do.
    """
    mapped = _without_mittens(mapping.bones)
    canonical, joints = _joints(avatar, target, mapped)
    missing = [joint for joint in _NEEDED if joint not in joints]
    if missing:
        raise InputError(
            f"The armature has no bone that begins at: {', '.join(missing)}; "
            "a body needs at least two hips and two shoulders."
        )
    used = [joint for joint in joints if joint.partition(".")[0] in _FRAME_JOINTS]
    to_target = _similarity(
        np.array([canonical[joint] for joint in used]), np.array([joints[joint] for joint in used])
    )
    from_target = np.linalg.inv(to_target)
    joints = {joint: _apply(from_target, place) for joint, place in joints.items()}
    misfit = np.array([joints[joint] - canonical[joint] for joint in used])
    if np.sqrt(np.mean(np.sum(misfit**2, axis=1))) > _LARGEST_MISFIT * np.ptp(
        avatar.vertices[:, 2]
    ):
        raise InputError(
            "The armature's joints do not stand to each other as a person's do: only a human "
            "avatar in an upright rest pose can become a haptic body."
        )
    stands_for = known_regions(mapped)
    number = {region: k for k, region in enumerate(REGIONS)}
    of_canonical = np.array(
        [number[stands_for[region_of(bone)]] for bone in avatar.skeleton.bone_names]
    )
    owners = owners_of(target, {rig_bone: bone for bone, rig_bone in mapped.items()})
    of_target = np.array([-1 if o is None else number[region_of(o)] for o in owners], np.int64)
    points = _apply(from_target, target.vertices)
    target_shares = _filled(group_shares(target.weights, of_target, len(REGIONS)), points)
    return Skeletons(
        to_target,
        points,
        canonical,
        joints,
        group_shares(avatar.weights, of_canonical, len(REGIONS)),
        target_shares,
        _feet_forward(points, _dominant(target_shares), joints),
    )


def _filled(shares: F64, points: F64) -> F64:
    """Skin that follows no bone belongs to the region of the nearest skin that does."""
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
    """Leave out a finger that stands for all of them: it says nothing on any one's place."""
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


def _similarity(one: F64, other: F64) -> F64:
    """Turn, scale and shift that bring points onto others best (Umeyama 1991), (4, 4)."""
    centre, goal = one.mean(axis=0), other.mean(axis=0)
    u, spread, v = np.linalg.svd((other - goal).T @ (one - centre))
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    scale = np.trace(np.diag(spread) @ sign) / np.sum((one - centre) ** 2)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (u @ sign @ v)
    matrix[:3, 3] = goal - matrix[:3, :3] @ centre
    return matrix


def _apply(matrix: F64, points: F64) -> F64:
    moved: F64 = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def pose(avatar: Avatar, bodies: Skeletons) -> F64:
    """Vertices of the canonical avatar in the target's rest pose, (V, 3), normalised space."""
    segments = _Segments(avatar, bodies)
    bones = np.stack([segments.matrix_of_bone(name) for name in avatar.skeleton.bone_names])
    weights = avatar.weights
    owners = np.repeat(np.arange(len(avatar.vertices)), np.diff(weights.offsets))
    blended = np.zeros((len(avatar.vertices), 12))
    for entry in range(12):
        blended[:, entry] = np.bincount(
            owners, weights.values * bones[weights.bones].reshape(-1, 16)[:, entry]
        )
    matrices = blended.reshape(-1, 3, 4)
    posed: F64 = (
        np.einsum("vij,vj->vi", matrices[..., :3], avatar.vertices.astype(np.float64))
        + matrices[..., 3]
    )
    return posed


class _Segments:
    """The transform of each segment, made when it is first asked for."""

    def __init__(self, avatar: Avatar, bodies: Skeletons) -> None:
        self._c, self._t = bodies.canonical, bodies.joints
        self._vertices = avatar.vertices.astype(np.float64)
        self._points = bodies.points
        self._avatar_region = _dominant(bodies.avatar_shares)
        self._target_region = _dominant(bodies.target_shares)
        self._made: dict[str, F64] = {}
        self._turns: dict[str, F64] = {}
        self._makers: dict[str, Callable[[str], tuple[F64, F64]]] = {
            "torso": self._torso,
            "neck": self._neck,
            "head": self._head,
            "girdle": self._girdle,
            "hand": self._hand,
            "foot": self._foot,
        }

    def matrix_of_bone(self, bone: str) -> F64:
        region = region_of(bone)
        stem, _, side = region.partition(".")
        if bone.startswith("neck"):
            return self._matrix("neck")
        if bone.startswith(("clavicle", "shoulder")):
            return self._matrix(f"girdle.{bone[-1]}")
        if stem.startswith("finger"):
            return self._finger(bone)
        if bone.startswith("lowerarm02"):
            return self._twisted(side)
        return self._matrix(region)

    def _matrix(self, name: str) -> F64:
        if name not in self._made:
            stem, _, side = name.partition(".")
            turn, matrix = self._makers.get(stem, self._limb)(name if stem in _ENDS else side)
            self._turns[name], self._made[name] = turn, matrix
        return self._made[name]

    def _turn(self, name: str) -> F64:
        self._matrix(name)
        return self._turns[name]

    def _skins(self, region: str) -> tuple[F64, F64]:
        """Vertices of both bodies in one region."""
        number = REGIONS.index(region)
        return (
            self._vertices[self._avatar_region == number],
            self._points[self._target_region == number],
        )

    def _torso(self, _side: str) -> tuple[F64, F64]:
        def frame(at: Mapping[str, F64]) -> tuple[F64, F64, float]:
            hips = (at["hip.L"] + at["hip.R"]) / 2
            up = (at["shoulder.L"] + at["shoulder.R"]) / 2 - hips
            left = at["hip.L"] - at["hip.R"] + at["shoulder.L"] - at["shoulder.R"]
            z = up / np.linalg.norm(up)
            left = left - (left @ z) * z
            x = left / np.linalg.norm(left)
            return np.column_stack((x, np.cross(z, x), z)), hips, float(np.linalg.norm(up))

        (old, old_hips, old_up), (new, new_hips, new_up) = frame(self._c), frame(self._t)
        mine, theirs = self._skins("torso")
        old_size = np.std((mine - old_hips) @ old, axis=0)
        new_size = np.std((theirs - new_hips) @ new, axis=0) if len(theirs) > 10 else old_size
        scale = np.clip(new_size / old_size, 0.7, 1.6)
        scale[2] = new_up / old_up
        return _affine(new @ old.T, new @ np.diag(scale) @ old.T, old_hips, new_hips)

    def _neck(self, _side: str) -> tuple[F64, F64]:
        # Rigs disagree on where a neck begins and ends; the skin on either side of it does not.
        start, end = self._c["neck"], self._c["head"]
        new_start = _apply(self._matrix("torso"), start)
        new_end = _apply(self._matrix("head"), end)
        girth = float(np.cbrt(np.linalg.det(self._matrix("head")[:3, :3])))
        return self._stretched(self._turn("torso"), start, end, new_start, new_end, girth)

    def _head(self, _side: str) -> tuple[F64, F64]:
        """Heads are upright; the skull above the ears tells size and place, whatever the rig."""
        mine, theirs = self._skins("head")
        if len(theirs) <= 10:
            return self._turn("torso"), self._matrix("torso")
        top, new_top = mine[:, 2].max(), theirs[:, 2].max()
        skull = mine[mine[:, 2] > top - _SKULL_M]
        scale = np.ones(2)
        for _ in range(8):  # the larger the head, the more of it is skull
            new_skull = theirs[theirs[:, 2] > new_top - _SKULL_M * scale.mean()]
            scale = np.clip(np.ptp(new_skull[:, :2], axis=0) / np.ptp(skull[:, :2], axis=0), 0.6, 2)
        low, high = _extent(skull)
        new_low, new_high = _extent(new_skull)
        old, new = (low + high) / 2, (new_low + new_high) / 2
        old[2], new[2] = top, new_top
        return _affine(np.eye(3), np.diag([*scale, scale.mean()]), old, new)

    def _girdle(self, side: str) -> tuple[F64, F64]:
        start = self._c[f"clavicle.{side}"]
        end = self._t[f"shoulder.{side}"]
        return self._stretched(
            self._turn("torso"),
            start,
            self._c[f"shoulder.{side}"],
            _apply(self._matrix("torso"), start),
            end,
            1.0,
        )

    def _limb(self, name: str) -> tuple[F64, F64]:
        stem, _, side = name.partition(".")
        parent, start, end = _ENDS[stem]
        above = parent if parent == "torso" else f"{parent}.{side}"
        start, end = f"{start}.{side}", f"{end}.{side}"
        if start not in self._t:
            return self._turn(above), self._matrix(above)
        if end not in self._t:
            return self._rigid(above, start)
        return self._between(above, start, end, self._girth(name, start, end))

    def _hand(self, side: str) -> tuple[F64, F64]:
        forearm, wrist = f"forearm.{side}", f"wrist.{side}"
        if wrist not in self._t:
            return self._turn(forearm), self._matrix(forearm)
        knuckles = [f"finger{k}-1.{side}" for k in range(2, 6)]
        known = [joint for joint in knuckles if joint in self._t]
        if len(known) < 2:
            return self._mitten(forearm, wrist, f"hand.{side}")
        old_mid = np.mean([self._c[joint] for joint in known], axis=0)
        new_mid = np.mean([self._t[joint] for joint in known], axis=0)
        old = _frame(old_mid - self._c[wrist], self._c[known[0]] - self._c[known[-1]])
        new = _frame(new_mid - self._t[wrist], self._t[known[0]] - self._t[known[-1]])
        length = np.linalg.norm(new_mid - self._t[wrist]) / np.linalg.norm(old_mid - self._c[wrist])
        across = np.linalg.norm(self._t[known[0]] - self._t[known[-1]]) / np.linalg.norm(
            self._c[known[0]] - self._c[known[-1]]
        )
        scale = np.clip([length, across, np.sqrt(length * across)], *_GIRTHS)
        return _affine(new @ old.T, new @ np.diag(scale) @ old.T, self._c[wrist], self._t[wrist])

    def _finger(self, bone: str) -> F64:
        """A phalanx; one that the rig does not have moves with the one before it."""
        if bone not in self._made:
            stem, _, side = bone.partition(".")
            finger, phalanx = stem[:-2], int(stem[-1])
            chain = [
                f"{finger}-{k}.{side}" for k in range(1, 4) if f"{finger}-{k}.{side}" in self._t
            ]
            before = [joint for joint in chain if int(joint[-3]) < phalanx]
            parent = before[-1] if before else f"hand.{side}"
            if before:
                self._finger(parent)
            else:
                self._matrix(parent)
            if bone not in self._t:
                made = self._turns[parent], self._made[parent]
            elif bone == chain[-1]:
                made = self._by_extent(parent, bone, f"{finger}.{side}")
            else:
                after = chain[chain.index(bone) + 1]
                made = self._between(parent, bone, after, self._girth(f"{finger}.{side}"))
            self._turns[bone], self._made[bone] = made
        return self._made[bone]

    def _foot(self, side: str) -> tuple[F64, F64]:
        """Feet stand flat: turned about the upright only, and sized by their soles' extent."""
        ankle, ball, region = f"ankle.{side}", f"ball.{side}", f"foot.{side}"
        leg = f"lowerleg.{side}"
        if ankle not in self._t:
            return self._turn(leg), self._matrix(leg)
        mine, theirs = self._skins(region)
        if len(theirs) <= 10:
            return self._rigid(leg, ankle)
        if ball in self._t:
            old_way, new_way = self._c[ball] - self._c[ankle], self._t[ball] - self._t[ankle]
        else:
            old_way, new_way = (
                mine.mean(axis=0) - self._c[ankle],
                theirs.mean(axis=0) - self._t[ankle],
            )
        old, new = _frame(_UP, old_way), _frame(_UP, new_way)  # up, forward, sideways
        low, high = _extent((mine - self._c[ankle]) @ old)
        low_t, high_t = _extent((theirs - self._t[ankle]) @ new)
        scale = np.ones(3)
        scale[0] = low_t[0] / low[0]  # from the ankle to the sole
        scale[1:] = (high_t - low_t)[1:] / (high - low)[1:]
        scale = np.clip(scale, *_GIRTHS)
        linear = new @ np.diag(scale) @ old.T
        shift = np.zeros(3)
        shift[1:] = (high_t - scale * high)[1:]
        return _affine(new @ old.T, linear, self._c[ankle], self._t[ankle] + new @ shift)

    def _twisted(self, side: str) -> F64:
        """The lower forearm: half of the hand's twist, as the bones of a forearm cross."""
        forearm = self._matrix(f"forearm.{side}")
        if f"wrist.{side}" not in self._t:
            return forearm
        relative = self._turn(f"hand.{side}") @ self._turn(f"forearm.{side}").T
        axis = self._t[f"wrist.{side}"] - self._t[f"elbow.{side}"]
        axis /= np.linalg.norm(axis)
        twist = _twist_about(relative, axis)
        turn = _about(axis, twist / 2)
        matrix = np.eye(4)
        matrix[:3, :3] = turn
        matrix[:3, 3] = self._t[f"wrist.{side}"] - turn @ self._t[f"wrist.{side}"]
        return matrix @ forearm

    # Shapes of transforms

    def _rigid(self, parent: str, joint: str) -> tuple[F64, F64]:
        turn = self._turns.get(parent)
        turn = self._turn(parent) if turn is None else turn
        return _affine(turn, turn, self._c[joint], self._t[joint])

    def _between(self, parent: str, start: str, end: str, girth: float) -> tuple[F64, F64]:
        turn = self._turns[parent] if parent in self._turns else self._turn(parent)
        return self._stretched(
            turn, self._c[start], self._c[end], self._t[start], self._t[end], girth
        )

    def _stretched(
        self, turn: F64, start: F64, end: F64, new_start: F64, new_end: F64, girth: float
    ) -> tuple[F64, F64]:
        way, new_way = end - start, new_end - new_start
        length, new_length = np.linalg.norm(way), np.linalg.norm(new_way)
        if new_length < 1e-6:
            return _affine(turn, turn, start, new_start)
        axis = way / length
        turned = _least_turn(turn @ axis, new_way / new_length) @ turn
        along = np.outer(axis, axis)
        linear = turned @ (girth * (np.eye(3) - along) + new_length / length * along)
        return _affine(turned, linear, start, new_start)

    def _by_extent(self, parent: str, joint: str, region: str) -> tuple[F64, F64]:
        """The last bone of a limb: as long as the skin beyond its joint reaches."""
        turn = self._turns[parent]
        mine, theirs = self._skins(region)
        start, new_start = self._c[joint], self._t[joint]
        if len(theirs) <= 3:
            return self._rigid(parent, joint)
        # The tip: the mean of what reaches farthest from the joint, seen from the parent.
        tip = _tip(mine, start)
        new_tip = _tip(theirs, new_start)
        return self._stretched(turn, start, tip, new_start, new_tip, self._girth(region))

    def _mitten(self, parent: str, joint: str, region: str) -> tuple[F64, F64]:
        """A hand without knuckles: its broad side tells how it is turned."""
        turn, _ = self._by_extent(parent, joint, region)
        mine, theirs = self._skins(region)
        if len(theirs) <= 10:
            return self._rigid(parent, joint)
        frames, sizes = [], []
        for points, start, guess in (
            (mine, self._c[joint], None),
            (theirs, self._t[joint], turn),
        ):
            main = _tip(points, start) - start
            axis = main / np.linalg.norm(main)
            flat = points - start - np.outer((points - start) @ axis, axis)
            broad = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][0]
            if guess is not None and broad @ (guess @ frames[0][:, 1]) < 0.0:
                broad = -broad
            frame = _frame(main, broad)
            frames.append(frame)
            sizes.append([float(np.linalg.norm(main)), *np.std(points @ frame[:, 1:], axis=0)])
        old, new = frames
        scale = np.clip(np.divide(sizes[1], sizes[0]), *_GIRTHS)
        linear = new @ np.diag(scale) @ old.T
        return _affine(new @ old.T, linear, self._c[joint], self._t[joint])

    def _girth(self, region: str, start: str = "", end: str = "") -> float:
        """Ratio of how thick a region is about the line between two joints."""
        mine, theirs = self._skins(region)
        if len(theirs) <= 10:
            return 1.0
        if not start:
            spread, new_spread = (
                np.sqrt(
                    np.prod(
                        np.linalg.svd(p - p.mean(axis=0), compute_uv=False)[1:] / np.sqrt(len(p))
                    )
                )
                for p in (mine, theirs)
            )
            return float(np.clip(new_spread / spread, *_GIRTHS))
        radii = []
        for points, at in ((mine, self._c), (theirs, self._t)):
            way = at[end] - at[start]
            share = (points - at[start]) @ way / (way @ way)
            inner = (share > 0.2) & (share < 0.9)
            if np.count_nonzero(inner) <= 10:
                return 1.0
            across = points[inner] - at[start] - share[inner, None] * way
            radii.append(float(np.median(np.linalg.norm(across, axis=1))))
        return float(np.clip(radii[1] / radii[0], *_GIRTHS))


_ENDS: Final = {
    "upperarm": ("girdle", "shoulder", "elbow"),
    "forearm": ("upperarm", "elbow", "wrist"),
    "upperleg": ("torso", "hip", "knee"),
    "lowerleg": ("upperleg", "knee", "ankle"),
}
"""Parent, first and last joint of the long segments."""


def _dominant(shares: F64) -> I64:
    found: I64 = np.where(shares.max(axis=1) > 0.0, shares.argmax(axis=1), -1)
    return found


def _affine(turn: F64, linear: F64, start: F64, new_start: F64) -> tuple[F64, F64]:
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = new_start - linear @ start
    return turn, matrix


def _frame(main: F64, other: F64) -> F64:
    """Right-handed axes: along ``main``, towards ``other``, and across; as columns."""
    x = main / np.linalg.norm(main)
    y = other - (other @ x) * x
    y = y / np.linalg.norm(y)
    return np.column_stack((x, y, np.cross(x, y)))


def _least_turn(one: F64, other: F64) -> F64:
    """The smallest turn that takes one unit vector to another."""
    axis = np.cross(one, other)
    sine, cosine = np.linalg.norm(axis), one @ other
    if sine < 1e-12:
        if cosine > 0.0:
            return np.eye(3)
        axis = np.cross(one, np.eye(3)[np.argmin(np.abs(one))])
        return _about(axis / np.linalg.norm(axis), np.pi)
    return _about(axis / sine, float(np.arctan2(sine, cosine)))


def _about(axis: F64, angle: float) -> F64:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: F64 = (
        np.cos(angle) * np.eye(3)
        + np.sin(angle) * cross
        + (1.0 - np.cos(angle)) * np.outer(axis, axis)
    )
    return turn


def _twist_about(turn: F64, axis: F64) -> float:
    """Angle of the part of a turn that goes about an axis, after its swing is taken off."""
    swing = _least_turn(axis, turn @ axis)
    rest = swing.T @ turn
    sine = axis @ np.array(
        [rest[2, 1] - rest[1, 2], rest[0, 2] - rest[2, 0], rest[1, 0] - rest[0, 1]]
    )
    return float(np.arctan2(sine / 2, (np.trace(rest) - 1.0) / 2))


def _extent(points: F64) -> tuple[F64, F64]:
    return points.min(axis=0), points.max(axis=0)


def _tip(points: F64, start: F64) -> F64:
    """Where a limb ends: the middle of the skin that is farthest from its last joint."""
    far = np.linalg.norm(points - start, axis=1)
    tip: F64 = points[far >= 0.93 * far.max()].mean(axis=0)
    return tip
