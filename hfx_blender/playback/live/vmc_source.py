# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses of a person from a program that sends the VMC protocol."""

from __future__ import annotations

from mathutils import Quaternion, Vector

from ...avatars.tracked_rig import HumanPose
from ...tracking.receiver import OscReceiver
from ...tracking.vmc_body import ROOT, VmcBody


class VmcSource:
    """Poses received at a UDP port, as a :class:`.body_tracking.PoseSource`.

    Raises UsageError: the address or port cannot be used.
    """

    def __init__(self, address: str, port: int) -> None:
        self._receiver = OscReceiver(address, port, is_used=VmcBody.is_used)
        self._body = VmcBody()
        self.port = self._receiver.port

    @property
    def title(self) -> str:
        return f"VMC, port {self.port}"

    def pose(self) -> HumanPose | None:
        body = self._body
        last_age_s = body.age_s(0.0)
        body.update(self._receiver.take())
        # Ages at one moment: a smaller one means a newer pose.
        if body.age_s(0.0) >= last_age_s or not body.is_ready:
            return None
        rotations = {
            name: Quaternion(pose.rotation) for name, pose in body.poses.items() if name != ROOT
        }
        root, hips = body.poses.get(ROOT), body.poses.get("Hips")
        hips_m = None if hips is None else Vector(hips.position_m)
        if root is not None:
            # The root moves the whole body: its pose comes before that of the hips.
            turn = Quaternion(root.rotation)
            rotations["Hips"] = turn @ rotations.get("Hips", Quaternion())
            hips_m = None if hips_m is None else Vector(root.position_m) + turn @ hips_m
        return HumanPose(rotations, hips_m)

    def close(self) -> None:
        self._receiver.close()
