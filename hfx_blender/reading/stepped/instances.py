# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances and particles of haptic volumes, each read as a volume with its own effect.

Keys of instances are collected at whole frames of the user's scene, and at all samples if instances
may exist between two frames only. Values are read at each sample's own time. The id of an instance
is stable: its instancer (particle system, collection instance, geometry nodes) and the persistent
number.

Blender frees an instance's object with the next step of the loop over instances, so all values are
copied inside the loop. Sources are identified by the full names, because a library and the file
may have objects of equal names.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import bpy
import numpy as np

from ...authoring import volumes
from ...authoring.effects import effect_values, effects
from ...engine.arrays import F64, Bool
from ...engine.response.motion_estimate import OVERLAP
from ...engine.scene import AnimationBlock, EffectDescription, TimeBase
from ...engine.volume.shape import Shape
from ...errors import InputError
from ..curves.animation_time import animation_frames
from ..description import (
    activation,
    response_values,
    scene_description,
    soundness,
    unfelt,
    visibility,
)
from ..description.scene_description import HapticObjects
from . import stepping
from .reached import data_reached_from, data_reaching, is_instancer, is_volume, sources_of
from .stepped_reading import EffectRow, effect_block
from .stepping import Stepper

MOST = 4096  # largest number of instances of haptic volumes in a scene
_NO_NUMBER = 2**31 - 1  # filler value in unused levels of a persistent id in Blender

Key = tuple[str, str, tuple[int, ...]]
"""Full name of the source, full name of the instancer ("" without), and persistent id."""


def _shown(
    depsgraph: bpy.types.Depsgraph,
) -> Iterator[tuple[Key, bpy.types.Object, bpy.types.DepsgraphObjectInstance]]:
    """Yield (key, evaluated source, instance) of the present instances of haptic volumes, without
    disabled sources. A key seen before gets zeros appended. The source and the instance are freed
    with the next step."""
    taken: set[Key] = set()
    for instance in depsgraph.object_instances:
        if not instance.is_instance:
            continue
        source = instance.object
        if not is_volume(source) or source.hide_viewport:
            continue
        parent = instance.parent
        number = tuple(n for n in instance.persistent_id if n != _NO_NUMBER)
        key = (
            source.original.name_full,
            "" if parent is None else parent.original.name_full,
            number,
        )
        # Two geometry nodes of an object may count from 0 each: extend the id until unique.
        while key in taken:
            key = (*key[:2], (*key[2], 0))
        taken.add(key)
        yield key, source, instance


@dataclass(frozen=True, eq=False)
class _Values:
    """Values shared by the instances of a volume at one time."""

    level: float
    parameters: list[float]  # in the modality's order; wind: the speed only
    scale: F64  # (3,) shape space to local space
    response: F64 | None  # (F, WIDTH)


