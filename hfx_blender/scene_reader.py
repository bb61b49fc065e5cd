# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene reader: the only code that turns Blender's scene into the engine's plain data.

It first reads what does not change (:class:`SceneDescription`), finds from the animation data
when anything can be felt at all, and then steps through just those times.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from . import __version__, activation, body_binding, effects, stepping, volumes
from .broken_keys import refuse_broken_keys
from .engine.body.model import load_model
from .engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    SceneDescription,
    SurfaceBinding,
    TimeBase,
)
from .engine.volume.mesh import MeshVolume
from .engine.volume.shape import Falloff, FalloffKind, Shape
from .errors import InputError
from .scene_rows import EffectRow, PoseRow, Row, block_of

BLOCK_SIZE = 32
"""Times in a block; blocks start at multiples of it, so that results do not depend on the range."""

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


def time_base(
    scene: bpy.types.Scene, frames: tuple[int, int] | None = None, rate_hz: Fraction | None = None
) -> TimeBase:
    """When samples are taken of a scene: its own frame range and rate unless told otherwise."""
    first, last = frames or (scene.frame_start, scene.frame_end)
    if last < first:
        raise InputError(
            f"Scene '{scene.name}': the frame range {first} to {last} holds no frames."
        )
    fps = Fraction(scene.render.fps) / Fraction(scene.render.fps_base).limit_denominator(10000)
    rate = rate_hz or Fraction(scene.hfx.rate).limit_denominator(1000)
    return TimeBase(fps, rate, scene.frame_start, first, last)


