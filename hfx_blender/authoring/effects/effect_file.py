# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects in a file of their own (``.hfxeffect``): to keep, to share, to ship as a library.

One JSON file holds one sensation: a list of unitary effects with their areas or volumes, their
parameters in physical units, how they answer a touch, and their clips, timed from 0. It holds no
code and names no path.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ...engine.body.parts import PARTS
from ...engine.modality import MODALITIES
from ...files import suffixes
from ...files.atomic import atomic_file
from ...files.kinds import refuse_another
from ...files.strict_json import Node, parse, read
from ..paths import path_file
from ..paths.path_file import PathRecipe
from .response_recipes import (
    FilterRecipe,
    SwarmRecipe,
    response_document,
    response_of,
    swarm_document,
    swarm_of,
)

SUFFIX: Final = suffixes.EFFECT
SCHEMA: Final = "hfx-effects"
VERSION: Final = 1

_MOST_BYTES: Final = 32 << 20
"""Painted areas are lists of their vertices: one of a whole body has 41 thousand of them."""

Number3 = tuple[float, float, float]

_SHAPES: Final = {
    "SPHERE": ("radius_m",),
    "CUBOID": ("size_m",),
    "CYLINDER": ("radius_m", "height_m"),
    "CAPSULE": ("radius_m", "height_m"),
}
_FALLOFFS: Final = ("none", "linear", "smooth")
_REFERENCES: Final = ("AMBIENT", "CONTACT")
_SIDES: Final = ("both", "left", "right")


@dataclass(frozen=True)
class ClipRecipe:
    """Clip of a recipe; its profile is (seconds, activation) over one repetition.

    Its drawn fades are (seconds, strength) over the whole of it, in place of straight ones.
    """

    name: str
    start_s: float
    duration_s: float
    fade_in_s: float = 0.0
    fade_out_s: float = 0.0
    repeat: float = 1.0
    profile: tuple[tuple[float, float], ...] = ()
    drawn_fades: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class PartsArea:
    """Whole body parts, softened over some vertices: fits every perceptual model."""

    parts: tuple[str, ...]
    side: str = "both"
    smooth: int = 0


@dataclass(frozen=True)
class VertexArea:
    """Area painted on one edition of one perceptual model."""

    model_id: str
    model_hash: str
    vertices: tuple[int, ...]
    weights: tuple[float, ...]


@dataclass(frozen=True)
class VolumeRecipe:
    """Volume at rest, or in motion along places; metres, relative to the recipe's origin."""

    shape: str
    radius_m: float = 0.5
    height_m: float = 2.0
    size_m: Number3 = (1.0, 1.0, 1.0)
    falloff: str = "none"
    falloff_share: float = 1.0
    location_m: Number3 = (0.0, 0.0, 0.0)
    rotation_deg: Number3 = (0.0, 0.0, 0.0)
    path: tuple[tuple[float, Number3], ...] = ()  # (seconds, place)
    response: tuple[FilterRecipe, ...] = ()  # how it answers a touch
    swarm: SwarmRecipe | None = None  # particles of it, in place of itself


@dataclass(frozen=True)
class SpotRecipe:
    """Point on the skin: its disc, its path, and its position along the path over time."""

    path: PathRecipe
    radius_m: float = 0.03
    falloff: str = "none"
    falloff_share: float = 1.0
    position: float = 0.0


@dataclass(frozen=True)
class ActuatorsRecipe:
    """A vector sensation: (seconds, value) for each actuator of a device."""

    device: str
    curves: tuple[tuple[str, tuple[tuple[float, float], ...]], ...]


@dataclass(frozen=True)
class EffectRecipe:
    """Unitary effect of a sensation."""

    name: str
    modality: str
    parameters: dict[str, float]  # by name, in the modality's units; without direction
    where: PartsArea | VertexArea | VolumeRecipe | SpotRecipe | ActuatorsRecipe
    intensity: float = 1.0
    temperature_reference: str = "AMBIENT"
    clips: tuple[ClipRecipe, ...] = ()


@dataclass(frozen=True)
class Sensation:
    """Content of one effect file."""

    name: str
    description: str
    effects: tuple[EffectRecipe, ...]


def load(path: Path) -> Sensation:
    """Read a file, every field checked.

    Raises
    ------
    InputError
        For the first fault: file, place in it, what was found and what is allowed.
    """
    return _sensation(read(path, _MOST_BYTES))


def from_text(text: str) -> Sensation:
    """Read a sensation from the text of a file, as it is copied and pasted."""
    return _sensation(parse(text.encode(), "What was copied", _MOST_BYTES))


def text_of(sensation: Sensation) -> str:
    """Text of a sensation's file."""
    return json.dumps(_document(sensation), indent=1) + "\n"