class Sources:
    """Volumes of a scene with possible instances, and readers of the present instances.

    New faults are added to ``faults``, message -> sample indices, in place. ``objects`` are the
    sources by full name, without muted, faulty and always silent volumes; with ``time`` also
    without volumes that are off at all its samples, in ``asleep`` with reasons. ``warnings`` name
    corrected values and excluded volumes, ``notes`` keyframes that are NaN or infinite.
    ``activations`` include muted volumes.
    """

    def __init__(
        self,
        found: HapticObjects,
        shapes: effect_values.ShapeCache,
        faults: dict[str, set[int]] | None = None,
        time: TimeBase | None = None,
    ) -> None:
        self._found = found
        self._shapes = shapes
        self._faults = {} if faults is None else faults
        sources = sources_of(found.scene, found.instancers)
        valid, bad = soundness.without_faulty(sources.values(), soundness.warnings_of)
        warnings = (text for texts in valid.values() for text in texts)
        sources = {name: source for name, source in sources.items() if source in valid}
        # An effect of the scene on solo silences sources as well.
        own = effects.effects_of(found.scene) if sources else ()
        every = {obj.name_full: obj for obj in own}
        silenced = effects.muted_effects({**every, **sources}.values())
        states = {
            name: activation.SILENCED if source in silenced else activation.activation_of(source)
            for name, source in sources.items()
        }
        self.warnings = (*warnings, *soundness.left_out(bad))
        self.notes = soundness.non_finite_keyframes(sources.values())
        self.activations = {sources[name]: state for name, state in states.items()}
        self.asleep = (
            {} if time is None else unfelt.asleep(found.scene, time, self.activations, found.equal)
        )
        self.states = {
            name: state
            for name, state in states.items()
            if state.source is not activation.ActivationSource.OFF
            and sources[name] not in self.asleep
        }
        self.objects = {name: sources[name] for name in self.states}
        self._ids = effects.unique_ids(list(self.objects.values()))

    def described(self, name: str) -> EffectDescription:
        """Description shared by the instances of the source with full name ``name``: unique id,
        clips, falloff, filters."""
        source, hfx = self.objects[name], self.objects[name].hfx
        return EffectDescription(
            id=self._ids[source],
            name=effects.shown_names([source])[source],
            modality=hfx.modality,
            model_id=effects.model_id_for(hfx.modality, self._found.bodies[0]),
            area=response_values.volume_of(source),
            is_contact=hfx.temperature_reference == "CONTACT",
            clips=scene_description.played_clips(self._found.scene, self.states[name]),
        )

    def keys_now(self, depsgraph: bpy.types.Depsgraph) -> set[Key]:
        """Keys of the present instances of :attr:`objects`."""
        return {key for key, _, _ in _shown(depsgraph) if key[0] in self.objects}

    def rows_now(
        self, depsgraph: bpy.types.Depsgraph, time: TimeBase | None = None, index: int = 0
    ) -> dict[Key, EffectRow]:
        """Effect rows by key of the present instances of :attr:`objects`, metres; instances without
        a shape are missing. With ``time`` sine phases are continuous up to sample ``index``, else
        as stored. Faults are recorded at ``index``."""
        rows: dict[Key, EffectRow] = {}
        common: dict[str, _Values] = {}
        shapes: dict[tuple[str, int], Shape | None] = {}
        for key, evaluated, instance in _shown(depsgraph):
            name = key[0]
            if name not in self.objects:
                continue
            if name not in common:
                common[name] = self._values(name, evaluated, time, index)
            values = common[name]
            # Geometry nodes may instance several meshes of one source at a time. Only the address
            # tells these apart: evaluated meshes may share a name.
            data = evaluated.data
            which = name, 0 if data is None else data.as_pointer()
            if which not in shapes:
                part = sum(source == name for source, _ in shapes)
                shapes[which] = self._shape(name, evaluated, part, index)
            shape = shapes[which]
            if shape is None:
                continue
            world = effect_values.world_matrix(instance)
            parameters = values.parameters
            if evaluated.hfx.modality == "wind":
                parameters = [*parameters, *effect_values.directions(world).tolist()]
            matrix = effect_values.to_metres(world, self._found.unit_m)
            matrix[:3, :3] *= values.scale
            rows[key] = EffectRow(values.level, parameters, matrix, shape, values.response)
        return rows

    def _values(
        self, name: str, evaluated: bpy.types.Object, time: TimeBase | None, index: int
    ) -> _Values:
        """Level, parameters (wind: the speed only), shape scale and filter controls shared by the
        present instances of a source; ``time`` and ``index`` as of :meth:`rows_now`."""
        hfx, unit_m = evaluated.hfx, self._found.unit_m
        parameters = effect_values.parameters(hfx, np.eye(4))
        if time is None:
            response = response_values.controls(hfx, unit_m)
        else:
            response = response_values.controls_at(
                self._found.scene, self.objects[name], hfx, unit_m, time, index
            )
        return _Values(
            self.states[name].level(hfx),
            parameters[:1] if hfx.modality == "wind" else parameters,
            volumes.shape_scale(hfx),
            response,
        )

    def _shape(self, name: str, evaluated: bpy.types.Object, part: int, index: int) -> Shape | None:
        """Shape of an evaluated source, mesh number ``part`` at this time; None for an empty mesh,
        and for a mesh without an inside, with a fault recorded at sample ``index``."""
        if evaluated.hfx.shape == "MESH" and effect_values.is_empty(evaluated):
            return None  # nodes turned the whole mesh into instances, listed themselves
        source = self.objects[name]
        try:
            return self._shapes.shape_of(source, evaluated, part)
        except InputError as error:
            soundness.add_fault(self._faults, str(error), index)
            return None  # silent while the mesh has no inside


