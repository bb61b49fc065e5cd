# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF of a recorded track: painted effects exactly, contacts by body part.

A perception per body, model and modality. A painted effect becomes a channel for each class
of its weights, with the effect's own envelope. A volume becomes a channel for each touched body
part, with the strongest contact at each sample and all touched vertices of the part.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import numpy as np

from ...engine.arrays import F32, F64, I64, U32
from ...engine.body.model import PerceptualModel, load_model
from ...engine.modality import neutral_temperature_c
from ...engine.rendering.device_config import DeviceConfig
from ...engine.samples import SampleRun, Stream
from ...engine.track import TrackHeader, TrackReader
from ...errors import InputError, NothingFeltError
from ...files.strict_json import clean
from ...text import counted
from ..glb import glb
from ..signals.signals import DEFAULT_TOLERANCE, MAX_HZ
from ..written import Written, write_json
from .body_parts import described, vertex_masks
from .envelopes import PITCH_HZ, Dense, timescale_of
from .perceptions import SUFFIX, TOO_WEAK, Place, document_of, perception_of, too_weak_places

_WEIGHT_CLASSES: Final = 8


def write(
    track: TrackReader,
    devices: Sequence[DeviceConfig],
    stem: Path,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Written:
    """Write ``stem.hjif``, and each body model as ``stem.<model>.glb`` in the same folder. Raises
    NothingFeltError without samples on a body, InputError for a body model of another version than
    recorded, and OutputError for an unwritable file; no partial file remains."""
    document, meshes, loss = compose(track, devices, stem.name, tolerance)
    path = stem.with_name(stem.name + SUFFIX)
    files = [path]
    # Vertex ids of channels refer to these meshes.
    for model in meshes:
        files.append(stem.with_name(f"{stem.name}.{model.id}{glb.SUFFIX}"))
        glb.write_model(model, files[-1], quote(path.name))
    write_json(document, path)
    driven = [effect.name for effect in track.header.effects if effect.kind == "actuators"]
    notes = (
        *(f"'{clean(name)}' drives single actuators, not a body: left out" for name in driven),
        f"curves are within {tolerance:.1%} of full scale and {PITCH_HZ:g} Hz (half a hertz "
        "more where a long vibration is cut into effects)",
        f"weights of painted effects are kept in {_WEIGHT_CLASSES} classes, contacts by body part",
    )
    return Written(tuple(files), notes=notes) + loss


def compose(
    track: TrackReader,
    devices: Sequence[DeviceConfig],
    name: str,
    tolerance: float = DEFAULT_TOLERANCE,
) -> tuple[dict[str, Any], list[PerceptualModel], Written]:
    """HJIF document of a track, its models, and losses as a Written without files. Raises as
    :func:`write`, except OutputError. ``name`` begins the mesh file names."""
    header = track.header
    seconds = (header.time.sample_count + 1) / float(header.time.rate_hz)
    timescale = timescale_of(header.time.fps, header.time.rate_hz, seconds=seconds)
    used = list(dict.fromkeys(stream.model_id for stream in header.streams))
    loaded = {id: _recorded_model(id, track) for id in used}
    masks = {id: vertex_masks(model) for id, model in loaded.items()}
    collected = {
        stream: _Collected(masks[stream.model_id], by_part=header.effect(stream).kind != "painted")
        for stream in header.streams
    }
    for run in track.runs():
        collected[run.stream].add(run)
    groups = _groups(header, collected)
    if not groups:
        raise NothingFeltError(f"{track.path}: has no samples on a body, and HJIF needs some.")
    # Avatars are numbered by the models in use: a model without samples gets no mesh file.
    avatars = {
        id: {"id": k + 1, "lod": 0, "type": "Custom", "mesh": quote(f"{name}.{id}{glb.SUFFIX}")}
        for k, id in enumerate(dict.fromkeys(model_id for _, model_id, _ in groups))
    }
    bodies = {body.id: body.name for body in header.bodies}
    perceptions = []
    weak: list[str] = []  # titles of silent channels
    turning: list[str] = []  # titles of winds without a direction
    for k, ((body_id, model_id, modality), streams) in enumerate(groups.items()):
        places = [
            channel_place
            for stream in streams
            for channel_place in _places(stream, collected[stream], track, masks[model_id])
        ]
        perception = perception_of(k, modality, places, devices, timescale, tolerance)
        weak += too_weak_places(perception, places)
        if modality == "wind":
            turning += [item.title for item in places if item.direction is None]
        perception["avatar_id"] = avatars[model_id]["id"]
        perception["description"] = clean(f"{bodies[body_id]}: {modality}")
        perceptions.append(perception)
    title = clean(str(header.source.get("name", "")) or name)
    document = document_of(title, perceptions, timescale, list(avatars.values()))
    written = [stream for streams in groups.values() for stream in streams]
    left_out = tuple(map(clean, _losses(header, written, collected, turning)))
    loss = Written(left_out=left_out, notes=tuple(map(clean, counted(weak, TOO_WEAK))))
    return document, [loaded[id] for id in avatars], loss


def _recorded_model(id: str, track: TrackReader) -> PerceptualModel:
    """Load a model of the track; InputError if its content hash differs from the recorded hash."""
    model = load_model(id)
    recorded = next(entry.content_hash for entry in track.header.models if entry.id == id)
    if model.content_hash != recorded:
        raise InputError(f"{track.path}: was recorded on another version of the body model '{id}'.")
    return model


def _groups(
    header: TrackHeader, collected: "Mapping[Stream, _Collected]"
) -> dict[tuple[str, str, str], list[Stream]]:
    """Streams with samples on a body by (body, model, modality), without effects on actuators."""
    groups: dict[tuple[str, str, str], list[Stream]] = {}
    for stream in header.streams:
        if len(collected[stream]) and header.effect(stream).kind != "actuators":
            key = (stream.body_id, stream.model_id, stream.modality)
            groups.setdefault(key, []).append(stream)
    return groups


def _losses(
    header: TrackHeader,
    written: Sequence[Stream],
    collected: "Mapping[Stream, _Collected]",
    turning: Sequence[str],
) -> Iterator[str]:
    """Yield a sentence on vibrations above 1000 Hz of ``written`` streams, on the winds named
    ``turning``, and on painted areas with changing vertices of all streams; none without such."""
    # Frequencies are the second parameter of vibration.
    high = [
        header.effect(stream).name
        for stream in written
        if stream.modality == "vibration" and (collected[stream].columns()[2][:, 1] > MAX_HZ).any()
    ]
    yield from counted(high, f"vibrations above {MAX_HZ:g} Hz are written as {MAX_HZ:g} Hz")
    yield from counted(turning, "winds with a changing direction have no direction in HJIF")
    changing = [header.effect(s).name for s in header.streams if collected[s].changes]
    yield from counted(
        changing, "painted areas with changing vertices are written as at their first sample"
    )


class _Collected:
    """Samples of a stream, collected run by run.

    Memory is bounded: each sample stores a weight per body part, not the contacts. ``masks`` (V,):
    body part mask of each vertex of the model. ``by_part``: store the strongest weight of each body
    part; otherwise only the first vertex set.
    """

    def __init__(self, masks: U32, *, by_part: bool) -> None:
        # Parts are distinct masks, so the midline with two bits is a part of its own.
        self._masks, part_of = np.unique(masks, return_inverse=True)
        self._part_of: I64 = part_of.reshape(-1)
        self._is_touched = np.zeros(len(masks), np.bool_)
        self._by_part = by_part
        self._rows: list[I64] = []
        self._levels: list[F64] = []
        self._parameters: list[F64] = []
        self._strongest: list[F32] = []  # (n, parts)
        self.first_set: tuple[I64, F64] | None = None
        """Vertices and weights of the first sample; None before it."""
        self.changes = False
        """True if the vertices change; always False by part."""

    def add(self, run: SampleRun) -> None:
        """Append the next samples of the stream, by ascending sample index: levels and parameters.
        Of the contacts only the first vertex set and whether the set changes, or by body part the
        strongest weight of each sample and the touched vertices."""
        self._rows.append(run.indices)
        self._levels.append(run.levels)
        self._parameters.append(run.parameters)
        if self.first_set is None:
            part = slice(0, int(run.offsets[1]))
            self.first_set = (
                run.vertices[part].astype(np.int64),
                run.weights[part].astype(np.float64),
            )
        if not self._by_part:
            # Sizes are compared first: only sets of equal size line up with the tiled first set.
            first = self.first_set[0]
            self.changes |= bool((np.diff(run.offsets) != len(first)).any()) or not np.array_equal(
                run.vertices, np.tile(first, len(run.offsets) - 1)
            )
        else:
            # Row-wise maximum: each contact goes to cell (set, part) of a flattened table.
            sizes, parts = np.diff(run.offsets), len(self._masks)
            table = np.zeros(len(sizes) * parts, np.float32)
            base = np.repeat(np.arange(len(sizes)) * parts, sizes)
            np.maximum.at(table, base + self._part_of[run.vertices], run.weights)
            self._strongest.append(table.reshape(-1, parts)[run.set_of])
            self._is_touched[run.vertices] = True

    def __len__(self) -> int:
        return sum(len(rows) for rows in self._rows)

    def columns(self) -> tuple[I64, F64, F64]:
        """Ascending sample indices (n,), levels (n,) and parameters (n, P); only with samples."""
        return (
            np.concatenate(self._rows),
            np.concatenate(self._levels),
            np.concatenate(self._parameters),
        )

    def touched(self) -> list[tuple[int, F64, I64]]:
        """Touched body parts: mask, strongest weight per sample (n,), ascending vertex ids."""
        touched = np.flatnonzero(self._is_touched)
        strongest = np.concatenate(self._strongest)
        return [
            (
                int(self._masks[part]),
                strongest[:, part].astype(np.float64),
                touched[self._part_of[touched] == part],
            )
            for part in np.unique(self._part_of[touched]).tolist()
        ]


def _places(
    stream: Stream, collected: _Collected, track: TrackReader, masks: U32
) -> Iterator[Place]:
    """Yield the channels of an effect on a body, with dense strengths in the modality's unit.

    A painted effect has a channel per eighth of the weights, heaviest first, or a single one for
    weights within 1/255; a volume has a channel per touched body part. ``masks`` (V,) are the body
    parts of the model's vertices. Temperatures are relative to neutral, frequencies clipped to
    ``MAX_HZ``; the last row lasts one period.
    """
    effect = track.header.effect(stream)
    count = track.header.time.sample_count
    period_s = 1.0 / float(track.header.time.rate_hz)
    times = np.arange(count + 1) * period_s
    rows, levels, parameters = collected.columns()
    neutral = neutral_temperature_c(effect.is_contact) if stream.modality == "temperature" else 0.0
    strengths = levels * (parameters[:, 0] - neutral)
    # Between contacts the frequency is interpolated: nothing sounds there.
    pitch = None
    if stream.modality == "vibration":
        hertz = np.clip(parameters[:, 1], 0.0, MAX_HZ)
        pitch = np.interp(np.arange(count + 1), rows, hertz)
    direction = None
    if stream.modality == "wind":
        # The mean direction in glTF axes, of length 127; none for a turn of about 1 degree or
        # more, which makes the mean of the unit vectors shorter than 0.9998.
        mean = (parameters[:, 1:4] @ glb.TO_GLTF.T).mean(axis=0)
        length = float(np.linalg.norm(mean))
        if length >= 0.9998:
            whole = np.rint(127.0 * mean / length).astype(int).tolist()
            direction = dict(zip("XYZ", whole, strict=True))

    # Samples without contact are absent from a track, and 0 in the dense column.
    def dense(values: F64) -> Dense:
        column = np.zeros(count + 1)
        column[rows] = values
        column[-1] = column[-2]  # the last row lasts a row
        return Dense(times, column, pitch)

    if effect.kind == "painted":
        assert collected.first_set is not None
        vertices, weights = collected.first_set
        # Classes are eighths of 1; weights of (0, 1/8] are in the first.
        steps = np.ceil(weights * _WEIGHT_CLASSES - 1e-6)
        if np.ptp(weights) < 1.0 / 255.0:
            steps[:] = steps[0]
        classes = np.unique(steps)[::-1]
        for step in classes:
            weight, ids = round(float(weights[steps == step].mean()), 6), vertices[steps == step]
            mask = int(np.bitwise_or.reduce(masks[ids], initial=0))
            share = "" if len(classes) == 1 else f", weight {weight:.3g}"
            title = f"{effect.name}{share}"
            yield Place(title, weight, mask, dense(strengths), set(ids.tolist()), direction)
        return
    for mask, strongest, touched in collected.touched():
        title = f"{effect.name}, {described(mask)}"
        touched_ids = set(touched.tolist())
        yield Place(title, 1.0, mask, dense(strengths * strongest), touched_ids, direction)
