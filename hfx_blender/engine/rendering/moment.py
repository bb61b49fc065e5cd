# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of single moments: present values of a device's actuators.

A moment is a track with a single row. Update intervals are not held, and latency is not
compensated: the caller passes later samples to :meth:`MomentRenderer.ahead`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from ..arrays import F64, I64, Bool
from ..body.model import load_model
from ..samples import SampleRun
from ..scene import SceneDescription, TimeBase
from ..track.header import TrackHeader
from .conditioning.frequency import Partial
from .device_config import DeviceConfig
from .dispatch import ModelLoader
from .renderer import Renderer

_ONE_ROW = TimeBase(Fraction(1), Fraction(1), scene_start=0, frame_first=0, frame_last=0)


def moment_header(scene: SceneDescription, models: ModelLoader = load_model) -> TrackHeader:
    """Track header of a scene, with a clock of a single row."""
    used = {effect.model_id: models(effect.model_id) for effect in scene.effects}
    return of_one_moment(TrackHeader.of(scene, used, settings={}, tools={}))


def of_one_moment(header: TrackHeader) -> TrackHeader:
    """Copy of a header with a clock of a single row."""
    return replace(header, time=_ONE_ROW)


class MomentRenderer:
    """Renderer of a scene's moments for one device; InputError for an unknown wearer.

    ``scene`` is a scene or a header of :func:`moment_header`; ``models`` loads a perceptual model
    by id. ``body_id``, also an attribute, is the body that wears the device; optional for one body.
    """

    def __init__(
        self,
        scene: SceneDescription | TrackHeader,
        device: DeviceConfig,
        models: ModelLoader = load_model,
        *,
        body_id: str | None = None,
    ) -> None:
        header = scene if isinstance(scene, TrackHeader) else moment_header(scene, models)
        self.device = device
        self._renderer = Renderer(
            header, device, models, body_id=body_id, compensates_latency=False
        )
        self.body_id = self._renderer.body_id
        self._effects = header.effects
        # For each latency: raster columns, and a mask of the waveform actuators.
        self._late: dict[float, tuple[I64, Bool]] = {}
        late = [a.type.latency_ms for a in device.actuators for _ in a.type.controls]
        sounding = [a.type.latency_ms for a in device.actuators if a.type.takes_waveform]
        for latency_ms in set(late):
            columns = np.flatnonzero(np.array(late) == latency_ms)
            self._late[latency_ms] = columns, np.array(sounding) == latency_ms

    def prepare(self) -> None:
        """Compute reached vertices and panning of spots of all effects before any contact. Raises
        InputError for a place of the device that does not fit a model."""
        for group in self._renderer.groups:
            for effect in self._effects:
                if group.renders(effect.modality):
                    group.cells_on(effect.model_id)
                    if effect.kind == "spot":
                        group.panning_on(effect.model_id)

    def move_play_space(self, matrix: F64) -> None:
        """Set the pose of the play space, (4, 4) to world, m; an unusable pose is ignored."""
        for group in self._renderer.groups:
            group.play_space.move(matrix)

    def values(self, runs: Sequence[SampleRun], time_s: float | None = None) -> F64:
        """Values (columns,) within the device's limits; neutral without sensations.

        Runs have at most one sample each, of index 0; without the scene's time, ``time_s``, nothing
        adapts or persists. Raises InputError for a place of the device that does not fit a model.
        """
        self._renderer.restart()
        self._renderer.add(runs, time_s)
        return self._renderer.first_row()

    def tones(self) -> list[Partial]:
        """Sines of the last rendered moment, one for each effect, at the W waveform actuators. A
        single row each, together within the device's limits."""
        return list(self._renderer.partials())

    def ahead(
        self,
        now: Sequence[SampleRun],
        later: Mapping[float, Sequence[SampleRun]],
        time_s: float | None = None,
    ) -> tuple[F64, list[Partial]]:
        """Values (columns,) and tones, each actuator's at the time of its response.

        ``now`` are samples of the present moment; ``later`` maps a latency in ms to samples so much
        later. Missing latencies are not compensated. ``time_s`` as of :meth:`values`, of ``now``.
        """
        values, tones = self.values(now, time_s), self.tones()
        for latency_ms, (columns, is_late) in self._late.items():
            if latency_ms not in later:
                continue
            self._renderer.latency_ms = latency_ms
            late_s = None if time_s is None else time_s + latency_ms / 1e3
            values[columns] = self.values(later[latency_ms], late_s)[columns]
            self._renderer.latency_ms = 0.0
            if is_late.any():
                # Of the later moment's tones only these actuators play, of the earlier the rest.
                parts = [(tone, ~is_late) for tone in tones]
                parts += [(tone, is_late) for tone in self.tones()]
                tones = [
                    replace(tone, amplitudes=np.where(is_on, tone.amplitudes, 0.0))
                    for tone, is_on in parts
                ]
        return values, tones

    def felt(self, runs: Sequence[SampleRun]) -> list[tuple[SampleRun, F64]]:
        """Non-empty runs on the wearer, each with the gains of its first sample (A,), in 0..1."""
        on_wearer = [run for run in runs if run.stream.body_id == self.body_id and len(run)]
        return [(run, self._renderer.gains(run)[0]) for run in on_wearer]
