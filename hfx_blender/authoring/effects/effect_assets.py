# SPDX-License-Identifier: GPL-3.0-or-later
"""Sensations as assets: an empty dragged out of the Asset Browser names a sensation.

A drop brings the empty; :func:`take_dropped` puts the sensation in its place: painted effects on
the body, volumes where it was dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy
from mathutils import Vector

from ...avatars import avatar_meshes
from ...blender.scene_info import metres_of
from . import effects

if TYPE_CHECKING:
    from .effect_file import Sensation

SENSATION = "hfx_sensation"
"""ID property of an asset's empty: the file name of the sensation, without ending."""

LIBRARY_FILE = "sensations.blend"

_ON_BODY_M = 0.1
"""A drop so near to an avatar's bounding box is meant for the body."""


def dropped_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Objects dropped into a scene that have not been replaced yet."""
    return [obj for obj in scene.objects if SENSATION in obj]


def is_worn(sensation: Sensation) -> bool:
    """Test a sensation for effects on the body."""
    from .effect_file import VolumeRecipe

    return not all(isinstance(effect.where, VolumeRecipe) for effect in sensation.effects)


def take_dropped(scene: bpy.types.Scene, dropped: bpy.types.Object) -> list[bpy.types.Object]:
    """Replace a dropped object by its sensation; returns the effects that were made.

    What was dropped is gone, whether it fits or not.

    Raises
    ------
    InputError
        There is no such sensation, or no body to paint it on; nothing is made.
    """
    from . import effect_exchange  # imported late: Blender's start would wait for it

    name, place = str(dropped[SENSATION]), dropped.matrix_world.translation.copy()
    bpy.data.objects.remove(dropped)
    sensation = effect_exchange.load_library(name)
    body, distance = nearest_body(scene, place)
    is_meant_for_body = is_worn(sensation) or distance * metres_of(scene) <= _ON_BODY_M
    if body is not None and is_meant_for_body:
        place = body.matrix_world.translation
    return effect_exchange.place(
        scene, sensation, body=body, frame=float(scene.frame_current), origin=place
    )


def nearest_body(
    scene: bpy.types.Scene, place: Sequence[float]
) -> tuple[bpy.types.Object | None, float]:
    """Haptic body whose avatar is nearest to a place, and its distance, Blender's units."""
    best: tuple[bpy.types.Object | None, float] = (None, float("inf"))
    for body in effects.bodies_of(scene):
        shown = avatar_meshes.meshes_of(body) or [body]
        distance = min(_distance(each, place) for each in shown)
        if distance < best[1]:
            best = body, distance
    return best


def _distance(obj: bpy.types.Object, place: Sequence[float]) -> float:
    """Distance of a place from an object's bounding box in the world."""
    import numpy as np

    corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
    point = np.array(place, np.float64)
    outside = np.maximum(np.maximum(corners.min(axis=0) - point, point - corners.max(axis=0)), 0.0)
    return float(np.linalg.norm(outside))