def _sensation(node: Node) -> Sensation:
    refuse_another(node.value, node.file, SCHEMA)
    top = node.members(required=("schema", "version", "name", "effects"), optional=("description",))
    top["schema"].choice((SCHEMA,))
    top["version"].integer(VERSION, VERSION)
    return Sensation(
        top["name"].text(),
        top["description"].text() if "description" in top else "",
        tuple(_effect(node) for node in top["effects"].items(least=1, most=256)),
    )


def save(sensation: Sensation, path: Path) -> None:
    """Write a file atomically: an existing one is replaced only by a complete one.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with atomic_file(path) as file:
        file.write(text_of(sensation).encode())


def parameter_names(modality: str) -> tuple[str, ...]:
    """Parameters that a file holds; a wind's direction is that of its volume."""
    names = MODALITIES[modality].parameter_names
    return tuple(name for name in names if not name.startswith("direction_"))


def _effect(node: Node) -> EffectRecipe:
    members = node.members(
        required=("name", "modality", "parameters"),
        optional=(*_WHERES, "intensity", "temperature_reference", "clips"),
    )
    modality = members["modality"].choice(tuple(MODALITIES))
    places = [name for name in _WHERES if name in members]
    if len(places) != 1:
        node.fail("an effect with either an 'area' or a 'volume', or a 'spot', or 'actuators'")
    (kind,) = places
    reference = "AMBIENT"
    if "temperature_reference" in members:
        reference = members["temperature_reference"].choice(_REFERENCES)
    clips = members["clips"].items(least=0, most=10_000) if "clips" in members else []
    return EffectRecipe(
        name=members["name"].text(),
        modality=modality,
        parameters=_parameters(modality, members["parameters"]),
        where=_WHERES[kind](members[kind]),
        intensity=members["intensity"].number(0.0, 1.0) if "intensity" in members else 1.0,
        temperature_reference=reference,
        clips=tuple(_clip(each) for each in clips),
    )


def _parameters(modality: str, node: Node) -> dict[str, float]:
    names = parameter_names(modality)
    known = {each.name: each for each in MODALITIES[modality].parameters}
    return {
        name: value.number(known[name].minimum, known[name].maximum, known[name].unit)
        for name, value in node.members(required=names).items()
    }


def _area(node: Node) -> PartsArea | VertexArea:
    if isinstance(node.value, dict) and "parts" in node.value:
        members = node.members(required=("parts",), optional=("side", "smooth"))
        parts = members["parts"].items(least=0, most=len(PARTS))
        return PartsArea(
            tuple(part.choice(PARTS) for part in parts),
            members["side"].choice(_SIDES) if "side" in members else "both",
            members["smooth"].integer(0, 100) if "smooth" in members else 0,
        )
    members = node.members(required=("model", "hash", "vertices", "weights"))
    vertices = members["vertices"].items(least=0, most=1_000_000)
    weights = members["weights"].items(least=len(vertices), most=len(vertices))
    return VertexArea(
        members["model"].text(),
        members["hash"].text(r"[0-9a-f]{64}", "a SHA-256 as 64 hexadecimal digits"),
        tuple(each.integer(0, 2**31 - 1) for each in vertices),
        tuple(each.number(0.0, 1.0) for each in weights),
    )


def _volume(node: Node) -> VolumeRecipe:
    placed = ("location_m", "rotation_deg", "path", "swarm")
    optional = ("falloff", "falloff_share", "response", *placed)
    shape = node.entries(allowed="an object")
    name = shape["shape"].choice(tuple(_SHAPES)) if "shape" in shape else "SPHERE"
    members = node.members(required=("shape", *_SHAPES[name]), optional=optional)
    found: dict[str, Any] = {}
    for key in ("radius_m", "height_m"):
        if key in members:
            found[key] = members[key].number(0.0, 1000.0, "m")
    for key, most, unit in (
        ("size_m", 1000.0, "m"),
        ("location_m", 1000.0, "m"),
        ("rotation_deg", 360.0, "degrees"),
    ):
        if key in members:
            found[key] = members[key].triple(-most, most, unit)
    if "falloff" in members:
        found["falloff"] = members["falloff"].choice(_FALLOFFS)
    if "falloff_share" in members:
        found["falloff_share"] = members["falloff_share"].number(0.0, 1.0)
    if "path" in members:
        places = [
            each.members(required=("time_s", "location_m"))
            for each in members["path"].items(least=1, most=100_000)
        ]
        found["path"] = tuple(
            (
                place["time_s"].number(0.0, 86_400.0, "s"),
                place["location_m"].triple(-1000.0, 1000.0, "m"),
            )
            for place in places
        )
    if "response" in members:
        found["response"] = response_of(members["response"])
    if "swarm" in members:
        found["swarm"] = swarm_of(members["swarm"])
    return VolumeRecipe(name, **found)


