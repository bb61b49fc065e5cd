# SPDX-License-Identifier: GPL-3.0-or-later
"""Effect files (``.hfxeffect``), for storing and sharing sensations.

A JSON file contains a sensation: a list of effects with areas or volumes, parameters in
physical units, contact responses, and clips timed from 0. There is no code and no path in a file.
"""

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

from ...engine.body.parts import PARTS
from ...engine.modality import MODALITIES, Modality
from ...engine.response_filters.controls import ContactLaw
from ...files import kinds
from ...files.atomic import atomic_file
from ...files.json_shapes import (
    PRINTABLE,
    SHA256,
    Either,
    Items,
    Node,
    Number,
    Record,
    Text,
    curve,
    node_of,
    numbers,
    read,
    strict,
    tagged,
)
from ...files.kinds import refuse_another
from ..paths import path_file
from ..paths.path_file import PathRecipe
from . import response_recipes

SUFFIX: Final = kinds.EFFECT_SUFFIX
SCHEMA: Final = "hfx-effects"
VERSION: Final = 1

_MOST_BYTES: Final = 32 << 20
"""Largest file; the painted area of a whole body lists 41,000 vertices."""

Number3 = tuple[float, float, float]

_SHAPES: Final = {
    "SPHERE": ("radius_m",),
    "CUBOID": ("size_m",),
    "CYLINDER": ("radius_m", "height_m"),
    "CAPSULE": ("radius_m", "height_m"),
}
_VOLUME_MEMBERS: Final = ("falloff", "falloff_share", "location_m", "rotation_deg")


@dataclass(frozen=True)
class ClipRecipe:
    """Clip of an effect, times in seconds. ``profile`` is (seconds, activation) over one
    repetition, ``drawn_fades`` is (seconds, strength) over the whole clip in place of linear fades;
    both may be empty."""

    start_s: float
    duration_s: float
    name: str = "Clip"
    fade_in_s: float = 0.0
    fade_out_s: float = 0.0
    repeat: float = 1.0
    profile: tuple[tuple[float, float], ...] = ()
    drawn_fades: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class PartsArea:
    """Painted area of whole body parts, valid for all perceptual models. The edge is softened over
    ``smooth`` steps from vertex to vertex."""

    parts: tuple[str, ...]
    side: str = "both"
    smooth: int = 0


@dataclass(frozen=True)
class VertexArea:
    """Painted area of vertices of an edition of a perceptual model."""

    model_id: str
    model_hash: str
    vertices: tuple[int, ...]
    weights: tuple[float, ...]


@dataclass(frozen=True)
class VolumeRecipe:
    """Volume, still or moving along a path; metres, relative to the sensation's origin."""

    shape: str
    radius_m: float = 0.5
    height_m: float = 2.0
    size_m: Number3 = (1.0, 1.0, 1.0)
    falloff: str = "none"
    falloff_share: float = 1.0
    law: ContactLaw | None = None  # None: no force
    location_m: Number3 = (0.0, 0.0, 0.0)
    rotation_deg: Number3 = (0.0, 0.0, 0.0)
    path: tuple[tuple[float, Number3], ...] = ()  # (seconds, position)
    response: tuple[response_recipes.FilterRecipe, ...] = ()  # contact response
    swarm: response_recipes.SwarmRecipe | None = (
        None  # emitted as particles; None for a single volume
    )


@dataclass(frozen=True)
class SpotRecipe:
    """Point on the skin: a disc with a path, and the position along the path, 0 to 1."""

    path: PathRecipe
    radius_m: float = 0.03
    falloff: str = "none"
    falloff_share: float = 1.0
    position: float = 0.0


@dataclass(frozen=True)
class ActuatorsRecipe:
    """Vector sensation: keyframes (seconds, value) for each actuator of a device."""

    device: str
    curves: tuple[tuple[str, tuple[tuple[float, float], ...]], ...]


@dataclass(frozen=True)
class EffectRecipe:
    """Effect of a sensation."""

    name: str
    modality: str
    parameters: dict[str, float]  # by name, in the modality's units, without direction
    where: PartsArea | VertexArea | VolumeRecipe | SpotRecipe | ActuatorsRecipe
    intensity: float = 1.0
    temperature_reference: str = "AMBIENT"
    clips: tuple[ClipRecipe, ...] = ()


@dataclass(frozen=True)
class Sensation:
    """Content of an effect file."""

    name: str
    description: str
    effects: tuple[EffectRecipe, ...]


def _spot(
    points_m: tuple[Number3, ...], path: str, *, closed: int = 0, motion: Any = (), **more: Any
) -> SpotRecipe:
    return SpotRecipe(PathRecipe("", points_m, path, closed == 1, motion=motion), **more)


