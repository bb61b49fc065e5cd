# SPDX-License-Identifier: GPL-3.0-or-later
"""Header of a HapticTrack."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

from ..body.model import PerceptualModel
from ..modality import MODALITIES
from ..samples import Stream
from ..scene import ActuatorArea, Clip, EffectKind, PaintedArea, SceneDescription, TimeBase
from ..surface.surface_drive import with_drives

MAX_VERTEX_COUNT: Final = 2**31 - 1
MAX_SAMPLE_COUNT: Final = 2**31 - 1
MAX_ACTUATORS: Final = 4096
_MAX_FRAME = 2**31 - 1
_MAX_FRACTION = 2**63 - 1


@dataclass(frozen=True)
class TrackModel:
    """Perceptual model of a track's vertex ids."""

    id: str
    modality: str
    content_hash: str
    vertex_count: int


@dataclass(frozen=True)
class TrackBody:
    """Haptic body of a track."""

    id: str
    name: str


@dataclass(frozen=True)
class TrackEffect:
    """Effect of the recorded scene."""

    id: str
    name: str
    modality: str
    kind: EffectKind
    model_id: str
    is_contact: bool = False
    clips: tuple[Clip, ...] = ()
    painted_vertices: int | None = None  # painted effects only: number of painted vertices
    device_id: str | None = None  # kind "actuators" only
    actuators: tuple[str, ...] = ()  # of the device, for kind "actuators"


@dataclass(frozen=True, eq=False)
class TrackHeader:
    """Description of a track without its samples.

    A stream is identified by the index in ``streams``. ``source``, ``settings`` and ``tools`` hold
    JSON values. Raises ValueError for equal ids, a reference without a target, or a number out of
    range.
    """

    time: TimeBase
    models: tuple[TrackModel, ...]
    bodies: tuple[TrackBody, ...]
    effects: tuple[TrackEffect, ...]
    streams: tuple[Stream, ...]
    source: Mapping[str, Any] = field(default_factory=dict)  # "name" and "sha256" of the .blend
    settings: Mapping[str, Any] = field(default_factory=dict)
    tools: Mapping[str, Any] = field(default_factory=dict)  # name: version
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("scene_start", "frame_first", "frame_last"):
            _require_range(name, getattr(self.time, name), -_MAX_FRAME, _MAX_FRAME)
        for name in ("fps", "rate_hz"):
            # Readers in other languages keep a fraction as two 64-bit numbers.
            for part in getattr(self.time, name).as_integer_ratio():
                _require_range(name, part, 1, _MAX_FRACTION)
        _require_range("sample_count", self.time.sample_count, 1, MAX_SAMPLE_COUNT)
        models = _by_id("models", self.models)
        bodies = _by_id("bodies", self.bodies)
        effects = _by_id("effects", self.effects)
        for model in self.models:
            _require_range("vertex_count", model.vertex_count, 1, MAX_VERTEX_COUNT)
        for effect in self.effects:
            _check_effect(effect, models)
        pairs = [(stream.effect_id, stream.body_id) for stream in self.streams]
        if len(set(pairs)) != len(pairs):
            raise ValueError("two streams have the same effect and body")
        for stream in self.streams:
            if stream.effect_id not in effects or stream.body_id not in bodies:
                raise ValueError(
                    f"stream of effect '{stream.effect_id}' on body '{stream.body_id}': no such one"
                )
            effect = effects[stream.effect_id]
            if (stream.modality, stream.model_id) != (effect.modality, effect.model_id):
                raise ValueError(f"stream of effect '{effect.id}' differs from it")

    @classmethod
    def of(
        cls,
        scene: SceneDescription,
        models: Mapping[str, PerceptualModel],
        *,
        settings: Mapping[str, Any],
        tools: Mapping[str, Any],
    ) -> "TrackHeader":
        """Header of a recording of ``scene``. A volume has a stream for each body, every other
        effect a single stream. ``models`` by id may hold unused models, which are omitted."""
        streams, effects = [], []
        all_ids = [body.id for body in scene.bodies]
        for effect in scene.effects:
            area, body_ids = effect.area, all_ids
            own: tuple[Any, ...] = ()  # of a kind: painted_vertices, device_id, actuators
            # Painted areas, spots and actuators belong to one body.
            if hasattr(area, "body_id"):
                body_ids = [area.body_id]
            if isinstance(area, PaintedArea):
                own = (len(area.vertices),)
            elif isinstance(area, ActuatorArea):
                own = None, area.device_id, area.actuators
            streams += [Stream(effect.id, b, effect.modality, effect.model_id) for b in body_ids]
            facts = effect.id, effect.name, effect.modality, effect.kind, effect.model_id
            effects.append(TrackEffect(*facts, effect.is_contact, effect.clips, *own))
        used = {effect.model_id: models[effect.model_id] for effect in scene.effects}
        return cls(
            time=scene.time,
            models=tuple(
                TrackModel(id, model.modality, model.content_hash, len(model))
                for id, model in used.items()
            ),
            bodies=tuple(TrackBody(body.id, body.name) for body in scene.bodies),
            effects=tuple(effects),
            streams=tuple(streams),
            source=scene.source,
            settings={**with_drives(settings, scene), **scene.feel},
            tools=tools,
            warnings=scene.warnings,
        )

    def effect(self, stream: Stream) -> TrackEffect:
        """Effect of a stream."""
        return self._by_ids[0][stream.effect_id]

    def vertex_count(self, stream: Stream) -> int:
        """Vertex count of the model of a stream."""
        return self._by_ids[1][stream.model_id]

    @cached_property
    def _by_ids(self) -> tuple[dict[str, TrackEffect], dict[str, int]]:
        """Effects by id, and vertex counts by model id; readers ask for each chunk of a stream."""
        effects = {effect.id: effect for effect in self.effects}
        return effects, {model.id: model.vertex_count for model in self.models}


