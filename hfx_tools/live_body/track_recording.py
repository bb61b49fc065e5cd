# SPDX-License-Identifier: GPL-3.0-or-later
"""Recording of the touch of tracked bodies as a track, for any export."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track import (
    TrackBody,
    TrackEffect,
    TrackHeader,
    TrackModel,
    TrackWriter,
)
from hfx_blender.errors import InputError
from hfx_blender.formats.clip.container import NONE, Sections

from ..formats.clip_reader import texts_at
from .player_core import CoreBody

RATE_HZ: Final = 100
"""Samples of a recorded track a second."""


@dataclass(frozen=True, eq=False)
class _Touch:
    """Touch of an effect on a body at a time; ``level`` 0: nothing is felt."""

    time_s: float
    level: float
    parameters: npt.NDArray[np.float64]  # (P,)
    vertices: npt.NDArray[np.int32]  # (n,) ascending ids of the model
    weights: npt.NDArray[np.float32]  # (n,) above 0


class _Worn:
    """Effect of the clip on a tracked body: its stream, and the touches so far.

    ``nearest``: index (V,) of the clip's vertex that is nearest to each vertex of the model at
    rest, as a clip may have a coarser model.
    """

    def __init__(self, stream: Stream, effect: int, nearest: npt.NDArray[np.intp]) -> None:
        self.stream, self.effect, self._nearest = stream, effect, nearest
        self.touches: list[_Touch] = []

    def add(
        self, time_s: float, core: CoreBody, factor: float, parameters: npt.NDArray[np.float64]
    ) -> None:
        """Add the touch of the last evaluation; ``factor``: of gain and fade. A touch that repeats
        the touch before is left out."""
        weights = core.weights(self.effect)
        level = min(core.level(self.effect) * factor, 1.0) if weights.any() else 0.0
        weights = weights[self._nearest] if level > 0.0 else np.zeros(0, np.float32)
        ids = np.flatnonzero(weights > 0.0).astype(np.int32)
        weights = weights[ids]
        if self.touches:
            last = self.touches[-1]
            if level <= 0.0 and last.level <= 0.0:
                return
            # Equal sets are stored once.
            if np.array_equal(last.vertices, ids) and np.array_equal(last.weights, weights):
                ids, weights = last.vertices, last.weights
        self.touches.append(_Touch(time_s, max(level, 0.0), parameters, ids, weights))

    def run(self, count: int) -> SampleRun | None:
        """Samples at the times of a track with ``count`` samples, each the latest touch; None
        without any."""
        times_s = np.array([touch.time_s for touch in self.touches])
        clock_s = np.arange(count) / RATE_HZ
        latest = np.searchsorted(times_s, clock_s + 1e-9, side="right") - 1
        indices = np.array([i for i, k in enumerate(latest) if k >= 0 and self.touches[k].level])
        if not len(indices):
            return None
        touches = [self.touches[k] for k in latest[indices]]
        # A set for each change of the vertices or weights.
        is_new = [
            k == 0 or touch.weights is not touches[k - 1].weights for k, touch in enumerate(touches)
        ]
        sets = [touch for touch, new in zip(touches, is_new, strict=True) if new]
        return SampleRun(
            self.stream,
            indices.astype(np.int64),
            clock_s[indices],
            np.array([touch.level for touch in touches]),
            np.array([touch.parameters for touch in touches]),
            np.cumsum([0, *(len(touch.vertices) for touch in sets)]).astype(np.int64),
            np.concatenate([touch.vertices for touch in sets]),
            np.concatenate([touch.weights for touch in sets]),
            np.cumsum(is_new) - 1,
        )


class TrackRecording:
    """Touch of all effects on tracked bodies over time, in memory until :meth:`write`.

    ``sections``: of the clip; ``bodies``: names of tracked bodies; ``path``: for messages. Raises
    InputError: a perceptual model of the clip is not installed, or has fewer vertices.
    """

    def __init__(self, sections: Sections, bodies: Iterable[str], path: str) -> None:
        self._sections = sections
        self._names = texts_at(sections, sections["BODY"]["name"])
        self._path = path
        self._effects = self._effects_of()
        self._models: dict[str, TrackModel] = {}
        for model_id in dict.fromkeys(effect.model_id for effect in self._effects):
            model = load_model(model_id)
            self._models[model_id] = TrackModel(
                model_id, model.modality, model.content_hash, len(model)
            )
        self._worn = {name: self._worn_by(self._names.index(name)) for name in bodies}
        self._end_s = 0.0

    def _effects_of(self) -> list[TrackEffect]:
        """Effects of the clip in order, with their numbers as ids."""
        records = self._sections["EFCT"]
        names, models = (texts_at(self._sections, records[key]) for key in ("name", "model"))
        modalities = list(MODALITIES)
        return [
            TrackEffect(
                f"{k}",
                names[k],
                modalities[int(record["modality"])],
                "painted" if record["kind"] else "volume",
                models[k],
                painted_vertices=int(record["painted"]) if record["kind"] else None,
            )
            for k, record in enumerate(records)
        ]

    def add(
        self, time_s: float, name: str, core: CoreBody, factor: float, parameters: list[Any]
    ) -> None:
        """Add the touch of a tracked body by name, at the last evaluation of ``core``.

        ``time_s``: from the start, rising. ``factor``: of gain and fade, 0 to 1. ``parameters``:
        values (P,) of each effect in the order of its modality.
        """
        self._end_s = max(self._end_s, time_s)
        for worn in self._worn[name]:
            worn.add(time_s, core, factor, parameters[worn.effect])

    def _worn_by(self, body: int) -> list[_Worn]:
        """Streams of the effects that a body can feel."""
        sections, name = self._sections, self._names[body]
        record = sections["BODY"][body]
        first = int(record["first_model"])
        models = sections["MODL"][first : first + int(record["models"])]
        by_id = dict(zip(texts_at(sections, models["id"]), models, strict=True))
        worn = []
        for k, effect in enumerate(self._effects):
            wearer = int(sections["EFCT"]["body"][k])
            model = by_id.get(effect.model_id)
            if model is None or wearer not in (body, NONE):
                continue
            start = int(model["first_vertex"])
            ids = sections["VERT"]["id"][start : start + int(model["vertices"])]
            if ids.max(initial=0) >= self._models[effect.model_id].vertex_count:
                raise InputError(
                    f"{self._path}: it has vertices of another version of '{effect.model_id}'."
                )
            stream = Stream(effect.id, name, effect.modality, effect.model_id)
            worn.append(_Worn(stream, k, self._nearest(effect.model_id, ids)))
        return worn

    def _nearest(self, model_id: str, ids: npt.NDArray[np.uint32]) -> npt.NDArray[np.intp]:
        """Index (V,) into ``ids`` of the vertex nearest to each vertex of a model at rest."""
        from scipy.spatial import cKDTree

        places = load_model(model_id).vertices
        nearest = cKDTree(places[ids]).query(places)[1]
        nearest[ids] = np.arange(len(ids))  # also where two vertices have one place
        return np.asarray(nearest, np.intp)

    def write(self, path: Path) -> None:
        """Write the track; OutputError if the file cannot be written."""
        count = int(self._end_s * RATE_HZ) + 1
        streams = [worn for worns in self._worn.values() for worn in worns]
        used = {worn.stream.effect_id for worn in streams}
        effects = tuple(effect for effect in self._effects if effect.id in used)
        header = TrackHeader(
            time=TimeBase(Fraction(RATE_HZ), Fraction(RATE_HZ), 0, 0, count - 1),
            models=tuple(self._models[id] for id in dict.fromkeys(e.model_id for e in effects)),
            bodies=tuple(TrackBody(name, name) for name in self._worn),
            effects=effects,
            streams=tuple(worn.stream for worn in streams),
            tools={"hfx feel": "1"},
        )
        with TrackWriter(path, header) as writer:
            runs = [run for worn in streams if (run := worn.run(count)) is not None]
            writer.append(runs)
