# SPDX-License-Identifier: GPL-3.0-or-later
"""References between data-blocks: instancers, sources of instances, and dependencies."""

from collections.abc import Collection, Iterable, Iterator, Sequence

import bpy

from ...authoring.effects import swarms
from ...blender.scene_info import scene_objects

Reference = tuple[bpy.types.ID, bpy.types.ID]  # (user, used) data-blocks


def is_instancer(obj: bpy.types.ID) -> bool:
    """Test for an object with instancing, particle systems or geometry nodes, which may show
    further objects."""
    return isinstance(obj, bpy.types.Object) and (
        obj.instance_type != "NONE"
        or bool(obj.particle_systems)
        or (bool(obj.modifiers) and any(modifier.type == "NODES" for modifier in obj.modifiers))
    )


def is_volume(obj: bpy.types.Object) -> bool:
    """Test for the object of a haptic volume."""
    return bool(obj.hfx.role == "EFFECT" and obj.hfx.kind == "VOLUME")


def instancers_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Objects of a scene that may show further objects, see :func:`is_instancer`."""
    return [obj for obj in scene_objects(scene) if is_instancer(obj)]


def sources_of(
    scene: bpy.types.Scene, instancers: Sequence[bpy.types.Object] | None = None
) -> dict[str, bpy.types.Object]:
    """Haptic volumes that a scene's ``instancers`` (None: :func:`instancers_of`) use, directly or
    not, by full name, sorted; empty without any."""
    if not any(map(is_volume, bpy.data.objects)):
        return {}
    instancers = instancers_of(scene) if instancers is None else instancers
    reached = reached_from(instancers) if instancers else set()
    volumes = filter(is_volume, sorted(reached, key=lambda obj: obj.name_full))
    return {obj.name_full: obj for obj in volumes}


def has_effects(scene: bpy.types.Scene) -> bool:
    """Test for haptic effects in a scene, instanced volumes included."""
    return bool(swarms.listed_effects(scene) or sources_of(scene))


def reached_from(
    start: Iterable[bpy.types.Object], ignored: Collection[Reference] = ()
) -> set[bpy.types.Object]:
    """Objects and all objects in use by these, directly or not; ``ignored`` (user, used) references
    are not followed. A superset of dependencies."""
    reached = data_reached_from(start, ignored)
    return {data for data in reached if isinstance(data, bpy.types.Object)}


def data_reached_from(
    start: Iterable[bpy.types.Object], ignored: Collection[Reference] = ()
) -> set[bpy.types.ID]:
    """Objects and all data-blocks in use by these, directly or not; ``ignored`` (user, used)
    references are not followed."""
    return _closure(start, (pair for pair in _references() if pair not in ignored))


def data_reaching(start: Iterable[bpy.types.Object]) -> set[bpy.types.ID]:
    """Objects and all their direct and indirect users; scenes do not count as users."""
    return _closure(start, ((used, user) for user, used in _references()))


def _references() -> Iterator[Reference]:
    """Yield (user, used) of all data-blocks of the file except of scenes, and (parent, child) of
    parents with instancing."""
    # Scenes use everything in them, which would connect all objects.
    for used, users in bpy.data.user_map().items():
        yield from ((user, used) for user in users if not isinstance(user, bpy.types.Scene))
    for obj in bpy.data.objects:  # an instancer's children are its sources
        if obj.parent is not None and obj.parent.instance_type != "NONE":
            yield obj.parent, obj


def _closure(start: Iterable[bpy.types.Object], pairs: Iterable[Reference]) -> set[bpy.types.ID]:
    """Data-blocks ``start``, and all reached from them in any number of steps by ``pairs``."""
    following: dict[bpy.types.ID, list[bpy.types.ID]] = {}
    for first, second in pairs:
        following.setdefault(first, []).append(second)
    reached: set[bpy.types.ID] = set()
    pending: list[bpy.types.ID] = [*start]
    while pending:
        data = pending.pop()
        if data not in reached:
            reached.add(data)
            pending += following.get(data, ())
    return reached
