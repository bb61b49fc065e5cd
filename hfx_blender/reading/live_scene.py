# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluation of the open scene at the present frame, for preview and live devices.

The same reader and engine as for an export, but Blender's current evaluated state is read instead
of stepping. Faulty effects are left out.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from operator import attrgetter
from typing import Any, Final

import bpy
import numpy as np

from ..authoring import responses
from ..authoring.effects import effects
from ..authoring.effects.effect_values import ShapeCache
from ..authoring.surfaces import surfaces
from ..blender.scene_info import fps_of, scene_objects
from ..engine.evaluate import Engine
from ..engine.samples import SampleRun
from ..engine.scene import AnimationBlock, EffectDescription, HapticVolume, SpotArea
from ..engine.tolerance import Tolerance
from ..engine.volume.shape import Falloff, FalloffKind
from .curves.animation_time import time_base
from .description import area_values, scene_description, visibility
from .description.scene_description import HapticObjects
from .stepped import instances
from .stepped.instances import Key
from .stepped.stepped_reading import EffectRow, PoseRow, SteppedReading, effect_block, pose_block
from .stepped.stepping import Stepper

Overrides = Mapping[str, Mapping[str, Any]]
"""Received values by property and name of the effect, in place of evaluated properties."""

LONGEST_STEP_S = 0.3  # longest time between two related moments; later moments start without memory
FEWEST = 64  # slots of a source without present instances, for particles of later frames

# Properties of bodies and effects that a description holds; animated ones are read at each moment.
_CONSTANT_PROPERTIES = attrgetter(
    *"role modality kind shape falloff falloff_share temperature_reference model_hash".split(),
    *"body_name body_models follow is_muted is_group_muted is_solo".split(),
    *("stiffness", "damping", "friction"),
)

_FALLOFF: Final = ("falloff", "falloff_share")


def described_overrides(overrides: Overrides) -> tuple[tuple[str, str, Any], ...]:
    """Received values that a description holds, as (effect, property, value), sorted: falloff, and
    reference of a temperature."""
    names = (*_FALLOFF, "temperature_reference")
    return tuple(
        sorted((e, k, x) for e, xs in overrides.items() for k, x in xs.items() if k in names)
    )


def _overridden(effect: EffectDescription, values: Mapping[str, Any]) -> EffectDescription:
    """Description of an effect with received values of falloff and temperature reference."""
    area = effect.area
    if isinstance(area, HapticVolume | SpotArea) and not values.keys().isdisjoint(_FALLOFF):
        kind = FalloffKind(values.get("falloff", area.falloff.kind))
        falloff = Falloff(kind, values.get("falloff_share", area.falloff.share))
        area = replace(area, falloff=falloff)
    is_contact = effect.is_contact
    if "temperature_reference" in values:
        is_contact = values["temperature_reference"] == "CONTACT"
    return replace(effect, area=area, is_contact=is_contact)


class LiveClock:
    """Clock of the moments of a scene; ``now`` is a monotonic clock, seconds."""

    def __init__(self, scene: bpy.types.Scene, now: Callable[[], float] = time.monotonic) -> None:
        self._scene = scene
        self._now = now
        self._frame_s = self._clock_s = self._time_s = 0.0
        self._is_first = True

    def tick(self) -> tuple[float, float | None]:
        """Advance to now; returns (time, step since the last call), seconds from the scene's start.

        The frame's time if the frame has changed, else the last time plus the clock's. The step is
        None at the first call, for a step back or none, and above :data:`LONGEST_STEP_S`.
        """
        scene, clock_s = self._scene, self._now()
        frame_s = float(scene.frame_current_final - scene.frame_start) / fps_of(scene)
        if frame_s != self._frame_s or self._is_first:
            step = frame_s - self._frame_s
            time_s = frame_s
        else:
            step = clock_s - self._clock_s
            time_s = self._time_s + step
        # Jumps and long pauses are unrelated moments; a moved frame decides over the clock.
        follows = not self._is_first and 0.0 < step <= LONGEST_STEP_S
        if follows and frame_s != self._frame_s:
            # The frame moved on after time had passed on a dragged frame.
            step = time_s - self._time_s
            follows = 0.0 < step
        self._frame_s, self._clock_s, self._time_s = frame_s, clock_s, time_s
        self._is_first = False
        return time_s, step if follows else None

    def ahead_s(self) -> float:
        """Time of the last tick plus the clock's time since, seconds; changes nothing."""
        return self._time_s + (self._now() - self._clock_s)


