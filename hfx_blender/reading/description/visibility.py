# SPDX-License-Identifier: GPL-3.0-or-later
"""Visibility of objects: those in the view layer that the viewport does not disable are evaluated.

The monitor icon can be keyed, and then tells at each time whether an object is there; the frame
that is current does not. Neither the eye icon nor the camera icon matters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy

from ...blender import compat, scene_info

if TYPE_CHECKING:
    from ...engine.scene import SceneDescription  # Blender's start does not wait for it

PATH = "hide_viewport"
"""Property by which an animation disables an object."""


def is_keyed(obj: bpy.types.Object, path: str = PATH) -> bool:
    """Test for an action, a clip or a driver that disables an object at times, or changes another
    of its properties.
    """
    data = obj.animation_data
    if data is None:
        return False
    curves = [curve for each in compat.curve_collections(obj) for curve in each]
    return any(curve.data_path == path for curve in (*curves, *data.drivers))


def is_disabled(obj: bpy.types.Object) -> bool:
    """Test for an object that is disabled in viewports at all times."""
    return bool(obj.hide_viewport) and not is_keyed(obj)


def enabled_objects(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> set[bpy.types.Object]:
    """Objects of the collections that are on in a view layer of a scene, or behind it."""
    layers = [layer, *map(scene_info.layer_of, scene_info.backgrounds_of(scene))]
    return set().union(*(_enabled(each.layer_collection) for each in layers))


def _enabled(collection: bpy.types.LayerCollection) -> set[bpy.types.Object]:
    if collection.collection.hide_viewport:
        return set()
    found = set() if collection.exclude else set(collection.collection.objects)
    return found.union(*map(_enabled, collection.children))


def may_be_seen(
    obj: bpy.types.Object, layer: bpy.types.ViewLayer, enabled: set[bpy.types.Object]
) -> bool:
    """Test that Blender evaluates an object at any time; ``enabled`` are those of the layer."""
    # An object outside the view layer is returned as its unposed original; and even where
    # something else needs it, so that it is evaluated, it is not posed.
    is_there = obj in enabled and not is_disabled(obj)
    return is_there and obj.evaluated_get(layer.depsgraph).is_evaluated


def felt_on(scene: SceneDescription, which: Sequence[bool]) -> list[int]:
    """Effects, by their place in a scene, that act on some of its bodies."""
    ids = {body.id for body, is_one in zip(scene.bodies, which, strict=True) if is_one}
    return [k for k, e in enumerate(scene.effects) if getattr(e.area, "body_id", None) in ids]
