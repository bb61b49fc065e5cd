# SPDX-License-Identifier: GPL-3.0-or-later
"""Pose of a clip's body from the bones of a tracked person.

Rotations are copied and only the hips move, scaled by the length of the legs, so that persons of
any size fit. Bones of the person are relative to a T-pose; arms of a clip at rest in another pose
are turned to the T-pose first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from hfx_blender.tracking.vmc_body import PARENTS, ROOT, BonePose, VmcBody

F64 = npt.NDArray[np.float64]

_THUMBS: Final = {  # Unity's names of VRM's thumbs
    f"{side}Thumb{vrm}": f"{side}Thumb{unity}"
    for side in ("Left", "Right")
    for vrm, unity in (
        ("Metacarpal", "Proximal"),
        ("Proximal", "Intermediate"),
        ("Distal", "Distal"),
    )
}
_FINGERS: Final = ("Thumb", "Index", "Middle", "Ring", "Little")
_ALIGNED: Final = 0.9  # cosine within which an axis of the rest pose counts as an axis of space


def unity_name(vrm: str) -> str:
    """Unity's name of VRM's human bone, as ``LeftUpperArm`` of ``leftUpperArm``."""
    name = vrm[:1].upper() + vrm[1:]
    return _THUMBS.get(name, name)


class AvatarPose:
    """Bones of a clip's body that follow a tracked person.

    ``humans``: VRM's human bone of each bone; may be empty or repeated.
    ``parents``: index of each bone's parent, below the bone's own; -1: none.
    ``rest``: (bones, 3, 4) bone to rest space; all zeros: unknown.
    ``place_m``: place (3,) of the tracked room's origin in the world.
    """

    def __init__(
        self, humans: Sequence[str], parents: Sequence[int], rest: F64, place_m: F64 | None = None
    ) -> None:
        self._place_m = np.zeros(3) if place_m is None else place_m
        self._humans = [unity_name(human) for human in humans]
        self._parents = parents
        known = rest[:, :, :3].any(axis=(1, 2))
        self._heads = rest[:, :, 3]
        # A bone of unknown place moves with its parent.
        self._humans = [
            human if human in PARENTS and ok else ""
            for human, ok in zip(self._humans, known, strict=True)
        ]
        self._first = {human: k for k, human in reversed(list(enumerate(self._humans))) if human}
        self._axes = self._axes_of_rest()
        self._corrections = self._arm_corrections()
        self._leg_m = self._leg_length([self._head("UpperLeg"), self._head("LowerLeg")])

    def matrices(self, person: VmcBody) -> F64:
        """Matrices (bones, 3, 4) from rest space to the world; the rest pose without any bone. A
        headset turns a head without a bone; without hips the body stands below the headset."""
        world, hips_m = _world_rotations(person)
        turned = {h: self._axes @ world[h] @ self._axes.T @ self._corrections[h] for h in world}
        count = len(self._humans)
        rotations, heads = np.empty((count, 3, 3)), np.empty((count, 3))
        for k, (human, parent) in enumerate(zip(self._humans, self._parents, strict=True)):
            if parent >= 0:
                rotations[k] = turned[human] if human else rotations[parent]
                relative = self._heads[k] - self._heads[parent]
                heads[k] = heads[parent] + rotations[parent] @ relative
            else:
                rotations[k] = turned[human or "Hips"]
                heads[k] = self._heads[k]
        self._move_hips(heads, hips_m, person)
        headset, head = _headset(person), self._first.get("Head")
        if hips_m is None and headset is not None and head is not None:
            heads += self._axes @ np.array(headset.position_m) - heads[head]
        heads += self._place_m
        shifts = heads - np.einsum("kij,kj->ki", rotations, self._heads)
        return np.concatenate([rotations, shifts[:, :, None]], axis=2)

    def listener(self, matrices: F64) -> F64:
        """Rigid matrix (3, 4) from the world to the head: X front, Y left, Z up, origin at the
        head's joint, of the hips for a body without a head; ``matrices`` of :meth:`matrices`."""
        k = self._first.get("Head", self._first.get("Hips", 0))
        rotation, shift = matrices[k, :, :3], matrices[k, :, 3]
        # Columns of the axes are left, back and up of the body at rest.
        left, back, up = self._axes.T
        turn = np.stack([-back, left, up]) @ rotation.T
        return np.column_stack([turn, -turn @ (rotation @ self._heads[k] + shift)])

    def _move_hips(self, heads: F64, hips_m: F64 | None, person: VmcBody) -> None:
        """Move all heads so that the hips are at the person's, in place; None leaves the heads."""
        hips = self._first.get("Hips")
        if hips is None or hips_m is None:
            return
        tracked_m = self._leg_length_of(person)
        scale = self._leg_m / tracked_m if self._leg_m and tracked_m else 1.0
        heads += self._axes @ hips_m * scale - heads[hips]

    def _head(self, bone: str, side: str = "Left") -> F64 | None:
        """Rest head of a human bone; None where the body has none."""
        k = self._first.get(side + bone)
        return None if k is None else self._heads[k]

    def _axes_of_rest(self) -> F64:
        """Rotation (3, 3) from the person's axes (left, back, up) to rest space; identity where the
        body has no pair of thighs or arms."""
        for bone in ("UpperLeg", "UpperArm", "Shoulder"):
            left, right = self._head(bone), self._head(bone, "Right")
            top, hips = self._first.get("Head"), self._first.get("Hips")
            if left is None or right is None or top is None or hips is None:
                continue
            x = _snapped(left - right)
            z = _snapped(self._heads[top] - self._heads[hips])
            if x is not None and z is not None and abs(x @ z) < 0.5:
                return np.stack([x, np.cross(z, x), z], axis=1)
        return np.eye(3)

    def _arm_corrections(self) -> dict[str, F64]:
        """Rotation (3, 3) in rest space from the rest pose to the T-pose, for each human bone."""
        corrections: dict[str, F64] = {}
        for bone, parent in PARENTS.items():
            corrections[bone] = np.eye(3)
            side = "Right" if bone.startswith("Right") else "Left"
            part = bone.removeprefix(side)
            if part in ("UpperArm", "LowerArm"):
                head = self._head(part, side)
                end = self._head({"UpperArm": "LowerArm", "LowerArm": "Hand"}[part], side)
                if head is not None and end is not None:
                    outward = self._axes[:, 0] * (1.0 if side == "Left" else -1.0)
                    corrections[bone] = _rotation_between(end - head, outward)
            elif part == "Hand" or part.startswith(_FINGERS):
                corrections[bone] = corrections[parent]
        return corrections

    def _leg_length(self, heads: Sequence[F64 | None]) -> float:
        """Length of thigh and shin of the left leg at rest, metres; 0: unknown."""
        points = [*heads, self._head("Foot")]
        if any(point is None for point in points):
            return 0.0
        steps = np.diff(np.array(points), axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())

    def _leg_length_of(self, person: VmcBody) -> float:
        """Length of the person's left thigh and shin, metres; 0: unknown."""
        bones = [person.poses.get(name) for name in ("LeftLowerLeg", "LeftFoot")]
        return sum(float(np.linalg.norm(bone.position_m)) if bone else 0.0 for bone in bones)


