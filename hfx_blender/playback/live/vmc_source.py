# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses of a person from a program that sends the VMC protocol."""

from mathutils import Quaternion, Vector

from ...avatars.tracked_rig import HumanPose
from ...tracking.receiver import OscReceiver
from ...tracking.vmc_body import LOST_S, PARENTS, ROOT, VmcBody
from .vr_source import eye_height, pose_of

_WAIST, _WAIST_REACH = 0.57, 0.17  # height and tolerance, shares of the eye height
_APART_M = 0.1  # distance from the middle that tells left from right


class VmcSource:
    """Poses received at a UDP port, as a :class:`.body_tracking.PoseSource`.

    Raises UsageError: the address or port cannot be used.
    """

    def __init__(self, address: str, port: int) -> None:
        self._receiver = OscReceiver(address, port, is_used=VmcBody.is_used, is_single=True)
        self._body = VmcBody()
        self._worn = WornDevices()
        self.port = self._receiver.port

    @property
    def title(self) -> str:
        return f"VMC, port {self.port}"

    def pose(self) -> HumanPose | None:
        body = self._body
        before_s = body.newest_s
        body.update(self._receiver.take())
        is_new = body.newest_s > before_s and body.is_ready
        if not is_new or body.age_s(body.newest_s) > LOST_S:
            return None
        if body.poses.keys().isdisjoint(("Hips", "Head")):
            return self._worn.pose(body)
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
        headset = next((pose for (kind, _), pose in body.devices.items() if kind == "Hmd"), None)
        if headset is not None and "Head" not in rotations:
            above, bone = Quaternion(), PARENTS["Head"]
            while bone:
                above, bone = rotations.get(bone, Quaternion()) @ above, PARENTS[bone]
            rotations["Head"] = above.inverted() @ Quaternion(headset.rotation)
        return HumanPose(rotations, hips_m)

    def close(self) -> None:
        self._receiver.close()


class WornDevices:
    """Headset, controllers and a tracker at the waist of a person without bones.

    VMC does not say where a device is worn. The first pose in which a device is clearly in a place
    decides: a controller to the left or right of the head, a tracker at the height of the hips.
    """

    def __init__(self) -> None:
        self._eyes_m = 0.0
        self._places: dict[tuple[str, str], str] = {}  # "Left", "Right" or "Waist"

    def pose(self, body: VmcBody) -> HumanPose | None:
        """Pose of the newest devices, as of a VR session; None without a headset."""
        devices = body.devices
        headset = next((pose for (kind, _), pose in devices.items() if kind == "Hmd"), None)
        if headset is None:
            return None
        head, turn = Vector(headset.position_m), Quaternion(headset.rotation)
        self._eyes_m = self._eyes_m or eye_height(head.z)
        back = Quaternion((0.0, 0.0, 1.0), turn.to_swing_twist("Z")[1]).inverted()
        for device, pose in devices.items():
            offset = back @ (Vector(pose.position_m) - head)
            place = ""
            if device[0] == "Con" and abs(offset.x) > _APART_M:
                place = "Left" if offset.x > 0.0 else "Right"
            elif device[0] == "Tra":
                height = pose.position_m[2] / self._eyes_m
                place = "Waist" if abs(height - _WAIST) < _WAIST_REACH else ""
            if place and place not in self._places.values():
                self._places.setdefault(device, place)
        worn = {place: devices[device] for device, place in self._places.items()}
        hands = [Vector(worn[k].position_m) if k in worn else Vector() for k in ("Left", "Right")]
        person = pose_of(head, turn, hands, self._eyes_m)
        if "Waist" not in worn:
            return person
        return HumanPose(person.rotations, Vector(worn["Waist"].position_m))
