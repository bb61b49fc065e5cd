# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes not reported by Blender's dependency graph: values set by scripts, list items.

An object whose properties differ from those of the evaluated copy is tagged for an update.
"""

from __future__ import annotations

import bpy

from ...authoring.effects import effects
from ...blender import compat


def tag(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bool:
    """Tag effects and bodies of a scene whose stored haptic values differ from the evaluated copy;
    returns True if there are any. Other objects are not tagged, because a tag clears simulation
    caches."""
    changed = [
        obj
        for obj in (*effects.effects_of(scene), *effects.bodies_of(scene))
        if _content(obj) != _content(obj.evaluated_get(layer.depsgraph))
    ]
    for obj in changed:
        obj.update_tag()
    return bool(changed)


def _content(obj: bpy.types.Object) -> str:
    """Text of an object's haptic property group and its "hfx_" properties, for comparison; as text
    NaN equals NaN. Data-blocks count by full name."""
    values = []
    for key, value in obj.items():
        if key.startswith("hfx_"):  # "hfx" itself is a property group
            if isinstance(value, bpy.types.ID):
                value = value.name_full
            values.append((key, value.to_list() if hasattr(value, "to_list") else value))
    return repr((compat.properties(obj), values))
