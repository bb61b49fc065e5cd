# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracked body of the Virtual Motion Capture protocol (VMC), as plain poses of bones.

Protocol: https://protocol.vmc.info/marionette-spec. Bones have the names of Unity's
``HumanBodyBones`` and are relative to their parents, in Unity's axes: left-handed, metres, Y up,
the body faces +Z. Here the axes are Blender's: right-handed, Z up, the body faces -Y. A point
(x, y, z) of Unity is (-x, -z, y); a reflection inverts turns, so a quaternion
(x, y, z, w) is (w, x, z, -y) in the order w, x, y, z. (Unity: docs.unity3d.com/Manual/
QuaternionAndEulerRotationsInUnity.html; the same table is in ``docs/formats/clip.md``.)
"""

import math
import time
from collections.abc import Iterable
from itertools import pairwise
from typing import Final, NamedTuple

from .receiver import ReceivedMessage

ROOT: Final = "root"
"""Name of the whole body's pose in :attr:`VmcBody.poses`."""

LOST_S: Final = 0.5
"""Time without a pose of root, trunk or headset after which a sender is lost, seconds."""

FADE_S: Final = 1.4  # silent within 2 s of the last pose, with the way to the device
"""Duration of the fade of all devices after :data:`LOST_S`, seconds."""

_FINGERS: Final = ("Thumb", "Index", "Middle", "Ring", "Little")
_JOINTS: Final = ("Proximal", "Intermediate", "Distal")


def _parents() -> dict[str, str]:
    """Parent of each bone in ``HumanBodyBones``, parents first; "" for the hips."""
    trunk = ("", "Hips", "Spine", "Chest", "UpperChest", "Neck", "Head")
    parents = {bone: parent for parent, bone in pairwise(trunk)}
    parents["Jaw"] = "Head"
    for side in ("Left", "Right"):
        parents[f"{side}Eye"] = "Head"
        for first, *limb in (
            ("Hips", "UpperLeg", "LowerLeg", "Foot", "Toes"),
            ("UpperChest", "Shoulder", "UpperArm", "LowerArm", "Hand"),
            *(("Hand", *(finger + joint for joint in _JOINTS)) for finger in _FINGERS),
        ):
            parent = side + first if first == "Hand" else first
            for bone in limb:
                parents[side + bone] = parent
                parent = side + bone
    return parents


PARENTS: Final = _parents()
"""Parent of each of Unity's 55 human bones, parents before children; "" for ``Hips``."""

_TRUNK: Final = (ROOT, "Hips", "Spine", "Chest", "UpperChest", "Neck", "Head")

# Time without a pose of the trunk or headset after which earlier poses are void, seconds.
_VOID_S: Final = 2.0

# A person wears far fewer trackers: more names are a flood.
_MAX_DEVICES: Final = 32
_UNIT_TOLERANCE: Final = 0.05  # of a quaternion's length
_MAX_M: Final = 1000.0