def _world_rotations(person: VmcBody) -> tuple[dict[str, F64], F64 | None]:
    """Rotation (3, 3) of each human bone from the T-pose, in the person's axes, and the position of
    the hips, metres; None without the hips. A bone not received turns with its parent."""
    still = BonePose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    poses = person.poses
    root = poses.get(ROOT, still)
    top, headset = _matrix(root.rotation), _headset(person)
    head = None if headset is None or "Head" in poses else _matrix(headset.rotation)
    if head is not None and "Hips" not in poses:
        top = _heading(head)
    world: dict[str, F64] = {}
    for bone, parent in PARENTS.items():
        above = world[parent] if parent else top
        world[bone] = above @ _matrix(poses[bone].rotation) if bone in poses else above
        if bone == "Head" and head is not None:
            world[bone] = head
    if "Hips" not in poses:
        return world, None
    return world, top @ np.array(poses["Hips"].position_m) + np.array(root.position_m)


def _headset(person: VmcBody) -> BonePose | None:
    """Pose of the first headset in the world; None without a headset."""
    return next((pose for (kind, _), pose in person.devices.items() if kind == "Hmd"), None)


def _heading(turn: F64) -> F64:
    """Rotation (3, 3) about Z to the heading of a rotation of a body that faces -Y at rest."""
    x, y, _ = -turn[:, 1]
    length = float(np.hypot(x, y))  # 0 for a look straight up or down
    sine, cosine = (x / length, -y / length) if length > 1e-9 else (0.0, 1.0)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _matrix(rotation: tuple[float, float, float, float]) -> F64:
    """Rotation matrix (3, 3) of a unit quaternion w, x, y, z."""
    w, x, y, z = rotation
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _snapped(direction: F64) -> F64 | None:
    """Axis of space nearest to a direction; the unit direction beyond 26 degrees; None for 0."""
    length = float(np.linalg.norm(direction))
    if not length:
        return None
    unit = direction / length
    k = int(np.argmax(abs(unit)))
    return np.sign(unit[k]) * np.eye(3)[k] if abs(unit[k]) >= _ALIGNED else unit


def _rotation_between(start: F64, end: F64) -> F64:
    """Smallest rotation (3, 3) from one direction to another; identity for opposite ones or 0."""
    lengths = float(np.linalg.norm(start) * np.linalg.norm(end))
    if not lengths or start @ end <= -0.999 * lengths:
        return np.eye(3)
    # Rodrigues: I + [v] + [v]^2 / (1 + c), with v the cross product and c the cosine.
    x, y, z = np.cross(start, end) / lengths
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + skew + skew @ skew / (1.0 + start @ end / lengths)
