# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects and bodies read from F-curves over blocks of times, without stepping."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import bpy
import numpy as np
import numpy.typing as npt

from ...authoring import responses, volumes
from ...authoring.effects import effect_values
from ...blender.stored_values import limited
from ...engine.arrays import F64, I64
from ...engine.response_filters.controls import WIDTH
from ...engine.scene import EffectBlock, PoseBlock, SkinBinding, SurfaceBinding
from ...engine.volume.shape import Shape
from ..description import area_values, response_values, visibility
from ..description.activation import Activation, ActivationSource
from ..description.area_values import SurfaceVertices
from ..description.soundness import animated_paths
from .animation_curves import NotModelledError
from .fcurve_kinematics import Parents, PlainObject, rest_value

_CHUNK = 256  # samples in a chunk: sampling has a high fixed cost


class CurveEffect:
    """Effect with level, parameters and placement defined by F-curves; raises NotModelledError if
    another cause moves, shows or deforms the effect."""

    def __init__(
        self,
        effect: bpy.types.Object,
        state: Activation,
        shape: Shape | None,
        unit_m: float,
        parents: Parents | None = None,
    ) -> None:
        self._hfx = effect.hfx
        self._state = state
        self.shape = shape
        self._unit_m = unit_m
        self._place = PlainObject(effect, self._default, parents)
        self._names = effect_values.properties_of(effect.hfx.modality)
        animated = {path for path, _ in self._place.values.columns}
        known = {f"hfx.{name}" for name in (*self._names, "activation", "intensity", "envelope")}
        animated = {p for p in animated if response_values.place_of(p) is None}
        animated = {p for p in animated if not area_values.is_drive(p)}
        if effect.hfx.kind == "SPOT":
            known |= {f"hfx.{name}" for name in area_values.PLACE}
        # A property outside of these lists may change the kind of the effect, or its shape.
        unsupported = sorted(path for path in animated - known if path.startswith("hfx."))
        if visibility.is_keyed(effect):
            raise NotModelledError(f"'{effect.name}' is shown and hidden")
        if unsupported:
            raise NotModelledError(f"'{unsupported[0]}' of '{effect.name}' is animated")
        if state.source is ActivationSource.ANIMATED and "hfx.activation" not in animated:
            raise NotModelledError(f"the activation of '{effect.name}' is animated otherwise")
        if effect.hfx.kind == "VOLUME" and effect.hfx.shape == "MESH":
            _refuse_deformed(effect)
        self.scale = volumes.shape_scale(effect.hfx) if effect.hfx.kind == "VOLUME" else np.ones(3)
        self._vertices: F64 | None = None
        if effect.hfx.kind == "SURFACE":
            _refuse_deformed(effect)
            self._vertices = SurfaceVertices().of(effect, effect)[None]

    def _default(self, path: str, index: int) -> float:
        """Value of a property without a playing strip: the RNA default; 0 for an actuator, the rest
        value of a transform. Raises NotModelledError for other properties of ``hfx``."""
        filter_property = response_values.place_of(path)
        if filter_property is not None:
            filters = self._hfx.bl_rna.properties["response"].fixed_type
            return float(filters.properties[filter_property[1]].default)
        if area_values.is_drive(path):
            return 0.0
        if path.startswith("hfx."):
            known = self._hfx.bl_rna.properties.get(path[4:])
            if known is None or known.type not in ("FLOAT", "INT", "BOOLEAN"):
                raise NotModelledError(f"'{path}' is animated")
            return float(known.default)
        return rest_value(path, index)

    def read(self, frames: F64) -> EffectBlock:
        """Block of the effect at animation frames (T,): levels and parameters (wind: with
        directions). Volumes also have matrices, shape and filter controls, surfaces matrices and
        vertices (1, V, 3); other effects have ``place`` of a spot and ``drive`` of actuators."""
        sampled = self._place.values.sample(frames)
        parameters = [self._value(name, sampled) for name in self._names]
        is_volume = self._hfx.kind == "VOLUME"
        world: F64 | None = None
        if is_volume or self._vertices is not None or self._hfx.modality == "wind":
            world = self._place.world(frames, sampled)
        if self._hfx.modality == "wind" and world is not None:
            parameters += list(effect_values.directions(world).T)
        # The same product as in Activation.level, for all times.
        if self._state.source is ActivationSource.OFF:
            levels = np.zeros(len(sampled))
        else:
            levels = self._value("intensity", sampled)
            if self._state.source is not ActivationSource.ALWAYS_ON:
                levels = self._value("activation", sampled) * levels
            levels = levels * limited(self._hfx, "group_gain")
        block = EffectBlock(levels, np.stack(parameters, axis=1))
        if self._vertices is not None and world is not None:
            matrices = effect_values.to_metres(world, self._unit_m)
            return replace(block, matrices=matrices, vertices=self._vertices)
        if not is_volume or world is None or self.shape is None:
            value = partial(self._value, sampled=sampled)
            place = area_values.places(self._hfx, self._unit_m, value)
            return replace(block, place=place, drive=area_values.drives(self._hfx, value))
        response = self._response(sampled)
        return replace(
            block, matrices=self._placing(world), shapes=(self.shape,), response=response
        )

    def matrices(self, frames: F64) -> F64:
        """Shape space to world (T, 4, 4), metres, at animation frames (T,), without Blender."""
        return self._placing(self._place.world(frames))

    @property
    def key_frames(self) -> F64:
        """Ascending unique animation frames (k,) of keys of the effect and the parents, where
        motion may turn."""
        return self._place.key_frames

    def _placing(self, world: F64) -> F64:
        """Shape space to world (T, 4, 4), metres, from object matrices (T, 4, 4) in Blender units;
        the shape's scale is included, the input unchanged."""
        scaled = effect_values.to_metres(world, self._unit_m)
        scaled[..., :3, :3] *= self.scale
        return scaled

    def _response(self, sampled: F64) -> F64 | None:
        """Controls (T, F, WIDTH) of the F active filters by :meth:`_value`, lengths in metres,
        unused columns 0; None without filters."""
        active = responses.active_filters(self._hfx)
        values = np.zeros((len(sampled), len(active), WIDTH))
        for f, (number, item) in enumerate(active):
            for c, name in enumerate(responses.properties_of(item)):
                unit = self._unit_m if name in responses.LENGTHS else 1.0
                values[:, f, c] = self._value(f"response[{number}].{name}", sampled) * unit
        return values if active else None

    def _value(self, name: str, sampled: F64) -> F64:
        """Values (T,) of ``hfx.<name>`` from sampled values (T, C), clamped to hard limits and
        rounded to float32; without a curve the present value at all times."""
        # Blender clamps evaluated values to the limits and stores float32: both are repeated here,
        # so that values equal those of a stepped scene.
        column = self._place.values.columns.get((f"hfx.{name}", 0))
        path, _, name = name.rpartition(".")
        owner = self._hfx.path_resolve(path) if path else self._hfx
        if column is None:
            return np.full(len(sampled), limited(owner, name))
        limits = owner.bl_rna.properties[name]
        clipped = np.clip(sampled[:, column], limits.hard_min, limits.hard_max)
        return clipped.astype(np.float32).astype(np.float64)


