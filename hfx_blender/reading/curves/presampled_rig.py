# SPDX-License-Identifier: GPL-3.0-or-later
"""Presampled rig: bones are set from sampled F-curves, and Blender solves the rest.

Blender resolves each F-curve's path again at each frame, which costs several times the posing. A
copy of the armature object without bone animation stands in the scratch scene. The copy keeps
constraints, drivers, parent, and all other animation.
"""

from fractions import Fraction

import bpy
import numpy as np

from ...blender import compat
from ...engine.arrays import F32
from .animation_curves import AnimatedValues, NotModelledError
from .animation_time import animation_frames
from .fcurve_kinematics import BONE_PATH, WIDTHS, rest_value

_CHUNK = 128  # times sampled together, at fixed positions in time


class PresampledRig:
    """Animated bones of an armature over time, and the copy of the armature showing these bones.
    ``first`` is the frame of the first sample, ``step`` the frames per sample. Raises
    NotModelledError for linked armatures, animation that cannot be sampled, and strips of bones and
    other properties."""

    def __init__(
        self, scene: bpy.types.Scene, obj: bpy.types.Object, first: Fraction, step: Fraction
    ) -> None:
        if obj.library is not None or obj.override_library is not None:
            raise NotModelledError(f"'{obj.name}' is linked")
        self._scene = scene
        self.obj = obj
        self.copy: bpy.types.Object | None = None
        self._first, self._step = first, step
        self._values = AnimatedValues(obj, rest_value, _moves_a_bone, with_drivers=True)
        if not self._values.columns:
            raise NotModelledError(f"nothing animates the bones of '{obj.name}'")
        # A strip is removed from the copy as a whole, so it may move bones only. Of the assigned
        # action a copy with muted bone curves remains if it animates more than bones.
        for track in obj.animation_data.nla_tracks:
            for strip in track.strips:
                paths = [_moves_a_bone(curve.data_path) for curve in compat.strip_fcurves(strip)]
                if any(paths) and not all(paths):
                    raise NotModelledError(f"strip '{strip.name}' moves more than bones")
        paths = [_moves_a_bone(curve.data_path) for curve in compat.fcurves(obj)]
        self._mixed = obj.animation_data.action if any(paths) and not all(paths) else None
        bones = {bone.name: k for k, bone in enumerate(obj.pose.bones)}
        channels: dict[str, list[tuple[int, int]]] = {}
        for (path, number), column in self._values.columns.items():
            match = BONE_PATH.match(path)
            bone = bones.get(bpy.utils.unescape_identifier(match[1])) if match else None
            if match is not None and bone is not None:
                slot = bone * WIDTHS[match[2]] + number
                channels.setdefault(match[2], []).append((slot, column))
        self._places = {name: np.array(entries).T for name, entries in channels.items()}
        self._chunk = -1
        self.sampled: dict[str, F32] = {}

    def make_copy(self) -> list[bpy.types.ID]:
        """Make :attr:`copy`, without bone animation and not linked to a scene; returns the created
        data-blocks, to be removed by the caller. Strips of bones are removed from the copy, curves
        of bones muted. References to the rig itself, such as constraint targets, become references
        to the copy."""
        self.copy = self.obj.copy()
        created: list[bpy.types.ID] = [self.copy]
        data = self.copy.animation_data
        for track in data.nla_tracks:
            # Strips of bones would overwrite the set values. Muting is not enough: Blender
            # evaluates the channels of muted strips as well.
            for strip in list(track.strips):
                if any(_moves_a_bone(curve.data_path) for curve in compat.strip_fcurves(strip)):
                    track.strips.remove(strip)
        if self._mixed is not None:
            # Blender 4.2 has no slots; later versions animate nothing, without an error, until a
            # slot is set.
            slot = getattr(data, "action_slot", None)
            data.action = self._mixed.copy()
            created.append(data.action)
            if slot is not None:
                data.action_slot = next(s for s in data.action.slots if s.handle == slot.handle)
            for curve in compat.fcurves(self.copy):
                curve.mute |= _moves_a_bone(curve.data_path)
        elif any(_moves_a_bone(curve.data_path) for curve in compat.fcurves(self.copy)):
            data.action = None
        return created

    def set_frame(self, frame: Fraction) -> None:
        """Set the bone channels of the copy to the sample at ``frame`` and tag the copy; the scene
        must be evaluated afterwards. Samples the chunk with the frame if another is loaded."""
        chunk, row = divmod(int((frame - self._first) / self._step), _CHUNK)
        if chunk != self._chunk:
            self.sample(chunk)
        assert self.copy is not None
        for name, values in self.sampled.items():
            self.copy.pose.bones.foreach_set(name, values[row])
        # Values set in bulk do not mark an object as changed: without a tag the pose would stay.
        self.copy.update_tag(refresh={"OBJECT"})

    def sample(self, chunk: int) -> None:
        """Sample all animated bone channels at the 128 samples of chunk number ``chunk`` into
        :attr:`sampled`, (128, B * width) each; components without a curve keep the present
        value."""
        first = self._first + chunk * _CHUNK * self._step
        frames = [first + k * self._step for k in range(_CHUNK)]
        whole = [frame.numerator // frame.denominator for frame in frames]
        parts = [float(frame - k) for frame, k in zip(frames, whole, strict=True)]
        at = np.array(whole, np.float32) + np.array(parts, np.float32)  # Blender's float32 sum
        at = animation_frames(self._scene, at)
        values = self._values.sample(at, single=True).astype(np.float32)
        for name, (places, columns) in self._places.items():
            still = np.zeros(len(self.obj.pose.bones) * WIDTHS[name], np.float32)
            self.obj.pose.bones.foreach_get(name, still)
            self.sampled[name] = np.repeat(still[None], _CHUNK, axis=0)
            self.sampled[name][:, places] = values[:, columns]
        self._chunk = chunk


def _moves_a_bone(path: str) -> bool:
    """Test for the RNA path of a location, rotation or scale (also delta) of a bone."""
    match = BONE_PATH.match(path)
    return match is not None and match[2] in WIDTHS