def _effect(**members: Any) -> EffectRecipe:
    # The JSON shape allows exactly one of these members.
    (where,) = (members.pop(key) for key in _WHERES if key in members)
    return EffectRecipe(where=where, **members)


def _sensation(
    schema: str, version: int, name: str, effects: tuple[EffectRecipe, ...], description: str = ""
) -> Sensation:
    return Sensation(name, description, effects)


_SHARE: Final = Number(0.0, 1.0)
_FALLOFF: Final = {"falloff": Text(("none", "linear", "smooth")), "falloff_share": _SHARE}
_DIMENSIONS: Final = {
    "radius_m": Number(0.0, 1000.0, "m"),
    "height_m": Number(0.0, 1000.0, "m"),
    "size_m": numbers(3, -1000.0, 1000.0, "m"),
}
_LOCATION: Final = numbers(3, -1000.0, 1000.0, "m")
_LAW: Final = strict(
    {field.name: Number(0.0, 1e6) for field in fields(ContactLaw)}, into=ContactLaw
)
# A member of another shape, such as the height of a sphere, is refused: it would have no effect.
_VOLUME: Final = tagged(
    "shape",
    {
        shape: strict(
            {name: _DIMENSIONS[name] for name in dimensions},
            {
                **_FALLOFF,
                "response": response_recipes.RESPONSE,
                "location_m": _LOCATION,
                "rotation_deg": numbers(3, -360.0, 360.0, "degrees"),
                "path": Items(
                    strict(
                        {"time_s": Number(0.0, 86_400.0, "s"), "location_m": _LOCATION},
                        into=lambda time_s, location_m: (time_s, location_m),
                    ),
                    1,
                    100_000,
                ),
                "swarm": response_recipes.SWARM,
                "law": _LAW,
            },
            into=VolumeRecipe,
        )
        for shape, dimensions in _SHAPES.items()
    },
)
# Parts are valid for every model; vertex numbers only for the edition with this hash.
_AREA: Final = Either(
    "parts",
    strict(
        {"parts": Items(Text(PARTS), 0, len(PARTS))},
        {"side": Text(("both", "left", "right")), "smooth": Number(0, 100, is_whole=True)},
        into=PartsArea,
    ),
    strict(
        {
            "model": PRINTABLE,
            "hash": SHA256,
            "vertices": Items(Number(0, 2**31 - 1, is_whole=True), 0, 1_000_000),
            "weights": Items(_SHARE, 0, 1_000_000),
        },
        into=lambda model, hash, **values: VertexArea(model, hash, **values),
    ),
)
_SPOT: Final = strict(
    {
        "points_m": path_file.POINTS,
        "path": Text(path_file.KINDS),
        "radius_m": Number(0.0, 10.0, "m"),
    },
    {"closed": path_file.CLOSED, "motion": curve(), **_FALLOFF, "position": _SHARE},
    into=_spot,
)
_ACTUATORS: Final = strict(
    {
        "device": PRINTABLE,
        "curves": Items(
            strict(
                {"actuator": PRINTABLE, "keys": curve()},
                into=lambda actuator, keys: (actuator, keys),
            ),
            1,
            4096,
        ),
    },
    into=ActuatorsRecipe,
)
_WHERES: Final = {"area": _AREA, "volume": _VOLUME, "spot": _SPOT, "actuators": _ACTUATORS}
_CLIP: Final = strict(
    {"start_s": Number(0.0, 86_400.0, "s"), "duration_s": Number(0.001, 86_400.0, "s")},
    {
        "name": PRINTABLE,
        **dict.fromkeys(("fade_in_s", "fade_out_s"), Number(0.0, 86_400.0, "s")),
        "repeat": Number(0.1, 1000.0),
        **dict.fromkeys(("profile", "drawn_fades"), curve(least=2)),
    },
    into=ClipRecipe,
)


def _effect_shape(modality: Modality) -> Record:
    parameters = {p.name: Number(p.minimum, p.maximum, p.unit) for p in modality.controls}
    return strict(
        {"name": PRINTABLE, "parameters": strict(parameters)},
        {
            **_WHERES,
            "intensity": _SHARE,
            "temperature_reference": Text(("AMBIENT", "CONTACT")),
            "clips": Items(_CLIP, 0, 10_000),
        },
        one_of=tuple(_WHERES),
        into=_effect,
    )


_FILE: Final = strict(
    {
        "schema": Text((SCHEMA,)),
        "version": Number(VERSION, VERSION, is_whole=True),
        "name": PRINTABLE,
        "effects": Items(
            tagged("modality", {name: _effect_shape(m) for name, m in MODALITIES.items()}), 1, 256
        ),
    },
    {"description": PRINTABLE},
    into=_sensation,
)


