# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects motion too fast for poses that are read only now and then.

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

_MOST_TURN: Final = math.pi / 4
"""Radians that a rotation may turn between two poses: its fastest is not thrice its mean."""

_STILL_SHOWN: Final = {"LIMITS", "CYCLES"}
"""Modifiers of F-curves that do not make them any faster."""

_SWINGING: Final = ("ELASTIC", "BOUNCE")
"""Ways between two keys that are gone to and fro."""

_ROUNDING: Final = 1e-3  # frames: keys are single precision


def is_shown_by(apart: float) -> bool:
    """Test that poses so many frames apart show all motion of the file.

    So it is where F-curves alone move what the file holds, each so slowly; other objects'
    motion counts as well, since a constraint may pass it on to a bone.
    """
    if any(_is_driven(owner) for owner in _owners()):
        return False
    speed = max(map(_speed_of, _strips()), default=1.0)
    if not math.isfinite(speed) or _acts_on_values():
        return False
    return all(_is_slow(curve, apart * max(speed, 1.0)) for curve in _curves())


def _owners() -> Iterator[bpy.types.ID]:
    """Datablocks that may carry animation which bones follow."""
    data = bpy.data
    yield from chain(
        *(data.objects, data.armatures, data.meshes, data.curves, data.lattices),
        *(data.shape_keys, data.cameras, data.lights, data.node_groups, data.scenes),
    )


def _is_driven(owner: bpy.types.ID) -> bool:
    return owner.animation_data is not None and bool(owner.animation_data.drivers)


def _strips() -> Iterator[bpy.types.NlaStrip]:
    for owner in _owners():
        if owner.animation_data is not None:
            for track in owner.animation_data.nla_tracks:
                yield from compat.with_grouped(track.strips)


def _speed_of(strip: bpy.types.NlaStrip) -> float:
    """Speed at which a strip plays its action; infinity where an F-curve controls it."""
    if strip.use_animated_time or strip.modifiers:
        return math.inf
    return 1.0 / max(abs(strip.scale), 1e-9)


def _acts_on_values() -> bool:
    """Test for a constraint that plays an action by a value: a slow one may play it fast."""
    for obj in bpy.data.objects:
        bones = () if obj.pose is None else obj.pose.bones
        stacks = chain([obj.constraints], (bone.constraints for bone in bones))
        if any(each.type == "ACTION" for stack in stacks for each in stack):
            return True
    return False


def _curves() -> Iterator[bpy.types.FCurve]:
    for action in bpy.data.actions:
        slots: Iterable[bpy.types.ActionSlot | None] = getattr(action, "slots", (None,))
        for slot in slots:
            yield from compat.action_fcurves(action, slot)


def _is_slow(curve: bpy.types.FCurve, apart: float) -> bool:
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
    items = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items
    if np.isin(kinds, [items[name].value for name in _SWINGING]).any():
        return False
    if "rotation_euler" not in curve.data_path and "axis_angle" not in curve.data_path:
        return True
    return bool((np.abs(np.diff(values)) * apart <= _MOST_TURN * gaps).all())
