# SPDX-License-Identifier: GPL-3.0-or-later
"""The header of a HapticTrack as JSON and back."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from fractions import Fraction
from typing import Any, Final, TypeVar

from ..modality import AMBIENT_NEUTRAL_C, CONTACT_NEUTRAL_C, MODALITIES
from ..samples import Stream
from ..scene import Clip, EffectKind, TimeBase
from .header import TrackBody, TrackEffect, TrackHeader, TrackModel

FORMAT: Final = "hfxtrack"
VERSION: Final = 2
"""The newest. What holds no spot and no vector sensation is written as version 1, as before."""

_KINDS: Final[dict[int, tuple[EffectKind, ...]]] = {
    1: ("painted", "volume"),
    2: ("painted", "volume", "spot", "actuators"),
}

_NOTES = {
    "effect": "What an effect does at a vertex is weight * level * strength parameter.",
    **{name: modality.combining for name, modality in MODALITIES.items()},
}


def to_json(header: TrackHeader, encoding: Mapping[str, Any]) -> bytes:
    """The header as UTF-8 JSON, the same bytes for the same content.

    Raises
    ------
    ValueError
        A value is not JSON (an object, NaN).
    """
    used = dict.fromkeys(effect.modality for effect in header.effects)
    version = 1 if all(effect.kind in _KINDS[1] for effect in header.effects) else 2
    content = {
        "format": FORMAT,
        "version": version,
        "encoding": encoding,
        "time": {
            "fps": list(header.time.fps.as_integer_ratio()),
            "rate_hz": list(header.time.rate_hz.as_integer_ratio()),
            "scene_start": header.time.scene_start,
            "frame_first": header.time.frame_first,
            "frame_last": header.time.frame_last,
            "sample_count": header.time.sample_count,
        },
        "models": [asdict(model) for model in header.models],
        "bodies": [asdict(body) for body in header.bodies],
        "effects": [_effect_to_json(effect) for effect in header.effects],
        "streams": [
            {"effect_id": stream.effect_id, "body_id": stream.body_id} for stream in header.streams
        ],
        "modalities": {name: _modality_to_json(name) for name in used},
        "neutral_c": {"ambient": AMBIENT_NEUTRAL_C, "contact": CONTACT_NEUTRAL_C},
        "notes": _NOTES,
        "source": dict(header.source),
        "settings": dict(header.settings),
        "tools": dict(header.tools),
        "warnings": list(header.warnings),
    }
    try:
        return json.dumps(content, indent=1, sort_keys=True, allow_nan=False).encode() + b"\n"
    except TypeError as error:
        raise ValueError(f"the header of a track holds JSON values only: {error}") from error


def from_json(text: bytes) -> tuple[TrackHeader, dict[str, Any]]:
    """Parse the header and its ``encoding`` from :func:`to_json` text.

    Raises
    ------
    ValueError
        It is not such JSON; the message says where.
    """
    content = parse_json(text)
    if get(content, "format", str) != FORMAT:
        raise ValueError(f"'format' is '{content['format']:.40}', expected '{FORMAT}'")
    version = get(content, "version", int)
    if version not in _KINDS:
        raise ValueError(f"it has version {version}, this program reads up to version {VERSION}")
    effects = tuple(
        _effect_from_json(item, _KINDS[version]) for item in get(content, "effects", list)
    )
    modalities = get(content, "modalities", dict)
    for name in {effect.modality for effect in effects}:
        if name not in MODALITIES or modalities.get(name) != _modality_to_json(name):
            raise ValueError(f"modality '{name:.40}' is not known with these parameters")
    effect_by_id = {effect.id: effect for effect in effects}
    time = get(content, "time", dict)
    header = TrackHeader(
        time=TimeBase(
            fps=_fraction(time, "fps"),
            rate_hz=_fraction(time, "rate_hz"),
            scene_start=get(time, "scene_start", int),
            frame_first=get(time, "frame_first", int),
            frame_last=get(time, "frame_last", int),
        ),
        models=tuple(
            TrackModel(
                id=get(item, "id", str),
                modality=get(item, "modality", str),
                content_hash=get(item, "content_hash", str),
                vertex_count=get(item, "vertex_count", int),
            )
            for item in get(content, "models", list)
        ),
        bodies=tuple(
            TrackBody(get(item, "id", str), get(item, "name", str))
            for item in get(content, "bodies", list)
        ),
        effects=effects,
        streams=tuple(
            _stream_from_json(item, effect_by_id) for item in get(content, "streams", list)
        ),
        source=get(content, "source", dict),
        settings=get(content, "settings", dict),
        tools=get(content, "tools", dict),
        warnings=tuple(texts(get(content, "warnings", list), "warnings")),
    )
    if get(time, "sample_count", int) != header.time.sample_count:
        raise ValueError(f"'sample_count' is not {header.time.sample_count}")
    return header, get(content, "encoding", dict)


_Kind = TypeVar("_Kind")


def get(item: Any, key: str, kind: type[_Kind]) -> _Kind:
    """Get a member of a JSON object that must have exactly this type."""
    if not isinstance(item, dict) or key not in item:
        raise ValueError(f"'{key}' is missing")
    value = item[key]
    if type(value) is not kind:
        raise ValueError(f"'{key}' is a {type(value).__name__}, expected a {kind.__name__}")
    return value


def parse_json(text: bytes) -> Any:
    """Parse JSON without non-standard constants, and not too deep.

    Raises
    ------
    ValueError
    """
    try:
        return json.loads(text, parse_constant=_finite, parse_float=_finite)
    except RecursionError:
        raise ValueError("JSON that is nested too deeply") from None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text} is not finite")
    return value


def _modality_to_json(name: str) -> dict[str, Any]:
    modality = MODALITIES[name]
    return {
        "parameters": [{"name": each.name, "unit": each.unit} for each in modality.parameters],
        "strength": modality.strength,
    }


def _effect_to_json(effect: TrackEffect) -> dict[str, Any]:
    clips = [
        {
            "name": clip.name,
            "frame_start": float(clip.frame_start),
            "frame_end": float(clip.frame_end),
        }
        for clip in effect.clips
    ]
    content = {**asdict(effect), "clips": clips}
    if effect.kind != "actuators":
        del content["device_id"], content["actuators"]
    return content


def _effect_from_json(item: Any, kinds: tuple[EffectKind, ...]) -> TrackEffect:
    found = get(item, "kind", str)
    kind = next((each for each in kinds if each == found), None)
    if kind is None:
        raise ValueError(f"'kind' is '{found:.40}', expected one of {', '.join(kinds)}")
    is_driven = kind == "actuators"
    return TrackEffect(
        id=get(item, "id", str),
        name=get(item, "name", str),
        modality=get(item, "modality", str),
        kind=kind,
        model_id=get(item, "model_id", str),
        is_contact=get(item, "is_contact", bool),
        clips=tuple(
            Clip(
                get(clip, "name", str),
                get(clip, "frame_start", float),
                get(clip, "frame_end", float),
            )
            for clip in get(item, "clips", list)
        ),
        painted_vertices=get(item, "painted_vertices", int) if kind == "painted" else None,
        device_id=get(item, "device_id", str) if is_driven else None,
        actuators=tuple(texts(get(item, "actuators", list), "actuators")) if is_driven else (),
    )


def _stream_from_json(item: Any, effects: Mapping[str, TrackEffect]) -> Stream:
    effect_id = get(item, "effect_id", str)
    if effect_id not in effects:
        raise ValueError(f"a stream names effect '{effect_id:.40}', which is not there")
    effect = effects[effect_id]
    return Stream(effect_id, get(item, "body_id", str), effect.modality, effect.model_id)


def _fraction(item: Any, key: str) -> Fraction:
    pair = get(item, key, list)
    if len(pair) != 2 or any(type(part) is not int or part <= 0 for part in pair):
        raise ValueError(f"'{key}' is not two positive whole numbers")
    return Fraction(*pair)


def texts(items: list[Any], name: str) -> Iterable[str]:
    """Yield the items of a list that may hold text only."""
    for item in items:
        if not isinstance(item, str):
            raise ValueError(f"'{name}' holds something that is not text")
        yield item
