# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps through time: in the user's own scene, or in a scratch scene of needed objects.

A scratch scene links the haptic bodies and effects and nothing else (Blender adds what these
depend on), so that no prop, no other character and no avatar mesh is evaluated. What it cannot
reproduce is known and looked for; where code may run, a few times are compared with the own scene.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING

import bpy

from ...avatars import avatar_meshes
from ...blender.scene_info import scene_objects
from ..description import visibility
from . import simulation as simulations
from .drivers import RetriedDrivers, drivers_of
from .reached import data_reached_from, data_reaching, is_instancer, reached_from

if TYPE_CHECKING:
    from ..curves.presampled_rig import PresampledRig
    from ..description.scene_description import HapticObjects
    from .simulation import Simulation

_is_stepping = False

_RENDER_SETTINGS = (
    *("fps", "fps_base", "frame_map_old", "frame_map_new"),
    *("use_simplify", "simplify_subdivision"),
)
"""Settings of a scene that change when and how its objects are evaluated."""

_TRACKING = {"CAMERA_SOLVER", "FOLLOW_TRACK", "OBJECT_SOLVER"}
"""Constraints that take the camera or the movie clip of the scene."""


class Stepper:
    """Scene that is set to times and read through its dependency graph.

    Rigs that are ``presampled`` are in it as their copies. ``is_own`` is the user's scene, not a
    scratch scene; ``has_code`` tells of code in it that may show and hide objects. Drivers of
    ``driven`` data that failed at one time are evaluated again at the next.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        layer: bpy.types.ViewLayer,
        *,
        presampled: Sequence[PresampledRig] = (),
        is_own: bool = True,
        has_code: bool = False,
        simulation: Simulation | None = None,
        driven: Iterable[bpy.types.ID] = (),
    ) -> None:
        self._scene = scene
        self._layer = layer
        self.is_own = is_own
        self._has_code = has_code
        self._simulation = simulation
        self._presampled = presampled
        self._copies = {rig.obj: rig.copy for rig in presampled}
        self._drivers = RetriedDrivers(driven, tags=simulation is None)

    def set_frame(self, frame: Fraction) -> None:
        """Evaluate the scene at a frame, which may lie between whole ones."""
        whole, rest = divmod(frame.numerator, frame.denominator)
        if self._simulation is not None:
            self._simulation.go_to(frame)
        for rig in self._presampled:
            rig.set_frame(frame)
        self._set_frame(whole, rest / frame.denominator)

    def _set_frame(self, whole: int, subframe: float) -> None:
        scene, camera = self._scene, self._scene.camera
        self._drivers.evaluate(lambda: scene.frame_set(whole, subframe=subframe))
        if scene.camera != camera:  # by a marker, after all that depends on it was evaluated
            scene.frame_set(whole, subframe=subframe)

    def show(self, frame: tuple[int, float]) -> None:
        """Evaluate the scene at the user's frame, as a whole number and the rest of it."""
        self._set_frame(*frame)

    @property
    def failures(self) -> tuple[str, ...]:
        """Drivers that could not be evaluated at this time, as sentences."""
        return self._drivers.failures

    def evaluated(self, obj: bpy.types.Object) -> bpy.types.Object:
        """Evaluated object at this time."""
        return (self._copies.get(obj) or obj).evaluated_get(self._layer.depsgraph)

    @cached_property
    def is_changing(self) -> bool:
        """Test that the scene may show other objects at other times."""
        return self._has_code or any(map(visibility.is_keyed, scene_objects(self._scene)))

    @property
    def objects(self) -> bpy.types.bpy_prop_collection:
        """The evaluated objects that the scene shows at this time."""
        return self._layer.depsgraph.objects


Stepping = AbstractContextManager[Stepper]


