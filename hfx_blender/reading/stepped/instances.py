# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances and particles of haptic volumes, each as a volume of its own.

Which there are is found at whole frames of the user's own scene, and at all samples where some
may be there between two frames only; what each is at a time is read at that very time. Each has
an id that stays: what makes it (a particle system, a collection instance, geometry nodes), and
its number there.

The objects that Blender shows as instances live no longer than a step of the loop over them, so
all that counts is copied inside of it. Sources are told apart by their full names: a library
and the file may each have an object of the same name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import bpy
import numpy as np

from ...authoring import volumes
from ...authoring.effects import effect_values, effects
from ...engine.arrays import F64, Bool
from ...engine.response.paths import OVERLAP
from ...engine.scene import AnimationBlock, EffectDescription, HapticVolume, TimeBase
from ...engine.volume.shape import Shape
from ...errors import InputError
from ..curves.animation_time import animation_frames
from ..description import (
    activation,
    dormant,
    response_values,
    scene_description,
    soundness,
    visibility,
)
from ..description.scene_description import HapticObjects
from . import stepping
from .reached import data_reached_from, data_reaching, is_instancer, is_volume, sources_of
from .scene_rows import EffectRow, effect_block
from .stepping import Stepper

MOST = 4096
"""Largest number of instances of haptic volumes."""

_NO_NUMBER = 2**31 - 1
"""Filler of the unused levels of a persistent id in Blender."""

Key = tuple[str, str, tuple[int, ...]]
"""The full names of the source and of its instancer, and the persistent id."""

Phase = Callable[[bpy.types.Object, F64], F64]
"""Controls (F, WIDTH) of a source's filters -> the same with phases that go on evenly."""


def _states(
    scene: bpy.types.Scene, sources: Mapping[str, bpy.types.Object]
) -> dict[str, activation.Activation]:
    """Activations of volumes, by their full names; solo volumes silence all others."""
    every = {obj.name_full: obj for obj in effects.effects_of(scene)}
    silenced = effects.muted_effects({**every, **sources}.values())
    return {
        name: activation.SILENCED if source in silenced else activation.activation_of(source)
        for name, source in sources.items()
    }


def _shown(
    depsgraph: bpy.types.Depsgraph,
) -> Iterator[tuple[Key, bpy.types.Object, bpy.types.DepsgraphObjectInstance]]:
    """Present instances of haptic volumes: key, evaluated source, instance.

    Both of the latter are gone with the next step.
    """
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
        while key in taken:  # two nodes of one object may count from 0 each
            key = (*key[:2], (*key[2], 0))
        taken.add(key)
        yield key, source, instance


@dataclass(frozen=True, eq=False)
class _Values:
    """Values shared by the instances of a volume at one time."""

    level: float
    parameters: list[float]  # of wind the speed only
    scale: F64  # (3,) shape space to local space
    response: F64 | None  # (F, WIDTH)


