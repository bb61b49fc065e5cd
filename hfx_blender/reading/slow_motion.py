# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether poses that are read now and then show how everything moves that Blender poses.

Between two keys a value goes one way, or there and back: poses no farther apart than keys show
it. What nothing bounds, such as drivers and noise, may swing between any two poses unseen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Final

import bpy
import numpy as np

from .. import compat
from .reached import data_reached_from

_MOST_TURN: Final = math.pi / 4
"""Radians that a rotation may turn between two poses: its fastest is not thrice its mean."""

_STILL_SHOWN: Final = {"LIMITS", "CYCLES"}
"""Modifiers of F-curves that do not make them any faster."""

_SWINGING: Final = ("ELASTIC", "BOUNCE")
"""Ways between two keys that are gone to and fro."""

_ROUNDING: Final = 1e-3  # frames: keys are single precision


def is_shown_by(apart: float, objects: Iterable[bpy.types.Object]) -> bool:
    """Whether poses that many frames apart show all motion of some objects.

    So it is where F-curves alone move them, each so slowly; the motion of all that they refer
    to counts as well, since a constraint may pass it on to a bone.
    """
    reached = data_reached_from(objects)
    moved = [each for each in reached if getattr(each, "animation_data", None) is not None]
    if any(len(owner.animation_data.drivers) for owner in moved):
        return False
    speed = max(map(_speed_of, _strips(moved)), default=1.0)
    if not math.isfinite(speed) or _acts_on_values(reached):
        return False
    items = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items
    swinging = [items[name].value for name in _SWINGING]
    return all(_is_slow(curve, apart * max(speed, 1.0), swinging) for curve in _curves(reached))


def _strips(moved: Iterable[bpy.types.ID]) -> Iterator[bpy.types.NlaStrip]:
    for owner in moved:
        for track in owner.animation_data.nla_tracks:
            yield from compat.with_grouped(track.strips)


def _speed_of(strip: bpy.types.NlaStrip) -> float:
    """How much faster a strip plays its action; infinity where an F-curve tells."""
    if strip.use_animated_time or strip.modifiers:
        return math.inf
    return 1.0 / max(abs(strip.scale), 1e-9)


def _acts_on_values(reached: Iterable[bpy.types.ID]) -> bool:
    """Whether a constraint plays an action as a value tells: a slow one may play it fast."""
    for obj in reached:
        if not isinstance(obj, bpy.types.Object):
            continue
        bones = () if obj.pose is None else obj.pose.bones
        stacks = chain([obj.constraints], (bone.constraints for bone in bones))
        if any(each.type == "ACTION" for stack in stacks for each in stack):
            return True
    return False


def _curves(reached: Iterable[bpy.types.ID]) -> Iterator[bpy.types.FCurve]:
    for action in reached:
        if isinstance(action, bpy.types.Action):
            slots: Iterable[bpy.types.ActionSlot | None] = getattr(action, "slots", (None,))
            for slot in slots:
                yield from compat.action_fcurves(action, slot)


def _is_slow(curve: bpy.types.FCurve, apart: float, swinging: Iterable[int]) -> bool:
    if curve.mute:
        return True
    if any(not each.mute and each.type not in _STILL_SHOWN for each in curve.modifiers):
        return False
    points = curve.keyframe_points
    if len(curve.sampled_points):  # baked: a value for each frame
        return apart <= 1.0 + _ROUNDING
    if len(points) < 2:
        return True
    places = np.zeros(2 * len(points))
    points.foreach_get("co", places)
    frames, values = places.reshape(-1, 2).T
    gaps = np.diff(frames)
    if gaps.min() < apart - _ROUNDING:
        return False
    kinds = np.zeros(len(points), np.int32)
    points.foreach_get("interpolation", kinds)
    if any((kinds == each).any() for each in swinging):
        return False
    if "rotation_euler" not in curve.data_path and "axis_angle" not in curve.data_path:
        return True
    return bool((np.abs(np.diff(values)) * apart <= _MOST_TURN * gaps).all())
