# SPDX-License-Identifier: GPL-3.0-or-later
"""Layout of a HapticTrack in the ZIP container: names, limits, and header and index as JSON."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any, Final

from ...errors import InputError
from ...files import json_shapes as shapes
from ...files.strict_json import parse
from ..modality import AMBIENT_NEUTRAL_C, CONTACT_NEUTRAL_C, MODALITIES
from ..samples import Stream
from ..scene import Clip, EffectKind, TimeBase
from .codec import CHANNELS
from .header import TrackBody, TrackEffect, TrackHeader, TrackModel

HEADER: Final = "header.json"
INDEX: Final = "index.json"

SAMPLES_PER_CHUNK: Final = 128
"""Chunk size of the writer: chunk ``c`` holds samples ``128 c`` to ``128 c + 127``."""

MAX_SAMPLES_PER_CHUNK: Final = 4096
MAX_JSON_BYTES: Final = 2**24
MAX_CHUNK_BYTES: Final = 2**28

WEIGHTS_BYTE: Final = "uint8"
WEIGHTS_FULL: Final = "float32"


def chunk_name(chunk: int) -> str:
    """Name of a chunk's entry in the container: number with at least six digits."""
    return f"chunks/{chunk:06d}.bin"


@dataclass
class StreamIndex:
    """Index entry of a stream; sample numbers are those of the time base."""

    samples: int = 0
    first: int = -1  # sample index; -1 without samples
    last: int = -1
    entries: int = 0  # (sample, vertex) pairs
    peak_level: float = 0.0
    channels: tuple[str, ...] = ()

    def add(self, later: "StreamIndex") -> None:
        """Merge the entry of later samples of the same stream, in place; an entry without samples
        changes nothing."""
        if not later.samples:
            return
        if self.first < 0:
            self.first = later.first
        self.last = later.last
        self.samples += later.samples
        self.entries += later.entries
        self.peak_level = max(self.peak_level, later.peak_level)
        # In the order of CHANNELS, so that the bytes do not depend on the order of recording.
        both = {*self.channels, *later.channels}
        self.channels = tuple(name for name in CHANNELS if name in both)


INDEX_SHAPE: Final = shapes.loose(
    {
        "chunks": shapes.Items(shapes.Number(is_whole=True), order="ascending"),
        "streams": shapes.Items(
            shapes.loose(
                {
                    **dict.fromkeys(("first", "last"), shapes.Number(is_whole=True)),
                    **dict.fromkeys(("samples", "entries"), shapes.Number(0, is_whole=True)),
                    "peak_level": shapes.Number(0.0, 1.0),
                    "channels": shapes.Items(shapes.Text(tuple(CHANNELS))),
                },
                into=StreamIndex,
            )
        ),
    }
)

STORAGE: Final = shapes.loose(
    {
        "samples_per_chunk": shapes.Number(1, MAX_SAMPLES_PER_CHUNK, is_whole=True),
        "weights": shapes.Text((WEIGHTS_BYTE, WEIGHTS_FULL)),
    }
)


def encode_index(chunks: list[int], streams: list[StreamIndex]) -> bytes:
    """Chunk numbers and the streams' entries as UTF-8 JSON with a final newline."""
    content = {"chunks": chunks, "streams": [vars(stream) for stream in streams]}
    return json.dumps(content, sort_keys=True, allow_nan=False).encode() + b"\n"


FORMAT: Final = "hfxtrack"
VERSION: Final = 2  # newest version; tracks without spots and actuators are written as version 1
_KINDS: Final[dict[int, tuple[EffectKind, ...]]] = {
    1: ("painted", "volume"),
    2: ("painted", "volume", "spot", "actuators"),
}

_NOTES = {
    "effect": "What an effect does at a vertex is weight * level * strength parameter.",
    **{name: modality.combining for name, modality in MODALITIES.items()},
}


def to_json(header: TrackHeader, encoding: Mapping[str, Any]) -> bytes:
    """Header as indented, sorted UTF-8 JSON with ``encoding``; equal headers give equal bytes.
    Version 1 unless a spot or actuators exist. Raises ValueError for a value that is no JSON value
    (an object, NaN)."""
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
        # Facts of this program for readers of other programs; this program compares them.
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


_TEXT: Final = shapes.Text()
_WHOLE: Final = shapes.Number(is_whole=True)
_FRACTION: Final = shapes.Row((shapes.Number(1, is_whole=True),) * 2)
_ANY: Final = shapes.Table(shapes.Anything())

_CLIP: Final = shapes.loose(
    {"name": _TEXT, "frame_start": shapes.Number(), "frame_end": shapes.Number()}, into=Clip
)
_EFFECT: Final[Mapping[str, shapes.Shape]] = {
    **dict.fromkeys(("id", "name", "modality", "model_id"), _TEXT),
    "is_contact": shapes.Flag(),
    "clips": shapes.Items(_CLIP),
}
_MEMBERS: Final[Mapping[EffectKind, Mapping[str, shapes.Shape]]] = {
    "painted": {"painted_vertices": _WHOLE},
    "actuators": {"device_id": _TEXT, "actuators": shapes.Items(_TEXT)},
}
"""Additional JSON members of a kind of effect."""