class Sources:
    """Volumes of a scene that may have instances, and the state of these at a time.

    Parameters
    ----------
    faults : dict, optional
        Where it is told what went wrong, and at which samples.
    time : TimeBase, optional
        Volumes that cannot be felt at any time of it are left out, too.

    Attributes
    ----------
    objects : dict
        Those that are neither muted nor faulty, by their full names.
    warnings : tuple of str
        What is read otherwise than it stands in the file, and what was left out.
    notes : tuple of str
        Keyframes that are no numbers.
    asleep : dict
        Those that cannot be felt at any time of ``time``, and why.
    activations : dict
        When each of them is on; muted ones, too.
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
        every = sources_of(found.scene)
        sound, bad = soundness.without_faulty(every.values(), soundness.warnings_of)
        warned = (text for each in sound.values() for text in each)
        every = {name: source for name, source in every.items() if source in sound}
        states = _states(found.scene, every)
        self.warnings = (*warned, *soundness.left_out(bad))
        self.notes = soundness.non_finite_keyframes(every.values())
        self.activations = {every[name]: state for name, state in states.items()}
        self.asleep = (
            {} if time is None else dormant.asleep(found.scene, time, self.activations.items())
        )
        self.states = {
            name: state
            for name, state in states.items()
            if state.source is not activation.ActivationSource.OFF
            and every[name] not in self.asleep
        }
        self.objects = {name: every[name] for name in self.states}
        self._ids = effects.unique_ids(list(self.objects.values()))
        plain = [source.name for source in self.objects.values()]
        self._names = {  # a library may have a volume of the same name
            name: source.name if plain.count(source.name) == 1 else name
            for name, source in self.objects.items()
        }

    def described(self, name: str) -> EffectDescription:
        """Description shared by the instances of a source."""
        source, hfx = self.objects[name], self.objects[name].hfx
        return EffectDescription(
            id=self._ids[name],
            name=self._names[name],
            modality=hfx.modality,
            model_id=effects.model_id_for(hfx.modality),
            area=HapticVolume(effect_values.falloff(hfx), response_values.filters_of(source)),
            is_contact=hfx.temperature_reference == "CONTACT",
            clips=scene_description.played_clips(self._found.scene, self.states[name]),
        )

    def keys_now(self, depsgraph: bpy.types.Depsgraph) -> set[Key]:
        """Keys of the present instances."""
        return {key for key, _, _ in _shown(depsgraph) if key[0] in self.objects}

    def rows_now(
        self, depsgraph: bpy.types.Depsgraph, phase: Phase | None = None, index: int = 0
    ) -> dict[Key, EffectRow]:
        """Rows of the present instances, at a sample."""
        rows: dict[Key, EffectRow] = {}
        common: dict[str, _Values] = {}
        shapes: dict[tuple[str, int], Shape | None] = {}
        for key, evaluated, instance in _shown(depsgraph):
            name = key[0]
            if name not in self.objects:
                continue
            if name not in common:
                common[name] = self._values(name, evaluated, phase)
            values = common[name]
            data = evaluated.data
            which = name, 0 if data is None else data.as_pointer()
            if which not in shapes:
                part = sum(other == name for other, _ in shapes)
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

    def _values(self, name: str, evaluated: bpy.types.Object, phase: Phase | None) -> _Values:
        hfx = evaluated.hfx
        parameters = effect_values.parameters(hfx, np.eye(4))
        response = response_values.controls(hfx, self._found.unit_m)
        if response is not None and phase is not None:
            response = phase(self.objects[name], response)
        return _Values(
            self.states[name].level(hfx),
            parameters[:1] if hfx.modality == "wind" else parameters,
            volumes.shape_scale(hfx),
            response,
        )

    def _shape(self, name: str, evaluated: bpy.types.Object, part: int, index: int) -> Shape | None:
        """The shape of an instance; None: it has none, of which a fault is told."""
        if evaluated.hfx.shape == "MESH" and effect_values.is_empty(evaluated):
            return None  # nodes made instances of all of it, which come by themselves
        source = self.objects[name]
        try:
            return self._shapes.shape_of(source, evaluated, part)
        except InputError as error:
            soundness.add_fault(self._faults, str(error), index)
            return None  # silent while its mesh has no inside


class Instances:
    """All instances of a scene's haptic volumes, over its own frames and the exported ones.

    Parameters
    ----------
    faults : dict
        Where it is told what went wrong, and at which samples.

    Attributes
    ----------
    descriptions : tuple of EffectDescription
        One for each instance.
    warnings, notes : tuple of str
    asleep, activations : dict
        See :class:`Sources`.

    Raises
    ------
    InputError
        There are too many.
    """

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
        self._last: dict[int, dict[Key, EffectRow]] = {}  # of the last samples
        self.descriptions: tuple[EffectDescription, ...] = ()
        if self._sources.objects:
            self._find()

    def _find(self) -> None:
        scene, time = self._found.scene, self._time
        self._first = min(scene.frame_start, time.frame_first)
        last = max(scene.frame_end, time.frame_last) + 1
        frames = {Fraction(frame) for frame in range(self._first, last + 1)}
        if _may_be_brief(self._sources.objects.values()):
            first = -int((time.frame_first - self._first) * time.rate_hz / time.fps)
            count = int((last - time.frame_first) * time.rate_hz / time.fps)
            frames.update(map(time.frame, range(first, count + 1)))
        seen: list[set[Key]] = [set() for _ in range(self._first, last + 1)]
        with self.stepper() as stepper:
            for frame in sorted(frames):
                stepper.set_frame(frame)
                now = self._sources.keys_now(self._found.layer.depsgraph)
                seen[int(frame) - self._first] |= now
        self._keys = tuple(sorted(set().union(*seen)))
        if len(self._keys) > MOST:
            raise InputError(
                f"Scene '{scene.name}' has {len(self._keys)} instances of haptic volumes; at "
                f"most {MOST} can be felt."
            )
        names = sorted({name for name, _, _ in self._keys})
        # At a sub-frame the instances of the frame before and after may exist.
        self._present = {name: np.zeros(len(seen) + 2, np.bool_) for name in names}
        for row, here in enumerate(seen):
            for name in {name for name, _, _ in here}:
                self._present[name][row : row + 3] = True
        self.descriptions = _numbered(
            self._keys, {name: self._sources.described(name) for name in names}
        )

    def stepper(self) -> stepping.Stepping:
        """The user's own scene, to be set to the times at which instances are read."""
        return stepping.own_scene(self._found)

    def may_be_on(self, frames: F64) -> Bool:
        """Test that any instance can be felt at each played frame, (n,)."""
        animation = animation_frames(self._found.scene, frames)
        on = np.zeros(len(frames), np.bool_)
        for name in {name for name, _, _ in self._keys}:
            present = self._present[name]
            row = np.floor(frames).astype(np.int64) - self._first + 1
            inside = (row >= 0) & (row < len(present))
            there = inside & present[np.clip(row, 0, len(present) - 1)]
            on |= there & self._sources.states[name].may_be_on(animation)
        return on

    def extended(self, block: AnimationBlock, stepper: Stepper) -> AnimationBlock:
        """A block with the instances after its own effects."""
        rows = [self._rows(index, stepper) for index in block.indices.tolist()]
        nothing = EffectRow()
        more = (
            effect_block([row.get(key, nothing) for row in rows], description.modality)
            for key, description in zip(self._keys, self.descriptions, strict=True)
        )
        return replace(block, effects=(*block.effects, *more))

    def _rows(self, index: int, stepper: Stepper) -> dict[Key, EffectRow]:
        if index not in self._last:
            stepper.set_frame(self._time.frame(index))
            for failure in stepper.failures:
                soundness.add_fault(self._faults, failure, index)
            frame = np.array([float(self._time.frame(index))])

            def phase(source: bpy.types.Object, controls: F64) -> F64:
                scene = self._found.scene
                values = controls[None]
                return response_values.with_even_phase(scene, source, values, frame, self._time)[0]

            rows = self._sources.rows_now(self._found.layer.depsgraph, phase, index)
            for name, _, _ in rows.keys() - set(self._keys):
                text = f"an instance of '{name}' that is there between two frames only is not felt"
                self._faults.setdefault(text, set()).add(index)
            self._last = {k: self._last[k] for k in [*self._last][1 - OVERLAP :]} | {index: rows}
        return self._last[index]


