# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects and bodies at single times: read from a stepped scene, compared, joined into blocks."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Euler, Matrix, Vector

from ...authoring import volumes
from ...authoring.effects import effect_values
from ...avatars import avatar_meshes, body_binding
from ...engine.arrays import F64
from ...engine.modality import MODALITIES
from ...engine.scene import EffectBlock, PoseBlock, SceneDescription, SurfaceBinding
from ...engine.volume.shape import Shape
from ...errors import InputError
from ..curves.curve_reading import is_rigid
from ..description import activation, area_values, response_values, soundness
from ..description.area_values import SurfaceVertices, joined, stacked
from ..description.scene_description import HapticObjects
from .stepping import Stepper

_RELATIVE = 1e-5
_ABSOLUTE = 5e-6
"""Relative and absolute tolerance between two readings of a time: Blender computes in float32."""


@dataclass(eq=False)
class EffectRow:
    """State of an effect at one time; the default is an effect that is off."""

    level: float = 0.0  # activation times intensity, 0..1
    parameters: list[float] | None = None  # in the modality's order; None if off
    matrix: F64 | None = None  # (4, 4) to world, metres; None without a place in the scene
    shape: Shape | None = None  # volumes only
    response: F64 | None = None  # (F, WIDTH) controls of the response filters
    vertices: F64 | None = None  # (V, 3) of a surface, object space
    place: F64 | None = None  # (2,) of a spot; see EffectBlock
    drive: F64 | None = None  # (A,) of a vector sensation


@dataclass(eq=False)
class PoseRow:
    """Pose of a body at one time."""

    to_world: F64  # (4, 4) armature or avatar to world, metres
    bones: npt.NDArray[np.float32] | None = None  # (B, 3, 4) rest space to armature space
    surface: npt.NDArray[np.float32] | None = None  # (A, 3) avatar vertices, local space


@dataclass(frozen=True, eq=False)
class VolumePlacements:
    """Placements of N volumes at one time; arrays of several times have a leading time axis."""

    there: npt.NDArray[np.bool_]  # (N,) False: disabled, other fields are undefined
    matrices: F64  # (N, 4, 4) object space to world, Blender units
    boxes: F64  # (N, 2, 3) corners of the volume's box, object space; NaN if unknown


@dataclass(eq=False)
class SceneRow:
    """Effects and bodies at one sample, by the indices in the scene description."""

    index: int
    effects: dict[int, EffectRow] = field(default_factory=dict)
    places: VolumePlacements | None = None  # of far volumes, which have no effect row
    poses: dict[int, PoseRow | None] = field(default_factory=dict)  # None: disabled


def agree(one: object, two: object, names: Sequence[str]) -> bool:
    """Test two rows for attributes equal up to float32 rounding; None equals only None."""
    return all(_close(getattr(one, name), getattr(two, name)) for name in names)


def _close(one: npt.ArrayLike | None, two: npt.ArrayLike | None) -> bool:
    """Test arrays of equal shape for equality of all elements; None equals only None."""
    if one is None or two is None:
        return one is two
    one, two = np.asarray(one), np.asarray(two)
    if one.shape == two.shape and (one == two).all():
        return True  # common, and ten times faster than allclose
    return one.shape == two.shape and bool(are_close(one, two).all())


