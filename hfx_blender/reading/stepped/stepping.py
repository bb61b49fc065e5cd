# SPDX-License-Identifier: GPL-3.0-or-later
"""Stepping through time in the user's own scene or in a scratch scene.

A scratch scene links haptic bodies and effects only; Blender adds their dependencies. Props, other
characters and avatar meshes are not evaluated. Known causes of different results in a scratch scene
are checked; with code in the file, a few times are compared with the own scene.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from fractions import Fraction
from functools import cached_property, partial
from typing import TYPE_CHECKING

import bpy

from ...avatars import avatar_meshes
from ...blender import compat
from ...blender.scene_info import scene_objects
from ..description import visibility
from . import simulation as simulations
from .drivers import RetriedDrivers, drivers_of
from .reached import data_reached_from, data_reaching, is_instancer, reached_from, sources_of

if TYPE_CHECKING:
    from ..curves.presampled_rig import PresampledRig
    from ..description.scene_description import HapticObjects
    from .simulation import Simulation

_is_stepping = False

_RENDER_SETTINGS = (
    *("fps", "fps_base", "frame_map_old", "frame_map_new"),
    *("use_simplify", "simplify_subdivision"),
)
"""Render settings that change times or results of an object's evaluation."""

_TRACKING = {"CAMERA_SOLVER", "FOLLOW_TRACK", "OBJECT_SOLVER"}
"""Constraints that depend on the scene's camera or movie clip."""


class Stepper:
    """Scene that is set to frames and read through its dependency graph. ``presampled`` rigs are
    replaced by copies in this scene. ``is_own`` is True for the user's scene, False for a scratch
    scene. ``has_code``: the scene may run code that shows and hides objects. Drivers of the
    ``driven`` data-blocks are retried after a failure."""

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
        """Evaluate the scene at a frame with a fraction, also the presampled rigs; a lost
        simulation is played again before."""
        whole, rest = divmod(frame.numerator, frame.denominator)
        if self._simulation is not None:
            self._simulation.go_to(frame)
        for rig in self._presampled:
            rig.set_frame(frame)
        self.show(whole, rest / frame.denominator)

    def show(self, whole: int, subframe: float) -> None:
        """Evaluate at frame ``whole`` plus ``subframe`` (0..1), drivers retried; again if a marker
        changed the camera. Presampled rigs and simulations stay as they are."""
        scene, camera = self._scene, self._scene.camera
        self._drivers.evaluate(lambda: scene.frame_set(whole, subframe=subframe))
        # A marker switches the camera after its dependents were evaluated, so evaluate them again.
        if scene.camera != camera:
            scene.frame_set(whole, subframe=subframe)

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences about the drivers that failed at the present frame."""
        return self._drivers.failures

    def evaluated(self, obj: bpy.types.Object) -> bpy.types.Object:
        """Evaluated copy of an object at the present frame; of a presampled rig, the copy's."""
        return (self._copies.get(obj) or obj).evaluated_get(self._layer.depsgraph)

    @cached_property
    def is_changing(self) -> bool:
        """Cached test that visible objects differ by frame: code, or an animated monitor icon."""
        return self._has_code or any(map(visibility.is_keyed, scene_objects(self._scene)))

    @property
    def objects(self) -> bpy.types.bpy_prop_collection:
        """Evaluated visible objects at the present frame."""
        return self._layer.depsgraph.objects


Stepping = AbstractContextManager[Stepper]


