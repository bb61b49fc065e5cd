# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes of effects and bodies that Blender does not report: properties set by scripts, painted
areas, items added to a list.

Blender's dependency graph is the only one that tells of changes. An object whose properties differ
from those of its evaluated copy was changed without its knowledge, and is tagged.
"""

from __future__ import annotations

import bpy

from ...authoring.effects import effects
from ...blender import compat


def tag(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bool:
    """Tag the effects and bodies whose change was not reported; returns True if there are any.

    Nothing else is tagged: that would empty the caches of simulations.
    """
    changed = [
        obj
        for obj in (*effects.effects_of(scene), *effects.bodies_of(scene))
        if _content(obj) != _content(obj.evaluated_get(layer.depsgraph))
    ]
    for obj in changed:
        obj.update_tag()
    return bool(changed)


def _content(obj: bpy.types.Object) -> str:
    """Text of what an object stores for haptics: NaN is equal to itself there."""
    arrays = [
        (key, _plain(value))
        for key, value in obj.items()
        if key.startswith("hfx_")  # "hfx" itself, where it is listed, is a group of properties
    ]
    return repr((compat.properties(obj), arrays))


def _plain(value: object) -> object:
    if isinstance(value, bpy.types.ID):
        return value.name_full
    return value.to_list() if hasattr(value, "to_list") else value
