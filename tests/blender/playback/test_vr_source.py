# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses of head and hands, known by hand, and requests to the controllers."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from mathutils import Quaternion, Vector

from hfx_blender.playback.live import vr_source

UP, LEFT = Vector((0, 0, 1)), Vector((1, 0, 0))
NOWHERE = Vector((0, 0, 0))
HEAD = Vector((3.0, 4.0, 1.0))
EYES_M = 1.0  # shoulders 0.11 m beside and 0.15 m below, upper arm 0.17 m, forearm 0.16 m


def limbs(hand: Vector, turn: Quaternion) -> tuple[Vector, Vector]:
    """World directions of the left upper arm and forearm, by the rotations along the chain."""
    pose = vr_source.pose_of(HEAD, turn, [hand, NOWHERE], EYES_M)
    assert "RightUpperArm" not in pose.rotations
    upper = pose.rotations["Hips"] @ pose.rotations["LeftUpperArm"]
    return upper @ LEFT, upper @ pose.rotations["LeftLowerArm"] @ LEFT


@pytest.mark.parametrize("degrees", [0.0, 90.0, -135.0])
def test_the_arm_ends_at_the_controller(degrees: float) -> None:
    turn = Quaternion(UP, math.radians(degrees))
    shoulder = HEAD + turn @ Vector((0.11, 0.0, -0.15))
    for offset in ((0.33, 0, 0), (0.05, -0.2, 0.1), (0.1, -0.1, -0.2)):
        hand = shoulder + turn @ Vector(offset)
        upper, lower = limbs(hand, turn)
        assert (shoulder + 0.17 * upper + 0.16 * lower - hand).length < 1e-3
    # A right angle at the elbow is as far as the diagonal; beyond reach the arm is straight.
    upper, lower = limbs(shoulder + turn @ Vector((0, -math.hypot(0.17, 0.16), 0)), turn)
    assert abs(upper.dot(lower)) < 1e-4 and upper.z < 0.0
    upper, lower = limbs(shoulder + turn @ Vector((0.9, 0, 0)), turn)
    assert upper.dot(turn @ LEFT) > 0.999 and lower.dot(turn @ LEFT) > 0.99


def test_the_hips_take_the_heading_and_the_head_the_rest() -> None:
    nod, heading = Quaternion(LEFT, 0.3), Quaternion(UP, 1.1)
    pose = vr_source.pose_of(HEAD, heading @ nod, [NOWHERE, NOWHERE], EYES_M)
    assert pose.rotations["Hips"].rotation_difference(heading).angle < 1e-3
    assert pose.rotations["Head"].rotation_difference(nod).angle < 1e-3
    assert pose.hips_m is not None and (pose.hips_m - Vector((3, 4, 0.57))).length < 1e-6


@pytest.mark.parametrize(
    ("version", "levels", "requests"),
    [
        ((5, 2, 2), (0.4, 0.0), [("/user/hand/left", 0.05 * 1e6, 0.4)]),
        ((5, 2, 2), (0.00005, 2.0), [("/user/hand/right", 0.05 * 1e6, 1.0)]),
        ((5, 2, 2), (0.0, 0.0001), [("/user/hand/right", 0.05 * 1e6, 0.0001)]),
        ((5, 3, 0), (0.4, 0.4), []),  # untested: the same factor could be hours
        ((4, 5, 0), (0.4, 0.4), []),
    ],
)
def test_requests_last_50_ms_in_tested_versions_only(
    registered: Any,
    monkeypatch: pytest.MonkeyPatch,
    version: tuple[int, ...],
    levels: tuple[float, ...],
    requests: list[tuple[str, float, float]],
) -> None:
    actuators = [SimpleNamespace(id="left"), SimpleNamespace(id="right")]
    stand_in = SimpleNamespace(
        device=lambda name: SimpleNamespace(actuators=actuators),
        state=lambda name: SimpleNamespace(is_armed=True, levels=levels),
    )
    monkeypatch.setattr(vr_source, "live", stand_in)
    blender = SimpleNamespace(app=SimpleNamespace(version=version), context=bpy.context)
    monkeypatch.setattr(vr_source, "bpy", blender)
    actual: list[tuple[str, float, float]] = []

    def request(_c: Any, _s: str, _a: str, hand: str, s: float, _hz: float, level: float) -> None:
        actual.append((hand, s, level))

    vr_source.apply_haptics(SimpleNamespace(haptic_action_apply=request))
    assert actual == requests