class Instances:
    """All instances of a scene's haptic volumes over its own frames and the exported frames.
    ``descriptions`` has an entry for each instance, sorted by key; warnings, notes, asleep and
    activations as of :class:`Sources`. New faults are added to ``faults``, message -> sample
    indices, in place. Raises InputError for more than :data:`MOST` instances."""

    def __init__(
        self,
        found: HapticObjects,
        time: TimeBase,
        shapes: effect_values.ShapeCache,
        faults: dict[str, set[int]],
    ) -> None:
        self._time = time
        self._faults = faults
        self._sources = Sources(found, shapes, faults, time)
        self.warnings, self.notes = self._sources.warnings, self._sources.notes
        self.asleep, self.activations = self._sources.asleep, self._sources.activations
        self._found = replace(found, dormant={**found.dormant, **self.asleep})
        self._keys: tuple[Key, ...] = ()
        self._last: dict[int, dict[Key, EffectRow]] = {}  # by index of the last samples
        self.descriptions: tuple[EffectDescription, ...] = ()
        if self._sources.objects:
            self._find()

    def _find(self) -> None:
        """Step through the scene's and the read frames, collect all keys, and describe each
        instance. Also at samples if instances may be brief. Raises InputError above :data:`MOST`
        instances."""
        scene, time = self._found.scene, self._time
        self._first = min(scene.frame_start, time.frame_first)
        last = max(scene.frame_end, time.frame_last) + 1
        frames = {Fraction(frame) for frame in range(self._first, last + 1)}
        # Blocks near the start of the range also read samples before it, as far as the scene goes.
        if _may_be_brief(self._sources.objects.values()):
            first = -int((time.frame_first - self._first) * time.rate_hz / time.fps)
            count = int((last - time.frame_first) * time.rate_hz / time.fps)
            frames.update(map(time.frame, range(first, count + 1)))
        seen: list[set[Key]] = [set() for _ in range(self._first, last + 1)]
        with self.stepper() as stepper:
            for frame in sorted(frames):
                stepper.set_frame(frame)
                now = self._sources.keys_now(self._found.layer.depsgraph)
                # Keys at sub-frames count for the frame before; the masks below are a frame wider
                # on both sides.
                seen[int(frame) - self._first] |= now
        self._keys = tuple(sorted(set().union(*seen)))
        if len(self._keys) > MOST:
            raise InputError(
                f"Scene '{scene.name}' has {len(self._keys)} instances of haptic volumes; at "
                f"most {MOST} can be felt."
            )
        names = sorted({name for name, _, _ in self._keys})
        # An instance at a sub-frame may belong to the frame before or to the frame after.
        self._present = {name: np.zeros(len(seen) + 2, np.bool_) for name in names}
        for row, frame_keys in enumerate(seen):
            for name in {name for name, _, _ in frame_keys}:
                self._present[name][row : row + 3] = True
        self.descriptions = _numbered(
            self._keys,
            {name: self._sources.described(name) for name in names},
            {*effects.shown_names(effects.effects_of(scene)).values()},
        )

    @property
    def sources(self) -> set[bpy.types.Object]:
        """Volumes with instances."""
        return {self._sources.objects[name] for name, _, _ in self._keys}

    def stepper(self) -> stepping.Stepping:
        """Context that steps the user's own scene, to be given to :meth:`extended`."""
        return stepping.own_scene(self._found)

    def may_be_on(self, frames: F64) -> Bool:
        """Mask (n,) of played frames at which any instance may be felt; a superset: each source
        counts from one frame before an instance to one after."""
        animation = animation_frames(self._found.scene, frames)
        on = np.zeros(len(frames), np.bool_)
        for name in {name for name, _, _ in self._keys}:
            present = self._present[name]
            row = np.floor(frames).astype(np.int64) - self._first + 1
            inside = (row >= 0) & (row < len(present))
            is_present = inside & present[np.clip(row, 0, len(present) - 1)]
            on |= is_present & self._sources.states[name].may_be_on(animation)
        return on

    def extended(self, block: AnimationBlock, stepper: Stepper) -> AnimationBlock:
        """Copy of a block with the effects of all instances appended, read at the block's samples.
        The level of an instance is 0 at samples without the instance."""
        rows = [self._rows(index, stepper) for index in block.indices.tolist()]
        absent = EffectRow()
        more = (
            effect_block([row.get(key, absent) for row in rows], description.modality)
            for key, description in zip(self._keys, self.descriptions, strict=True)
        )
        return replace(block, effects=(*block.effects, *more))

    def _rows(self, index: int, stepper: Stepper) -> dict[Key, EffectRow]:
        """Rows of all effects by key at sample ``index``; the last :data:`OVERLAP` samples are
        cached. Failed drivers and instances without a description are recorded as faults; their
        rows stay in the result."""
        if index not in self._last:
            stepper.set_frame(self._time.frame(index))
            for failure in stepper.failures:
                soundness.add_fault(self._faults, failure, index)
            rows = self._sources.rows_now(self._found.layer.depsgraph, self._time, index)
            for name, _, _ in rows.keys() - set(self._keys):
                text = f"an instance of '{name}' that is there between two frames only is not felt"
                self._faults.setdefault(text, set()).add(index)
            # The next block begins with the last samples of this block.
            self._last = {k: self._last[k] for k in [*self._last][1 - OVERLAP :]} | {index: rows}
        return self._last[index]


