# SPDX-License-Identifier: GPL-3.0-or-later
"""Detection of simulations, and playback before sub-frames are read.

A simulation continues from the previous frame, and a step back in time disturbs all later frames.
After playback its cache holds all frames, between which Blender interpolates. Baked simulations are
not played.
"""

from collections.abc import Iterable, Iterator
from fractions import Fraction

import bpy

from ...blender.scene_info import nodes_of, scene_objects
from .reached import reached_from

_PHYSICS = {
    *("CLOTH", "SOFT_BODY", "FLUID", "DYNAMIC_PAINT"),
    *("EXPLODE", "OCEAN", "PARTICLE_INSTANCE"),
}
"""Modifiers with motion or deformation besides F-curves."""

_MOVING_PAINT = {"DISPLACE", "WAVE"}  # surface types of dynamic paint that deform a mesh

_CACHED = {"CLOTH", "SOFT_BODY"}
"""Modifiers with a point cache; their step length depends on time remapping."""


class Simulation:
    """Simulations of a scene, played once; ``last`` is the last required frame of the animation."""

    def __init__(self, scene: bpy.types.Scene, last: int) -> None:
        self._scene = scene
        self._last = last
        self._is_played = False
        modifiers = (modifier for obj in _shown(scene) for modifier in obj.modifiers)
        self._forgets = any(m.type == "NODES" and _simulates(m) for m in modifiers)
        self._frame = Fraction(0)  # last read frame
        self.frames_played = 0

    def play(self) -> None:
        """Step from the earliest simulated frame to the last required frame, to fill Blender's
        caches; later calls do nothing. Leaves the scene at the last frame; Time Remapping is off
        during playback."""
        if self._is_played:
            return
        scene, render = self._scene, self._scene.render
        starts = [start for obj in _shown(scene) for start in _starts(obj)]
        if scene.rigidbody_world is not None:
            starts.append(scene.rigidbody_world.point_cache.frame_start)
        remapped = render.frame_map_old, render.frame_map_new
        try:
            # Caches hold whole frames of the animation. Remapped playback would skip frames or
            # step through fractions.
            if remapped[0] != remapped[1]:
                render.frame_map_old = render.frame_map_new = 100
            # A cache may begin before the scene: its simulation needs all frames from its own
            # start.
            for frame in range(min([scene.frame_start, *starts]), self._last + 1):
                self._scene.frame_set(frame)
                self.frames_played += 1
        finally:
            if remapped[0] != remapped[1]:
                render.frame_map_old, render.frame_map_new = remapped
        self._is_played = True

    def go_to(self, frame: Fraction) -> None:
        """Remember ``frame`` as the next frame to read; call before the caller sets that frame.

        The current frame stays, with one exception: if geometry nodes simulate, and the frame
        remembered before is later than ``frame`` and than the scene's end, :meth:`play` runs again
        from the earliest simulated frame and leaves the scene at the last required frame. Blender
        4.5 clears simulations of geometry nodes on such a step back."""
        if self._forgets and frame < self._frame and self._frame > self._scene.frame_end:
            self._is_played = False
            self.play()
        self._frame = frame


def simulated(start: Iterable[bpy.types.Object]) -> bpy.types.Object | None:
    """First object, by full name, with a rigid body or simulating modifier among objects and
    dependencies; None without any."""
    # The search for dependencies is slow, so files without physics skip it.
    if not any(map(_is_simulated, bpy.data.objects)):
        return None
    return next(filter(_is_simulated, _by_name(reached_from(start))), None)


def takes_part(obj: bpy.types.Object) -> bool:
    """Test for physics, particles, force fields, collision or rigid body constraints."""
    if _is_simulated(obj) or obj.particle_systems or obj.rigid_body_constraint is not None:
        return True
    is_field = obj.field is not None and obj.field.type != "NONE"
    return is_field or any(modifier.type == "COLLISION" for modifier in obj.modifiers)


def has_simulation_anywhere(scene: bpy.types.Scene) -> bool:
    """Test for physics, simulation nodes, emitted particles or dynamic hair among a scene's objects
    and dependencies."""
    return simulated(scene_objects(scene)) is not None or moves_particles(scene)


def moves_particles(scene: bpy.types.Scene) -> bool:
    """Test for emitters or dynamic hair among a scene's objects and dependencies."""
    # A file without settings of particles has no particle system; references are slow to follow.
    return bool(bpy.data.particles) and any(
        system.settings.type == "EMITTER" or system.use_hair_dynamics
        for obj in _shown(scene)
        for system in obj.particle_systems
    )


def to_bake(scene: bpy.types.Scene, haptic: Iterable[bpy.types.Object]) -> list[str]:
    """Warnings, by object name, about unbaked simulations among ``haptic`` objects and
    dependencies. Fluids and moving dynamic paint always need a bake, cloth and soft bodies only
    with Time Remapping."""
    haptic = list(haptic)
    if simulated(haptic) is None:
        return []
    is_remapped = scene.render.frame_map_old != scene.render.frame_map_new
    warnings = []
    for obj in _by_name(reached_from(haptic)):
        for modifier in obj.modifiers:
            if _is_unbaked(modifier):
                name = modifier.bl_rna.name.removesuffix(" Modifier").lower()
                warnings.append(f"the {name} of '{obj.name}' is not baked: bake it to feel it")
            elif modifier.type in _CACHED and is_remapped and not modifier.point_cache.is_baked:
                warnings.append(
                    f"time is remapped and the simulation of '{obj.name}' is not baked: bake it "
                    "to be sure of what is felt"
                )
    return warnings


def _is_unbaked(modifier: bpy.types.Modifier) -> bool:
    """Test for an unbaked fluid domain, or an unbaked, active, deforming surface of dynamic
    paint."""
    if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN":
        return not modifier.domain_settings.has_cache_baked_data
    if modifier.type == "DYNAMIC_PAINT" and modifier.canvas_settings is not None:
        return any(
            surface.is_active
            and surface.surface_type in _MOVING_PAINT
            and not surface.point_cache.is_baked
            for surface in modifier.canvas_settings.canvas_surfaces
        )
    return False


def _shown(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Objects of a scene and all objects that they refer to, by name."""
    return _by_name(reached_from(scene_objects(scene)))


def _by_name(objects: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
    """Objects sorted by full name."""
    return sorted(objects, key=lambda obj: obj.name_full)


def _is_simulated(obj: bpy.types.Object) -> bool:
    """Test for rigid bodies and for simulating modifiers."""
    return obj.rigid_body is not None or any(map(_simulates, obj.modifiers))


def _simulates(modifier: bpy.types.Modifier) -> bool:
    """Test for a modifier with physics (see :data:`_PHYSICS`) or with a simulation zone in the
    nodes."""
    if modifier.type == "NODES":
        kinds = (node.bl_idname for node in nodes_of(modifier.node_group))
        return "GeometryNodeSimulationInput" in kinds
    return modifier.type in _PHYSICS


def _starts(obj: bpy.types.Object) -> Iterator[int]:
    """Yield the first frames of an object's caches: particles, cloth, soft body, dynamic paint,
    fluid domain."""
    for system in obj.particle_systems:
        yield system.point_cache.frame_start
    for modifier in obj.modifiers:
        if modifier.type in _CACHED:
            yield modifier.point_cache.frame_start
        elif modifier.type == "DYNAMIC_PAINT" and modifier.canvas_settings is not None:
            yield from (surface.frame_start for surface in modifier.canvas_settings.canvas_surfaces)
        elif modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN":
            yield modifier.domain_settings.cache_frame_start
