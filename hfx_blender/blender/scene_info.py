# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes: units of length and time, and the objects of their background scenes.

Blender evaluates and shows the objects of a background scene (``background_set``) in the scene that
refers to the background. A background scene may have a background scene in turn; Blender rejects
cycles.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy


def metres_of(scene: bpy.types.Scene) -> float:
    """Metres per Blender unit; 1 without a unit system."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(settings.scale_length)


def fps_of(scene: bpy.types.Scene) -> float:
    """Frames per second of playback."""
    return float(scene.render.fps / scene.render.fps_base)


def frames_per_shown_unit(scene: bpy.types.Scene) -> float:
    """Frames per displayed unit of time: 1 for frames, or the frame rate for seconds."""
    return 1.0 if scene.hfx.time_unit == "FRAMES" else fps_of(scene)


def backgrounds_of(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    """Yield the background scene of a scene, then the background scene of that, and so on."""
    while scene.background_set is not None:
        scene = scene.background_set
        yield scene


def scene_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Unique objects of a scene, followed by objects of the background scenes."""
    background = (obj for behind in backgrounds_of(scene) for obj in behind.objects)
    return list(dict.fromkeys((*scene.objects, *background)))


def layer_of(background: bpy.types.Scene) -> bpy.types.ViewLayer:
    """View layer shown of a background scene: the first for rendering, else the first."""
    layers = background.view_layers
    return next((layer for layer in layers if layer.use), layers[0])
