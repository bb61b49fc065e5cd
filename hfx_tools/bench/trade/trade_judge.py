# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of a setting, against the recording of the preset ``exact``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import SkinBinding
from hfx_blender.engine.skin.skinned_model import SkinnedModel
from hfx_blender.engine.tolerance import Tolerance
from hfx_blender.engine.volume.shape import inverse_placement

from . import trade_errors
from .trade_recording import Recording

_JUDGED: Final = 400  # number of wrong contacts with a measured distance to the boundary


def events(runs: Sequence[SampleRun], rate_hz: float) -> dict[Stream, F64]:
    """Begin and end (n, 2) of the contact events of each stream, seconds since the first sample."""
    indices: dict[Stream, list[I64]] = {}
    for run in runs:
        indices.setdefault(run.stream, []).append(run.indices)
    return {
        stream: trade_errors.events(np.concatenate(parts), rate_hz)
        for stream, parts in indices.items()
    }


class Judge:
    """Comparison of recordings with the reference."""

    def __init__(self, reference: Recording, onsets: dict[Stream, F64]) -> None:
        self._reference = reference
        self._onsets = onsets
        self._kinds = {effect.id: effect.kind for effect in reference.description.effects}
        self._contacts = trade_errors.contacts_of(self._volume_runs(reference))
        self._models: dict[str, PerceptualModel] = {}
        self._bound: dict[tuple[str, str], SkinnedModel] = {}

    def _volume_runs(self, recording: Recording) -> list[SampleRun]:
        return [run for run in recording.runs if self._kinds[run.stream.effect_id] == "volume"]

    def errors(self, recording: Recording, tolerance: Tolerance) -> dict[str, Any]:
        """All errors of a recording at a tolerance; plain data."""
        rate_hz = recording.description.time.rate_hz
        return {
            **self._contact_errors(recording),
            **self._onset_errors(recording),
            **self._amplitude_errors(recording, int(np.ceil(tolerance.time_s * float(rate_hz)))),
            "memory_mb": recording.memory_bytes / 1e6,
            "reading": recording.note,
        }

    def _contact_errors(self, recording: Recording) -> dict[str, Any]:
        contacts = trade_errors.contacts_of(self._volume_runs(recording))
        errors = {
            stream: trade_errors.contact_error(
                contacts.get(stream, trade_errors.NOTHING),
                self._contacts.get(stream, trade_errors.NOTHING),
                self._model(stream.model_id).areas_m2.astype(np.float64),
            )
            for stream in dict.fromkeys((*self._contacts, *contacts))
        }
        samples = max(sum(error.samples for error in errors.values()), 1)
        area_m2 = sum(error.felt_m2 for error in errors.values()) or 1.0
        missed_m2 = sum(error.missed_m2 for error in errors.values())
        extra_m2 = sum(error.extra_m2 for error in errors.values())
        distances = self._distances({s: (e.missed, e.extra) for s, e in errors.items()})
        return {
            "missed": sum(len(error.missed) for error in errors.values()),
            "extra": sum(len(error.extra) for error in errors.values()),
            "contacts": sum(error.count for error in errors.values()),
            "missed_cm2": 1e4 * missed_m2 / samples,
            "extra_cm2": 1e4 * extra_m2 / samples,
            "wrong_share": (missed_m2 + extra_m2) / area_m2,
            "distance_mean_mm": 1e3 * float(np.mean(distances)) if len(distances) else 0.0,
            "distance_p95_mm": 1e3 * float(np.quantile(distances, 0.95)) if len(distances) else 0.0,
        }

    def _onset_errors(self, recording: Recording) -> dict[str, Any]:
        rate_hz = float(recording.description.time.rate_hz)
        events_of_streams = events(recording.runs, rate_hz)
        nothing = np.zeros((0, 2))
        errors = [
            trade_errors.onset_error(
                events_of_streams.get(stream, nothing), self._onsets.get(stream, nothing)
            )
            for stream in dict.fromkeys((*self._onsets, *events_of_streams))
        ]
        late = np.abs(np.concatenate([np.zeros(0), *(error.errors_s for error in errors)]))
        return {
            "events": sum(len(error.errors_s) + error.missed for error in errors),
            "events_missed": sum(error.missed for error in errors),
            "events_extra": sum(error.extra for error in errors),
            "onset_mean_ms": 1e3 * float(late.mean()) if len(late) else 0.0,
            "onset_largest_ms": 1e3 * float(late.max(initial=0.0)),
        }

    def _amplitude_errors(self, recording: Recording, window: int) -> dict[str, Any]:
        errors = [
            trade_errors.amplitude_error(raster, reference, device, window)
            for (device, raster), (_, reference) in zip(
                recording.rasters, self._reference.rasters, strict=True
            )
        ]
        driven = sum(error.count for error in errors) or 1
        return {
            "amplitude_mean": sum(error.mean * error.count for error in errors) / driven,
            "amplitude_largest": max((error.largest for error in errors), default=0.0),
        }

    def _model(self, model_id: str) -> PerceptualModel:
        return self._models.setdefault(model_id, load_model(model_id))

    def _distances(self, wrong: dict[Stream, tuple[I64, I64]]) -> F64:
        """Finite distances of about 400 wrong contacts from the boundary of their volume."""
        count = sum(len(part) for pair in wrong.values() for part in pair)
        step = max(count // _JUDGED, 1)
        distances = [
            self._distance(stream, int(key))
            for stream, pair in wrong.items()
            for key in np.concatenate(pair)[::step]
        ]
        return np.array([distance for distance in distances if np.isfinite(distance)])

    def _distance(self, stream: Stream, key: int) -> float:
        index, vertex = divmod(key, trade_errors.VERTICES)
        for block in self._reference.blocks:
            row = int(np.searchsorted(block.indices, index))
            if row < len(block.indices) and block.indices[row] == index:
                break
        else:
            return np.inf
        description = self._reference.description
        effect = next(k for k, e in enumerate(description.effects) if e.id == stream.effect_id)
        body = next(k for k, b in enumerate(description.bodies) if b.id == stream.body_id)
        animated, pose = block.effects[effect], block.poses[body]
        bound = self._bound_model(stream, body)
        if bound is None or animated.matrices is None or not pose.valid[row]:
            return np.inf
        inverses, usable = inverse_placement(animated.matrices[row : row + 1])
        if not usable[0]:
            return np.inf
        points = bound.points(np.array([vertex], np.int32), pose, row, pose.to_world[row])
        shape_index = 0 if animated.shape_index is None else int(animated.shape_index[row])
        shape = animated.shapes[shape_index]
        return float(trade_errors.boundary_distance_m(shape, inverses[0], points)[0])

    def _bound_model(self, stream: Stream, body: int) -> SkinnedModel | None:
        key = (stream.body_id, stream.model_id)
        binding = self._reference.description.bodies[body].binding
        if not isinstance(binding, SkinBinding):
            return None
        if key not in self._bound:
            model = self._model(stream.model_id)
            fitted = binding.fitted.get(stream.model_id)
            self._bound[key] = SkinnedModel(model if fitted is None else fitted.of(model), binding)
        return self._bound[key]