def _header(version: int) -> shapes.Record:
    """Shape of a header's JSON object in version 1 or 2; further members are ignored."""
    # Version 1 has no spots and actuators: such an entry is a fault there.
    kinds: dict[str, shapes.Record] = {
        kind: shapes.loose({**_EFFECT, **_MEMBERS.get(kind, {})}, into=TrackEffect)
        for kind in _KINDS[version]
    }
    whole = dict.fromkeys(("scene_start", "frame_first", "frame_last", "sample_count"), _WHOLE)
    model = dict.fromkeys(("id", "modality", "content_hash"), _TEXT) | {"vertex_count": _WHOLE}
    return shapes.loose(
        {
            "effects": shapes.Items(shapes.tagged("kind", kinds)),
            "modalities": _ANY,
            "time": shapes.loose({**dict.fromkeys(("fps", "rate_hz"), _FRACTION), **whole}),
            "models": shapes.Items(shapes.loose(model, into=TrackModel)),
            "bodies": shapes.Items(shapes.loose({"id": _TEXT, "name": _TEXT}, into=TrackBody)),
            "streams": shapes.Items(shapes.loose({"effect_id": _TEXT, "body_id": _TEXT})),
            **dict.fromkeys(("source", "settings", "tools", "encoding"), _ANY),
            "warnings": shapes.Items(_TEXT),
        }
    )


_BEGIN: Final = shapes.loose({"format": shapes.Text((FORMAT,)), "version": _WHOLE})


def from_json(text: bytes) -> tuple[TrackHeader, dict[str, Any]]:
    """Parse the header and the ``encoding``, as written by :func:`to_json`; raises ValueError with
    the place of the first fault. Modalities and the sample count are compared with this
    program's."""
    document = parse_json(text, "header")
    version = value_in(document, _BEGIN, "header")["version"]
    if version not in _KINDS:
        raise ValueError(f"it has version {version}, this program reads up to version {VERSION}")
    content = value_in(document, _header(version), "header")
    effects: tuple[TrackEffect, ...] = content["effects"]
    # A track stores the parameters' columns without names, so both programs must agree on them.
    for name in {effect.modality for effect in effects}:
        if name not in MODALITIES or content["modalities"].get(name) != _modality_to_json(name):
            raise ValueError(f"modality '{name:.40}' is not known with these parameters")
    effect_by_id = {effect.id: effect for effect in effects}
    streams = []
    for members in content["streams"]:
        effect_id, body_id = members["effect_id"], members["body_id"]
        if effect_id not in effect_by_id:
            raise ValueError(f"a stream names effect '{effect_id:.40}', which is not there")
        effect = effect_by_id[effect_id]
        streams.append(Stream(effect_id, body_id, effect.modality, effect.model_id))
    time: dict[str, Any] = content["time"]
    # Redundant in the file, for readers without exact fractions.
    count = time.pop("sample_count")
    fps, rate_hz = Fraction(*time.pop("fps")), Fraction(*time.pop("rate_hz"))
    header = TrackHeader(
        time=TimeBase(fps, rate_hz, **time),
        effects=effects,
        streams=tuple(streams),
        **{
            key: content[key]
            for key in ("models", "bodies", "source", "settings", "tools", "warnings")
        },
    )
    if count != header.time.sample_count:
        raise ValueError(f"'sample_count' is not {header.time.sample_count}")
    return header, content["encoding"]


def parse_json(text: bytes, name: str) -> Any:
    """Parse strict JSON; raises ValueError with a message beginning with ``name``, without a full
    stop."""
    try:
        return parse(text, name, has_file_names=True)
    except InputError as error:
        raise ValueError(str(error).rstrip(".")) from None


def value_in(document: Any, shape: shapes.Shape, name: str) -> Any:
    """Check a parsed document against ``shape`` and convert it; raises ValueError for the first
    fault, with the place below ``name``."""
    try:
        return shapes.Node(document, name).read(shape)
    except InputError as error:
        raise ValueError(str(error).rstrip(".")) from None


def _modality_to_json(name: str) -> dict[str, Any]:
    """Parameter names and units and the strength of a modality, as stored for checks by readers."""
    modality = MODALITIES[name]
    return {
        "parameters": [{"name": p.name, "unit": p.unit} for p in modality.parameters],
        "strength": modality.strength,
    }


def _effect_to_json(effect: TrackEffect) -> dict[str, Any]:
    """JSON object of an effect; device and actuators for that kind only."""
    clips = [
        {
            "name": clip.name,
            "frame_start": float(clip.frame_start),
            "frame_end": float(clip.frame_end),
        }
        for clip in effect.clips
    ]
    content = {**vars(effect), "clips": clips}
    if effect.kind != "actuators":
        del content["device_id"], content["actuators"]
    return content
