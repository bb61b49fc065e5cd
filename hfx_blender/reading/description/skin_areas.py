# SPDX-License-Identifier: GPL-3.0-or-later
"""The areas of points on the skin and of vector sensations, checked."""

from __future__ import annotations

import bpy

from ...authoring.effects import effect_values
from ...authoring.paths import paths
from ...engine.scene import ActuatorArea, SpotArea
from ...errors import InputError


def spot_area(effect: bpy.types.Object, body_id: str) -> SpotArea:
    """The path of a point on the skin, and how its strength falls off to its rim.

    Raises
    ------
    InputError
        It has been put nowhere, or its path is broken.
    """
    path = paths.path_of(effect)
    if not len(path):
        raise InputError(f"Effect '{effect.name}' is nowhere on the skin. Place it, or delete it.")
    return SpotArea(body_id, path, effect_values.falloff(effect.hfx))


def actuator_area(effect: bpy.types.Object, body_id: str) -> ActuatorArea:
    """The device and the actuators of a vector sensation.

    Raises
    ------
    InputError
        It has none, or one of them twice.
    """
    names = tuple(each.name for each in effect.hfx.drive)
    if not effect.hfx.device or not names:
        raise InputError(f"Effect '{effect.name}' drives no actuators. Choose its device.")
    if len(set(names)) != len(names):
        raise InputError(f"Effect '{effect.name}' names an actuator twice.")
    return ActuatorArea(body_id, effect.hfx.device, names)


def signature(effect: bpy.types.Object) -> tuple[object, ...]:
    """Fingerprint of the area: changes with every setting that affects it."""
    hfx = effect.hfx
    if hfx.kind == "SPOT":
        return (hash(paths.path_of(effect).tobytes()),)
    return (hfx.device, *(each.name for each in hfx.drive)) if hfx.kind == "ACTUATORS" else ()
