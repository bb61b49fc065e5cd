# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of points on the skin and of vector sensations, at a time or at many."""

from __future__ import annotations

import re
from collections.abc import Callable

import bpy
import numpy as np

from ...blender.stored_values import limited
from ...engine.arrays import F64

Value = Callable[[str], F64]
"""Path of a property below ``hfx`` -> its values (T,)."""

_DRIVE = re.compile(r"hfx\.drive\[(\d+)\]\.value")

PLACE = ("path_position", "radius")


def is_drive(path: str) -> bool:
    """Test an animated path for the strength of an actuator."""
    return _DRIVE.fullmatch(path) is not None


def place(hfx: bpy.types.PropertyGroup, unit_m: float) -> F64 | None:
    """Share of the path and radius in metres, (2,), of a point on the skin."""
    if hfx.kind != "SPOT":
        return None
    return np.array([limited(hfx, "path_position"), limited(hfx, "radius") * unit_m])


def drive(hfx: bpy.types.PropertyGroup) -> F64 | None:
    """Strength of each actuator, (A,), of a vector sensation."""
    if hfx.kind != "ACTUATORS":
        return None
    return np.array([limited(each, "value") for each in hfx.drive], np.float64)


def places(hfx: bpy.types.PropertyGroup, unit_m: float, value: Value) -> F64 | None:
    """Values of :func:`place` at many times, (T, 2)."""
    if hfx.kind != "SPOT":
        return None
    along, radius = (value(name) for name in PLACE)
    return np.stack([along, radius * unit_m], axis=1)


def drives(hfx: bpy.types.PropertyGroup, value: Value) -> F64 | None:
    """Values of :func:`drive` at many times, (T, A)."""
    if hfx.kind != "ACTUATORS" or not len(hfx.drive):
        return None
    return np.stack([value(f"drive[{k}].value") for k in range(len(hfx.drive))], axis=1)
