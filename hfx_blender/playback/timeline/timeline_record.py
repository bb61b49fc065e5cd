# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of effects and actuators over the whole timeline, recorded in pieces while Blender is
idle.

Same path as an export (reader, engine, renderer), at the tolerance of preview and live devices.
Records are in memory only.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import floor
from operator import itemgetter
from typing import Any

import bpy
import numpy as np

from ...authoring.effects import effects, swarms
from ...engine.arrays import F64
from ...engine.body.model import load_model
from ...engine.evaluate import Engine
from ...engine.modality import MODALITIES, neutral_temperature_c
from ...engine.native import library
from ...engine.rendering.device_config import DeviceConfig
from ...engine.rendering.raster import Raster
from ...engine.rendering.renderer import Renderer
from ...engine.samples import SampleRun, Stream
from ...engine.scene import EffectDescription, SceneDescription, TimeBase
from ...engine.track.header import TrackHeader
from ...errors import HfxError, InputError
from ...reading.curves.animation_time import time_base
from ...reading.description.scene_settings import live_tolerance, load_scene_device
from ...reading.scene_reader import SceneReader
from ...reading.stepped.reached import sources_of

MOST_SAMPLES = 20_000  # limit of samples: longer scenes are sampled once a frame, or not at all

MOST_BYTES = 64_000_000
"""Memory limit of cached samples, bytes. Later samples are evaluated when drawn, without latency
compensation."""

_MUST_STEP = "The values need every frame of the scene to be set."


class NeedsSteppingError(HfxError):
    """Raised for scenes that Blender has to evaluate frame by frame, or that take minutes."""


@dataclass(eq=False)
class EffectRecord:
    """Strength of an effect on a body at T times."""

    name: str
    stream: Stream
    unit: str
    neutral: float  # of the strength
    values: F64  # (T,) maximum over all vertices; temperature: deviation from neutral


@dataclass(eq=False)
class TimelineRecord:
    """Effects and actuators of a scene at T times, with the cached haptic samples."""

    described: SceneDescription
    time: TimeBase
    frames: F64  # (T,) of the scene
    effects: list[EffectRecord]
    devices: list[tuple[DeviceConfig, Raster]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)  # errors of devices
    notes: list[str] = field(default_factory=list)  # differences from the real output
    groups: dict[str, str] = field(default_factory=dict)  # group by effect name
    _blocks: list[tuple[int, list[SampleRun]]] = field(default_factory=list)  # first sample, runs
    _bytes: int = 0

    def __post_init__(self) -> None:
        self._first = float(self.frames[0])
        self._per_frame = float(self.time.rate_hz / self.time.fps)
        self._kept_count = len(self.frames)

    @property
    def is_cut(self) -> bool:
        """Test for samples beyond the memory limit, which are not cached."""
        return self._kept_count < len(self.frames)

    @property
    def kept_range(self) -> tuple[int, int]:
        """First and last frame with cached samples, inclusive; last < first without any."""
        first = self.time.frame_first
        if not self.is_cut:
            return first, self.time.frame_last
        return first, floor(self.frames[self._kept_count - 1]) if self._kept_count else first - 1

    def rows(self) -> list[EffectRecord]:
        """Values of the effects; effects of equal group, body and modality are merged into the
        value of largest magnitude."""
        rows: dict[tuple[str, ...], EffectRecord] = {}
        for effect in self.effects:
            stream, group = effect.stream, self.groups.get(effect.name, "")
            key = group, "" if group else stream.effect_id, stream.body_id, stream.modality
            if key in rows:
                values = rows[key].values
                # By magnitude: in a group of warm and cold effects, the cold must not get lost.
                strongest = np.where(np.abs(effect.values) > np.abs(values), effect.values, values)
                rows[key] = replace(effect, name=group, values=strongest)
            else:
                rows[key] = effect
        return list(rows.values())

    def position(self, frames: Any) -> Any:
        """Indices of samples, with fractions, at frames: numbers or arrays."""
        return (frames - self._first) * self._per_frame

    def index(self, frame: float) -> int | None:
        """Index of the sample nearest to a frame; None over a sample outside of the timeline."""
        # A sample more than the ends: frame `last + 0.9` still belongs to the last frame's sample.
        position, last = self.position(frame), len(self.frames) - 1
        return min(max(round(position), 0), last) if -1.0 <= position <= last + 1.0 else None

    def runs(self, index: int) -> list[SampleRun] | None:
        """Samples at a time, as runs of a single sample; None if not cached, [] for silence."""
        if index >= self._kept_count:
            return None
        # The last block that starts at or before the sample; a block has all runs of its times.
        block = bisect_right(self._blocks, index, key=itemgetter(0)) - 1
        present = []
        for run in self._blocks[block][1] if block >= 0 else ():
            position = int(run.indices.searchsorted(index))
            if position < len(run.indices) and run.indices[position] == index:
                present.append(run.one(position))
        return present

    def add(self, runs: Sequence[SampleRun]) -> None:
        """Add the samples of the next block of times: peaks always, samples within the limit."""
        runs = [run for run in runs if len(run)]
        for run in runs:
            effect = next(effect for effect in self.effects if effect.stream == run.stream)
            effect.values[run.indices] = _peaks(run, effect.neutral)
        if not runs or self.is_cut:
            return
        # From the first block above the limit no samples are cached: `kept_range` stays one range.
        first = min(int(run.indices[0]) for run in runs)
        arrays = [array for run in runs for array in (run.vertices, run.weights, run.positions)]
        self._bytes += sum(array.nbytes for array in arrays if array is not None)
        if self._bytes > MOST_BYTES:
            self._kept_count = first
        else:
            self._blocks.append((first, list(runs)))