def load(path: Path) -> Sensation:
    """Read an effect file and check every field. Raises InputError for the first fault, with file,
    field, found and allowed value."""
    return _read(read(path, _MOST_BYTES))


def from_text(text: str) -> Sensation:
    """Read a sensation from JSON text of the clipboard; InputError for the first fault."""
    return _read(node_of(text.encode(), "What was copied", _MOST_BYTES))


def text_of(sensation: Sensation) -> str:
    """JSON text of a sensation in the format of effect files, indented, with a final newline.
    Raises InputError for a text that :func:`load` would refuse: too many effects, clips or
    bytes."""
    document = {
        "schema": SCHEMA,
        "version": VERSION,
        "name": sensation.name,
        **({"description": sensation.description} if sensation.description else {}),
        "effects": [_effect_document(effect) for effect in sensation.effects],
    }
    text = json.dumps(document, indent=1) + "\n"
    _read(node_of(text.encode(), f"Effects '{sensation.name}'", _MOST_BYTES))
    return text


def _read(node: Node) -> Sensation:
    refuse_another(node.value, node.file, SCHEMA)
    sensation: Sensation = node.read(_FILE)
    for effect in node["effects"].items():
        _check_consistency(effect)
    return sensation


def _check_consistency(effect: Node) -> None:
    """Raise InputError if an area has unequal numbers of vertices and weights, a swarm's last birth
    precedes its first, or a fade exceeds the clip's duration; returns nothing."""
    # JSON shapes check members one by one; these rules compare two members.
    if "area" in effect and "vertices" in effect["area"]:
        count = len(effect["area"]["vertices"].value)
        if len(effect["area"]["weights"].value) != count:
            effect["area"]["weights"].fail(f"{count} items")
    if "volume" in effect and "swarm" in effect["volume"]:
        response_recipes.refuse_reversed_births(effect["volume"]["swarm"])
    for clip in effect["clips"].items() if "clips" in effect else ():
        for key in ("fade_in_s", "fade_out_s"):
            if key in clip:
                clip[key].hold(Number(0.0, clip.number("duration_s"), "s"))


def save(sensation: Sensation, path: Path) -> None:
    """Write an effect file; an existing file is replaced only after a complete write. Raises
    InputError as :func:`text_of`, OutputError: the file cannot be written."""
    with atomic_file(path) as file:
        file.write(text_of(sensation).encode())


def _effect_document(effect: EffectRecipe) -> dict[str, Any]:
    """JSON object of an effect. Members of a volume that its shape does not have, contact laws
    without stiffness, and empty responses, swarms, paths and curves of clips, are left out."""
    where = effect.where
    document: dict[str, Any] = {
        "name": effect.name,
        "modality": effect.modality,
        "parameters": effect.parameters,
        "intensity": effect.intensity,
    }
    if effect.modality == "temperature":
        document["temperature_reference"] = effect.temperature_reference
    if isinstance(where, PartsArea):
        document["area"] = asdict(where)
    elif isinstance(where, SpotRecipe):
        document["spot"] = {
            "points_m": where.path.points_m,
            "path": where.path.kind,
            "closed": int(where.path.is_closed),
            **{key: value for key, value in vars(where).items() if key != "path"},
            **({"motion": where.path.motion} if where.path.motion else {}),
        }
    elif isinstance(where, ActuatorsRecipe):
        document["actuators"] = {
            "device": where.device,
            "curves": [{"actuator": actuator, "keys": keys} for actuator, keys in where.curves],
        }
    elif isinstance(where, VertexArea):
        document["area"] = {
            "model": where.model_id,
            "hash": where.model_hash,
            "vertices": where.vertices,
            "weights": where.weights,
        }
    else:
        document["volume"] = {
            "shape": where.shape,
            **{key: getattr(where, key) for key in (*_SHAPES[where.shape], *_VOLUME_MEMBERS)},
        }
        if where.law is not None:
            document["volume"]["law"] = asdict(where.law)
        if where.response:
            document["volume"]["response"] = response_recipes.response_document(where.response)
        if where.swarm is not None:
            document["volume"]["swarm"] = asdict(where.swarm)
        if where.path:
            document["volume"]["path"] = [
                {"time_s": time, "location_m": place} for time, place in where.path
            ]
    # Empty profiles and drawn fades mean an even activation and linear fades, and are left out.
    document["clips"] = [
        {"name": clip.name, **{key: value for key, value in vars(clip).items() if value != ()}}
        for clip in effect.clips
    ]
    return document