class LiveScene:
    """Scene that is described once and evaluated after every change.

    ``layer`` holds the evaluated objects; ``with_positions`` adds positions to samples, for devices
    in a room. ``overrides`` are values in place of evaluated properties, by property and name of
    the effect; the mapping is read at each moment. ``before`` is an earlier description of the
    scene, whose loaded models and skins are used further. Raises InputError if the scene has no
    body or no valid effect.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        layer: bpy.types.ViewLayer,
        tolerance: Tolerance,
        *,
        with_positions: bool = False,
        overrides: Overrides | None = None,
        before: "LiveScene | None" = None,
    ) -> None:
        self.signature = signature_of(scene)
        haptics = scene_description.find(scene, layer)
        shapes = ShapeCache()
        self._instances = LiveInstances(haptics, shapes)
        more = self._instances.descriptions
        # One update per frame during playback gives surface contacts their speed.
        self._has_surfaces = any(obj.hfx.kind == "SURFACE" for obj in haptics.effects)
        time = time_base(scene)
        time = replace(time, rate_hz=time.fps) if self._has_surfaces else time
        self.objects, self.description = scene_description.describe(
            haptics, time, shapes, always_posed=False, more=more
        )
        own = [_overridden(x, (overrides or {}).get(x.name, {})) for x in self.description.effects]
        self.description = replace(self.description, effects=tuple(own))
        self.faults = self.objects.left_out
        self.tolerance = tolerance
        self.record = ("positions",) if with_positions else ()
        engine = None if before is None else before.engine
        self.engine = Engine(
            self.description, record=self.record, tolerance=tolerance, before=engine
        )
        self.engine.prepare()
        self._reading = SteppedReading(self.objects, self.description, shapes)
        if overrides is not None:
            self._reading.overrides = overrides
        self._now = _AsItStands(scene, layer)
        self._index = 0  # advances where strokes over surfaces need history
        count = len(self.objects.effects)  # further effects are instances
        self._volumes = [k for k, e in enumerate(own[:count]) if e.kind == "volume"]
        areas = [effect.area for effect in self.description.effects]
        self._answers = any(isinstance(area, HapticVolume) and area.response for area in areas)
        self._has_memory = self._answers or any(getattr(area, "law", None) for area in areas)
        self.clock = LiveClock(scene)
        self._before: tuple[list[EffectRow], dict[int, PoseRow | None]] | None = None

    @property
    def rings(self) -> bool:
        """True while an impact of a response is felt at the clock's time, without motion."""
        return self._answers and self.engine.responses.settling.any_rings(self.clock.ahead_s())

    def runs(self) -> list[SampleRun]:
        """Samples of the present frame, all with index 0: at most one for each effect and body;
        empty if all effects are off. Advances the clock and the responses."""
        active = self._effects_to_read()
        if active is None:
            return []
        row = self._reading.read(0, self._now, active, ())
        effects = [row.effects.get(k, EffectRow()) for k in range(len(self.objects.effects))]
        hidden = [body.evaluated_get(self.objects.layer.depsgraph) for body in self.objects.bodies]
        for k in visibility.felt_on(self.description, [body.hide_viewport for body in hidden]):
            effects[k] = EffectRow()
        instance_rows, stays = self._instances.rows()
        is_volume_on = any(effects[k].level > 0.0 for k in self._volumes)
        if self.record or is_volume_on or any(row_of.level > 0.0 for row_of in instance_rows):
            self._reading.add_poses(row, self._now, range(len(self.objects.bodies)))
        # Strokes, responses and contact laws need rising times; else each moment stands alone.
        self._index += self._has_surfaces or self._has_memory
        block = self._block(effects + instance_rows, row.poses, stays)
        runs = self.engine.evaluate(block)
        # All runs get index 0, because the display shows one moment.
        return [replace(run, indices=np.zeros(len(run), np.int64)) for run in runs]

    def _effects_to_read(self) -> Sequence[int] | None:
        """Indices of effects: all in a scene with responses, surfaces or instances, also if empty;
        else those with a level above 0 or NaN, None without any."""
        # Responses and surfaces need the moments of silence as well; instances are no own effects.
        if self._answers or self._has_surfaces or self._instances.descriptions:
            return range(len(self.objects.effects))
        graph = self.objects.layer.depsgraph
        pairs = zip(self.objects.effects, self.objects.activations, strict=True)
        read = self._reading.properties_of
        levels = [state.level(read(obj, obj.evaluated_get(graph))) for obj, state in pairs]
        # Not "> 0": NaN has to be found and reported.
        return [k for k, level in enumerate(levels) if not level <= 0.0] or None

    def _block(
        self, effects: list[EffectRow], poses: dict[int, PoseRow | None], stays: list[bool]
    ) -> AnimationBlock:
        """Block of the present rows, after the last call's rows if a response or a contact law
        needs history and the clock relates both. Advances the clock; an unrelated moment clears the
        impacts of all responses. ``stays`` has one entry per instance slot, the last effects: False
        makes the slot's last row an effect that is off."""
        rows, posed = [[effect] for effect in effects], [poses]
        now_s, step_s = self.clock.tick()
        has_history = self._has_memory and step_s is not None and self._before is not None
        if not has_history and step_s is None:
            self.engine.responses.settling.memories.clear()
        # The rows before give the engine motion: responses react to speed and to the begin of a
        # touch.
        if has_history and self._before is not None:
            before, before_poses = self._before
            own = len(effects) - len(stays)
            for k, row in enumerate(rows):
                is_same = k < own or stays[k - own]
                row.insert(0, before[k] if is_same else EffectRow())
            posed.insert(0, before_poses)
        self._before = (effects, poses) if self._has_memory else None
        count = len(posed)
        real_s = np.array([now_s - (step_s or 0.0), now_s])[-count:]
        return AnimationBlock(
            indices=np.arange(self._index - count + 1, self._index + 1),
            effects=tuple(
                effect_block(row, description.modality)
                for row, description in zip(rows, self.description.effects, strict=True)
            ),
            poses=tuple(
                pose_block([pose.get(k) for pose in posed]) for k in range(len(self.objects.bodies))
            ),
            history=count - 1,
            live_s=real_s if self._has_memory else None,
        )


