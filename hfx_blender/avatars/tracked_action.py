# SPDX-License-Identifier: GPL-3.0-or-later
"""Recording of a tracked rig as an action of keyframes, one a frame."""

import bpy
import numpy as np
from mathutils import Matrix

from ..blender import compat
from ..engine.arrays import F64
from ..errors import InputError
from .tracked_rig import TrackedRig


class RigRecording:
    """Poses of a rig's tracked bones over time, from ``frame_start`` on."""

    def __init__(self, rig: TrackedRig, frame_start: int) -> None:
        self.frame_start = frame_start
        self._names = rig.names
        self._times_s: list[float] = []
        self._bases: list[list[Matrix]] = []

    @property
    def length_s(self) -> float:
        """Time of the last pose since the first one, seconds; 0 without poses."""
        return self._times_s[-1] - self._times_s[0] if self._times_s else 0.0

    def add(self, time_s: float, bases: list[Matrix]) -> None:
        """Append a pose to the recording: ``bases``, the basis matrix (4, 4) of each bone
        (see :meth:`.TrackedRig.bases`). A pose that is not later than the last is ignored."""
        if not self._times_s or time_s > self._times_s[-1]:
            self._times_s.append(time_s)
            self._bases.append(bases)

    def bake(self, armature: bpy.types.Object, fps: float) -> bpy.types.Action:
        """New action of the armature with a key for each bone and frame, linear; an action assigned
        before is kept in the file without being assigned.

        Between two received poses rotations and positions are interpolated. Constraints of the
        bones get influence 0 in the action. Raises InputError without two poses.
        """
        if len(self._times_s) < 2:
            raise InputError("Nothing was received during the recording.")
        times_s = np.array(self._times_s) - self._times_s[0]
        count = int(np.floor(times_s[-1] * fps + 1e-6)) + 1
        places, turns = self._at(times_s, np.minimum(np.arange(count) / fps, times_s[-1]))
        frames = self.frame_start + np.arange(count, dtype=np.float64)
        data = armature.animation_data or armature.animation_data_create()
        if data.action is not None:
            data.action.use_fake_user = True
        action = data.action = bpy.data.actions.new(f"{armature.name} Tracked")
        for k, name in enumerate(self._names):
            bone = armature.pose.bones[name]
            path, values = _rotation_channel(bone, turns[:, k])
            stem = f'pose.bones["{bpy.utils.escape_identifier(name)}"]'
            channels = {path: values}
            if np.ptp(places[:, k], axis=0).max() > 0.0 or places[0, k].any():
                channels["location"] = places[:, k]
            for constraint in bone.constraints:
                title = bpy.utils.escape_identifier(constraint.name)
                channels[f'constraints["{title}"].influence'] = np.zeros((1, 1))
            for channel, rows in channels.items():
                for axis in range(rows.shape[1]):
                    curve = compat.new_fcurve(armature, action, f"{stem}.{channel}", axis)
                    keys = zip(frames[: len(rows)].tolist(), rows[:, axis].tolist(), strict=True)
                    compat.set_keys(curve, keys)
        return action

    def _at(self, times_s: F64, sampled_s: F64) -> tuple[F64, F64]:
        """Locations (T, B, 3) and unit quaternions (T, B, 4), continuous in sign, at times (T,)."""
        parts = [[basis.decompose()[:2] for basis in bases] for bases in self._bases]
        places = np.array([[place for place, _ in row] for row in parts], np.float64)
        turns = np.array([[turn for _, turn in row] for row in parts], np.float64)
        # q and -q are one rotation; without jumps of sign the shorter way lies between two keys.
        flips = np.where((turns[1:] * turns[:-1]).sum(axis=2) < 0.0, -1.0, 1.0)
        turns[1:] *= np.cumprod(flips, axis=0)[:, :, None]
        after = np.clip(np.searchsorted(times_s, sampled_s), 1, len(times_s) - 1)
        share = (sampled_s - times_s[after - 1]) / (times_s[after] - times_s[after - 1])
        share = share[:, None, None]
        places = places[after - 1] * (1.0 - share) + places[after] * share
        turns = turns[after - 1] * (1.0 - share) + turns[after] * share
        return places, turns / np.linalg.norm(turns, axis=2, keepdims=True)


def _rotation_channel(bone: bpy.types.PoseBone, turns: F64) -> tuple[str, F64]:
    """Name and values (T, 3 or 4) of the channel of a bone's rotation mode, from quaternions (T,
    4); Euler angles without jumps."""
    from mathutils import Euler, Quaternion

    if bone.rotation_mode == "QUATERNION":
        return "rotation_quaternion", turns
    if bone.rotation_mode == "AXIS_ANGLE":
        pairs = [Quaternion(turn).to_axis_angle() for turn in turns]
        return "rotation_axis_angle", np.array([(angle, *axis) for axis, angle in pairs])
    rows, last = [], Euler((0.0, 0.0, 0.0), bone.rotation_mode)
    for turn in turns:
        last = Quaternion(turn).to_euler(bone.rotation_mode, last)
        rows.append(tuple(last))
    return "rotation_euler", np.array(rows)
