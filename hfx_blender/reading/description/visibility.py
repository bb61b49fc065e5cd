# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that Blender evaluates: visibility, and changes that its dependency graph did not report.

Only enabled objects of the view layer are evaluated. The monitor icon (`hide_viewport`) may be
keyed, so the current frame does not decide. The eye icon and the camera icon have no influence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import bpy

from ...authoring.effects import effects
from ...blender import compat, scene_info

if TYPE_CHECKING:
    from ...engine.scene import SceneDescription  # Blender's start does not wait for it

PATH = "hide_viewport"  # property of the monitor icon


def is_keyed(obj: bpy.types.Object, path: str = PATH) -> bool:
    """Test for an F-curve (action or strip, also muted) or a driver of ``path``, by default of the
    monitor icon."""
    data = obj.animation_data
    if data is None:
        return False
    return any(curve.data_path == path for curve in (*compat.all_fcurves(obj), *data.drivers))


def is_disabled(obj: bpy.types.Object) -> bool:
    """Test for a monitor icon that is off now and not animated."""
    return bool(obj.hide_viewport) and not is_keyed(obj)


def enabled_objects(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> set[bpy.types.Object]:
    """Objects in view layers of a scene and the background scenes, without disabled or excluded
    collections; the objects' own icons are ignored."""
    layers = [layer, *map(scene_info.layer_of, scene_info.backgrounds_of(scene))]
    return set().union(*(_enabled(view.layer_collection) for view in layers))


def _enabled(collection: bpy.types.LayerCollection) -> set[bpy.types.Object]:
    """Objects of a layer collection and the children. A disabled collection hides the children too,
    an excluded one does not."""
    if collection.collection.hide_viewport:
        return set()
    objects = set() if collection.exclude else set(collection.collection.objects)
    return objects.union(*map(_enabled, collection.children))


def may_be_seen(
    obj: bpy.types.Object, layer: bpy.types.ViewLayer, enabled: set[bpy.types.Object]
) -> bool:
    """Test that Blender evaluates an object at some frame: in ``enabled`` (see
    :func:`enabled_objects`), monitor icon on or animated, and evaluated now."""
    # Outside the view layer Blender returns the unposed original, and dependencies alone do not
    # make Blender pose an object.
    is_enabled = obj in enabled and not is_disabled(obj)
    return is_enabled and obj.evaluated_get(layer.depsgraph).is_evaluated


def felt_on(scene: SceneDescription, which: Sequence[bool]) -> list[int]:
    """Ascending indices of effects with an area on a body selected by ``which`` (one entry per
    body); volumes and surfaces have none."""
    ids = {body.id for body, is_one in zip(scene.bodies, which, strict=True) if is_one}
    return [k for k, e in enumerate(scene.effects) if getattr(e.area, "body_id", None) in ids]


def tag_unreported(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> None:
    """Tag effects and bodies of a scene as of :func:`tag_changed`."""
    objects = (*effects.effects_of(scene), *effects.bodies_of(scene))
    tag_changed({obj: stored_of(obj) for obj in objects}, layer)


def tag_changed(
    stored: Mapping[bpy.types.Object, dict[str, Any]], layer: bpy.types.ViewLayer
) -> bool:
    """Tag the objects of ``stored`` (see :func:`stored_of`) whose haptic values differ from those
    of the evaluated copy; returns True if there are any."""
    # Blender's dependency graph does not report values set by scripts, and list items. Other
    # objects are not tagged, because a tag clears simulation caches.
    depsgraph = layer.depsgraph
    changed = [
        obj
        for obj, values in stored.items()
        for copy in [obj.evaluated_get(depsgraph)]
        # Raw values of most unchanged objects are equal, and quick to compare; NaN is not.
        if values != stored_of(copy) and _content(obj) != _content(copy)
    ]
    for obj in changed:
        obj.update_tag()
    return bool(changed)


def stored_of(obj: bpy.types.Object) -> dict[str, Any]:
    """An object's stored values by name; a data-block in the values is another one in copies."""
    stored = {"hfx": compat.stored_properties(obj).get("hfx")}
    stored |= {name: value for name, value in obj.items() if name != "hfx"}
    # Groups and arrays, as Blender stores these.
    groups = {k: v.to_dict() if hasattr(v, "to_dict") else v for k, v in stored.items()}
    return {k: v.to_list() if hasattr(v, "to_list") else v for k, v in groups.items()}


def _content(obj: bpy.types.Object) -> str:
    """Text of an object's haptic property group and its "hfx_" properties, for comparison; as text
    NaN equals NaN. Data-blocks count by full name."""
    # "hfx" itself is a property group.
    values = [(k, compat.plain(value)) for k, value in obj.items() if k.startswith("hfx_")]
    return repr((compat.properties(obj), values))