@contextmanager
def own_scene(found: HapticObjects) -> Iterator[Stepper]:
    """Context that steps the user's scene, after its simulation was played; frame and camera are
    restored. Objects that no haptic object depends on are hidden in viewports for this time, so
    that Blender does not evaluate them; with a window only dormant effects, with code in the scene
    none."""
    scene, simulation = found.scene, found.simulation
    with _marked_as_stepping():
        # Markers change the scene's camera during the steps.
        before, camera = (scene.frame_current, scene.frame_subframe), scene.camera
        has_code = foreign_handler() is not None or runs_code(scene_objects(scene))
        instanced = (o for o in bpy.data.objects if o.hfx.role == "EFFECT")
        haptic = [*found.read, *(o for o in instanced if o not in found.dormant)]
        idle = [] if has_code else [obj for obj in idle_objects(found) if not obj.hide_viewport]
        stepper = Stepper(
            scene,
            found.layer,
            has_code=has_code,
            simulation=simulation,
            driven=data_reached_from(haptic),
        )

        def restore() -> None:
            """Show the hidden objects, and set the frame and camera of before."""
            for obj in idle:
                obj.hide_viewport = False
            stepper.show(*before)
            if scene.camera != camera:
                scene.camera = camera

        try:
            for obj in idle:
                obj.hide_viewport = True
            if simulation is not None:
                simulation.play()
            yield stepper
        finally:
            # A second Ctrl-C may end the restoration half-way. All steps may be repeated.
            try:
                restore()
            except KeyboardInterrupt:
                restore()
                raise


def idle_objects(found: HapticObjects) -> list[bpy.types.Object]:
    """Objects of a scene, in order, that no haptic object depends on; empty list possible. Never
    cameras, metaballs, objects with physics or an animated monitor icon. With a window only dormant
    effects and instancers of these, unless still required."""
    objects = scene_objects(found.scene)
    haptic = [o for o in bpy.data.objects if o.hfx.role == "EFFECT" and o not in found.dormant]
    shown = set(filter(is_instancer, data_reaching(haptic)))
    # The property that names an avatar's mesh is our reference, not a dependency in Blender.
    named = {(body, mesh) for body in found.bodies for mesh in avatar_meshes.meshes_of(body)}
    idle = set(objects)
    if not bpy.app.background:
        # In a window hidden objects would flicker, so only instancers of dormant effects are
        # hidden.
        idle &= set(filter(is_instancer, data_reaching(found.dormant))) - shown | {*found.dormant}
        named = set()
    # The scene itself uses its camera, a metaball changes the surface of its family, and physics
    # or an animated monitor icon have effects without any reference: such objects must stay.
    idle = {
        obj
        for obj in idle.difference(found.read)
        if obj.type not in ("CAMERA", "META")
        and not visibility.is_keyed(obj)
        and not simulations.takes_part(obj)
    }
    # A source in an excluded collection is not read itself, but its instances are: hiding it would
    # remove them.
    sources = [obj for obj in sources_of(found.scene).values() if obj not in found.dormant]
    in_use = (*found.read, *sources, *set(objects).difference(idle))
    required = shown | reached_from(in_use, named)
    return [obj for obj in objects if obj in idle and obj not in required]


@contextmanager
def _marked_as_stepping() -> Iterator[None]:
    """Context in which :func:`is_stepping` returns True; the earlier value is restored."""
    global _is_stepping
    was_stepping, _is_stepping = _is_stepping, True
    try:
        yield
    finally:
        _is_stepping = was_stepping


def is_stepping() -> bool:
    """True while the add-on steps through time, not during the user's playback."""
    return _is_stepping


@contextmanager
def scratch_scene(
    scene: bpy.types.Scene,
    objects: Iterable[bpy.types.Object],
    presampled: Sequence[PresampledRig] = (),
) -> Iterator[Stepper]:
    """Context that steps a scratch scene of ``objects`` and copies of ``presampled`` rigs, with the
    time and simplify settings of ``scene``; removed at the end. Metaballs bring their family.
    ``scene`` is not evaluated; at the end the objects get the animated values of its current frame.
    Raises NotModelledError if an object depends on a rig."""
    # Not where Blender starts: it needs numpy.
    from ..curves.animation_curves import NotModelledError

    with _marked_as_stepping():
        scratch = bpy.data.scenes.new(".HFX Export")
        created: list[bpy.types.ID] = [scratch]
        stepper = None
        try:
            # A new scene has Blender's defaults: its times and subdivisions would differ.
            for name in _RENDER_SETTINGS:
                setattr(scratch.render, name, getattr(scene.render, name))
            linked = (member for obj in objects for member in (obj, *_metaball_family(obj, scene)))
            for obj in dict.fromkeys(linked):  # several bodies may show one mesh
                scratch.collection.objects.link(obj)
            # The copies replace the rigs: any dependency on an original means different results.
            for rig in presampled:
                created += rig.make_copy()
                scratch.collection.objects.link(rig.copy)
            layer = scratch.view_layers[0]
            layer.update()
            driven = [data.original for data in layer.depsgraph.ids]
            for rig in presampled:
                if rig.obj in driven:
                    raise NotModelledError(f"something follows '{rig.obj.name}'")
            stepper = Stepper(scratch, layer, presampled=presampled, is_own=False, driven=driven)
            yield stepper
        finally:
            try:
                # Evaluation writes animated values into the original objects: write those of the
                # user's frame.
                if stepper is not None:
                    stepper.show(scene.frame_current, scene.frame_subframe)
            finally:
                # scenes.remove() crashes Blender 4.3 within ``blender --command`` (no window yet).
                bpy.data.batch_remove(created)


