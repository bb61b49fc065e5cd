# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that a scene may show or depend on, though none of its collections holds them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

import bpy

from ...authoring.effects import swarms
from ...blender.scene_info import scene_objects

Reference = tuple[bpy.types.ID, bpy.types.ID]
"""Data, and other data that it refers to."""


def is_instancer(obj: bpy.types.ID) -> bool:
    """Test for an object that may make instances of others, or of its own geometry."""
    return isinstance(obj, bpy.types.Object) and (
        obj.instance_type != "NONE"
        or bool(obj.particle_systems)
        or any(modifier.type == "NODES" for modifier in obj.modifiers)
    )


def is_volume(obj: bpy.types.Object) -> bool:
    """Test for a haptic volume."""
    return bool(obj.hfx.role == "EFFECT" and obj.hfx.kind == "VOLUME")


def sources_of(scene: bpy.types.Scene) -> dict[str, bpy.types.Object]:
    """Volumes that something in a scene may instance, by their full names, sorted."""
    if not any(map(is_volume, bpy.data.objects)):
        return {}
    instancers = [obj for obj in scene_objects(scene) if is_instancer(obj)]
    reached = reached_from(instancers) if instancers else set()
    return {obj.name_full: obj for obj in sorted(reached, key=_full_name) if is_volume(obj)}


def has_effects(scene: bpy.types.Scene) -> bool:
    """Test for haptic effects of a scene, also for those that it only has instances of."""
    return bool(swarms.listed_effects(scene) or sources_of(scene))


def _full_name(data: bpy.types.ID) -> str:
    return str(data.name_full)


def reached_from(
    start: Iterable[bpy.types.Object], ignored: Collection[Reference] = ()
) -> set[bpy.types.Object]:
    """Objects, and all that they refer to, directly or not; a superset of what is needed."""
    found = data_reached_from(start, ignored)
    return {each for each in found if isinstance(each, bpy.types.Object)}


def data_reached_from(
    start: Iterable[bpy.types.Object], ignored: Collection[Reference] = ()
) -> set[bpy.types.ID]:
    """Objects, and all data that they refer to over any number of steps; see above.

    ``ignored`` references lead nowhere.
    """
    uses: dict[bpy.types.ID, list[bpy.types.ID]] = {}
    for user, used in _references():
        if (user, used) not in ignored:
            uses.setdefault(user, []).append(used)
    return _closure(start, uses)


def data_reaching(start: Iterable[bpy.types.Object]) -> set[bpy.types.ID]:
    """Objects, and all data that refers to them over any number of steps."""
    users: dict[bpy.types.ID, list[bpy.types.ID]] = {}
    for user, used in _references():
        users.setdefault(used, []).append(user)
    return _closure(start, users)


def _references() -> Iterator[Reference]:
    """Pairs of data and of other data that it refers to; what scenes hold does not count."""
    for used, users in bpy.data.user_map().items():
        yield from ((user, used) for user in users if not isinstance(user, bpy.types.Scene))
    for obj in bpy.data.objects:  # the children of an instancer are what it makes instances of
        if obj.parent is not None and obj.parent.instance_type != "NONE":
            yield obj.parent, obj


def _closure(
    start: Iterable[bpy.types.Object], following: dict[bpy.types.ID, list[bpy.types.ID]]
) -> set[bpy.types.ID]:
    found: set[bpy.types.ID] = set()
    waiting: list[bpy.types.ID] = [*start]
    while waiting:
        each = waiting.pop()
        if each not in found:
            found.add(each)
            waiting += following.get(each, ())
    return found
