# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses and swarms of particles between the scene and files of effects."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
from mathutils import Vector

from .. import compat
from ..engine.response_filters.controls import CONTROLS, FilterKind
from . import response_animation, responses
from .response_recipes import FilterRecipe, Keys, SwarmRecipe, abouts_of

_EMITTER_SUBDIVISIONS = 3


def response_recipe(
    effect: bpy.types.Object, unit_m: float, first: float, fps: float
) -> tuple[FilterRecipe, ...]:
    """A volume's filters; muted ones as well. Times count from frame ``first``."""
    return tuple(
        _recipe(effect, k, each, unit_m, first, fps) for k, each in enumerate(effect.hfx.response)
    )


def _recipe(
    effect: bpy.types.Object,
    place: int,
    each: bpy.types.PropertyGroup,
    unit_m: float,
    first: float,
    fps: float,
) -> FilterRecipe:
    kind = FilterKind(each.kind)
    controls = CONTROLS[kind]
    names = responses.properties_of(each)
    curves = {
        match[2]: curve
        for curve in compat.fcurves(effect)
        if (match := response_animation.PATH.match(curve.data_path)) and int(match[1]) == place
    }
    values, keys = {}, []
    for control, name in zip(controls, names, strict=True):
        scale = unit_m if name in responses.LENGTHS else 1.0

        def held(value: float, scale: float = scale, of: object = control) -> float:
            return min(max(value * scale, of.minimum), of.maximum)  # type: ignore[attr-defined]

        values[control.name] = held(float(getattr(each, name)))
        if name in curves:
            found: Keys = tuple(
                ((key.co[0] - first) / fps, held(key.co[1])) for key in curves[name].keyframe_points
            )
            keys.append((control.name, found))
    about = each.domain if kind is FilterKind.SINE else each.about
    return FilterRecipe(
        kind.value,
        values,
        each.operation,
        about if abouts_of(kind) else "centre",
        bool(each.is_muted),
        tuple(keys),
    )


def add_response(
    effect: bpy.types.Object,
    response: Sequence[FilterRecipe],
    unit_m: float,
    frame: float,
    fps: float,
) -> None:
    """Give a new volume its filters; times count from ``frame``."""
    for place, recipe in enumerate(response):
        kind = FilterKind(recipe.kind)
        each = responses.add_filter(effect, recipe.kind)
        each.operation, each.is_muted = recipe.operation, recipe.is_muted
        if kind is FilterKind.SINE:
            each.domain = recipe.about
        elif kind is FilterKind.DISTANCE:
            each.about = recipe.about
        properties = dict(
            zip((c.name for c in CONTROLS[kind]), responses.properties_of(each), strict=True)
        )
        for control, value in recipe.controls.items():
            name = properties[control]
            setattr(each, name, value / (unit_m if name in responses.LENGTHS else 1.0))
        for control, keys in recipe.keys:
            name = properties[control]
            scale = unit_m if name in responses.LENGTHS else 1.0
            curve = compat.own_fcurve(effect, f"hfx.response[{place}].{name}", "Response")
            compat.set_keys(curve, [(frame + t * fps, value / scale) for t, value in keys])


def emitters(
    scene: bpy.types.Scene, effect: bpy.types.Object
) -> list[tuple[bpy.types.Object, bpy.types.ParticleSystem]]:
    """Particle systems of a scene that emit this volume."""
    return [
        (obj, system)
        for obj in scene.objects
        for system in obj.particle_systems
        if effect in _instanced(system.settings)
    ]


def volumes_of(emitter: bpy.types.Object) -> list[bpy.types.Object]:
    """Haptic volumes among an object's particles."""
    found = [obj for system in emitter.particle_systems for obj in _instanced(system.settings)]
    is_volume = {obj: obj.hfx.role == "EFFECT" and obj.hfx.kind == "VOLUME" for obj in found}
    return [obj for obj, ours in is_volume.items() if ours]


def _instanced(settings: bpy.types.ParticleSettings) -> list[bpy.types.Object]:
    if settings.render_type == "OBJECT" and settings.instance_object is not None:
        return [settings.instance_object]
    if settings.render_type == "COLLECTION" and settings.instance_collection is not None:
        return list(settings.instance_collection.all_objects)
    return []


def swarm_recipe(
    scene: bpy.types.Scene, effect: bpy.types.Object, unit_m: float, first: float, fps: float
) -> SwarmRecipe | None:
    """Recipe of the first particle system that emits a volume; None without any."""
    found = emitters(scene, effect)
    if not found:
        return None
    emitter, system = found[0]
    settings = system.settings
    centre, radii = _extent(emitter)
    return SwarmRecipe(
        count=settings.count,
        seed=system.seed,
        born_from_s=(settings.frame_start - first) / fps,
        born_until_s=(settings.frame_end - first) / fps,
        lifetime_s=settings.lifetime / fps,
        location_m=tuple(unit_m * x for x in centre),  # type: ignore[arg-type]
        radii_m=tuple(unit_m * x for x in radii),  # type: ignore[arg-type]
        normal_speed_m_s=settings.normal_factor * unit_m,
        random_speed_m_s=settings.factor_random * unit_m,
        brownian=settings.brownian_factor,
        drag=settings.drag_factor,
        damping=settings.damping,
        gravity=settings.effector_weights.gravity,
    )


def _extent(emitter: bpy.types.Object) -> tuple[list[float], list[float]]:
    """Middle and half edges of an object's bounding box, world axes."""
    corners = [emitter.matrix_world @ Vector(corner) for corner in emitter.bound_box]
    lowest = [min(corner[axis] for corner in corners) for axis in range(3)]
    highest = [max(corner[axis] for corner in corners) for axis in range(3)]
    middle = [0.5 * (a + b) for a, b in zip(lowest, highest, strict=True)]
    return middle, [0.5 * (b - a) for a, b in zip(lowest, highest, strict=True)]


def add_swarm(
    scene: bpy.types.Scene,
    effect: bpy.types.Object,
    swarm: SwarmRecipe,
    unit_m: float,
    frame: float,
    fps: float,
    origin: Sequence[float],
) -> bpy.types.Object:
    """Make a particle system of a new volume, which leaves the scene itself; returns the
    emitter.
    """
    import bmesh

    source = bpy.data.collections.new(effect.name)
    source.use_fake_user = True  # it is in no scene
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
    emitter.scale = [max(x / unit_m, 1e-6) for x in swarm.radii_m]
    emitter.display_type = "WIRE"
    emitter.show_instancer_for_render = emitter.show_instancer_for_viewport = False
    system = emitter.modifiers.new("Swarm", "PARTICLE_SYSTEM").particle_system
    system.seed = swarm.seed
    settings = system.settings
    settings.count = swarm.count
    # Blender keeps the end after the start, so the order of setting them matters.
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
