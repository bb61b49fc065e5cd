# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiny body of dots, with a track and devices, all made by hand."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from hfx_blender.engine.body.model import PerceptualModel, SkinWeights
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.device_config import (
    Actuator,
    ActuatorControl,
    ActuatorType,
    DeviceConfig,
    Place,
    RoomPlace,
    Scheme,
    Substitution,
    VertexPlace,
    VertexSet,
)
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track.header import TrackBody, TrackEffect, TrackHeader, TrackModel


def dots(modality: str, count: int = 10) -> PerceptualModel:
    """Return vertices 10 cm apart along X, mirrored about the middle; the left half is at +X."""
    x = (np.arange(count) - (count - 1) / 2) * 0.1
    vertices = np.zeros((count, 3), np.float32)
    vertices[:, 0] = x
    return PerceptualModel(
        id=f"dots-{modality}",
        modality=modality,
        vertices=vertices,
        triangles=np.zeros((0, 3), np.int32),
        normals=np.tile(np.float32([0, 0, 1]), (count, 1)),
        areas_m2=np.ones(count, np.float32),
        part=np.where(np.arange(count) % 2, 1, 3).astype(np.uint8),  # torso, forearm
        side=np.where(x > 0, 1, 2).astype(np.uint8),
        mirror=np.arange(count, dtype=np.int32)[::-1].copy(),
        bone_names=("root",),
        weights=SkinWeights(
            np.arange(count + 1, dtype=np.int32), np.zeros(count, np.int32), np.ones(count, "f4")
        ),
        avatar_vertices=np.zeros((count, 3), np.int32),
        avatar_weights=np.zeros((count, 3), np.float32),
        avatar_offset_m=np.zeros(count, np.float32),
        provenance={},
    )


MODELS = {f"dots-{m}": dots(m) for m in ("vibration", "pressure", "temperature")}


def make_header(
    effects: dict[str, str],
    sample_count: int = 10,
    *,
    rate_hz: Fraction = Fraction(100),
    contact: Sequence[str] = (),
    bodies: Sequence[str] = ("body",),
) -> TrackHeader:
    """Return a header with volumes (id: modality) for every body."""
    return TrackHeader(
        time=TimeBase(rate_hz, rate_hz, 0, 0, sample_count - 1),
        models=tuple(
            TrackModel(model.id, model.modality, model.content_hash, len(model))
            for model in MODELS.values()
        ),
        bodies=tuple(TrackBody(body, body.title()) for body in bodies),
        effects=tuple(
            TrackEffect(id, id, modality, "volume", model_of(modality), id in contact)
            for id, modality in effects.items()
        ),
        streams=tuple(
            Stream(id, body, modality, model_of(modality))
            for id, modality in effects.items()
            for body in bodies
        ),
    )


def model_of(modality: str) -> str:
    return f"dots-{MODALITIES[modality].model}"


def make_run(
    header: TrackHeader,
    effect_id: str,
    samples: dict[int, dict[int, float]],
    parameters: Sequence[float],
    *,
    level: float = 1.0,
    body_id: str = "body",
) -> SampleRun:
    """Return a run from ``{sample index: {vertex: weight}}``."""
    stream = next(s for s in header.streams if (s.effect_id, s.body_id) == (effect_id, body_id))
    indices = np.array(sorted(samples), np.int64)
    rows = [sorted(samples[i].items()) for i in indices.tolist()]
    return SampleRun(
        stream=stream,
        indices=indices,
        times_s=header.time.times_s(indices),
        levels=np.full(len(indices), level),
        parameters=np.tile(np.asarray(parameters, np.float64), (len(indices), 1)),
        offsets=np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64),
        vertices=np.array([v for row in rows for v, _ in row], np.int32),
        weights=np.array([w for row in rows for _, w in row], np.float32),
    )


CONTROLS = {
    "vibration": [("amplitude_m_s2", 0, 20, 0), ("frequency_hz", 50, 250, 100)],
    "pressure": [("pressure_kpa", 0, 10, 0)],
    "temperature": [("temperature_c", 10, 40, 25)],
    "wind": [("speed_m_s", 0, 8, 0)],
}


def make_type(modality: str, interval_ms: float = 10.0) -> ActuatorType:
    controls = tuple(
        ActuatorControl(n, lo, hi, lo, hi, mid) for n, lo, hi, mid in CONTROLS[modality]
    )
    return ActuatorType(modality, modality, controls, 0.0, interval_ms)


def at(*vertices: int) -> VertexPlace:
    """Return a place with these vertices on each model."""
    return VertexPlace(tuple(VertexSet(m.id, m.content_hash, vertices) for m in MODELS.values()))


def make_device(
    actuators: dict[str, tuple[str, Place]],
    *,
    substitutions: Sequence[Substitution] = (),
    interval_ms: float = 10.0,
    **others: object,
) -> DeviceConfig:
    """Return a device from ``{actuator: (modality, place)}``."""
    types = {m: make_type(m, interval_ms) for m, _ in actuators.values()}
    options = {"scheme": Scheme(), "gain": 1.0, **others}
    return DeviceConfig(
        id="device",
        name="Device",
        description="",
        actuator_types=types,
        actuators=tuple(
            Actuator(id, types[m], position) for id, (m, position) in actuators.items()
        ),
        substitutions={substitution.source: substitution for substitution in substitutions},
        **options,  # type: ignore[arg-type]
    )


EVERYWHERE = RoomPlace(("torso", "forearm"))