def _spot(node: Node) -> SpotRecipe:
    members = node.members(
        required=("points_m", "path", "radius_m"),
        optional=("closed", "motion", "falloff", "falloff_share", "position"),
    )
    points = members["points_m"].items(least=1, most=path_file.MAX_POINTS)
    share = members["falloff_share"].number(0.0, 1.0) if "falloff_share" in members else 1.0
    return SpotRecipe(
        PathRecipe(
            name="",
            points_m=tuple(path_file.place_of(each) for each in points),
            kind=members["path"].choice(path_file.KINDS),
            is_closed="closed" in members and members["closed"].integer(0, 1) == 1,
            motion=members["motion"].curve() if "motion" in members else (),
        ),
        radius_m=members["radius_m"].number(0.0, 10.0, "m"),
        falloff=members["falloff"].choice(_FALLOFFS) if "falloff" in members else "none",
        falloff_share=share,
        position=members["position"].number(0.0, 1.0) if "position" in members else 0.0,
    )


def _actuators(node: Node) -> ActuatorsRecipe:
    members = node.members(required=("device", "curves"))
    curves = []
    for each in members["curves"].items(least=1, most=4096):
        curve = each.members(required=("actuator", "keys"))
        curves.append((curve["actuator"].text(), curve["keys"].curve()))
    return ActuatorsRecipe(members["device"].text(), tuple(curves))


_WHERES: Final[dict[str, Callable[[Node], Any]]] = {
    "area": _area,
    "volume": _volume,
    "spot": _spot,
    "actuators": _actuators,
}


def where_of(effect: EffectRecipe) -> str:
    """Key of the member of a file that says where an effect is: ``area``, ``volume``, ..."""
    if isinstance(effect.where, PartsArea | VertexArea):
        return "area"
    kinds = {VolumeRecipe: "volume", SpotRecipe: "spot", ActuatorsRecipe: "actuators"}
    return kinds[type(effect.where)]


def _clip(node: Node) -> ClipRecipe:
    times = ("fade_in_s", "fade_out_s")
    members = node.members(
        required=("start_s", "duration_s"),
        optional=("name", *times, "repeat", "profile", "drawn_fades"),
    )
    duration = members["duration_s"].number(0.001, 86_400.0, "s")
    fades = {key: members[key].number(0.0, duration, "s") for key in times if key in members}
    return ClipRecipe(
        name=members["name"].text() if "name" in members else "Clip",
        start_s=members["start_s"].number(0.0, 86_400.0, "s"),
        duration_s=duration,
        repeat=members["repeat"].number(0.1, 1000.0) if "repeat" in members else 1.0,
        profile=members["profile"].curve(least=2) if "profile" in members else (),
        drawn_fades=members["drawn_fades"].curve(least=2) if "drawn_fades" in members else (),
        **fades,
    )


def _document(sensation: Sensation) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "name": sensation.name,
        **({"description": sensation.description} if sensation.description else {}),
        "effects": [_effect_document(effect) for effect in sensation.effects],
    }


def _effect_document(effect: EffectRecipe) -> dict[str, Any]:
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
        document["area"] = {
            "parts": list(where.parts),
            "side": where.side,
            "smooth": where.smooth,
        }
    elif isinstance(where, SpotRecipe):
        document["spot"] = {
            "points_m": [list(point) for point in where.path.points_m],
            "path": where.path.kind,
            "closed": int(where.path.is_closed),
            "radius_m": where.radius_m,
            "falloff": where.falloff,
            "falloff_share": where.falloff_share,
            "position": where.position,
            **({"motion": [list(key) for key in where.path.motion]} if where.path.motion else {}),
        }
    elif isinstance(where, ActuatorsRecipe):
        document["actuators"] = {
            "device": where.device,
            "curves": [
                {"actuator": actuator, "keys": [list(key) for key in keys]}
                for actuator, keys in where.curves
            ],
        }
    elif isinstance(where, VertexArea):
        document["area"] = {
            "model": where.model_id,
            "hash": where.model_hash,
            "vertices": list(where.vertices),
            "weights": list(where.weights),
        }
    else:
        document["volume"] = {
            "shape": where.shape,
            **{key: getattr(where, key) for key in _SHAPES[where.shape]},
            "falloff": where.falloff,
            "falloff_share": where.falloff_share,
            "location_m": list(where.location_m),
            "rotation_deg": list(where.rotation_deg),
        }
        if where.response:
            document["volume"]["response"] = response_document(where.response)
        if where.swarm is not None:
            document["volume"]["swarm"] = swarm_document(where.swarm)
        if where.path:
            document["volume"]["path"] = [
                {"time_s": time, "location_m": list(place)} for time, place in where.path
            ]
    document["clips"] = [
        {
            "name": clip.name,
            "start_s": clip.start_s,
            "duration_s": clip.duration_s,
            "fade_in_s": clip.fade_in_s,
            "fade_out_s": clip.fade_out_s,
            "repeat": clip.repeat,
            **{
                key: [list(point) for point in getattr(clip, key)]
                for key in ("profile", "drawn_fades")
                if getattr(clip, key)
            },
        }
        for clip in effect.clips
    ]
    return document