def is_steady(effect: bpy.types.Object) -> bool:
    """Test for a volume without deformation and without an animated monitor icon; the transform may
    be animated."""
    return is_rigid(effect) and not visibility.is_keyed(effect)


def is_rigid(effect: bpy.types.Object) -> bool:
    """Test that no modifier, shape key, animated mesh or deforming parent changes the shape; True
    for every volume but a mesh."""
    try:
        if effect.hfx.shape == "MESH":
            _refuse_deformed(effect)
    except NotModelledError:
        return False
    return True


_DEFORMING = ("ARMATURE", "LATTICE")  # parenting types deforming a mesh like a modifier


def _refuse_deformed(effect: bpy.types.Object) -> None:
    """Raise NotModelledError for an object that is no mesh, and for a mesh with visible or animated
    modifiers, a deforming parent, shape keys or animation of its data."""
    mesh = effect.data
    if effect.type != "MESH":
        raise NotModelledError(f"'{effect.name}' is no mesh")
    switched = (path.endswith("].show_viewport") for path in animated_paths(effect))
    if any(modifier.show_viewport for modifier in effect.modifiers) or any(switched):
        raise NotModelledError(f"modifiers deform '{effect.name}'")
    if effect.parent is not None and effect.parent_type in _DEFORMING:
        raise NotModelledError(f"'{effect.parent.name}' deforms '{effect.name}'")
    if mesh.shape_keys is not None:
        raise NotModelledError(f"shape keys deform '{effect.name}'")
    if mesh.animation_data is not None:
        raise NotModelledError(f"the mesh of '{effect.name}' is animated")