class SceneReader:
    """Reads one scene of the open file.

    Parameters
    ----------
    scene : bpy.types.Scene
    frames : (first, last), optional
        Frames to read, both included; the scene's own range by default.
    rate_hz : Fraction, optional
        Samples a second; the scene's own setting by default.
    with_positions : bool
        Also read the poses of bodies on which nothing but painted effects act.
    with_velocities : bool
        The same, and the time before each stretch, so that its first sample has a velocity.

    Raises
    ------
    InputError
        The scene cannot be exported: no body, no effects, a fault in one of them.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        *,
        frames: tuple[int, int] | None = None,
        rate_hz: Fraction | None = None,
        with_positions: bool = False,
        with_velocities: bool = False,
    ) -> None:
        self._scene = scene
        self._layer = scene.view_layers[0]
        if scene == bpy.context.scene:
            self._layer = bpy.context.view_layer
        self._with_positions = with_positions or with_velocities
        self._with_velocities = with_velocities
        self._warnings: list[str] = []
        self._unit = (
            1.0 if scene.unit_settings.system == "NONE" else scene.unit_settings.scale_length
        )
        # Blender does not notice by itself that a script has set a property of ``hfx``.
        for obj in (*effects.effects_of(scene), *effects.bodies_of(scene)):
            obj.update_tag()
        self._layer.update()
        self._enabled = _enabled_objects(self._layer.layer_collection)
        self.time = time_base(scene, frames, rate_hz)
        self._bodies = self._read_bodies()
        self._effects = self._read_effects()
        self._activations = [activation.activation_of(effect) for effect in self._effects]
        refuse_broken_keys([*self._effects, *self._bodies])
        self.stepping_note = ""
        self._mesh_cache: dict[str, tuple[bytes, MeshVolume]] = {}
        self.description = self._describe()
        for effect in self._effects:
            if effect.hfx.kind == "VOLUME":
                self._shape(effect, self._evaluated(effect))  # a bad mesh is told at once

    @property
    def sample_indices(self) -> I64:
        """Samples at which something can be felt; nothing can at all others."""
        return np.flatnonzero(self._may_be_on(("PAINTED", "VOLUME")))

    def _may_be_on(self, kinds: tuple[str, ...]) -> npt.NDArray[np.bool_]:
        """Whether an effect of these kinds can be on, for each sample of the time base."""
        indices = np.arange(self.time.sample_count, dtype=np.int64)
        step = self.time.fps / self.time.rate_hz
        # Rounded once: a sample on the first frame of a clip must not fall before it.
        frames = self.time.frame_first + indices * step.numerator / step.denominator
        on = np.zeros(len(indices), np.bool_)
        for effect, state in zip(self._effects, self._activations, strict=True):
            if effect.hfx.kind in kinds:
                on |= state.may_be_on(frames)
        return on

    def blocks(self) -> Iterator[AnimationBlock]:
        """Step through :attr:`sample_indices` and read each; the scene is left as it was."""
        with ExitStack() as stack:
            if self._needs_own_scene():
                whole = light = stack.enter_context(stepping.own_scene(self._scene, self._layer))
            else:
                whole, light = (
                    stack.enter_context(stepping.scratch_scene(self._scene, objects))
                    for objects in (self._needed_objects(), self._effects)
                )
            # Where only painted effects can be on, nobody's pose matters.
            needs_pose = self._may_be_on(("VOLUME",)) | self._with_positions
            modalities = [effect.hfx.modality for effect in self._effects]
            previous: Row | None = None
            for indices in _contiguous_blocks(self.sample_indices):
                stepper = whole if needs_pose[indices].any() else light
                rows = []
                if self._with_velocities:
                    if previous is None or previous.index != indices[0] - 1:
                        previous = self._read(int(indices[0]) - 1, stepper)
                    rows.append(previous)
                history = len(rows)
                rows += [self._read(int(index), stepper) for index in indices]
                previous = rows[-1]
                yield block_of(rows, modalities, len(self._bodies), history)

    def _needs_own_scene(self) -> bool:
        reason = stepping.why_own_scene(self._scene)
        if reason is None and not self._scratch_agrees():
            reason = "a few frames came out differently in a scratch scene"
        self.stepping_note = (
            "stepped a scratch scene of bodies and effects"
            if reason is None
            else f"stepped the whole scene, because {reason}"
        )
        return reason is not None

    def _scratch_agrees(self) -> bool:
        """Compare a few times read from the user's scene and from a scratch scene."""
        indices = self.sample_indices
        if not len(indices):
            return True
        probes = np.unique(indices[[0, len(indices) // 3, 2 * len(indices) // 3, -1]]).tolist()
        with stepping.own_scene(self._scene, self._layer) as stepper:
            truth = [self._read(index, stepper) for index in probes]
        with stepping.scratch_scene(self._scene, self._needed_objects()) as stepper:
            return all(
                row.agrees(self._read(index, stepper))
                for row, index in zip(truth, probes, strict=True)
            )

    def _needed_objects(self) -> list[bpy.types.Object]:
        avatars = [
            body.hfx.avatar
            for body, described in zip(self._bodies, self.description.bodies, strict=True)
            if isinstance(described.binding, SurfaceBinding)
        ]
        return [*self._bodies, *self._effects, *avatars]

    # What does not change

    def _read_bodies(self) -> list[bpy.types.Object]:
        bodies = effects.bodies_of(self._scene)
        if not bodies:
            raise InputError(
                f"Scene '{self._scene.name}' has no haptic body: nobody is there to feel its "
                "effects. Add one with Add > Haptic > Avatar, or mark an armature as a body."
            )
        for body in bodies:
            for obj in filter(None, (body, body.hfx.avatar)):
                if not self._is_evaluated(obj):
                    raise InputError(
                        f"Body '{body.name}': '{obj.name}' is disabled in viewports or excluded "
                        "from the view layer, so Blender does not pose it."
                    )
        return bodies

    def _read_effects(self) -> list[bpy.types.Object]:
        found = effects.effects_of(self._scene)
        if not found:
            raise InputError(f"Scene '{self._scene.name}' has no haptic effects to export.")
        kept = []
        for effect in found:
            if self._is_evaluated(effect):
                kept.append(effect)
            else:
                self._warnings.append(
                    f"effect '{effect.name}' is disabled in viewports or excluded from the view "
                    "layer: it was left out"
                )
        if not kept:
            raise InputError(
                f"Scene '{self._scene.name}': all of its haptic effects are disabled in viewports."
            )
        return kept

    def _describe(self) -> SceneDescription:
        ids = effects.unique_ids([*self._bodies, *self._effects])
        described = tuple(
            self._describe_effect(effect, state, ids)
            for effect, state in zip(self._effects, self._activations, strict=True)
        )
        posed = {
            effect.model_id
            for effect in described
            if effect.kind == "volume" or self._with_positions
        }
        bindings = [body_binding.binding_of(body, posed) for body in self._bodies]
        for body, binding in zip(self._bodies, bindings, strict=True):
            if isinstance(binding, SurfaceBinding):
                self._warnings.append(
                    f"body '{body.name}' follows its avatar's evaluated surface, because "
                    f"{binding.reason}"
                )
        if bpy.app.autoexec_fail:
            self._warnings.append(
                "Blender did not run a script or a driver of this file "
                f"({bpy.app.autoexec_fail_message}): motion that depends on it is not exported"
            )
        return SceneDescription(
            time=self.time,
            bodies=tuple(
                BodyDescription(ids[body.name], body.name, binding)
                for body, binding in zip(self._bodies, bindings, strict=True)
            ),
            effects=described,
            source=_source(self._scene),
            warnings=tuple(self._warnings),
        )

    def _describe_effect(
        self, effect: bpy.types.Object, state: activation.Activation, ids: dict[str, str]
    ) -> EffectDescription:
        hfx = effect.hfx
        area: PaintedArea | HapticVolume
        if hfx.kind == "PAINTED":
            area = self._painted_area(effect, ids)
        else:
            area = HapticVolume(Falloff(FalloffKind(hfx.falloff), hfx.falloff_share))
        return EffectDescription(
            id=ids[effect.name],
            name=effect.name,
            modality=hfx.modality,
            model_id=effects.model_id_for(hfx.modality),
            area=area,
            is_contact=hfx.temperature_reference == "CONTACT",
            clips=state.clips,
        )

    def _painted_area(self, effect: bpy.types.Object, ids: dict[str, str]) -> PaintedArea:
        hfx = effect.hfx
        body = hfx.body or (self._bodies[0] if len(self._bodies) == 1 else None)
        if body not in self._bodies:
            raise InputError(
                f"Effect '{effect.name}' is painted on no body of scene '{self._scene.name}'; "
                "choose one of: " + ", ".join(body.name for body in self._bodies) + "."
            )
        vertices, weights = effects.area(effect)
        wanted = effects.model_id_for(hfx.modality)
        if hfx.model_id != wanted:
            raise InputError(
                f"Effect '{effect.name}' has no area on the {hfx.modality} model: expected "
                f"'{wanted}', found '{hfx.model_id or 'nothing painted'}'. Paint it first."
            )
        model = load_model(wanted)
        if hfx.model_hash != model.content_hash:
            raise InputError(
                f"Effect '{effect.name}' was painted on another edition of '{wanted}' "
                f"({hfx.model_hash[:12]}, this is {model.content_hash[:12]})."
            )
        checked = effects.checked_area(effect.name, vertices, weights, len(model))
        if not len(checked[0]):
            raise InputError(f"Effect '{effect.name}' is painted nowhere. Paint it, or delete it.")
        return PaintedArea(ids[body.name], *checked)

    # What is where at a time

    def _evaluated(self, obj: bpy.types.Object) -> bpy.types.Object:
        return obj.evaluated_get(self._layer.depsgraph)

    def _is_evaluated(self, obj: bpy.types.Object) -> bool:
        # What the view layer leaves out comes back as its own, unposed original; and even where
        # something else needs it, so that it is evaluated, it is not posed.
        enabled = obj in self._enabled and not obj.hide_viewport
        return enabled and self._evaluated(obj).is_evaluated

    def _read(self, index: int, stepper: stepping.Stepper) -> Row:
        stepper.set_frame(self.time.frame(index))
        row = Row(index)
        needs_pose = self._with_positions
        for effect, state in zip(self._effects, self._activations, strict=True):
            values = self._read_effect(effect, state, stepper.evaluated(effect))
            row.effects.append(values)
            needs_pose |= values.level > 0.0 and values.matrix is not None
        if needs_pose:
            row.poses = [self._read_pose(k, stepper) for k in range(len(self._bodies))]
        return row

    def _read_effect(
        self,
        effect: bpy.types.Object,
        state: activation.Activation,
        evaluated: bpy.types.Object,
    ) -> EffectRow:
        hfx = evaluated.hfx
        values = EffectRow()
        if state.source is activation.Source.OFF or not evaluated.is_evaluated:
            return values
        on = 1.0 if state.source is activation.Source.ALWAYS_ON else hfx.activation
        values.level = on * hfx.intensity
        if not values.level > 0.0 and not np.isnan(values.level):
            return values
        matrix = np.array(evaluated.matrix_world, dtype=np.float64)
        values.parameters = _parameters(hfx, matrix)
        if hfx.kind == "VOLUME":
            values.shape = self._shape(effect, evaluated)
            values.matrix = self._to_metres(matrix)
            values.matrix[:3, :3] *= volumes.shape_scale(hfx)
        return values

    def _to_metres(self, matrix: F64) -> F64:
        """World matrix in Blender units -> in metres."""
        scaled = matrix.copy()
        scaled[:3] *= self._unit
        return scaled

    def _shape(self, effect: bpy.types.Object, evaluated: bpy.types.Object) -> Shape:
        if evaluated.hfx.shape != "MESH":
            return volumes.analytic_shape(evaluated.hfx)
        mesh = evaluated.data
        positions = np.zeros(len(mesh.vertices) * 3, np.float32)
        if len(mesh.vertices):
            mesh.attributes["position"].data.foreach_get("vector", positions)
        content = positions.tobytes()
        known = self._mesh_cache.get(effect.name)
        if known is None or known[0] != content:  # made again only where the mesh deforms
            mesh.calc_loop_triangles()
            triangles = np.zeros(len(mesh.loop_triangles) * 3, np.int32)
            mesh.loop_triangles.foreach_get("vertices", triangles)
            volume = MeshVolume(
                positions.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3), effect.name
            )
            known = self._mesh_cache[effect.name] = (content, volume)
        return known[1]

    def _read_pose(self, index: int, stepper: stepping.Stepper) -> PoseRow:
        body = self._bodies[index]
        binding = self.description.bodies[index].binding
        if isinstance(binding, SurfaceBinding):
            avatar = stepper.evaluated(body.hfx.avatar)
            matrix = np.array(avatar.matrix_world, dtype=np.float64)
            surface = body_binding.read_surface(body.hfx.avatar, avatar)
            return PoseRow(self._to_metres(matrix), surface=surface)
        armature = stepper.evaluated(body)
        matrices = np.zeros(len(binding.bone_names) * 16, np.float32)
        armature.pose.bones.foreach_get("matrix_channel", matrices)  # column-major
        bones = matrices.reshape(-1, 4, 4).transpose(0, 2, 1)[:, :3]
        matrix = np.array(armature.matrix_world, dtype=np.float64)
        return PoseRow(self._to_metres(matrix), bones=bones)


def _enabled_objects(collection: bpy.types.LayerCollection) -> set[bpy.types.Object]:
    """Objects of the collections that are on in a view layer; the eye icon does not matter."""
    if collection.collection.hide_viewport:
        return set()
    found = set() if collection.exclude else set(collection.collection.objects)
    return found.union(*map(_enabled_objects, collection.children))


def _parameters(hfx: bpy.types.PropertyGroup, matrix: F64) -> list[float]:
    """An effect's values in the order of its modality's parameters."""
    if hfx.modality == "vibration":
        return [hfx.amplitude, hfx.frequency]
    if hfx.modality == "pressure":
        return [hfx.pressure]
    if hfx.modality == "temperature":
        return [hfx.temperature]
    direction = matrix[:3, 2]
    length = np.linalg.norm(direction)
    direction = direction / length if length > 0 else np.array([0.0, 0.0, 1.0])
    return [hfx.wind_speed, *direction.tolist()]


def _contiguous_blocks(indices: I64) -> Iterator[I64]:
    """Runs without gaps, cut at multiples of the block size."""
    cuts = np.flatnonzero((np.diff(indices) != 1) | (indices[1:] % BLOCK_SIZE == 0)) + 1
    yield from (block for block in np.split(indices, cuts) if len(block))


def _source(scene: bpy.types.Scene) -> dict[str, str]:
    source = {
        "scene": scene.name,
        "blender": bpy.app.version_string,
        "hfx": __version__,
    }
    path = Path(bpy.data.filepath)
    if bpy.data.filepath and path.is_file():
        source["file"] = path.name
        source["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    return source
