# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig takes poses of a tracked person: directions of limbs are known by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import bpy
import pytest
from mathutils import Euler, Matrix, Quaternion, Vector

from hfx_blender.avatars.tracked_action import RigRecording
from hfx_blender.avatars.tracked_rig import (
    POSE_BEFORE,
    HumanPose,
    TrackedRig,
    keep_pose,
    restore_pose,
)
from hfx_blender.blender import compat
from hfx_blender.errors import InputError

LEFT, BACK, UP = Vector((1, 0, 0)), Vector((0, 1, 0)), Vector((0, 0, 1))
FRONT, DOWN = -BACK, -UP
CHANNELS = "location rotation_quaternion rotation_euler rotation_axis_angle scale".split()


@pytest.fixture
def avatar(scene: Any) -> bpy.types.Object:
    bpy.ops.hfx.add_avatar()
    return bpy.context.object


def mixamo_rig() -> bpy.types.Object:
    """Rig as Mixamo's files are imported: centimetres, Y up, rotated upright by the object; arms
    hang down by 45 degrees, the spine is a single bone."""
    data = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", data)
    bpy.context.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    points = {
        "Hips": ((0, 100, 0), (0, 110, 0), None),
        "Spine": ((0, 110, 0), (0, 140, 0), "Hips"),
        "Neck": ((0, 150, 0), (0, 160, 0), "Spine"),
        "Head": ((0, 160, 0), (0, 180, 0), "Neck"),
    }
    for sign, side in ((1, "Left"), (-1, "Right")):
        points |= {
            f"{side}Arm": ((sign * 20, 145, 0), (sign * 40, 125, 0), "Spine"),
            f"{side}ForeArm": ((sign * 40, 125, 0), (sign * 60, 105, 0), f"{side}Arm"),
            f"{side}Hand": ((sign * 60, 105, 0), (sign * 65, 100, 0), f"{side}ForeArm"),
            f"{side}UpLeg": ((sign * 10, 95, 0), (sign * 10, 50, 0), "Hips"),
            f"{side}Leg": ((sign * 10, 50, 0), (sign * 10, 8, 0), f"{side}UpLeg"),
            f"{side}Foot": ((sign * 10, 8, 0), (sign * 10, 0, 10), f"{side}Leg"),
        }
    for name, (head, tail, parent) in points.items():
        bone = data.edit_bones.new(f"mixamorig:{name}")
        bone.head, bone.tail, bone.roll = head, tail, 0.3
        bone.parent = data.edit_bones.get(f"mixamorig:{parent}")
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.matrix_world = Matrix.Scale(0.01, 4) @ Euler((math.pi / 2, 0, 0)).to_matrix().to_4x4()
    bpy.context.view_layer.update()
    return rig


def pose(rig: bpy.types.Object, hips_m: Vector | None = None, **rotations: Quaternion) -> None:
    tracked = TrackedRig(rig)
    shown = HumanPose(rotations, hips_m)
    tracked.apply(tracked.bases(shown, rig), rig)
    bpy.context.view_layer.update()


def direction(rig: bpy.types.Object, first: str, second: str) -> Vector:
    """Unit vector between the heads of two posed bones, world space."""
    bones = rig.pose.bones
    return (rig.matrix_world.to_3x3() @ (bones[second].head - bones[first].head)).normalized()


RIGS: dict[str, tuple[Callable[[], bpy.types.Object], dict[str, str]]] = {
    "haptic avatar": (
        lambda: bpy.context.object,
        {
            "arm": "upperarm01.L",
            "forearm": "lowerarm01.L",
            "hand": "wrist.L",
            "thigh": "upperleg01.R",
            "shin": "lowerleg01.R",
        },
    ),
    "mixamo": (
        mixamo_rig,
        {
            "arm": "mixamorig:LeftArm",
            "forearm": "mixamorig:LeftForeArm",
            "hand": "mixamorig:LeftHand",
            "thigh": "mixamorig:RightUpLeg",
            "shin": "mixamorig:RightLeg",
        },
    ),
}


@pytest.fixture(params=list(RIGS))
def rig(request: pytest.FixtureRequest, avatar: Any) -> tuple[bpy.types.Object, dict[str, str]]:
    make, names = RIGS[request.param]
    return make(), names


def test_the_t_pose_and_turned_limbs_point_where_the_person_points(rig: Any) -> None:
    armature, bone = rig

    def arm() -> Vector:
        return direction(armature, bone["arm"], bone["forearm"])

    def forearm() -> Vector:
        return direction(armature, bone["forearm"], bone["hand"])

    pose(armature)
    assert (arm() - LEFT).length < 1e-3 and (forearm() - LEFT).length < 1e-3
    # Around the axis to the back, +90 degrees turn the left into down.
    pose(armature, LeftUpperArm=Quaternion(BACK, math.pi / 2))
    assert (arm() - DOWN).length < 1e-3 and (forearm() - DOWN).length < 1e-3
    # A forearm to the front, on an arm that hangs down: in the T-pose, around the axis to the back
    # comes last.
    pose(
        armature,
        LeftUpperArm=Quaternion(BACK, math.pi / 2),
        LeftLowerArm=Quaternion(UP, -math.pi / 2),
    )
    assert (arm() - DOWN).length < 1e-3 and (forearm() - FRONT).length < 1e-3
    # The whole body turns to its left with the hips, and the arm with the body.
    pose(armature, Hips=Quaternion(UP, math.pi / 2))
    assert (arm() - BACK).length < 1e-3
    pose(armature, RightUpperLeg=Quaternion(LEFT, -math.pi / 2))
    assert direction(armature, bone["thigh"], bone["shin"]).dot(FRONT) > 0.95


