# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF from a recorded track: painted effects as they are, contacts baked by body part.

One perception a body, model and modality. A painted effect is one channel for each class of
its weights, with the effect's own envelope; a volume is one channel for each body part that it
touched, with the strongest contact there and all vertices that it touched there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import numpy as np

from ...engine.arrays import F32, F64, I64, U32
from ...engine.body.model import PerceptualModel, load_model
from ...engine.modality import neutral_temperature_c
from ...engine.rendering.device import DeviceConfig
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
from .perceptions import (
    SUFFIX,
    TOO_WEAK,
    Place,
    document_of,
    perception_of,
    too_weak_places,
)

_WEIGHT_CLASSES: Final = 8


def write(
    track: TrackReader,
    devices: Sequence[DeviceConfig],
    stem: Path,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Written:
    """Write ``stem.hjif`` and beside it each body model as ``stem.<model>.glb``.

    Raises
    ------
    NothingFeltError
        Nothing was felt in the whole track.
    InputError
        A model is not the one it was recorded on.
    OutputError
        A file cannot be written; none is left half written.
    """
    document, meshes, loss = compose(track, devices, stem.name, tolerance)
    path = stem.with_name(stem.name + SUFFIX)
    files = [path]
    for model in meshes:
        files.append(stem.with_name(f"{stem.name}.{model.id}{glb.SUFFIX}"))
        glb.write_model(model, files[-1], quote(path.name))
    write_json(document, path)
    driven = [each.name for each in track.header.effects if each.kind == "actuators"]
    notes = (
        *(f"'{clean(each)}' drives single actuators: it is not felt on a body" for each in driven),
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
    """A document, its models, and, without files, what of the track it does not hold."""
    header = track.header
    seconds = (header.time.sample_count + 1) / float(header.time.rate_hz)
    timescale = timescale_of(header.time.fps, header.time.rate_hz, seconds=seconds)
    used = list(dict.fromkeys(stream.model_id for stream in header.streams))
    loaded = {id: _checked(load_model(id), id, track) for id in used}
    masks = {id: vertex_masks(model) for id, model in loaded.items()}
    found = {
        stream: _Collected(masks[stream.model_id], by_part=header.effect(stream).kind != "painted")
        for stream in header.streams
    }
    for run in track.runs():
        found[run.stream].add(run)
    groups = _groups(header, found)
    if not groups:
        raise NothingFeltError(f"{track.path}: nothing is felt in it, which HJIF cannot hold.")
    avatars = {
        id: {"id": k + 1, "lod": 0, "type": "Custom", "mesh": quote(f"{name}.{id}{glb.SUFFIX}")}
        for k, id in enumerate(dict.fromkeys(model_id for _, model_id, _ in groups))
    }
    bodies = {body.id: body.name for body in header.bodies}
    perceptions = []
    weak: list[str] = []
    turning: list[str] = []
    for k, ((body_id, model_id, modality), streams) in enumerate(groups.items()):
        places = [
            place
            for stream in streams
            for place in _places(stream, found[stream], track, masks[model_id])
        ]
        perception = perception_of(k, modality, places, devices, timescale, tolerance)
        weak += too_weak_places(perception, places)
        if modality == "wind":
            turning += [each.title for each in places if each.direction is None]
        perception["avatar_id"] = avatars[model_id]["id"]
        perception["description"] = clean(f"{bodies[body_id]}: {modality}")
        perceptions.append(perception)
    title = clean(str(header.source.get("name", "")) or name)
    document = document_of(title, perceptions, timescale, list(avatars.values()))
    loss = _loss(header, found, turning) + Written(notes=tuple(map(clean, counted(weak, TOO_WEAK))))
    return document, [loaded[id] for id in avatars], loss


class _Collected:
    """Samples of one stream, collected run by run.

    A few numbers a sample and body part are kept, not the contacts: a long track needs little
    memory.

    Parameters
    ----------
    masks : (V,) uint32
        The body part of each vertex of its model.
    by_part : bool
        Keep the strongest weight of each body part; if not, only the first vertex set is kept.
    """

    def __init__(self, masks: U32, *, by_part: bool) -> None:
        self._masks, part_of = np.unique(masks, return_inverse=True)
        self._part_of: I64 = part_of.reshape(-1)
        self._is_touched = np.zeros(len(masks), np.bool_)
        self._by_part = by_part
        self._rows: list[I64] = []
        self._levels: list[F64] = []
        self._parameters: list[F64] = []
        self._strongest: list[F32] = []  # (n, parts)
        self.first_set: tuple[I64, F64] | None = None
        """Vertices and weights of the first sample."""
        self.changes = False
        """Test for a sample with other vertices; only told if not by part."""

    def add(self, run: SampleRun) -> None:
        """Take the next samples."""
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
            first = self.first_set[0]
            self.changes |= bool((np.diff(run.offsets) != len(first)).any()) or not np.array_equal(
                run.vertices, np.tile(first, len(run.offsets) - 1)
            )
        else:
            sizes, parts = np.diff(run.offsets), len(self._masks)
            table = np.zeros(len(sizes) * parts, np.float32)
            base = np.repeat(np.arange(len(sizes)) * parts, sizes)
            np.maximum.at(table, base + self._part_of[run.vertices], run.weights)
            self._strongest.append(table.reshape(-1, parts)[run.set_of])
            self._is_touched[run.vertices] = True

    def __len__(self) -> int:
        return sum(len(rows) for rows in self._rows)

    @property
    def rows(self) -> I64:
        """Sample indices, (n,)."""
        return np.concatenate(self._rows)

    @property
    def levels(self) -> F64:
        """(n,)"""
        return np.concatenate(self._levels)

    @property
    def parameters(self) -> F64:
        """(n, P)"""
        return np.concatenate(self._parameters)

    def touched(self) -> list[tuple[int, F64, I64]]:
        """Touched body parts: mask, strongest weight of each sample, vertices."""
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


def _groups(
    header: TrackHeader, found: Mapping[Stream, _Collected]
) -> dict[tuple[str, str, str], list[Stream]]:
    """Streams with a place on a body that are felt, by body, model and modality."""
    groups: dict[tuple[str, str, str], list[Stream]] = {}
    for stream in header.streams:
        if len(found[stream]) and header.effect(stream).kind != "actuators":
            key = (stream.body_id, stream.model_id, stream.modality)
            groups.setdefault(key, []).append(stream)
    return groups


def _loss(
    header: TrackHeader, found: Mapping[Stream, _Collected], turning: Sequence[str]
) -> Written:
    """Contents of the streams that a document does not hold."""
    high = [
        header.effect(stream).name
        for streams in _groups(header, found).values()
        for stream in streams
        if stream.modality == "vibration" and (found[stream].parameters[:, 1] > MAX_HZ).any()
    ]
    changing = [header.effect(stream).name for stream in header.streams if found[stream].changes]
    left_out = (
        *counted(high, f"vibrations above {MAX_HZ:g} Hz are written as {MAX_HZ:g} Hz"),
        *counted(turning, "it holds one direction of a wind, and none of those that turn"),
        *counted(changing, "painted areas that change are written as they are at first"),
    )
    return Written(left_out=tuple(map(clean, left_out)))


def _checked(model: PerceptualModel, id: str, track: TrackReader) -> PerceptualModel:
    recorded = next(each for each in track.header.models if each.id == id)
    if model.content_hash != recorded.content_hash:
        raise InputError(f"{track.path}: was recorded on another version of the body model '{id}'.")
    return model


def _places(stream: Stream, found: _Collected, track: TrackReader, masks: U32) -> Iterator[Place]:
    """The channels of one effect on one body, their strength in physical units."""
    effect = track.header.effect(stream)
    count = track.header.time.sample_count
    period_s = 1.0 / float(track.header.time.rate_hz)
    times = np.arange(count + 1) * period_s
    rows, parameters = found.rows, found.parameters
    neutral = neutral_temperature_c(effect.is_contact) if stream.modality == "temperature" else 0.0
    strengths = found.levels * (parameters[:, 0] - neutral)
    pitch = None
    if stream.modality == "vibration":
        hertz = np.clip(parameters[:, 1], 0.0, MAX_HZ)
        pitch = np.interp(np.arange(count + 1), rows, hertz)
    direction = _direction(parameters) if stream.modality == "wind" else None

    def dense(values: F64) -> Dense:
        column = np.zeros(count + 1)
        column[rows] = values
        column[-1] = column[-2]  # the last row lasts a row
        return Dense(times, column, pitch)

    if effect.kind == "painted":
        assert found.first_set is not None
        classes = _weight_classes(*found.first_set)
        for weight, vertices in classes:
            mask = int(np.bitwise_or.reduce(masks[vertices], initial=0))
            share = "" if len(classes) == 1 else f", weight {weight:.3g}"
            title = f"{effect.name}{share}"
            yield Place(title, weight, mask, dense(strengths), set(vertices.tolist()), direction)
        return
    for mask, weights, touched in found.touched():
        title = f"{effect.name}, {described(mask)}"
        ids = set(touched.tolist())
        yield Place(title, 1.0, mask, dense(strengths * weights), ids, direction)


def _weight_classes(vertices: I64, weights: F64) -> list[tuple[float, I64]]:
    """Vertices of a painted area by weight: mean weight and ids of each class."""
    steps = np.ceil(weights * _WEIGHT_CLASSES - 1e-6)
    if np.ptp(weights) < 1.0 / 255.0:
        steps[:] = steps[0]
    return [
        (round(float(weights[steps == each].mean()), 6), vertices[steps == each])
        for each in np.unique(steps)[::-1]
    ]


def _direction(parameters: F64) -> dict[str, int] | None:
    """Direction of a wind, if it is constant within about a degree."""
    vectors = parameters[:, 1:4] @ glb.TO_GLTF.T
    mean = vectors.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < 0.9998:
        return None
    return dict(zip("XYZ", np.rint(127.0 * mean / length).astype(int).tolist(), strict=True))
