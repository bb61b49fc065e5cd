# SPDX-License-Identifier: GPL-3.0-or-later
"""Walk of a haptic body from place to place, for demo scenes and measurements."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from hfx_blender.blender import compat
from hfx_blender.blender.scene_info import fps_of
from hfx_blender.errors import InputError

from ..body_building.walk_cycle import WalkCycle, load_walk


def add_walk(
    armature: bpy.types.Object,
    places: Sequence[tuple[float, float, float]],
    frame_start: int,
    frame_end: int,
) -> None:
    """Animate a body to walk at constant speed through two or more positions, world space.

    The path is keyframed on the object. The walk cycle is an NLA strip, repeated once per stride
    length; both can be edited. The body faces the direction of motion. Raises InputError: less than
    two places, no frames, or no distance between the places.
    """
    if len(places) < 2 or frame_end <= frame_start:
        raise InputError(f"Body '{armature.name}': a walk needs two places and some frames.")
    walk = load_walk()
    positions = np.array(places, np.float64)
    moves = np.diff(positions, axis=0)
    lengths = np.linalg.norm(moves, axis=1)
    distance = float(lengths.sum())
    if not 0.0 < distance < np.inf:
        raise InputError(f"Body '{armature.name}': the places of a walk are all the same.")
    # Constant speed: keyframes are spaced by distance.
    frames = frame_start + (frame_end - frame_start) * np.append(0, np.cumsum(lengths)) / distance

    data = armature.animation_data or armature.animation_data_create()
    cycle = data.action = bpy.data.actions.new(f"{armature.name} Walk Cycle")
    _key_cycle(armature, cycle, walk)
    strip = data.nla_tracks.new().strips.new("Walk", frame_start, cycle)
    strip.name = "Walk"  # before Blender 4.5 a new strip has the action's name
    strip.action_frame_start, strip.action_frame_end = 0, len(walk.rotations)
    # Each repetition advances by a stride, so feet do not slide.
    strip.repeat = distance / walk.stride_m
    strip.frame_start, strip.frame_end = frame_start, frame_end

    action = data.action = bpy.data.actions.new(f"{armature.name} Way")
    for axis in range(3):
        curve = compat.new_fcurve(armature, action, "location", axis)
        compat.set_keys(curve, zip(frames, positions[:, axis], strict=True))
    # Rest space faces -Y. The body turns round each corner within half a second.
    headings = np.unwrap(np.arctan2(moves[:, 0], -moves[:, 1]))
    turn = [(frames[0], headings[0])]
    fps = fps_of(bpy.context.scene)
    for corner, before, after in zip(frames[1:], headings, headings[1:], strict=False):
        turn += [(corner - fps / 4, before), (corner + fps / 4, after)]
    armature.rotation_mode = "XYZ"
    curve = compat.new_fcurve(armature, action, "rotation_euler", 2)
    compat.set_keys(curve, turn, interpolation="BEZIER")


def _key_cycle(armature: bpy.types.Object, action: bpy.types.Action, walk: WalkCycle) -> None:
    frames = np.arange(len(walk.rotations) + 1)  # the first pose again at the end
    for k, bone in enumerate(walk.bone_names):
        armature.pose.bones[bone].rotation_mode = "QUATERNION"
        turns = np.append(walk.rotations[:, k], walk.rotations[:1, k], axis=0)
        for axis in range(4):
            path = f'pose.bones["{bone}"].rotation_quaternion'
            curve = compat.new_fcurve(armature, action, path, axis)
            compat.set_keys(curve, zip(frames, turns[:, axis], strict=True))
    root = armature.data.bones[0]
    # Locations of a pose bone are in the bone's rest axes.
    to_bone = np.array(root.matrix_local.to_3x3().inverted(), np.float64)
    offsets = np.append(walk.root_offset_m, walk.root_offset_m[:1], axis=0) @ to_bone.T
    for axis in range(3):
        curve = compat.new_fcurve(armature, action, f'pose.bones["{root.name}"].location', axis)
        compat.set_keys(curve, zip(frames, offsets[:, axis], strict=True))