def _metaball_family(obj: bpy.types.Object, scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Enabled metaballs of a scene with the name of a metaball except for the number, which form
    one surface; empty for other objects."""
    if obj.type != "META":
        return []
    shown = visibility.enabled_objects(scene, scene.view_layers[0])
    balls = [o for o in scene_objects(scene) if o.type == "META" and o in shown]
    without_number = partial(re.compile(r"\.\d+$").sub, "")
    return [ball for ball in balls if without_number(ball.name) == without_number(obj.name)]


# Package of the handlers of this add-on: ``hfx_blender``, or its name as an extension.
_OURS = (__package__ or "").rpartition(".reading")[0]


def foreign_handler() -> str | None:
    """Clause that names the first frame handler of another add-on or script; None without any."""
    handlers = bpy.app.handlers
    for handler in (*handlers.frame_change_pre, *handlers.frame_change_post):
        # Handlers without a module, such as partial objects, count as foreign.
        module = getattr(handler, "__module__", None) or ""
        if module != _OURS and not module.startswith(f"{_OURS}."):
            name = getattr(handler, "__name__", type(handler).__name__)
            return f"the handler '{name}' runs on frame changes"
    return None


def why_own_scene(objects: Sequence[bpy.types.Object]) -> str | None:
    """Reason why a scratch scene cannot reproduce objects; None if a scratch scene can. Physics,
    use of the scene's camera or clip, or a driver reading a scene, among these objects and
    dependencies."""
    mover = simulations.simulated(objects)
    if mover is not None:
        return f"physics moves '{mover.name}'"
    # By name: a set of data-blocks has another order in each run, and the first is reported.
    reached = sorted(data_reached_from(objects), key=lambda data: data.name_full)
    for data in reached:
        is_taken = False
        if isinstance(data, bpy.types.GeometryNodeTree):
            is_taken = any(node.bl_idname == "GeometryNodeInputActiveCamera" for node in data.nodes)
        elif isinstance(data, bpy.types.Object):
            # Tracking constraints may be on the object or on bones.
            owners = [data, *(data.pose.bones if data.pose is not None else ())]
            is_taken = any(c.type in _TRACKING for owner in owners for c in owner.constraints)
        if is_taken:
            return f"'{data.name}' depends on the scene's camera"
    for owner, curve in drivers_of(reached):
        for variable in curve.driver.variables:
            if variable.type == "CONTEXT_PROP" or any(
                target.id_type == "SCENE" for target in variable.targets
            ):
                return f"a driver of '{owner.name}' reads the scene"
    return None


def runs_code(objects: Iterable[bpy.types.Object]) -> bool:
    """Test for a scripted driver beyond a simple expression, or a driver path containing "objects",
    among objects and dependencies. Blender's dependency graph does not follow such drivers."""
    # References are slow to follow, and few files have drivers.
    if next(drivers_of(compat.data_blocks()), None) is None:
        return False
    drivers = (curve.driver for _, curve in drivers_of(data_reached_from(objects)))
    return any(
        (driver.type == "SCRIPTED" and not driver.is_simple_expression)
        or any("objects" in t.data_path for v in driver.variables for t in v.targets)
        for driver in drivers
    )
