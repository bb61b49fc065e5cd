# SPDX-License-Identifier: GPL-3.0-or-later
"""A clip's body follows the bones of a tracked person; places worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hfx_blender.tracking.vmc_body import ROOT, BonePose, VmcBody
from hfx_tools.live_body.avatar_pose import AvatarPose, unity_name

STILL = (1.0, 0.0, 0.0, 0.0)
HALF = math.sqrt(0.5)

# A body at rest with arms 45 degrees below the T-pose: VRM's bone, parent, head in metres.
BONES = [
    ("", -1, (0.0, 0.0, 0.0)),
    ("hips", 0, (0.0, 0.0, 1.0)),
    ("head", 1, (0.0, 0.0, 1.6)),
    ("leftUpperLeg", 1, (0.1, 0.0, 0.9)),
    ("leftLowerLeg", 3, (0.1, 0.0, 0.5)),
    ("leftFoot", 4, (0.1, 0.0, 0.1)),
    ("rightUpperLeg", 1, (-0.1, 0.0, 0.9)),
    ("leftUpperArm", 1, (0.2, 0.0, 1.4)),
    ("leftLowerArm", 7, (0.4, 0.0, 1.2)),
    ("leftHand", 8, (0.6, 0.0, 1.0)),
    ("leftThumbMetacarpal", 9, (0.6, -0.1, 1.0)),
]


def avatar() -> AvatarPose:
    rest = np.zeros((len(BONES), 3, 4))
    rest[:, :, :3] = np.eye(3)
    rest[:, :, 3] = [head for _, _, head in BONES]
    return AvatarPose([name for name, _, _ in BONES], [parent for _, parent, _ in BONES], rest)


def person(**rotations: tuple[float, float, float, float]) -> VmcBody:
    """Person of double size: legs of 1.6 m, hips 2 m high."""
    body = VmcBody()
    for name in ("Hips", "LeftUpperArm", "LeftLowerArm", "LeftHand", "LeftThumbProximal"):
        body.poses[name] = BonePose((0.0, 0.0, 0.0), rotations.get(name, STILL))
    body.poses["Hips"] = BonePose((0.0, 0.0, 2.0), rotations.get("Hips", STILL))
    for name in ("LeftLowerLeg", "LeftFoot"):
        body.poses[name] = BonePose((0.0, 0.0, -0.8), STILL)
    return body


def heads(matrices: np.ndarray) -> dict[str, np.ndarray]:
    return {
        name: matrices[k, :, :3] @ np.array(head) + matrices[k, :, 3]
        for k, (name, _, head) in enumerate(BONES)
    }


def test_arms_at_rest_below_the_t_pose_are_raised() -> None:
    at = heads(avatar().matrices(person()))
    # Half the size: hips at 1 m. Upper and lower arm are 0.2 * sqrt(2) long, both level now.
    length = 0.2 * math.sqrt(2.0)
    assert at["hips"] == pytest.approx([0.0, 0.0, 1.0])
    assert at["leftLowerArm"] == pytest.approx([0.2 + length, 0.0, 1.4])
    assert at["leftHand"] == pytest.approx([0.2 + 2 * length, 0.0, 1.4])
    # The thumb points to the front as at rest.
    assert at["leftThumbMetacarpal"] == pytest.approx([0.2 + 2 * length, -0.1, 1.4])


def test_a_bent_elbow_turns_the_hand_to_the_front() -> None:
    # -90 degrees about Z take the left, +X, to the front, -Y.
    at = heads(avatar().matrices(person(LeftLowerArm=(HALF, 0.0, 0.0, -HALF))))
    length = 0.2 * math.sqrt(2.0)
    assert at["leftHand"] == pytest.approx([0.2 + length, -length, 1.4])


def test_the_root_moves_and_turns_the_body() -> None:
    body = person()
    body.poses[ROOT] = BonePose((2.0, 0.0, 0.0), (HALF, 0.0, 0.0, HALF))  # +90 degrees about Z
    at = heads(avatar().matrices(body))
    # Half of 2 m to the left; then the head stays above, and the left leg is at the back.
    assert at["hips"] == pytest.approx([1.0, 0.0, 1.0])
    assert at["head"] == pytest.approx([1.0, 0.0, 1.6])
    assert at["leftUpperLeg"] == pytest.approx([1.0, 0.1, 0.9])


def test_a_person_without_bones_leaves_the_place_of_the_body() -> None:
    at = heads(avatar().matrices(VmcBody()))
    assert at["hips"] == pytest.approx([0.0, 0.0, 1.0])


def test_a_headset_without_bones_places_head_and_body() -> None:
    body = VmcBody()
    # Turned left by 90 degrees about Z, and 30 degrees down about the own left axis: at 1.5 m.
    tilt = (math.cos(math.radians(15)), math.sin(math.radians(15)), 0.0, 0.0)
    quarter = (HALF, 0.0, 0.0, HALF)
    rotation = (HALF * tilt[0], HALF * tilt[1], HALF * tilt[1], HALF * tilt[0])
    assert quarter[0] * tilt[0] == pytest.approx(rotation[0])
    body.devices["Hmd", "LHR-1"] = BonePose((2.0, 3.0, 1.5), rotation)
    matrices = avatar().matrices(body)
    at = heads(matrices)
    assert at["head"] == pytest.approx([2.0, 3.0, 1.5])
    # The hips are 0.6 m below; the left thigh, 0.1 m to the left, is now at +Y.
    assert at["hips"] == pytest.approx([2.0, 3.0, 0.9])
    assert at["leftUpperLeg"] == pytest.approx([2.0, 3.1, 0.8])
    # The head looks along +X and down: -Y is (cos 30, 0, sin -30).
    assert matrices[2, :, :3] @ [0.0, -1.0, 0.0] == pytest.approx([math.cos(math.pi / 6), 0, -0.5])


def test_a_headset_turns_a_head_without_a_bone() -> None:
    body = person()
    body.devices["Hmd", "LHR-1"] = BonePose((9.0, 9.0, 9.0), (HALF, 0.0, 0.0, HALF))
    matrices = avatar().matrices(body)
    assert heads(matrices)["hips"] == pytest.approx([0.0, 0.0, 1.0])
    assert matrices[2, :, :3] @ [0.0, -1.0, 0.0] == pytest.approx([1.0, 0.0, 0.0])


def test_vrms_thumb_has_another_name_in_unity() -> None:
    assert unity_name("leftThumbMetacarpal") == "LeftThumbProximal"
    assert unity_name("rightThumbProximal") == "RightThumbIntermediate"
    assert unity_name("leftUpperArm") == "LeftUpperArm"
