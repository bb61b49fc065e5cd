# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of spots on the skin and of vector sensations, and the checked areas."""

from __future__ import annotations

import re
from collections.abc import Callable

import bpy
import numpy as np

from ...authoring.effects import effect_values
from ...authoring.paths import paths
from ...blender.stored_values import limited
from ...engine.arrays import F64
from ...engine.scene import ActuatorArea, SpotArea
from ...errors import InputError

Value = Callable[[str], F64]
"""Function from a property path below ``hfx`` to values (T,)."""

_DRIVE = re.compile(r"hfx\.drive\[(\d+)\]\.value")

PLACE = ("path_position", "radius")


def is_drive(path: str) -> bool:
    """Test an RNA path for the strength of an actuator, ``hfx.drive[k].value``."""
    return _DRIVE.fullmatch(path) is not None


def place(hfx: bpy.types.PropertyGroup, unit_m: float) -> F64 | None:
    """Present position on the path (0..1) and radius in metres, (2,), clamped to hard limits; None
    unless a spot."""
    if hfx.kind != "SPOT":
        return None
    return np.array([limited(hfx, "path_position"), limited(hfx, "radius") * unit_m])


def drive(hfx: bpy.types.PropertyGroup) -> F64 | None:
    """Present strengths (A,) of the actuators, clamped to hard limits; None unless of kind
    ACTUATORS."""
    if hfx.kind != "ACTUATORS":
        return None
    return np.array([limited(item, "value") for item in hfx.drive], np.float64)


def places(hfx: bpy.types.PropertyGroup, unit_m: float, value: Value) -> F64 | None:
    """Position on the path (0..1) and radius in metres at T times, (T, 2), from ``value(name)`` in
    Blender units; None unless a spot."""
    if hfx.kind != "SPOT":
        return None
    along, radius = (value(name) for name in PLACE)
    return np.stack([along, radius * unit_m], axis=1)


def drives(hfx: bpy.types.PropertyGroup, value: Value) -> F64 | None:
    """Strengths (T, A) of the A actuators from ``value("drive[k].value")``; None without
    actuators."""
    if hfx.kind != "ACTUATORS" or not len(hfx.drive):
        return None
    return np.stack([value(f"drive[{k}].value") for k in range(len(hfx.drive))], axis=1)


def spot_area(effect: bpy.types.Object, body_id: str) -> SpotArea:
    """Path and falloff of a spot; raises InputError without a position or for a damaged path."""
    path = paths.path_of(effect)
    if not len(path):
        raise InputError(f"Effect '{effect.name}' is nowhere on the skin. Place it, or delete it.")
    return SpotArea(body_id, path, effect_values.falloff(effect.hfx))


def actuator_area(effect: bpy.types.Object, body_id: str) -> ActuatorArea:
    """Device and actuators, in stored order, of a vector sensation; raises InputError without a
    device or actuator, and for an actuator listed twice."""
    names = tuple(item.name for item in effect.hfx.drive)
    if not effect.hfx.device or not names:
        raise InputError(f"Effect '{effect.name}' drives no actuators. Choose its device.")
    if len(set(names)) != len(names):
        raise InputError(f"Effect '{effect.name}' names an actuator twice.")
    return ActuatorArea(body_id, effect.hfx.device, names)


def signature(effect: bpy.types.Object) -> tuple[object, ...]:
    """Comparable value for the detection of changes: hash of a spot's path, or device id and names
    of the driven actuators of an actuator effect; () for other kinds."""
    hfx = effect.hfx
    if hfx.kind == "SPOT":
        return (hash(paths.path_of(effect).tobytes()),)
    return (hfx.device, *(item.name for item in hfx.drive)) if hfx.kind == "ACTUATORS" else ()