def record(
    scene: bpy.types.Scene, *, may_step: bool, with_positions: bool = False
) -> Iterator[TimelineRecord | None]:
    """Record a scene in pieces: yields None after each block, and the record at the end. A device
    that cannot be loaded or rendered is left out, with its error in ``faults`` of the record.
    Latency is not compensated.

    ``may_step``: allow setting frames of scenes. The generator must then run to its end without a
    pause, as its end restores the frame. ``with_positions``: record positions of samples, for
    devices in the room.

    Raises NeedsSteppingError: without ``may_step``, frames have to be set, or volumes need the slow
    reference. Raises InputError: the scene has no body or effect, or more than :data:`MOST_SAMPLES`
    frames.
    """
    if not may_step and sources_of(scene):  # the reader steps all frames to find instances
        raise NeedsSteppingError(_MUST_STEP)
    tolerance = live_tolerance(scene)
    reader = SceneReader(
        scene,
        rate_hz=_rate(scene),
        tolerance=tolerance,
        with_positions=with_positions,
        is_probed=may_step,
    )
    if not may_step and reader.steps():
        raise NeedsSteppingError(_MUST_STEP)
    described = reader.description
    if not may_step and described.has_volumes and not library.is_there():
        raise NeedsSteppingError("Without the compiled part of HFX, this takes minutes.")
    header = TrackHeader.of(
        described,
        {effect.model_id: load_model(effect.model_id) for effect in described.effects},
        settings={},
        tools={},
    )
    time = reader.time
    described_by = {effect.id: effect for effect in described.effects}
    timeline = TimelineRecord(
        described=described,
        time=time,
        frames=float(time.scene_start)
        + time.times_s(np.arange(time.sample_count)) * float(time.fps),
        effects=[_empty(described_by[s.effect_id], s, time.sample_count) for s in header.streams],
        groups={effect.name: effects.group_of(effect) for effect in swarms.listed_effects(scene)},
    )
    # Latency is not compensated here: drawn values belong to the drawn frame.
    renderers = [
        (device, Renderer(header, device, load_model, body_id=body.id, compensates_latency=False))
        for device in devices_of(scene, timeline.faults)
        for body in header.bodies
    ]
    recorded = ("positions",) if with_positions else ()
    engine = Engine(described, record=recorded, tolerance=tolerance)
    for block in reader.blocks():
        runs = engine.evaluate(block)
        timeline.add(runs)
        for pair in renderers[:]:
            try:
                pair[1].add(runs)
            except InputError as error:
                timeline.faults.append(str(error))
                renderers.remove(pair)
        yield None
    timeline.devices = [(device, renderer.raster()) for device, renderer in renderers]
    timeline.notes = notes_of([device for device, _ in timeline.devices])
    yield timeline


def _rate(scene: bpy.types.Scene) -> Fraction:
    """Sampling rate in Hz: the scene's rate (1000 at most), or the frame rate if that were more
    than :data:`MOST_SAMPLES` samples. InputError for more frames than this limit."""
    time = time_base(scene)
    rate: Fraction = min(time.rate_hz, Fraction(1000))
    if time_base(scene, rate_hz=rate).sample_count > MOST_SAMPLES:
        rate = time.fps
    count = time_base(scene, rate_hz=rate).sample_count
    if count > MOST_SAMPLES:
        raise InputError(f"The timeline is too long to show values over it ({count} frames).")
    return rate


def devices_of(scene: bpy.types.Scene, faults: list[str]) -> list[DeviceConfig]:
    """Devices of the scene; errors of unreadable configurations are appended to ``faults``."""
    devices = []
    for item in scene.hfx.devices:
        try:
            devices.append(load_scene_device(item))
        except HfxError as error:
            faults.append(str(error))
    return devices


def notes_of(devices: Sequence[DeviceConfig]) -> list[str]:
    """A sentence for each device with a script, once per id: scripts do not run in a record."""
    return [
        f"'{id}' is shown without its script, which runs during playback and export"
        for id in dict.fromkeys(device.id for device in devices if device.script is not None)
    ]


def _empty(effect: EffectDescription, stream: Stream, count: int) -> EffectRecord:
    """Record with ``count`` values of 0; neutral is 0, for warmth the neutral temperature."""
    modality = MODALITIES[effect.modality]
    is_warmth = modality.name == "temperature"
    neutral = neutral_temperature_c(effect.is_contact) if is_warmth else 0.0
    unit = modality.strength_parameter.unit
    return EffectRecord(effect.name, stream, unit, neutral, np.zeros(count))


def _peaks(run: SampleRun, neutral: float) -> F64:
    """Largest strength of each sample of a run over all vertices, (n,); for temperatures the signed
    difference from neutral. 0 for samples without vertices."""
    modality = MODALITIES[run.stream.modality]
    strength = run.parameters[:, modality.parameter_names.index(modality.strength)]
    starts = run.offsets[:-1]
    weights = np.zeros(len(starts))
    # `reduceat` is undefined for empty sets: skip these.
    filled = np.diff(run.offsets) > 0
    if filled.any():
        weights[filled] = np.maximum.reduceat(run.weights, starts[filled])
    # `set_of` is the vertex set of each sample, as several samples may share a set.
    peaks: F64 = weights[run.set_of] * run.levels * (strength - neutral)
    return peaks