def test_the_highest_spine_bone_takes_the_sum_of_all_turns_below(rig: Any) -> None:
    armature, bone = rig
    quarter = Quaternion(UP, math.radians(30))
    pose(armature, Spine=quarter, Chest=quarter, UpperChest=quarter)
    arm = direction(armature, bone["arm"], bone["forearm"])
    assert (arm - BACK).length < 1e-3  # 3 x 30 degrees


def test_hips_move_by_the_rig_s_own_height(avatar: Any) -> None:
    rig = mixamo_rig()  # hips 1 m above the soles
    tracked = TrackedRig(rig)
    hips = rig.pose.bones["mixamorig:Hips"]
    for hips_m, place in (
        (Vector((2, 3, 0.5)), Vector((0, 0, 1))),  # the first place of a person half as tall
        (Vector((2.1, 3, 0.4)), Vector((0.2, 0, 0.8))),
    ):
        tracked.apply(tracked.bases(HumanPose({}, hips_m), rig), rig)
        bpy.context.view_layer.update()
        assert (rig.matrix_world @ hips.head - place).length < 1e-5


def test_every_rotation_mode_and_the_pose_before_are_kept(avatar: Any) -> None:
    bones = avatar.pose.bones
    modes = ("XYZ", "ZYX", "AXIS_ANGLE", "QUATERNION")
    names = ("upperarm01.L", "lowerarm01.L", "wrist.L", "head")
    for name, mode in zip(names, modes, strict=True):
        bones[name].rotation_mode = mode
    bones["upperarm01.L"].rotation_euler = (7.0, 0.25, -8.0)  # more than a turn stays so
    bones["head"].scale = (1.5, 1.0, 1.0)
    limit = bones["wrist.L"].constraints.new("LIMIT_ROTATION")
    silent = bones["head"].constraints.new("LIMIT_ROTATION")
    silent.mute = True

    def channels() -> list[tuple[float, ...]]:
        return [
            (
                *b.location,
                *b.rotation_quaternion,
                *b.rotation_euler,
                *b.rotation_axis_angle,
                *b.scale,
            )
            for b in bones
        ]

    before = channels()
    tracked = TrackedRig(avatar)
    keep_pose(avatar, tracked.names)
    assert limit.mute
    shown = HumanPose({"LeftUpperArm": Quaternion(BACK, math.pi / 2)}, Vector((0, 0, 1)))
    tracked.apply(tracked.bases(shown, avatar), avatar)
    bpy.context.view_layer.update()
    assert (direction(avatar, "upperarm01.L", "lowerarm01.L") - DOWN).length < 1e-3
    assert channels() != before
    restore_pose(avatar)
    assert channels() == before and not limit.mute and silent.mute
    assert POSE_BEFORE not in avatar


def test_a_recording_has_the_received_pose_at_each_frame(avatar: Any) -> None:
    """A turn of 90 degrees within a second, received at times between frames."""
    scene = bpy.context.scene
    scene.render.fps = 24
    avatar.pose.bones["lowerarm01.L"].rotation_mode = "ZXY"
    avatar.animation_data_create().action = before = bpy.data.actions.new("Before")
    tracked = TrackedRig(avatar)
    recording = RigRecording(tracked, 10)
    keep_pose(avatar, tracked.names)
    for k in range(61):
        turn = Quaternion(BACK, math.pi / 2 * k / 60)
        bases = tracked.bases(HumanPose({"LeftUpperArm": turn}, Vector((0, 0, 1 + k / 60))), avatar)
        recording.add(5.0 + k / 60, bases)
    restore_pose(avatar)
    action = recording.bake(avatar, 24.0)
    assert avatar.animation_data.action == action and before.use_fake_user
    for frame, degrees in ((10, 0.0), (17, 26.25), (22, 45.0), (34, 90.0)):
        scene.frame_set(frame)
        angle = math.radians(degrees)
        expected = Vector((math.cos(angle), 0, -math.sin(angle)))
        arm = direction(avatar, "upperarm01.L", "lowerarm01.L")
        assert (arm - expected).length < 1e-3, frame
    curves = compat.fcurves(avatar)
    assert {(round(c.range()[0]), round(c.range()[1])) for c in curves} == {(10, 34)}
    assert all(len(c.keyframe_points) == 25 for c in curves)


def test_a_recording_without_poses_is_refused(avatar: Any) -> None:
    with pytest.raises(InputError, match="Nothing was received"):
        RigRecording(TrackedRig(avatar), 1).bake(avatar, 24.0)
    assert avatar.animation_data is None
