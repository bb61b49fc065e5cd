# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes: units of length and time, objects of their background scenes; nodes of node trees.

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


def animation_fps(scene: bpy.types.Scene) -> float:
    """Frames of the animation per second of playback; :func:`fps_of` without time remapping."""
    return fps_of(scene) * _remapped(scene)


def frames_per_shown_unit(scene: bpy.types.Scene) -> float:
    """Frames of the animation per displayed unit of time: 1, or those of a second of playback."""
    return 1.0 if scene.hfx.time_unit == "FRAMES" else animation_fps(scene)


def shown_time(scene: bpy.types.Scene, frame: float) -> float:
    """Displayed time of a frame of the animation: the frame, or seconds of playback since the
    scene's first frame, which is time zero of tracks, reports and scripts."""
    return (frame - _zero_frame(scene)) / frames_per_shown_unit(scene)


def frame_at(scene: bpy.types.Scene, time: float) -> float:
    """Frame of the animation at a displayed time; inverse of :func:`shown_time`."""
    return time * frames_per_shown_unit(scene) + _zero_frame(scene)


def _zero_frame(scene: bpy.types.Scene) -> float:
    """Frame of the animation at displayed time 0."""
    return 0.0 if scene.hfx.time_unit == "FRAMES" else scene.frame_start * _remapped(scene)


def _remapped(scene: bpy.types.Scene) -> float:
    """Frames of the animation per played frame; 1 without time remapping."""
    return float(scene.render.frame_map_old / scene.render.frame_map_new)


def backgrounds_of(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    """Yield the background scene of a scene, then the background scene of that, and so on."""
    while scene.background_set is not None:
        scene = scene.background_set
        yield scene


def scene_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Unique objects of a scene, followed by objects of the background scenes."""
    # Two scenes may share an object.
    background = (obj for behind in backgrounds_of(scene) for obj in behind.objects)
    return list(dict.fromkeys((*scene.objects, *background)))


def layer_of(background: bpy.types.Scene) -> bpy.types.ViewLayer:
    """View layer shown of a background scene: the first for rendering, else the first."""
    layers = background.view_layers
    return next((layer for layer in layers if layer.use), layers[0])


def nodes_of(
    tree: bpy.types.NodeTree | None, seen: set[str] | None = None
) -> Iterator[bpy.types.Node]:
    """Yield the nodes of a tree and of nested groups, each group once; none for None. Full names of
    the trees are added to ``seen``, in place; trees in it are left out."""
    seen = set() if seen is None else seen
    # Blender refuses groups within themselves, but a damaged file may have some.
    if tree is not None and tree.name_full not in seen:
        seen.add(tree.name_full)
        for node in tree.nodes:
            yield node
            yield from nodes_of(getattr(node, "node_tree", None), seen)
