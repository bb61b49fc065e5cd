# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects motion too fast for poses that are read only now and then.

Between two keys a value goes one way, or there and back: poses no farther apart than keys show
it. What nothing bounds, such as drivers and noise, may swing between any two poses unseen. So may
most constraints: what aims at a target that comes near, or takes a limb to its full reach, or
splits a rotation into angles, turns by any angle while its target hardly moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

import bpy
import numpy as np

from ...blender import compat
from .reached import data_reached_from

_MOST_TURN: Final = math.pi / 4
"""Radians that a rotation may turn between two poses: its fastest is not thrice its mean."""

_STILL_SHOWN: Final = {"LIMITS", "CYCLES"}
"""Modifiers of F-curves that do not make them any faster."""

_SWINGING: Final = ("ELASTIC", "BOUNCE")
"""Ways between two keys that are gone to and fro."""

_EVEN: Final = {"COPY_LOCATION", "COPY_SCALE", "LIMIT_LOCATION", "LIMIT_SCALE"}
"""Constraints that move nothing much faster than their targets."""

_EVEN_WHOLE: Final = {"COPY_TRANSFORMS", "CHILD_OF"}
"""The same of those that take over a rotation, unless in part, which may go either way round."""

_ROUNDING: Final = 1e-3  # frames: keys are single precision


def is_shown_by(apart: float, objects: Iterable[bpy.types.Object]) -> bool:
    """Test that poses so many frames apart show all motion of some objects.

    So it is where F-curves alone move what they depend on, each so slowly, and constraints pass
    it on no faster.
    """
    reached = data_reached_from(objects)
    moved = [each for each in reached if getattr(each, "animation_data", None) is not None]
    if any(len(owner.animation_data.drivers) for owner in moved):
        return False
    if not all(_passes_on_evenly(each, reached) for each in _constraints(reached)):
        return False
    speed = max(map(_speed_of, _strips(moved)), default=1.0)
    if not math.isfinite(speed):
        return False
    items = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items
    swinging = [items[name].value for name in _SWINGING]
    return all(_is_slow(curve, apart * max(speed, 1.0), swinging) for curve in _curves(reached))


def _strips(moved: Iterable[bpy.types.ID]) -> Iterator[bpy.types.NlaStrip]:
    for owner in moved:
        for track in owner.animation_data.nla_tracks:
            yield from compat.with_grouped(track.strips)


def _speed_of(strip: bpy.types.NlaStrip) -> float:
    """Speed at which a strip plays its action; infinity where an F-curve controls it."""
    if strip.use_animated_time or strip.modifiers:
        return math.inf
    return 1.0 / max(abs(strip.scale), 1e-9)


def _constraints(reached: Iterable[bpy.types.ID]) -> Iterator[bpy.types.Constraint]:
    for obj in reached:
        if isinstance(obj, bpy.types.Object):
            yield from obj.constraints
            for bone in () if obj.pose is None else obj.pose.bones:
                yield from bone.constraints


def _passes_on_evenly(constraint: bpy.types.Constraint, reached: Iterable[bpy.types.ID]) -> bool:
    """Test that a constraint makes slow motion no faster, wherever its target goes."""
    kind = constraint.type
    if kind == "LIMIT_ROTATION":
        return not any(getattr(constraint, f"use_limit_{axis}") for axis in "xyz")
    if kind in _EVEN:
        return True
    if kind not in _EVEN_WHOLE or constraint.influence < 1.0:
        return False
    path = constraint.path_from_id()
    if any(curve.data_path.startswith(path) for curve in _curves(reached)):
        return False
    if kind == "CHILD_OF":
        ways = ("location", "rotation", "scale")
        return all(getattr(constraint, f"use_{way}_{axis}") for way in ways for axis in "xyz")
    return bool(constraint.mix_mode == "REPLACE")


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
    if not np.isfinite(places).all() or gaps.min() < apart - _ROUNDING:
        return False
    kinds = np.zeros(len(points), np.int32)
    points.foreach_get("interpolation", kinds)
    if any((kinds == each).any() for each in swinging):
        return False
    if "rotation_euler" not in curve.data_path and "axis_angle" not in curve.data_path:
        return True
    return bool((np.abs(np.diff(values)) * apart <= _MOST_TURN * gaps).all())