def _by_id(name: str, items: tuple[Any, ...]) -> dict[str, Any]:
    """Items by id; raises ValueError with the plural ``name`` for equal ids."""
    items_by_id = {item.id: item for item in items}
    if len(items_by_id) != len(items):
        raise ValueError(f"two {name} have the same id")
    return items_by_id


def _require_range(name: str, value: int, lowest: int, highest: int) -> None:
    """Raise ValueError with ``name`` for a number below ``lowest`` or above ``highest``."""
    if not lowest <= value <= highest:
        raise ValueError(f"{name} is out of range, allowed are {lowest} to {highest}")


def _check_effect(effect: TrackEffect, models: Mapping[str, TrackModel]) -> None:
    """Raise ValueError for an unknown model or modality, for painted vertices, a device or
    actuators on another kind of effect or missing on its own, and for an actuator named twice."""
    if effect.model_id not in models:
        raise ValueError(f"effect '{effect.id}' is felt on model '{effect.model_id}', not there")
    if effect.modality not in MODALITIES:
        raise ValueError(f"effect '{effect.id}' has the unknown modality '{effect.modality}'")
    if (effect.kind == "painted") != (effect.painted_vertices is not None):
        raise ValueError(f"effect '{effect.id}': only painted ones have painted_vertices")
    if effect.painted_vertices is not None:
        count = models[effect.model_id].vertex_count
        _require_range("painted_vertices", effect.painted_vertices, 0, count)
    # Device and actuators come together, and for this kind of effect only.
    is_driven = effect.device_id is not None and 0 < len(effect.actuators) <= MAX_ACTUATORS
    if is_driven != (effect.kind == "actuators") or (effect.actuators and not is_driven):
        raise ValueError(
            f"effect '{effect.id}': those of kind 'actuators', and no others, have a device and "
            f"1 to {MAX_ACTUATORS} actuators"
        )
    if len(set(effect.actuators)) != len(effect.actuators):
        raise ValueError(f"effect '{effect.id}' names an actuator twice")