def _may_be_brief(sources: Iterable[bpy.types.Object]) -> bool:
    """Test that an instance of these volumes may be there between two frames only.

    So it may be where visibility or what geometry nodes take is animated, where nodes read the
    time, particles live for less than a frame, or a handler of others does what it likes.
    """
    reached = data_reached_from(filter(is_instancer, data_reaching(sources)))
    return stepping.foreign_handler() is not None or any(map(_may_be_short, reached))


def _may_be_short(data: bpy.types.ID) -> bool:
    if isinstance(data, bpy.types.Object):
        paths = soundness.animated_paths(data)
        return any(each == visibility.PATH or each.startswith("modifiers[") for each in paths)
    if isinstance(data, bpy.types.ParticleSettings):
        shortest = data.lifetime * (1.0 - data.lifetime_random)
        return shortest < 1.0 or any(data.texture_slots) or bool(soundness.animated_paths(data))
    if isinstance(data, bpy.types.GeometryNodeTree):
        reads_time = any(each.bl_idname == "GeometryNodeInputSceneTime" for each in data.nodes)
        return reads_time or bool(soundness.animated_paths(data))
    return False


def _numbered(
    keys: Iterable[Key], sources: dict[str, EffectDescription]
) -> tuple[EffectDescription, ...]:
    """Descriptions of the instances; an id stays as long as its source."""
    instancers = sorted({(name, parent) for name, parent, _ in keys})
    several = {name for name, _ in instancers if sum(n == name for n, _ in instancers) > 1}
    found = []
    for name, parent, number in keys:
        text = ".".join(map(str, number))
        label = f"{parent} {text}" if name in several else text
        source = sources[name]
        found.append(replace(source, id=f"{source.id}:{label}", name=f"{source.name} {label}"))
    return tuple(found)
