# SPDX-License-Identifier: GPL-3.0-or-later
"""Headset, controllers and trackers of a person without bones, in Unity's axes as VMC sends them.

A point (x, y, z) of Unity is (-x, -z, y) here; the person faces Unity's +Z.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import bpy  # noqa: F401  (mathutils is part of it)
import pytest
from mathutils import Quaternion, Vector

from hfx_blender.playback.live import vmc_source, vr_source
from hfx_blender.tracking.osc_packets import OscMessage
from hfx_blender.tracking.receiver import ReceivedMessage
from hfx_blender.tracking.vmc_body import VmcBody

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class Sender:
    """Source of poses with messages of the test."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.waiting: list[ReceivedMessage] = []
        self.now_s = 0.0
        receiver = SimpleNamespace(port=1, take=self.take)
        monkeypatch.setattr(vmc_source, "OscReceiver", lambda *_, **__: receiver)
        self.source = vmc_source.VmcSource("127.0.0.1", 1)

    def take(self) -> list[ReceivedMessage]:
        messages, self.waiting = self.waiting, []
        return messages

    def pose(self, *messages: tuple[Any, ...]) -> Any:
        self.now_s += 0.1
        for kind, name, *numbers in messages:
            numbers = [float(x) for x in (*numbers, *(UPRIGHT if len(numbers) == 3 else ()))]
            message = OscMessage(f"/VMC/Ext/{kind}/Pos", (name, *numbers))
            self.waiting.append(ReceivedMessage(message, self.now_s))
        return self.source.pose()


HEADSET = ("Hmd", "H", 0.0, 1.6, 0.0)


def test_arms_reach_for_the_controllers_of_a_person_without_bones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sender = Sender(monkeypatch)
    assert sender.pose(("Con", "B", 0.4, 1.3, 0.3)) is None  # no headset
    pose = sender.pose(HEADSET, ("Con", "A", -0.4, 1.3, 0.3), ("Con", "B", 0.4, 1.3, 0.3))
    hands = [Vector((0.4, -0.3, 1.3)), Vector((-0.4, -0.3, 1.3))]
    expected = vr_source.pose_of(Vector((0, 0, 1.6)), Quaternion(), hands, 1.6)
    assert pose.rotations.keys() == expected.rotations.keys() and "LeftUpperArm" in pose.rotations
    for bone, rotation in expected.rotations.items():
        assert pose.rotations[bone].rotation_difference(rotation).angle < 1e-5
    assert pose.hips_m == expected.hips_m
    # Crossed hands stay left and right.
    crossed = sender.pose(("Con", "A", 0.2, 1.3, 0.3), ("Con", "B", -0.2, 1.3, 0.3))
    hands = [Vector((-0.2, -0.3, 1.3)), Vector((0.2, -0.3, 1.3))]
    expected = vr_source.pose_of(Vector((0, 0, 1.6)), Quaternion(), hands, 1.6)
    arm = "LeftUpperArm"
    assert crossed.rotations[arm].rotation_difference(expected.rotations[arm]).angle < 1e-5
    # Controllers alone bring nobody back.
    sender.now_s += 1.0
    assert sender.pose(("Con", "A", 0.2, 1.3, 0.3)) is None


def test_a_tracker_at_the_waist_moves_the_hips(monkeypatch: pytest.MonkeyPatch) -> None:
    sender = Sender(monkeypatch)
    pose = sender.pose(HEADSET, ("Tra", "foot", 0.1, 0.1, 0.0), ("Tra", "hip", 0.0, 0.95, 0.1))
    assert (pose.hips_m - Vector((0.0, -0.1, 0.95))).length < 1e-6
    # A crouching person: the same tracker, also at another height.
    pose = sender.pose(("Hmd", "H", 0.0, 1.1, 0.3), ("Tra", "hip", 0.0, 0.5, 0.0))
    assert (pose.hips_m - Vector((0.0, 0.0, 0.5))).length < 1e-6


def test_a_headset_turns_a_head_without_a_bone(monkeypatch: pytest.MonkeyPatch) -> None:
    sender = Sender(monkeypatch)
    half = math.sqrt(0.5)
    # Hips a quarter turn about Unity's Y, and the headset upright: the head turns back.
    pose = sender.pose(("Bone", "Hips", 0, 0.9, 0, 0, half, 0, half), HEADSET)
    world = pose.rotations["Hips"] @ pose.rotations["Head"]
    assert abs(world.angle) < 1e-5 and pose.rotations["Hips"].angle == pytest.approx(math.pi / 2)
    pose = sender.pose(("Bone", "Head", 0, 0.1, 0, *UPRIGHT))
    assert abs(pose.rotations["Head"].angle) < 1e-5  # the bone counts


def test_devices_have_an_age_as_bones() -> None:
    body = VmcBody()
    message = OscMessage("/VMC/Ext/Hmd/Pos", ("H", 0.0, 1.6, 0.0, *UPRIGHT))
    body.update([ReceivedMessage(message, 5.0)])
    assert body.age_s(6.0) == 1.0