class _AsItStands(Stepper):
    """Stepper that keeps the present frame."""

    def set_frame(self, frame: Fraction) -> None:
        pass


class LiveInstances:
    """Slots for the instances of a scene's volumes.

    A live scene is described once, so each source has a fixed number of slots. An instance keeps
    its slot while present; instances without a free slot are left out.
    """

    def __init__(self, haptics: HapticObjects, shapes: ShapeCache) -> None:
        self._layer = haptics.layer
        self._sources = instances.Sources(haptics, shapes)
        self._slots: dict[str, list[Key | None]] = {}
        descriptions: list[EffectDescription] = []
        # Sources outside the scene are templates of instances, also without an instance now.
        scene_members = set(scene_objects(haptics.scene))
        objects = self._sources.objects
        counts = {name: 0 for name, obj in objects.items() if obj not in scene_members}
        for name, _, _ in self._sources.keys_now(self._layer.depsgraph) if objects else ():
            counts[name] = counts.get(name, 0) + 1
        for source, count in sorted(counts.items()):
            # Twice the present instances: emitters grow during playback, and a new description
            # takes long.
            slots = min(max(FEWEST, 2 * count), instances.MOST)
            self._slots[source] = [None] * slots
            described = self._sources.described(source)
            descriptions += [
                replace(described, id=f"{described.id}:~{k}", name=f"{described.name} ~{k}")
                for k in range(slots)
            ]
        self.descriptions = tuple(descriptions)

    def rows(self) -> tuple[list[EffectRow], list[bool]]:
        """Effect row of each slot, and True for each slot with the same instance as at the last
        call. A missing instance frees the slot (an effect that is off); new instances take free
        slots by key. Further instances are left out."""
        if not self._slots:
            return [], []
        current = self._sources.rows_now(self._layer.depsgraph)
        rows: list[EffectRow] = []
        stays: list[bool] = []
        for source, slots in self._slots.items():
            own_rows = {key: row for key, row in current.items() if key[0] == source}
            before = list(slots)
            for k, key in enumerate(slots):
                if key not in own_rows:
                    slots[k] = None
            # New instances take free slots in the order of the keys.
            new_keys = sorted(set(own_rows) - set(slots))
            for k, key in enumerate(slots):
                if key is None and new_keys:
                    slots[k] = new_keys.pop(0)
            for key, old in zip(slots, before, strict=True):
                rows.append(EffectRow() if key is None else own_rows[key])
                stays.append(key is not None and key == old)
        return rows, stays


def signature_of(scene: bpy.types.Scene) -> tuple[object, ...]:
    """Comparable value of all settings that a scene description depends on; equal as long as a
    description stays valid. Quick enough for each update."""
    parts: list[object] = [scene.name]
    for obj in (*effects.bodies_of(scene), *effects.effects_of(scene)):
        hfx = obj.hfx
        data = obj.animation_data
        strips = () if data is None else tuple(_strips(data))
        parts.append(
            (
                obj.name,
                *_CONSTANT_PROPERTIES(hfx),
                hfx.body.name if hfx.body else "",
                hfx.avatar.name if hfx.avatar else "",
                _own_place(hfx.avatar),
                # Hashes instead of arrays, as a signature is made at every update of the scene.
                hash(bytes(memoryview(obj[effects.WEIGHTS]))) if _has_weights(obj) else 0,
                hash(bytes(memoryview(obj[effects.VERTICES]))) if _has_weights(obj) else 0,
                visibility.is_disabled(obj),
                responses.signature(hfx),
                surfaces.signature(obj) if hfx.kind == "SURFACE" else (),
                area_values.signature(obj),
                strips,
            )
        )
    return tuple(parts)


def _own_place(mesh: bpy.types.Object | None) -> object:
    """Own transform of an avatar's mesh, by rows; empty without a mesh, and with animation, which
    would need a new description at each frame."""
    is_still = mesh is not None and mesh.animation_data is None
    return tuple(map(tuple, mesh.matrix_basis)) if is_still else ()


def _has_weights(obj: bpy.types.Object) -> bool:
    # Blender returns an empty ID-property array as a list
    return effects.WEIGHTS in obj and not isinstance(obj[effects.WEIGHTS], list)


def _strips(data: bpy.types.AnimData) -> list[object]:
    """NLA on or off, name of the action, then for each track (mute, solo) and (name, mute) of each
    strip."""
    parts: list[object] = [data.use_nla, data.action.name if data.action else ""]
    for track in data.nla_tracks:
        parts.append((track.mute, track.is_solo))
        parts += [(strip.name, strip.mute) for strip in track.strips]
    return parts