@contextmanager
def own_scene(found: HapticObjects) -> Iterator[Stepper]:
    """Context that steps the user's scene, after its simulation; frame and camera are restored.

    Meanwhile objects that nothing felt depends on are disabled in viewports, so that Blender does
    not evaluate them: in a window, where they are seen, only effects that are dormant.
    """
    scene, simulation = found.scene, found.simulation
    with _marked_as_stepping():
        before, camera = (scene.frame_current, scene.frame_subframe), scene.camera
        has_code = foreign_handler() is not None or runs_code(scene_objects(scene))
        instanced = (o for o in bpy.data.objects if o.hfx.role == "EFFECT")
        felt = [*found.read, *(o for o in instanced if o not in found.dormant)]
        idle = [] if has_code else [obj for obj in idle_objects(found) if not obj.hide_viewport]
        stepper = Stepper(
            scene,
            found.layer,
            has_code=has_code,
            simulation=simulation,
            driven=data_reached_from(felt),
        )

        def restore() -> None:
            for obj in idle:
                obj.hide_viewport = False
            stepper.show(before)
            if scene.camera != camera:
                scene.camera = camera

        try:
            for obj in idle:
                obj.hide_viewport = True
            if simulation is not None:
                simulation.play()
            yield stepper
        finally:
            try:
                restore()
            except KeyboardInterrupt:  # a late Ctrl-C
                restore()
                raise


def idle_objects(found: HapticObjects) -> list[bpy.types.Object]:
    """Objects that nothing which is read or felt depends on, where no code may.

    With a window only dormant effects and what makes instances of such alone, as long as no other
    object of the scene depends on them.
    """
    objects = scene_objects(found.scene)
    felt = [o for o in bpy.data.objects if o.hfx.role == "EFFECT" and o not in found.dormant]
    shown = set(filter(is_instancer, data_reaching(felt)))
    # What else needs an avatar's mesh than our setting that names it, Blender finds itself.
    named = {(body, mesh) for body in found.bodies for mesh in avatar_meshes.meshes_of(body)}
    idle = set(objects)
    if not bpy.app.background:
        idle &= set(filter(is_instancer, data_reaching(found.dormant))) - shown | {*found.dormant}
        named = set()
    idle = {obj for obj in idle.difference(found.read) if not _has_part_of_its_own(obj)}
    kept = shown | reached_from((*found.read, *set(objects).difference(idle)), named)
    return [obj for obj in objects if obj in idle and obj not in kept]


def _has_part_of_its_own(obj: bpy.types.Object) -> bool:
    """Test for an object that counts though nothing refers to it, or that cannot stay disabled."""
    is_found = obj.type in ("CAMERA", "META")  # by the scene, or by the metaballs of its family
    return is_found or visibility.is_keyed(obj) or simulations.takes_part(obj)


@contextmanager
def _marked_as_stepping() -> Iterator[None]:
    """Context in which :func:`is_stepping` is true."""
    global _is_stepping
    was_stepping, _is_stepping = _is_stepping, True
    try:
        yield
    finally:
        _is_stepping = was_stepping


def is_stepping() -> bool:
    """Test that the program steps through time now, which is not the user's playback or
    scrubbing.
    """
    return _is_stepping


@contextmanager
def scratch_scene(
    scene: bpy.types.Scene,
    objects: Iterable[bpy.types.Object],
    presampled: Sequence[PresampledRig] = (),
) -> Iterator[Stepper]:
    """Context that steps a scratch scene of these objects, at last to the user's frame.

    The user's scene is not evaluated.

    Raises
    ------
    NotModelledError
        Something in it follows a presampled rig.
    """
    with _marked_as_stepping(), _scratch(scene, objects, presampled) as stepper:
        yield stepper