class BonePose(NamedTuple):
    """Position (x, y, z) in metres and unit quaternion (w, x, y, z), in Blender's axes."""

    position_m: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class VmcBody:
    """Newest poses of a tracked body.

    ``poses``: of :data:`ROOT` in the world, and of each received bone relative to its parent, by
    Unity's name.
    ``devices``: of headset (``Hmd``), controllers (``Con``) and trackers (``Tra``) in the world, by
    kind and serial number: ``("Hmd", "LHR-1")``.
    ``is_ready``: False while the sender states that it has no model or no tracking.
    ``time_s``: clock of the sender in seconds; NaN before the first message.
    ``ignored``: number of refused poses: NaN, infinity, no rotation, beyond 1 km.
    ``newest_s``: arrival of the newest pose on the clock of ``time.monotonic``; -inf before.
    ``longest_m``: greatest distance of a bone from its parent, metres.

    Poses of limbs and trackers alone bring no body back: after 2 s without root, trunk and headset
    their next pose removes all older poses.
    """

    def __init__(self) -> None:
        self.poses: dict[str, BonePose] = {}
        self.devices: dict[tuple[str, str], BonePose] = {}
        self.is_ready = True
        self.time_s = math.nan
        self.ignored = 0
        self.longest_m = 0.0
        self.newest_s = self._arrived_s = -math.inf
        self._stored_s: dict[str | tuple[str, str], float] = {}

    @staticmethod
    def is_used(address: str) -> bool:
        """Test that :meth:`update` uses messages of an OSC address."""
        return address in _ADDRESSES

    def age_s(self, now_s: float | None = None) -> float:
        """Seconds since the newest valid pose of root, trunk or headset while the sender was ready,
        on the clock of ``time.monotonic``; infinity before the first."""
        return (time.monotonic() if now_s is None else now_s) - self._arrived_s

    def update(self, messages: Iterable[ReceivedMessage]) -> None:
        """Apply messages of a receiver; messages of unknown addresses are left alone."""
        for message, arrived_s in messages:
            kind = _ADDRESSES.get(message.address)
            arguments = message.arguments
            if kind is None:
                continue
            if kind in ("OK", "T"):
                self._update_state(kind, arguments)
                continue
            pose = _pose(arguments)
            if pose is None or not self._store(kind, str(arguments[0]), pose, arrived_s):
                self.ignored += 1

    def _update_state(self, kind: str, arguments: tuple[object, ...]) -> None:
        numbers = [x for x in arguments if isinstance(x, int | float) and math.isfinite(x)]
        if len(numbers) != len(arguments) or not numbers:
            self.ignored += 1
        elif kind == "T":
            self.time_s = float(numbers[0])
        else:
            # Version 2.7 adds a fourth number, the state of tracking.
            self.is_ready = numbers[0] == 1 and (len(numbers) < 4 or numbers[3] == 1)

    def _store(self, kind: str, name: str, pose: BonePose, arrived_s: float) -> bool:
        """Store a pose; False for an unknown bone, or too many devices."""
        is_of_body = kind in ("Root", "Bone")
        key = ROOT if kind == "Root" else name if is_of_body else (kind, name)
        if kind == "Bone" and name not in PARENTS:
            return name == "LastBone"  # sent by some programs for the end of Unity's list
        if not is_of_body and key not in self.devices and len(self.devices) >= _MAX_DEVICES:
            return False
        if self.is_ready and (key in _TRUNK or kind == "Hmd"):
            if arrived_s - self._arrived_s > _VOID_S:
                self._forget(arrived_s - _VOID_S)
            self._arrived_s = max(self._arrived_s, arrived_s)
        if kind == "Bone":
            self.longest_m = max(self.longest_m, math.hypot(*pose.position_m))
        (self.poses if is_of_body else self.devices)[key] = pose  # type: ignore[index]
        self._stored_s[key] = arrived_s
        self.newest_s = max(self.newest_s, arrived_s)
        return True

    def _forget(self, before_s: float) -> None:
        """Remove poses that arrived before a time."""
        for key in [key for key, stored_s in self._stored_s.items() if stored_s < before_s]:
            del self._stored_s[key]
            self.poses.pop(key, None)  # type: ignore[arg-type]
            self.devices.pop(key, None)  # type: ignore[arg-type]


_ADDRESSES: Final = {
    **{f"/VMC/Ext/{kind}/Pos": kind for kind in ("Root", "Bone", "Hmd", "Con", "Tra")},
    "/VMC/Ext/OK": "OK",
    "/VMC/Ext/T": "T",
}


def _pose(arguments: tuple[object, ...]) -> BonePose | None:
    """Pose in Blender's axes of a name and seven numbers in Unity's; None for invalid ones."""
    numbers = [number for number in arguments[1:8] if isinstance(number, float)]
    if len(numbers) != 7 or not isinstance(arguments[0], str):
        return None
    px, py, pz, qx, qy, qz, qw = numbers
    length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    # Comparisons are False for NaN.
    is_near = all(abs(p) <= _MAX_M for p in (px, py, pz))
    if not is_near or not abs(length - 1.0) <= _UNIT_TOLERANCE:
        return None
    return BonePose((-px, -pz, py), (qw / length, qx / length, qz / length, -qy / length))
