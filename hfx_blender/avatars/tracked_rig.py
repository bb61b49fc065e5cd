# SPDX-License-Identifier: GPL-3.0-or-later
"""Pose of a body's rig from the bones of a tracked person, and the pose before.

Bones of the person have Unity's ``HumanBodyBones`` names and rotations relative to a T-pose, in the
person's axes: X to the left, Y to the back, Z up. Arms of a rig at rest in another pose are turned
to the T-pose first. Rotations are copied; only the hips move, scaled to the rig's hip height.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import bpy
from mathutils import Matrix, Quaternion, Vector

from ..engine.body.rigs.vocabulary import FINGERS
from ..errors import InputError
from ..tracking.vmc_body import PARENTS

POSE_BEFORE: Final = "hfx_pose_before"
"""ID property of a tracked armature: channels of the pose before, and muted constraints. The
property is part of saved files and undo steps, from which the pose is restored as well."""

_CHANNELS: Final = {
    **{"location": 3, "rotation_quaternion": 4, "rotation_euler": 3},
    **{"rotation_axis_angle": 4, "scale": 3},
}
_SPINES: Final = ("Spine", "Chest", "UpperChest")
_HIP_HEIGHT_M: Final = 0.95  # of a person whose first height is no height of a standing person
_STANDING_M: Final = (0.4, 1.5)  # plausible hip heights
_ALIGNED: Final = 0.96  # cosine; axes of a rig within 16 degrees of an axis of the armature


def _human_bones() -> dict[str, str]:
    """Human bone by canonical bone, without the spine."""
    human = {"root": "Hips", "neck01": "Neck", "neck02": "Neck", "neck03": "Neck", "head": "Head"}
    human["jaw"] = "Jaw"
    pairs = {"clavicle": "Shoulder", "shoulder01": "Shoulder", "upperarm01": "UpperArm"}
    pairs |= {"lowerarm01": "LowerArm", "wrist": "Hand", "eye": "Eye", "foot": "Foot"}
    pairs |= {"upperleg01": "UpperLeg", "lowerleg01": "LowerLeg"}
    pairs |= {f"toe{number}-1": "Toes" for number in range(1, 6)}
    for number, finger in enumerate(FINGERS, 1):
        name = "Little" if finger == "pinky" else finger.title()
        for joint, part in enumerate(("Proximal", "Intermediate", "Distal"), 1):
            pairs[f"finger{number}-{joint}"] = f"{name}{part}"
    for letter, side in (("L", "Left"), ("R", "Right")):
        human |= {f"{bone}.{letter}": side + part for bone, part in pairs.items()}
    return human


_HUMAN: Final = _human_bones()


@dataclass(frozen=True)
class HumanPose:
    """Bones of a tracked person at one time."""

    rotations: Mapping[str, Quaternion]  # local, relative to the T-pose; missing: none
    hips_m: Vector | None = None  # position of the hips, metres; None: unknown


@dataclass(eq=False)
class _Step:
    """Pose bone on the way from the top of the rig to a tracked bone."""

    name: str
    parent: int  # index of the parent's step; -1 at the top
    relative: Matrix  # (4, 4) rest pose in the parent's rest pose
    rest: Quaternion  # rest rotation, armature space
    basis: Matrix  # (4, 4) of the pose before
    turns: bool  # inherits the parent's rotation
    human: str = ""  # tracked bone; "": keeps the pose before
    correction: Quaternion | None = None  # rest pose to T-pose, armature space
    fixed: Matrix | None = None  # (4, 4) pose of an untracked bone with constraints


class TrackedRig:
    """Rig of a haptic body that takes poses of a person. Raises InputError: no human bones are
    known, or neither both thighs nor both upper arms are."""

    def __init__(self, armature: bpy.types.Object) -> None:
        from . import bone_table  # loads numpy, not needed before a body is tracked

        self._bones = bone_table.mapping_of(armature).bones
        human = {bone: _HUMAN[joint] for joint, bone in self._bones.items() if joint in _HUMAN}
        # From below: the highest bone of the spine follows the highest tracked part.
        spine = [f"spine{k:02d}" for k in range(5, 0, -1) if f"spine{k:02d}" in self._bones]
        for k, joint in enumerate(spine, 1):
            human[self._bones[joint]] = _SPINES[-(-k * len(_SPINES) // len(spine)) - 1]
        between = {up.name for name in human for up in armature.data.bones[name].parent_recursive}
        for bone in armature.pose.bones:
            # Segments of a limb, as Rigify's, that constraints would hold at the control bones.
            above = human.get(bone.parent.name, "") if bone.parent and bone.constraints else ""
            if above and bone.name in between:
                human.setdefault(bone.name, above)
        self.names = tuple(name for name in armature.pose.bones.keys() if name in human)
        self._axes = self._axes_of(armature)
        corrections = self._arm_corrections(armature)
        self._steps = self._steps_of(armature, human, corrections)
        self._hip_scale: float | None = None  # set by the first pose
        self._first_m = Vector()

    def _head(self, armature: bpy.types.Object, joint: str) -> Vector | None:
        """Rest head of a canonical bone, armature space; None without a bone."""
        bone = self._bones.get(joint)
        return None if bone is None else armature.data.bones[bone].head_local

    def _axes_of(self, armature: bpy.types.Object) -> Quaternion:
        """Rotation from the person's axes to armature space."""
        for joint in ("upperleg01", "upperarm01", "clavicle"):
            left, right = (self._head(armature, f"{joint}.{side}") for side in "LR")
            if left is not None and right is not None:
                break
        else:
            raise InputError(
                f"Armature '{armature.name}': tracking needs both thighs or both upper arms; "
                "assign them under Bones."
            )
        low = self._head(armature, "root") or (left + right) / 2.0
        high = self._head(armature, "head") or self._head(armature, "neck01")
        side, up = _snapped(left - right), _snapped((high or low + Vector((0, 0, 1))) - low)
        up = (up - side * up.dot(side)).normalized()
        return Matrix((side, up.cross(side), up)).transposed().to_quaternion()

    def _arm_corrections(self, armature: bpy.types.Object) -> dict[str, Quaternion]:
        """Rotation of each arm bone from rest pose to T-pose, armature space, by human bone."""
        corrections = {}
        for letter, side, sign in (("L", "Left", 1.0), ("R", "Right", -1.0)):
            outwards = self._axes @ Vector((sign, 0.0, 0.0))
            chain = [f"{bone}.{letter}" for bone in ("upperarm01", "lowerarm01", "wrist")]
            heads = [self._head(armature, joint) for joint in (*chain, f"finger3-1.{letter}")]
            turn = Quaternion()
            for k, part in enumerate(("UpperArm", "LowerArm", "Hand")):
                first, second = heads[k], heads[k + 1]
                # A joint without a bone beyond it keeps the turn of the joint above.
                if first is not None and second is not None and (second - first).length > 0.0:
                    turn = (second - first).rotation_difference(outwards)
                corrections[side + part] = turn
            for name in PARENTS:
                if name.startswith(side) and name.endswith(("Proximal", "Intermediate", "Distal")):
                    corrections[name] = turn
        return corrections

    def _steps_of(
        self,
        armature: bpy.types.Object,
        human: Mapping[str, str],
        corrections: Mapping[str, Quaternion],
    ) -> list[_Step]:
        """Tracked bones and their ancestors, parents first."""
        needed: set[str] = set()
        for name in self.names:
            bone = armature.data.bones[name]
            needed |= {name, *(above.name for above in bone.parent_recursive)}
        steps: list[_Step] = []
        indices: dict[str, int] = {}
        for pose_bone in armature.pose.bones:
            name, bone = pose_bone.name, pose_bone.bone
            if name not in needed:
                continue
            rest, parent = bone.matrix_local, bone.parent
            relative = rest if parent is None else parent.matrix_local.inverted() @ rest
            tracked = human.get(name, "")
            is_fixed = not tracked and any(not c.mute for c in pose_bone.constraints)
            indices[name] = len(steps)
            steps.append(
                _Step(
                    name,
                    -1 if parent is None else indices[parent.name],
                    relative.copy(),
                    rest.to_quaternion(),
                    pose_bone.matrix_basis.copy(),
                    bone.use_inherit_rotation,
                    tracked,
                    corrections.get(tracked),
                    pose_bone.matrix.copy() if is_fixed else None,
                )
            )
        return steps

    def bases(self, pose: HumanPose, armature: bpy.types.Object) -> list[Matrix]:
        """Basis matrix (4, 4) of each bone of ``names`` that gives the rig a person's pose. The
        armature is not changed. The first position sets the scale of the hips' motion."""
        turns = self._turns(pose)
        offset = self._hips_offset(pose, armature)
        placed: list[Matrix] = []
        bases = []
        for step in self._steps:
            inherited = step.relative
            if step.parent >= 0:
                inherited = placed[step.parent] @ step.relative
            if not step.turns:
                inherited = Matrix.LocRotScale(inherited.to_translation(), step.rest, None)
            if not step.human:
                placed.append(inherited @ step.basis if step.fixed is None else step.fixed)
                continue
            turn = turns[step.human]
            if step.correction is not None:
                turn = turn @ step.correction
            own = inherited.to_quaternion().inverted() @ (turn @ step.rest)
            place, _, scale = step.basis.decompose()
            if step.human == "Hips" and offset is not None:
                place = inherited.to_3x3().inverted_safe() @ offset
            basis = Matrix.LocRotScale(place, own, scale)
            placed.append(inherited @ basis)
            bases.append(basis)
        return bases

    def _turns(self, pose: HumanPose) -> dict[str, Quaternion]:
        """Rotation of each human bone from the T-pose, armature space."""
        whole: dict[str, Quaternion] = {"": Quaternion()}
        axes, back = self._axes, self._axes.inverted()
        turns = {}
        for name, parent in PARENTS.items():
            local = pose.rotations.get(name)
            whole[name] = whole[parent] if local is None else whole[parent] @ local
            turns[name] = axes @ whole[name] @ back
        return turns

    def _hips_offset(self, pose: HumanPose, armature: bpy.types.Object) -> Vector | None:
        """Motion of the hips since the first pose, armature space; None without a position."""
        if pose.hips_m is None:
            return None
        if self._hip_scale is None:
            self._first_m = pose.hips_m.copy()
            low, high = _STANDING_M
            person_m = self._first_m.z if low < self._first_m.z < high else _HIP_HEIGHT_M
            up = self._axes @ Vector((0.0, 0.0, 1.0))
            names = [self._bones.get(f"foot.{side}") for side in "LR"]
            feet = [armature.data.bones[name] for name in names if name is not None]
            soles = [end.dot(up) for foot in feet for end in (foot.head_local, foot.tail_local)]
            hips = self._head(armature, "root")
            is_known = hips is not None and soles
            self._hip_scale = (hips.dot(up) - min(soles)) / person_m if is_known else 1.0
        return self._axes @ ((pose.hips_m - self._first_m) * self._hip_scale)

    def apply(self, bases: Iterable[Matrix], armature: bpy.types.Object) -> None:
        """Set the pose bones of ``names`` to basis matrices of :meth:`bases`. InputError for a bone
        that was deleted or renamed meanwhile."""
        bones = armature.pose.bones
        for name, basis in zip(self.names, bases, strict=True):
            bone = bones.get(name)
            if bone is None:
                raise InputError(f"Armature '{armature.name}': bone '{name}' is missing now.")
            bone.matrix_basis = basis