@contextmanager
def _scratch(
    scene: bpy.types.Scene, objects: Iterable[bpy.types.Object], presampled: Sequence[PresampledRig]
) -> Iterator[Stepper]:
    from ..curves.animation_curves import (
        NotModelledError,  # not where Blender starts: it needs numpy
    )

    scratch = bpy.data.scenes.new(".HFX Export")
    made: list[bpy.types.ID] = [scratch]
    stepper = None
    try:
        for name in _RENDER_SETTINGS:
            setattr(scratch.render, name, getattr(scene.render, name))
        every = (each for obj in objects for each in (obj, *_metaball_family(obj, scene)))
        for obj in dict.fromkeys(every):  # several bodies may show one mesh
            scratch.collection.objects.link(obj)
        for rig in presampled:
            made += rig.make_copy()
            scratch.collection.objects.link(rig.copy)
        layer = scratch.view_layers[0]
        layer.update()
        there = {each.original for each in layer.depsgraph.ids} if presampled else set()
        for rig in presampled:
            if rig.obj in there:
                raise NotModelledError(f"something follows '{rig.obj.name}'")
        driven = [each.original for each in layer.depsgraph.ids]
        stepper = Stepper(scratch, layer, presampled=presampled, is_own=False, driven=driven)
        yield stepper
    finally:
        try:
            # What animation set in the objects themselves is as it was in the user's scene.
            if stepper is not None:
                stepper.show((scene.frame_current, scene.frame_subframe))
        finally:
            # scenes.remove() crashes Blender 4.3 within ``blender --command`` (no window yet).
            bpy.data.batch_remove(made)


def _metaball_family(obj: bpy.types.Object, scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Metaballs of a scene that make one surface with another: all of its name but the number."""
    if obj.type != "META":
        return []
    shown = visibility.enabled_objects(scene, scene.view_layers[0])
    balls = [each for each in scene_objects(scene) if each.type == "META" and each in shown]
    return [ball for ball in balls if _without_number(ball.name) == _without_number(obj.name)]


def _without_number(name: str) -> str:
    return re.sub(r"\.\d+$", "", name)


# Module of our own handlers: ``hfx_blender``, or its longer name as an extension.
_OURS = (__package__ or "").rpartition(".reading")[0]


def foreign_handler() -> str | None:
    """Frame handler of others, which may do anything; None if there are only ours."""
    handlers = bpy.app.handlers
    for handler in (*handlers.frame_change_pre, *handlers.frame_change_post):
        module = getattr(handler, "__module__", None) or ""
        if module != _OURS and not module.startswith(f"{_OURS}."):
            name = getattr(handler, "__name__", type(handler).__name__)
            return f"the handler '{name}' runs on frame changes"
    return None


def why_own_scene(objects: Sequence[bpy.types.Object]) -> str | None:
    """Reason why a scratch scene of these objects could not reproduce them; None if it can.

    What they do not reach, over any number of steps, does not matter.
    """
    mover = simulations.simulated(objects)
    if mover is not None:
        return f"physics moves '{mover.name}'"
    reached = sorted(data_reached_from(objects), key=lambda data: data.name_full)
    for owner in reached:
        if _takes_camera(owner):
            return f"'{owner.name}' depends on the scene's camera"
    for owner, curve in drivers_of(reached):
        for variable in curve.driver.variables:
            if variable.type == "CONTEXT_PROP" or any(
                target.id_type == "SCENE" for target in variable.targets
            ):
                return f"a driver of '{owner.name}' reads the scene"
    return None


def runs_code(objects: Iterable[bpy.types.Object]) -> bool:
    """Test for drivers that may read anything, of objects and all that they reach.

    They have code, or a path through a list of objects: Blender's dependency graph does not follow
    either.
    """
    drivers = (curve.driver for _, curve in drivers_of(data_reached_from(objects)))
    return any(
        (driver.type == "SCRIPTED" and not driver.is_simple_expression)
        or any("objects" in t.data_path for v in driver.variables for t in v.targets)
        for driver in drivers
    )


def _takes_camera(data: bpy.types.ID) -> bool:
    """Test for data that the camera or the movie clip of its scene changes."""
    if isinstance(data, bpy.types.GeometryNodeTree):
        return any(node.bl_idname == "GeometryNodeInputActiveCamera" for node in data.nodes)
    if not isinstance(data, bpy.types.Object):
        return False
    owners = [data, *(data.pose.bones if data.pose is not None else ())]
    return any(each.type in _TRACKING for owner in owners for each in owner.constraints)
