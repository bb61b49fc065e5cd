# SPDX-License-Identifier: GPL-3.0-or-later
"""Many small objects: instances and particles of a haptic volume are volumes themselves.

They are read once, at whole frames, from the user's own scene, which is what simulations and
geometry nodes can be read at; between frames they move straight on. Each has an id that stays:
what makes it (a particle system, a collection instance, geometry nodes), and its number there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ..authoring import effects
from ..engine.modality import MODALITIES
from ..engine.scene import AnimationBlock, EffectBlock, EffectDescription, HapticVolume, TimeBase
from ..engine.volume.shape import Shape
from ..errors import InputError
from . import activation, effect_values, response_values, stepping
from .scene_rows import EffectRow

F64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]
I64 = npt.NDArray[np.int64]

MOST = 4096
"""More instances of haptic volumes than that are refused."""

_NO_NUMBER = 2**31 - 1
"""What Blender fills up the unused levels of a persistent id with."""

Key = tuple[str, str, tuple[int, ...]]
"""The source's name, the instancer's, and the persistent id."""


def may_be(scene: bpy.types.Scene) -> bool:
    """Whether anything in a scene makes instances at all; cheap."""
    return any(_is_instancer(obj) for obj in scene.objects)


def _is_instancer(obj: bpy.types.Object) -> bool:
    return (
        obj.instance_type != "NONE"
        or bool(obj.particle_systems)
        or any(modifier.type == "NODES" for modifier in obj.modifiers)
    )


@dataclass(eq=False)
class _Seen:
    """The instances of one frame."""

    matrices: dict[Key, Any] = field(default_factory=dict)
    sources: dict[str, bpy.types.Object] = field(default_factory=dict)  # evaluated


def _seen(depsgraph: bpy.types.Depsgraph) -> _Seen:
    seen = _Seen()
    for instance in depsgraph.object_instances:
        if not instance.is_instance:
            continue
        obj = instance.object
        hfx = obj.hfx
        if hfx.role != "EFFECT" or hfx.kind != "VOLUME":
            continue
        name, parent = obj.original.name, instance.parent
        number = tuple(n for n in instance.persistent_id if n != _NO_NUMBER)
        key = (name, "" if parent is None else parent.original.name, number)
        seen.matrices[key] = effect_values.world_of(instance)
        seen.sources.setdefault(name, obj)
    return seen


@dataclass(frozen=True, eq=False)
class _SourceFrames:
    """One instanced volume at F frames; what its instances have in common."""

    description: EffectDescription
    shape: Shape
    levels: F64  # (F,)
    parameters: F64  # (F, P)
    scales: F64  # (F, 3) shape space to local space
    response: F64 | None  # (F, filters, WIDTH)


@dataclass(frozen=True, eq=False)
class Instances:
    """All instances of haptic volumes over some frames."""

    first: int  # frame
    keys: tuple[Key, ...]
    sources: dict[str, _SourceFrames]
    matrices: F64  # (F, N, 4, 4) world, Blender's units
    present: Bool  # (F, N)
    unit_m: float
    descriptions: tuple[EffectDescription, ...]  # (N,)

    def may_be_on(self, frames: F64) -> Bool:
        """Whether any instance can be felt at each frame, (n,)."""
        on = np.zeros(len(self.present), np.bool_)
        for k, key in enumerate(self.keys):
            on |= self.present[:, k] & (self.sources[key[0]].levels > 0.0)
        row = np.floor(frames).astype(np.int64) - self.first
        inside = (row >= 0) & (row < len(on))
        row = np.clip(row, 0, len(on) - 1)
        after = np.minimum(row + 1, len(on) - 1)
        return np.asarray(inside & (on[row] | on[after]))

    def blocks(self, frames: F64) -> tuple[EffectBlock, ...]:
        """Each instance at some frames, (T,), in the order of the descriptions."""
        last = len(self.present) - 1
        at = np.clip(frames - self.first, 0.0, last)
        row = np.minimum(np.floor(at).astype(np.int64), last)
        after = np.minimum(row + 1, last)
        share = at - row
        goes_on = self.present[row] & self.present[after]  # (T, N)
        way = np.where(goes_on, share[:, None], 0.0)[:, :, None, None]
        world = self.matrices[row] + (self.matrices[after] - self.matrices[row]) * way
        common = {
            name: self._common(each, row, after, share) for name, each in self.sources.items()
        }
        found = []
        for n, (name, _, _) in enumerate(self.keys):
            levels, parameters, scales, response = common[name]
            matrices = effect_values.to_metres(world[:, n], self.unit_m)
            if self.descriptions[n].modality == "wind":
                parameters = parameters.copy()
                parameters[:, 1:] = effect_values.directions(world[:, n])
            matrices[:, :3, :3] *= scales[:, None, :]
            found.append(
                EffectBlock(
                    levels=np.where(self.present[row, n], levels, 0.0),
                    parameters=parameters,
                    matrices=matrices,
                    shapes=(self.sources[name].shape,),
                    response=response,
                )
            )
        return tuple(found)

    @staticmethod
    def _common(
        each: _SourceFrames, row: I64, after: I64, share: F64
    ) -> tuple[F64, F64, F64, F64 | None]:
        def between(values: F64) -> F64:
            part = share.reshape(-1, *(1,) * (values.ndim - 1))
            return np.asarray(values[row] + (values[after] - values[row]) * part)

        response = None if each.response is None else between(each.response)
        return between(each.levels), between(each.parameters), between(each.scales), response

    def extended(self, block: AnimationBlock, frames: F64) -> AnimationBlock:
        """A block with the instances after its own effects."""
        return replace(block, effects=(*block.effects, *self.blocks(frames)))


def read(
    scene: bpy.types.Scene,
    layer: bpy.types.ViewLayer,
    time: TimeBase,
    shapes: effect_values.Shapes,
) -> Instances | None:
    """The instances of a scene's haptic volumes, over its own frames and the exported ones.

    Raises
    ------
    InputError
        There are too many.
    """
    if not may_be(scene) or not _any_volume():
        return None
    first = min(scene.frame_start, time.frame_first)
    last = max(scene.frame_end, time.frame_last) + 1
    unit_m = _unit_m(scene)
    seen: list[_Seen] = []
    values: dict[str, list[tuple[float, list[float], F64, F64 | None] | None]] = {}
    found: dict[str, tuple[EffectDescription, Shape]] = {}
    states: dict[str, activation.Activation] = {}
    with stepping.own_scene(scene, layer) as stepper:
        for row, frame in enumerate(range(first, last + 1)):
            stepper.set_frame(Fraction(frame))
            here = _seen(layer.depsgraph)
            for name, evaluated in here.sources.items():
                source = bpy.data.objects[name]
                if name not in states:
                    states[name] = _state(scene, source)
                    shape = shapes.shape_of(source, evaluated)
                    found[name] = _describe(source, states[name]), shape
                column = values.setdefault(name, [])
                column += [None] * (row - len(column))
                column.append(_values(evaluated, states[name], unit_m))
            # Objects of this frame are gone at the next; their matrices are kept.
            here.sources.clear()
            seen.append(here)
    silent = {name for name, state in states.items() if state.source is activation.Source.OFF}
    keys = sorted({key for here in seen for key in here.matrices if key[0] not in silent})
    if not keys:
        return None
    if len(keys) > MOST:
        raise InputError(
            f"Scene '{scene.name}' has {len(keys)} instances of haptic volumes; at most {MOST} "
            "can be felt."
        )
    matrices = np.tile(np.eye(4), (len(seen), len(keys), 1, 1))
    present = np.zeros((len(seen), len(keys)), np.bool_)
    number = {key: k for k, key in enumerate(keys)}
    for row, here in enumerate(seen):
        for key, matrix in here.matrices.items():
            if key in number:
                matrices[row, number[key]] = matrix
                present[row, number[key]] = True
    sources = {
        name: _frames(*found[name], column, len(seen))
        for name, column in values.items()
        if name not in silent
    }
    descriptions = _numbered(keys, {name: each.description for name, each in sources.items()})
    return Instances(first, tuple(keys), sources, matrices, present, unit_m, descriptions)


def possible_sources(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> dict[str, int]:
    """Volumes of which there are instances now, or may be at another time; how many there are."""
    if not may_be(scene) or not _any_volume():
        return {}
    counts = {
        obj.name: 0
        for obj in bpy.data.objects
        if obj.hfx.role == "EFFECT" and obj.hfx.kind == "VOLUME" and obj.name not in scene.objects
    }
    for name, _, _ in _seen(depsgraph).matrices:
        counts[name] = counts.get(name, 0) + 1
    return dict(sorted(counts.items()))


def described(scene: bpy.types.Scene, source: bpy.types.Object) -> EffectDescription:
    """What instances of a volume have in common."""
    return _describe(source, _state(scene, source))


def rows_now(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, shapes: effect_values.Shapes
) -> dict[Key, EffectRow]:
    """The instances as they stand now."""
    here, unit_m = _seen(depsgraph), _unit_m(scene)
    rows = {}
    common = {}
    for name, evaluated in here.sources.items():
        source = bpy.data.objects[name]
        state = _state(scene, source)
        if state.source is not activation.Source.OFF:
            shape = shapes.shape_of(source, evaluated)
            common[name] = shape, *_values(evaluated, state, unit_m)
    for key, world in here.matrices.items():
        if key[0] not in common:
            continue
        shape, level, parameters, scale, response = common[key[0]]
        if len(parameters) == 4:  # wind
            parameters = [parameters[0], *effect_values.directions(world).tolist()]
        matrix = effect_values.to_metres(world, unit_m)
        matrix[:3, :3] *= scale
        rows[key] = EffectRow(level, parameters, matrix, shape, response)
    return rows


def _any_volume() -> bool:
    return any(obj.hfx.role == "EFFECT" and obj.hfx.kind == "VOLUME" for obj in bpy.data.objects)


def _unit_m(scene: bpy.types.Scene) -> float:
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(settings.scale_length)


def _state(scene: bpy.types.Scene, source: bpy.types.Object) -> activation.Activation:
    every = {obj.name: obj for obj in (*effects.effects_of(scene), source)}
    if source in effects.silenced(every.values()):
        return activation.SILENCED
    return activation.activation_of(source)


def _describe(source: bpy.types.Object, state: activation.Activation) -> EffectDescription:
    hfx = source.hfx
    return EffectDescription(
        id=hfx.uid or source.name,
        name=source.name,
        modality=hfx.modality,
        model_id=effects.model_id_for(hfx.modality),
        area=HapticVolume(effect_values.falloff(hfx), response_values.filters_of(source)),
        is_contact=hfx.temperature_reference == "CONTACT",
        clips=state.clips,
    )


def _values(
    evaluated: bpy.types.Object, state: activation.Activation, unit_m: float
) -> tuple[float, list[float], F64, F64 | None]:
    from ..authoring import volumes

    hfx = evaluated.hfx
    parameters = effect_values.parameters(hfx, np.eye(4))
    scale = volumes.shape_scale(hfx)
    return state.level(hfx), parameters, scale, response_values.controls(hfx, unit_m)


def _frames(
    description: EffectDescription,
    shape: Shape,
    column: Sequence[tuple[float, list[float], F64, F64 | None] | None],
    count: int,
) -> _SourceFrames:
    """A source over all frames; where none of it is seen, it is as it was seen last or first."""
    known: list[Any] = [*column, *[None] * (count - len(column))]
    held = next(each for each in known if each is not None)
    for k, each in enumerate(known):
        held = known[k] = held if each is None else each
    width = len(MODALITIES[description.modality].parameters)
    return _SourceFrames(
        description,
        shape,
        np.array([each[0] for each in known], np.float64),
        np.array([each[1] for each in known], np.float64).reshape(count, width),
        np.stack([each[2] for each in known]),
        None if held[3] is None else np.stack([each[3] for each in known]),
    )


def _numbered(
    keys: Iterable[Key], sources: dict[str, EffectDescription]
) -> tuple[EffectDescription, ...]:
    """A description of each instance; its id stays as long as what makes it does."""
    instancers = sorted({(name, parent) for name, parent, _ in keys})
    several = {name for name, _ in instancers if sum(n == name for n, _ in instancers) > 1}
    found = []
    for name, parent, number in keys:
        text = ".".join(map(str, number))
        label = f"{parent} {text}" if name in several else text
        source = sources[name]
        found.append(replace(source, id=f"{source.id}:{label}", name=f"{source.name} {label}"))
    return tuple(found)
