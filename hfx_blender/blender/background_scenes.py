# SPDX-License-Identifier: GPL-3.0-or-later
"""Background scenes: Blender evaluates and shows their objects in the scene that names them.

A background scene (``background_set``) may name one in turn. Blender allows no circles.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy


def backgrounds_of(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    """Background scenes of a scene, the nearest first."""
    while scene.background_set is not None:
        scene = scene.background_set
        yield scene


def scene_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Objects of a scene and of its background scenes, each once."""
    own = scene.objects
    behind = (obj for each in backgrounds_of(scene) for obj in each.objects)
    return list(dict.fromkeys((*own, *behind)))


def layer_of(background: bpy.types.Scene) -> bpy.types.ViewLayer:
    """View layer that Blender shows of a background scene: the first that is rendered, if any."""
    layers = background.view_layers
    return next((layer for layer in layers if layer.use), layers[0])