def are_close(one: npt.ArrayLike, two: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Mask of elements equal within 1e-5 relative plus 5e-6; NaN equals NaN."""
    return np.isclose(one, two, _RELATIVE, _ABSOLUTE, equal_nan=True)


def effect_block(rows: Sequence[EffectRow], modality: str) -> EffectBlock:
    """Block of an effect from rows in the order of time (T). Missing parameters are 0, missing
    matrices the identity; without any matrix there are no shapes, response and vertices."""
    if all(row.parameters is None and row.level == 0.0 for row in rows):
        return silence(len(rows), modality)
    count = len(MODALITIES[modality].parameters)
    blank = [0.0] * count
    parameters = np.array([row.parameters or blank for row in rows], np.float64)
    levels = np.array([row.level for row in rows], np.float64)
    if not any(row.matrix is not None for row in rows):
        return EffectBlock(
            levels,
            parameters,
            place=stacked([row.place for row in rows]),
            drive=stacked([row.drive for row in rows]),
        )
    identity = np.eye(4)
    # A rigid volume has the same shape object in all rows, so a block holds each shape once.
    shapes: dict[Shape, int] = {}
    which = np.zeros(len(rows), np.int32)
    for k, row in enumerate(rows):
        if row.shape is not None:
            which[k] = shapes.setdefault(row.shape, len(shapes))
    return EffectBlock(
        levels,
        parameters,
        matrices=np.stack([identity if row.matrix is None else row.matrix for row in rows]),
        shapes=tuple(shapes),
        shape_index=which,
        response=stacked([row.response for row in rows]),
        vertices=joined([row.vertices for row in rows]),
    )


@lru_cache(64)  # of thousands of silent effects
def silence(count: int, modality: str) -> EffectBlock:
    """Block of an effect at ``count`` times with level and parameters 0, without a placement;
    shared by equal calls."""
    width = len(MODALITIES[modality].parameters)
    return EffectBlock(np.zeros(count), np.zeros((count, width)))


def pose_block(rows: Sequence[PoseRow | None]) -> PoseBlock:
    """Block of a body from rows in the order of time (T). None rows are invalid copies of the first
    valid row; without any, matrices are zero and bones and surface None."""
    valid = np.array([row is not None for row in rows])
    first = next((row for row in rows if row is not None), None)
    if first is None:
        return PoseBlock(valid, np.zeros((len(rows), 4, 4)))
    filled = [first if row is None else row for row in rows]
    bones = None
    if first.bones is not None:
        # In C order: otherwise each call of the compiled library would copy these matrices.
        bones = np.array([row.bones for row in filled], np.float64, order="C")
    return PoseBlock(
        valid,
        np.stack([row.to_world for row in filled]),
        bones,
        None if first.surface is None else np.stack([row.surface for row in filled]),
    )


@dataclass(frozen=True, eq=False)
class _Settings:
    """Cached settings of an effect without animated settings: only its placement changes."""

    row: EffectRow  # without matrix; parameters of wind: the speed only
    scale: F64 | None  # (3,) shape space to local space; None: no volume
    is_wind: bool
    is_mesh: bool  # deforming mesh: its shape is read at each time


class OverriddenProperties:
    """Haptic properties of an effect, read-only, with received values in place of some. Keys such
    as ``response/0/decay`` are properties of a filter of the contact response, or of an item of
    another collection."""

    def __init__(self, hfx: bpy.types.PropertyGroup, values: Mapping[str, Any]) -> None:
        self.__dict__.update(values, _stored=hfx)
        by_item: dict[str, dict[int, dict[str, float]]] = {}
        for key in values:
            if "/" in key:
                collection, index, name = key.split("/")
                by_item.setdefault(collection, {}).setdefault(int(index), {})[name] = values[key]
        for collection, changed in by_item.items():
            self.__dict__[collection] = [
                OverriddenProperties(item, changed[k]) if k in changed else item
                for k, item in enumerate(getattr(hfx, collection))
            ]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stored, name)


class SteppedReading:
    """Reader of effects and bodies from a stepped scene. ``keeps_settings``: cache the settings of
    effects without unmuted F-curves and drivers of haptic properties. False for scenes that a user
    or a handler may edit between two readings. Faults are added to ``faults``, message -> sample
    indices, in place."""

    def __init__(
        self,
        found: HapticObjects,
        scene: SceneDescription,
        shapes: effect_values.ShapeCache,
        *,
        keeps_settings: bool = False,
        faults: dict[str, set[int]] | None = None,
    ) -> None:
        self._found = found
        self._scene = scene
        self._shapes = shapes
        self._unit_m = found.unit_m
        self._vertices = SurfaceVertices()
        self._settings: dict[int, _Settings] = {}
        self._keeps = [
            keeps_settings and not any("hfx" in path for path in soundness.animated_paths(effect))
            for effect in found.effects
        ]
        self._is_rigid = [keeps_settings and is_rigid(effect) for effect in found.effects]
        self.counters = shapes.counters
        self.far: frozenset[int] = frozenset()
        """Mesh volumes far from skin, of which only boxes are read."""
        self.faults: dict[str, set[int]] = {} if faults is None else faults
        """Meshes that are no closed volumes: message -> sample indices."""
        self.overrides: Mapping[str, Mapping[str, Any]] = {}
        """Received values by property and name of the effect, in place of evaluated values."""

    def read(
        self, index: int, stepper: Stepper, effects: Iterable[int], bodies: Iterable[int]
    ) -> SceneRow:
        """Step to sample ``index`` and read effects and bodies by their indices into a new row.
        Failed drivers are recorded as faults."""
        stepper.set_frame(self._scene.time.frame(index))
        for failure in stepper.failures:
            soundness.add_fault(self.faults, failure, index)
        self.counters.times_stepped += 1
        row = SceneRow(index)
        row.effects = {k: self.read_effect(k, stepper, index) for k in effects}
        self.counters.effects_read += len(row.effects)
        self.add_poses(row, stepper, bodies)
        return row

    def add_poses(self, row: SceneRow, stepper: Stepper, bodies: Iterable[int]) -> None:
        """Read bodies by index at the present frame into ``row.poses``; no frame is set."""
        read = {k: self._read_pose(k, stepper) for k in bodies}
        self.counters.poses_read += len(read)
        row.poses |= read

    def read_effect(self, which: int, stepper: Stepper, index: int) -> EffectRow:
        """Read an effect at the present time; the default row if hidden, off, or never with an
        inside. Faults are recorded with the sample ``index``. While a mesh has no inside or a
        surface cannot be read, the level is 0 and the last shape or vertices stay. With cached
        settings only the placement is read."""
        effect, state = self._found.effects[which], self._found.activations[which]
        evaluated = stepper.evaluated(effect)
        # Of a disabled object evaluated_get() returns the original, as of an earlier frame, without
        # an error.
        if not evaluated.is_evaluated or evaluated.hide_viewport:
            return EffectRow()
        # Most effects have constant settings, and only the placement is animated: reading all
        # properties through RNA at each time is slow.
        cached = self._settings.get(which)
        if cached is not None and (which in self.far or not cached.is_mesh):
            return self._moved(cached, evaluated, effect)
        hfx = self.properties_of(effect, evaluated)
        values = EffectRow()
        if state.source is activation.ActivationSource.OFF:
            return values
        values.level = state.level(hfx)
        matrix = self._world_matrix(effect, evaluated)
        values.parameters = effect_values.parameters(hfx, matrix)
        values.place = area_values.place(hfx, self._unit_m)
        values.drive = area_values.drive(hfx)
        if hfx.kind == "SURFACE":
            try:
                values.vertices = self._vertices.of(effect, evaluated)
            except InputError as error:
                values.vertices, values.level = self._vertices.last_of(effect), 0.0
                soundness.add_fault(self.faults, str(error), index)
            values.matrix = effect_values.to_metres(matrix, self._unit_m)
        if hfx.kind == "VOLUME":
            # Geometry nodes turned the whole mesh into instances, which are effects themselves.
            has_nodes = any(modifier.type == "NODES" for modifier in evaluated.modifiers)
            if hfx.shape == "MESH" and has_nodes and effect_values.is_empty(evaluated):
                return EffectRow()
            try:
                values.shape = self._shape(which, evaluated, hfx)
            except InputError as error:
                soundness.add_fault(self.faults, str(error), index)
                values.shape = self._shapes.last_of(effect)
                if values.shape is None:
                    return EffectRow()
                values.level = 0.0  # silent while the mesh has no inside
            values.matrix = effect_values.shape_matrices(matrix, self._unit_m, hfx)
            scene, time = self._found.scene, self._scene.time
            values.response = response_values.controls_at(
                scene, effect, hfx, self._unit_m, time, index
            )
        if self._keeps[which]:
            self._keep(which, values, hfx)
        return values

    def properties_of(
        self, effect: bpy.types.Object, evaluated: bpy.types.Object
    ) -> bpy.types.PropertyGroup | OverriddenProperties:
        """Evaluated haptic properties of an effect, with :attr:`overrides`."""
        values = self.overrides.get(effect.name)
        return OverriddenProperties(evaluated.hfx, values) if values else evaluated.hfx

    def _world_matrix(self, effect: bpy.types.Object, evaluated: bpy.types.Object) -> F64:
        """World matrix (4, 4) in Blender units, with received location, rotation and scale in place
        of those of the object; parents and constraints act as before."""
        values = self.overrides.get(effect.name, {})
        if values.keys().isdisjoint(effect_values.TRANSFORM):
            return effect_values.world_matrix(evaluated)
        place, turn, size = evaluated.matrix_basis.decompose()
        basis = Matrix.LocRotScale(
            Vector(values.get("location", place)),
            Euler(values["rotation_euler"]) if "rotation_euler" in values else turn,
            Vector(values.get("scale", size)),
        )
        world = evaluated.matrix_world @ evaluated.matrix_basis.inverted_safe() @ basis
        return np.array(world, np.float64)

    def _shape(
        self, which: int, evaluated: bpy.types.Object, hfx: bpy.types.PropertyGroup
    ) -> Shape:
        """Shape of a volume with the properties ``hfx``: cached if rigid, the box if a far
        deforming mesh, else read. Raises InputError for a mesh without an inside."""
        if hfx.shape != "MESH":
            return volumes.analytic_shape(hfx)
        effect = self._found.effects[which]
        is_rigid = self._is_rigid[which]
        cached = self._shapes.last_of(effect) if is_rigid else None
        if cached is not None:
            return cached
        box = None
        if which in self.far and not is_rigid:
            box = self._shapes.box_of(effect, evaluated)
        return self._shapes.shape_of(effect, evaluated) if box is None else box

    def _keep(self, which: int, row: EffectRow, hfx: bpy.types.PropertyGroup) -> None:
        """Cache the settings of effect ``which`` from the row; not for surfaces, response filters,
        and deforming meshes at level 0."""
        # A surface and response filters vary with more than the placement. A mesh at level 0 may
        # have had no inside, and its shape would be the last valid one.
        is_mesh = hfx.kind == "VOLUME" and hfx.shape == "MESH" and not self._is_rigid[which]
        if hfx.kind == "SURFACE" or row.response is not None or (is_mesh and row.level <= 0.0):
            return
        is_volume, is_wind = hfx.kind == "VOLUME", hfx.modality == "wind"
        assert row.parameters is not None
        parameters = row.parameters[:1] if is_wind else row.parameters
        scale = volumes.shape_scale(hfx) if is_volume else None
        kept = replace(row, parameters=parameters, matrix=None)
        self._settings[which] = _Settings(kept, scale, is_wind, is_mesh)

    def _moved(
        self, cached: _Settings, evaluated: bpy.types.Object, effect: bpy.types.Object
    ) -> EffectRow:
        """Row of an effect from cached settings and the present placement; of a deforming mesh with
        the present box."""
        row = replace(cached.row)
        if cached.scale is None and not cached.is_wind:
            return row
        world = effect_values.world_matrix(evaluated)
        if cached.is_wind:
            row.parameters = [*row.parameters, *effect_values.directions(world).tolist()]
        if cached.scale is not None:
            world[:3] *= self._unit_m
            world[:3, :3] *= cached.scale
            row.matrix = world
            if cached.is_mesh:
                row.shape = self._shapes.box_of(effect, evaluated)
        return row

    def is_settled(self, which: int) -> bool:
        """Test for a rigid volume with cached settings, of which only the placement changes."""
        cached = self._settings.get(which)
        return cached is not None and cached.scale is not None and not cached.is_mesh

    def placed(self, which: int, matrices: F64, is_present: npt.NDArray[np.bool_]) -> EffectBlock:
        """Block of a settled volume (see :meth:`is_settled`) from placements (T, 4, 4) in Blender
        units. Level and parameters are 0, and matrices the identity, at absent times."""
        cached = self._settings[which]
        level, shape = cached.row.level, cached.row.shape
        assert cached.scale is not None and shape is not None
        parameters = np.tile(np.array(cached.row.parameters, np.float64), (len(is_present), 1))
        if cached.is_wind:
            parameters = np.hstack([parameters, effect_values.directions(matrices)])
        world = matrices.copy()
        world[:, :3] *= self._unit_m
        world[:, :3, :3] *= cached.scale
        world[~is_present] = np.eye(4)
        return EffectBlock(
            np.where(is_present, level, 0.0),
            np.where(is_present[:, None], parameters, 0.0),
            matrices=world,
            shapes=(shape,),
        )

    def _read_pose(self, which: int, stepper: Stepper) -> PoseRow | None:
        """Pose of a body at the present frame, metres: avatar vertices if bound to a surface, else
        bones. None if the body or a mesh of the surface is disabled."""
        body: bpy.types.Object = self._found.bodies[which]
        binding = self._scene.bodies[which].binding
        needed = [body]
        if isinstance(binding, SurfaceBinding):
            needed += avatar_meshes.meshes_of(body)
        # Blender poses no disabled object: its evaluated copy would be in rest pose.
        if any(stepper.evaluated(obj).hide_viewport for obj in needed):
            return None
        unit_m = self._unit_m
        if isinstance(binding, SurfaceBinding):
            matrix = effect_values.world_matrix(stepper.evaluated(body.hfx.avatar))
            surface = body_binding.read_surfaces(body, stepper.evaluated)
            return PoseRow(effect_values.to_metres(matrix, unit_m), surface=surface)
        # matrix_channel maps the rest pose to the pose, both in armature space. Blender stores
        # matrices column by column.
        armature = stepper.evaluated(body)
        matrices = np.zeros(len(binding.bone_names) * 16, np.float32)
        armature.pose.bones.foreach_get("matrix_channel", matrices)
        bones = matrices.reshape(-1, 4, 4).transpose(0, 2, 1)[:, :3]
        matrix = effect_values.world_matrix(armature)
        return PoseRow(effect_values.to_metres(matrix, unit_m), bones=bones)
