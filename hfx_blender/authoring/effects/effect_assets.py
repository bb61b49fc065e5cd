# SPDX-License-Identifier: GPL-3.0-or-later
"""Sensations in the Asset Browser: a dropped empty is replaced by a sensation.

Painted effects are placed on a body, volumes at the position of the drop.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy

from ...avatars import avatar_meshes
from ...blender.scene_info import metres_of
from . import effects
from .effect_file import VolumeRecipe

if TYPE_CHECKING:
    from .effect_file import Sensation

SENSATION = "hfx_sensation"
"""ID property of an asset's empty: the sensation's file name without suffix."""

LIBRARY_FILE = "sensations.blend"
AUTHOR = "HFX"  # author in the metadata of the assets
_ON_BODY_M = 0.1  # largest distance of a drop on a body from the avatar's bounding box


def dropped_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Dropped empties of a scene."""
    return [obj for obj in scene.objects if SENSATION in obj]


def has_effects_on_body(sensation: Sensation) -> bool:
    """Test for a sensation with effects on a body."""
    return not all(isinstance(effect.where, VolumeRecipe) for effect in sensation.effects)


def replace_dropped(scene: bpy.types.Scene, dropped: bpy.types.Object) -> list[bpy.types.Object]:
    """Replace a dropped empty by the sensation; return the new effects.

    The empty is removed in any case.

    Raises InputError: there is no such sensation, or no body; no effect is added.
    """
    from . import effect_exchange  # not needed at Blender's start

    name, location = str(dropped[SENSATION]), dropped.matrix_world.translation.copy()
    # Removed first: an error must not leave an empty without a function.
    bpy.data.objects.remove(dropped)
    sensation = effect_exchange.load_library(name)
    body, distance = nearest_body(scene, location)
    # Volumes dropped on a body are placed around it, as painted effects are.
    is_meant_for_body = has_effects_on_body(sensation) or distance * metres_of(scene) <= _ON_BODY_M
    if body is not None and is_meant_for_body:
        location = body.matrix_world.translation
    return effect_exchange.place_sensation(
        scene, sensation, body=body, frame=float(scene.frame_current), origin=location
    )


def nearest_body(
    scene: bpy.types.Scene, point: Sequence[float]
) -> tuple[bpy.types.Object | None, float]:
    """Nearest haptic body to a point by the avatar's boxes, and the distance in Blender units.
    (None, inf) without a body."""
    import numpy as np

    from ...blender import mesh_arrays

    position = np.array(point, np.float64)
    nearest: tuple[bpy.types.Object | None, float] = (None, float("inf"))
    for body in effects.bodies_of(scene):
        for obj in avatar_meshes.meshes_of(body) or [body]:
            # The nearest point of a box is the point clipped to the box; 0 inside.
            lowest, highest = mesh_arrays.world_box(obj)
            distance = float(np.linalg.norm(position - np.clip(position, lowest, highest)))
            if distance < nearest[1]:
                nearest = body, distance
    return nearest
