# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that a scene may show or depend on, though none of its collections holds them."""

from __future__ import annotations

from collections.abc import Iterable

import bpy


def is_instancer(obj: bpy.types.Object) -> bool:
    """Test for an object that may make instances of others, or of its own geometry."""
    return (
        obj.instance_type != "NONE"
        or bool(obj.particle_systems)
        or any(modifier.type == "NODES" for modifier in obj.modifiers)
    )


def reached_from(start: Iterable[bpy.types.Object]) -> set[bpy.types.Object]:
    """Objects, and all that they refer to, directly or not; a superset of what is needed."""
    return {each for each in data_reached_from(start) if isinstance(each, bpy.types.Object)}


def data_reached_from(start: Iterable[bpy.types.Object]) -> set[bpy.types.ID]:
    """Objects, and all data that they refer to over any number of steps; see above."""
    start = list(start)
    uses: dict[bpy.types.ID, list[bpy.types.ID]] = {}
    for used, users in bpy.data.user_map().items():
        for user in users:
            if not isinstance(user, bpy.types.Scene):
                uses.setdefault(user, []).append(used)
    for obj in bpy.data.objects:  # the children of an instancer are what it makes instances of
        if obj.parent is not None and obj.parent.instance_type != "NONE":
            uses.setdefault(obj.parent, []).append(obj)
    found: set[bpy.types.ID] = set()
    waiting: list[bpy.types.ID] = [*start]
    while waiting:
        each = waiting.pop()
        if each not in found:
            found.add(each)
            waiting += uses.get(each, ())
    return found
