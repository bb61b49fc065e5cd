# SPDX-License-Identifier: GPL-3.0-or-later
"""Particle systems that emit haptic volumes: swarms in the scene and in effect files."""

from collections.abc import Sequence

import bpy

from ...blender.scene_info import scene_objects
from . import effects
from .response_recipes import SwarmRecipe

_EMITTER_SUBDIVISIONS = 3


def emitters(
    scene: bpy.types.Scene, effect: bpy.types.Object
) -> list[tuple[bpy.types.Object, bpy.types.ParticleSystem]]:
    """Pairs of object and particle system of a scene that show ``effect`` as their instance object,
    or in their instance collection."""
    return [
        (obj, system)
        for obj in scene_objects(scene)
        for system in obj.particle_systems
        if effect in _instanced(system.settings)
    ]


def volumes_of(emitter: bpy.types.Object) -> list[bpy.types.Object]:
    """Haptic volumes that an object's particle systems show as instances, each once, in order."""
    objects = (obj for system in emitter.particle_systems for obj in _instanced(system.settings))
    return [
        obj
        for obj in dict.fromkeys(objects)
        if obj.hfx.role == "EFFECT" and obj.hfx.kind == "VOLUME"
    ]


def listed_effects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Effects of a scene, and volumes that exist only as its particles, sorted by name."""
    emitted = (volume for obj in scene_objects(scene) for volume in volumes_of(obj))
    # Emitted volumes are in no scene, and a volume may have several emitters.
    return sorted({*effects.effects_of(scene), *emitted}, key=lambda obj: obj.name)


def objects_showing(scene: bpy.types.Scene, effect: bpy.types.Object) -> list[bpy.types.Object]:
    """Objects that show an effect in a scene: the effect itself, or the emitters of its swarm."""
    if effect.name in scene.objects:
        return [effect]
    return [emitter for emitter, _ in emitters(scene, effect)]


def is_selected(scene: bpy.types.Scene, effect: bpy.types.Object) -> bool:
    """Test for a selected effect or emitter of its swarm."""
    return any(obj.select_get() for obj in objects_showing(scene, effect))


def selected_effects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Listed effects that are selected, or emitted by a selected object, sorted by name."""
    return [effect for effect in listed_effects(scene) if is_selected(scene, effect)]


def _instanced(settings: bpy.types.ParticleSettings) -> list[bpy.types.Object]:
    """Objects that a particle system shows as instances; empty for other ways of rendering."""
    if settings.render_type == "OBJECT" and settings.instance_object is not None:
        return [settings.instance_object]
    if settings.render_type == "COLLECTION" and settings.instance_collection is not None:
        return list(settings.instance_collection.all_objects)
    return []


def swarm_recipe(
    scene: bpy.types.Scene, effect: bpy.types.Object, unit_m: float, first: float, fps: float
) -> SwarmRecipe | None:
    """Recipe of the first particle system among all objects of the scene that emits the volume
    ``effect``; None if missing. Place and size are those of the emitter's box in the world. Times
    are in seconds from frame ``first``, lengths in metres."""
    systems = emitters(scene, effect)
    if not systems:
        return None
    from ...blender import mesh_arrays  # needs numpy, which Blender's start does not

    emitter, system = systems[0]
    settings = system.settings
    lowest, highest = mesh_arrays.world_box(emitter)
    centre, radii = 0.5 * (lowest + highest), 0.5 * (highest - lowest)
    return SwarmRecipe(
        count=settings.count,
        seed=system.seed,
        born_from_s=(settings.frame_start - first) / fps,
        born_until_s=(settings.frame_end - first) / fps,
        lifetime_s=settings.lifetime / fps,
        location_m=tuple(unit_m * x for x in centre.tolist()),  # type: ignore[arg-type]
        radii_m=tuple(unit_m * x for x in radii.tolist()),  # type: ignore[arg-type]
        normal_speed_m_s=settings.normal_factor * unit_m,
        random_speed_m_s=settings.factor_random * unit_m,
        brownian=settings.brownian_factor,
        drag=settings.drag_factor,
        damping=settings.damping,
        gravity=settings.effector_weights.gravity,
    )


def add_swarm(
    scene: bpy.types.Scene,
    effect: bpy.types.Object,
    swarm: SwarmRecipe,
    unit_m: float,
    frame: float,
    fps: float,
    origin: Sequence[float],
) -> bpy.types.Object:
    """Add a particle system that emits a new volume; return the emitter. The volume is unlinked
    from the scene into a collection of its own. ``frame`` is time 0 of the recipe and ``origin``
    its origin, in Blender units."""
    import bmesh

    source = bpy.data.collections.new(effect.name)
    source.use_fake_user = True  # it belongs to no scene
    for collection in list(effect.users_collection):
        collection.objects.unlink(effect)
    source.objects.link(effect)
    mesh = bpy.data.meshes.new(f"{effect.name} Emitter")
    shape = bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=_EMITTER_SUBDIVISIONS, radius=1.0)
    shape.to_mesh(mesh)
    shape.free()
    emitter = bpy.data.objects.new(f"{effect.name} Emitter", mesh)
    scene.collection.objects.link(emitter)
    emitter.location = [o + x / unit_m for o, x in zip(origin, swarm.location_m, strict=True)]
    # A scale of 0 has no inverse.
    emitter.scale = [max(x / unit_m, 1e-6) for x in swarm.radii_m]
    emitter.display_type = "WIRE"
    emitter.show_instancer_for_render = emitter.show_instancer_for_viewport = False
    system = emitter.modifiers.new("Swarm", "PARTICLE_SYSTEM").particle_system
    system.seed = swarm.seed
    settings = system.settings
    settings.count = swarm.count
    # Blender clamps each frame by the other one, so the end is set before and after the start.
    # Cache frames must include all births and lifetimes.
    settings.frame_end = max(frame + swarm.born_until_s * fps, settings.frame_start)
    settings.frame_start = frame + swarm.born_from_s * fps
    settings.frame_end = frame + swarm.born_until_s * fps
    settings.lifetime = swarm.lifetime_s * fps
    system.point_cache.frame_start = int(settings.frame_start)
    system.point_cache.frame_end = max(
        scene.frame_end, int(settings.frame_end + settings.lifetime) + 1
    )
    settings.normal_factor = swarm.normal_speed_m_s / unit_m
    settings.factor_random = swarm.random_speed_m_s / unit_m
    settings.brownian_factor, settings.drag_factor = swarm.brownian, swarm.drag
    settings.damping = swarm.damping
    settings.effector_weights.gravity = swarm.gravity
    settings.particle_size, settings.use_size_deflect = 1.0, False
    settings.render_type, settings.instance_collection = "COLLECTION", source
    return emitter