def _snapped(direction: Vector) -> Vector:
    """Unit vector of a direction: the nearest axis within 16 degrees, else the direction."""
    unit = direction.normalized()
    axis = max(range(3), key=lambda k: abs(unit[k]))
    if abs(unit[axis]) < _ALIGNED:
        return unit
    nearest = Vector()
    nearest[axis] = 1.0 if unit[axis] > 0.0 else -1.0
    return nearest


def keep_pose(armature: bpy.types.Object, names: Iterable[str]) -> None:
    """Store the pose of bones on the armature, and mute their constraints, which would move the
    bones elsewhere; undone by :func:`restore_pose`. A stored pose is kept."""
    if POSE_BEFORE in armature:
        return
    bones = [armature.pose.bones[name] for name in names]
    muted = [(b.name, c.name) for b in bones for c in b.constraints if not c.mute]
    channels = [v for bone in bones for name in _CHANNELS for v in getattr(bone, name)]
    armature[POSE_BEFORE] = {
        "bones": "\n".join(bone.name for bone in bones),
        "channels": channels,
        "muted": "\n".join("\t".join(pair) for pair in muted),
    }
    for bone, constraint in muted:
        armature.pose.bones[bone].constraints[constraint].mute = True


def restore_pose(armature: bpy.types.Object) -> None:
    """Restore the pose of :func:`keep_pose` and remove it; no effect without a stored pose. Bones
    and constraints that are missing now are left out."""
    stored: Any = armature.get(POSE_BEFORE)
    if stored is None:
        return
    values = iter(list(stored["channels"]))
    for name in stored["bones"].split("\n"):
        channels = {key: [next(values) for _ in range(n)] for key, n in _CHANNELS.items()}
        bone = armature.pose.bones.get(name)
        for key, channel in channels.items() if bone is not None else ():
            setattr(bone, key, channel)
    for line in filter(None, stored["muted"].split("\n")):
        name, constraint = line.split("\t", 1)
        bone = armature.pose.bones.get(name)
        if bone is not None and constraint in bone.constraints:
            bone.constraints[constraint].mute = False
    del armature[POSE_BEFORE]
    armature.update_tag()