def _may_be_brief(sources: Iterable[bpy.types.Object]) -> bool:
    """Test for sources with instances that may exist between two whole frames only. Causes are
    animated visibility, animated inputs of geometry nodes, nodes that read the scene time,
    particles that live less than a frame, and frame handlers of other add-ons."""
    reached = data_reached_from(filter(is_instancer, data_reaching(sources)))
    return stepping.foreign_handler() is not None or any(map(_may_be_short, reached))


def _may_be_short(data: bpy.types.ID) -> bool:
    """Test one data-block between an instancer and a source for instances shorter than a frame, see
    :func:`_may_be_brief`; False for further types."""
    if isinstance(data, bpy.types.Object):
        paths = soundness.animated_paths(data)
        return any(path == visibility.PATH or path.startswith("modifiers[") for path in paths)
    if isinstance(data, bpy.types.ParticleSettings):
        shortest = data.lifetime * (1.0 - data.lifetime_random)
        return shortest < 1.0 or any(data.texture_slots) or bool(soundness.animated_paths(data))
    if isinstance(data, bpy.types.GeometryNodeTree):
        reads_time = any(node.bl_idname == "GeometryNodeInputSceneTime" for node in data.nodes)
        return reads_time or bool(soundness.animated_paths(data))
    return False


def _numbered(
    keys: Sequence[Key], sources: dict[str, EffectDescription], taken: set[str]
) -> tuple[EffectDescription, ...]:
    """Descriptions of the instances in the order of ``keys``, with ids ``<id of the
    source>:<numbers>`` and names ``<name> <numbers>``, numbers joined by dots. The instancer's name
    precedes the numbers if a source has several instancers, or one of the names is ``taken``."""
    # Numbers are unique within an instancer only.
    instancers = sorted({(name, parent) for name, parent, _ in keys})
    several = {name for name, _ in instancers if sum(n == name for n, _ in instancers) > 1}
    texts = [".".join(map(str, number)) for _, _, number in keys]
    shown = [f"{sources[name].name} {text}" for (name, *_), text in zip(keys, texts, strict=True)]
    several |= {name for (name, *_), own in zip(keys, shown, strict=True) if own in taken}
    descriptions = []
    for (name, parent, _), text in zip(keys, texts, strict=True):
        label = f"{parent} {text}" if name in several else text
        source = sources[name]
        descriptions.append(
            replace(source, id=f"{source.id}:{label}", name=f"{source.name} {label}")
        )
    return tuple(descriptions)