class EffectChunks:
    """Cache of effects sampled in chunks of :data:`_CHUNK` samples. ``effect_of`` returns an effect
    by its number, ``frames_of`` animation frames of sample indices."""

    def __init__(
        self, effect_of: Callable[[int], CurveEffect], frames_of: Callable[[I64], F64]
    ) -> None:
        self._effect_of = effect_of
        self._frames_of = frames_of
        self._chunks: dict[int, tuple[F64, dict[int, EffectBlock]]] = {}

    def read(self, which: int, indices: I64) -> EffectBlock:
        """Block of the effect with number ``which`` at n >= 1 ascending sample indices (n,)."""
        # Chunks stand at fixed positions in time, so that neighbouring blocks share them.
        numbers = indices // _CHUNK
        parts = []
        for number in range(int(numbers[0]), int(numbers[-1]) + 1):
            rows = indices[numbers == number] - number * _CHUNK
            if len(rows):
                inside = np.arange(number * _CHUNK, (number + 1) * _CHUNK)
                parts.append(_rows_of(self._chunk(which, number, inside), rows))
        if len(parts) == 1:
            return parts[0]
        # Fields without a time axis are equal in all chunks.
        present = [name for name in _BY_TIME if getattr(parts[0], name) is not None]
        columns = {name: np.concatenate([getattr(b, name) for b in parts]) for name in present}
        return replace(parts[0], **columns)

    def _chunk(self, which: int, number: int, indices: I64) -> EffectBlock:
        """Block of an effect at ``indices``, cached by chunk number; a new chunk removes all but
        the two neighbouring chunks."""
        if number not in self._chunks:
            # Blocks are read forwards and overlap by a few samples: two chunks are in use.
            for old in [old for old in self._chunks if abs(old - number) > 1]:
                del self._chunks[old]
            self._chunks[number] = self._frames_of(indices), {}
        frames, blocks = self._chunks[number]
        if which not in blocks:
            blocks[which] = self._effect_of(which).read(frames)
        return blocks[which]


_BY_TIME = ("levels", "parameters", "matrices", "response", "place", "drive")
"""Fields of a sampled effect block with a time axis, if present."""


def _rows_of(block: EffectBlock, rows: I64) -> EffectBlock:
    """Copy of a block at some times; fields without a time axis (shapes, vertices) are shared."""
    known = [name for name in _BY_TIME if getattr(block, name) is not None]
    return replace(block, **{name: getattr(block, name)[rows] for name in known})


class CurveBody:
    """Body with bones animated by F-curves only; raises NotModelledError if bound to a surface,
    shown and hidden, or posed by another cause."""

    def __init__(
        self,
        body: bpy.types.Object,
        binding: SkinBinding | SurfaceBinding,
        unit_m: float,
        parents: Parents | None = None,
    ) -> None:
        if isinstance(binding, SurfaceBinding):
            raise NotModelledError(f"'{body.name}' follows its avatar's surface")
        if visibility.is_keyed(body):
            raise NotModelledError(f"'{body.name}' is shown and hidden")
        self.rig = (parents or Parents()).rig(body)
        self._unit_m = unit_m

    @property
    def key_frames(self) -> F64:
        """Ascending unique animation frames (k,) of keys of the armature object, the parents and
        the bones."""
        return np.union1d(self.rig.body.key_frames, self.rig.key_frames)

    def to_world(self, frames: F64) -> F64:
        """Armature to world (T, 4, 4), metres; reads nothing from Blender."""
        return effect_values.to_metres(self.rig.body.world(frames), self._unit_m)

    def read(self, frames: F64, is_wanted: npt.NDArray[np.bool_]) -> PoseBlock:
        """Pose block at animation frames (T,); rows outside the mask ``is_wanted`` are invalid and
        zero, and without any True there are no bones."""
        to_world = np.zeros((len(frames), 4, 4))
        if not is_wanted.any():
            return PoseBlock(is_wanted, to_world)
        # Posing a rig is costly, so only rows with an active effect are posed.
        if is_wanted.all():
            world, bones = self.rig.sample(frames)
            return PoseBlock(is_wanted, effect_values.to_metres(world, self._unit_m), bones)
        bones = np.zeros((len(frames), self.rig.bone_count, 3, 4))
        world, bones[is_wanted] = self.rig.sample(frames[is_wanted])
        to_world[is_wanted] = effect_values.to_metres(world, self._unit_m)
        return PoseBlock(is_wanted, to_world, bones)
