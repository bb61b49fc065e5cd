# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatial sound of a scene's haptic volumes, each a source, for the first body.

A source sounds as strongly as it is felt (its contact envelope), over a quiet tone of its own by
which it is heard before. It is written in step with the rasters of devices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

from ..engine.arrays import F64
from ..engine.body.model import load_model
from ..engine.evaluate import Engine
from ..engine.samples import SampleRun
from ..engine.scene import AnimationBlock, HapticVolume, SceneDescription, SkinBinding
from ..engine.spatial_sound.hearing import Hearing, ListenerFrame
from ..engine.spatial_sound.layouts import LAYOUTS, LoudspeakerLayout
from ..engine.spatial_sound.panner import Panner, Scheme
from ..engine.spatial_sound.reverberation import Reverberators
from ..engine.spatial_sound.spatial_mix import SoundSource, SpatialMix
from ..engine.track import TrackReader
from ..errors import InputError
from ..files.limits import MEMORY
from ..formats.sound import sound_wav
from ..reading.scene_reader import SceneReader

Progress = Callable[[float], None]


@dataclass(frozen=True)
class SoundSettings:
    """Settings of a scene's sound."""

    layout: LoudspeakerLayout = LAYOUTS["stereo"]
    scheme: Scheme = "vbap"
    hearing: Hearing = field(default_factory=Hearing)
    lowest_hz: float = 220.0  # of the sources' tones, which are spread over a pentatonic scale
    octaves: int = 2
    tone: float = 0.015  # of passing sources; touches add to it
    touch: float = 0.5
    reverberation_s: float = 1.4


class SoundRecorder:
    """Recorder of the motion and strength of sources, block after block.

    Raises
    ------
    InputError
        Nothing can sound: there is no volume, or nobody who hears it.
    """

    def __init__(self, scene: SceneDescription, settings: SoundSettings) -> None:
        self._scene = scene
        self._settings = settings
        self._volumes = [
            k for k, each in enumerate(scene.effects) if isinstance(each.area, HapticVolume)
        ]
        if not self._volumes:
            raise InputError(
                f"Scene '{scene.source.get('scene', '')}' has no haptic volume that makes sound."
            )
        if not isinstance(scene.bodies[0].binding, SkinBinding):
            raise InputError(
                f"Body '{scene.bodies[0].name}' has no bones, so it cannot be the listener."
            )
        model_id = scene.effects[self._volumes[0]].model_id
        self._listener = ListenerFrame(scene.bodies[0].binding, load_model(model_id))
        count = scene.time.sample_count
        what = f"{len(self._volumes):,} sources at {count:,} times would take"
        MEMORY.check(
            20.0 * len(self._volumes) * count, f"Scene '{scene.source.get('scene', '')}'", what
        )
        self._places = np.full((len(self._volumes), count, 3), np.nan, np.float32)
        self._tones = np.zeros((len(self._volumes), count), np.float32)
        self._touches = np.zeros((len(self._volumes), count), np.float32)
        self._number = {scene.effects[k].id: n for n, k in enumerate(self._volumes)}

    def add(self, block: AnimationBlock, runs: list[SampleRun]) -> None:
        """Add the next block, with its samples."""
        rows = np.arange(len(block.indices))[block.own]
        pose = block.poses[0]
        rows = rows[pose.valid[rows]]
        at = block.indices[rows]
        if len(rows):
            to_listener = self._listener.frames(pose, rows)
            for n, k in enumerate(self._volumes):
                effect = block.effects[k]
                if effect.matrices is None or not (effect.levels[rows] > 0.0).any():
                    continue
                origins = effect.matrices[rows][:, :, 3:]
                places = (to_listener @ origins)[:, :3, 0]
                places[~(effect.levels[rows] > 0.0)] = np.nan
                self._places[n, at] = places
                self._tones[n, at] = effect.levels[rows]
        self.add_felt(runs)

    def add_felt(self, runs: Iterable[SampleRun]) -> None:
        """Add samples: what is felt is heard, too."""
        body = self._scene.bodies[0].id
        for run in runs:
            found = self._number.get(run.stream.effect_id)
            if found is not None and run.stream.body_id == body:
                self._touches[found, run.indices] = run.levels

    def sources(self) -> list[SoundSource]:
        """Sound sources, each with a tone of its own."""
        made = []
        settings = self._settings
        steps = (0, 2, 4, 7, 9)  # major pentatonic
        for n, k in enumerate(self._volumes):
            if np.isnan(self._places[n]).all():
                continue
            octave, step = divmod(n * 2 % (len(steps) * settings.octaves), len(steps))
            # A little out of tune, each in its own way: alike tones would cancel each other.
            cents = (n * 0.618034 % 1.0 - 0.5) * 0.4
            tone = settings.lowest_hz * 2.0 ** (octave + (steps[step] + cents) / 12.0)
            amplitudes = settings.tone * self._tones[n] + settings.touch * self._touches[n]
            made.append(
                SoundSource(
                    self._scene.effects[k].name,
                    _held(self._places[n].astype(np.float64)),
                    amplitudes.astype(np.float64),
                    np.full(len(amplitudes), tone),
                )
            )
        return made

    def write(self, path: Path) -> float:
        """Write the sound; see :func:`sound_wav.write`."""
        settings, time = self._settings, self._scene.time
        sources = self.sources()
        panner = Panner(settings.layout, settings.hearing, settings.scheme)
        count = sound_wav.sample_count(time.sample_count, time.rate_hz)

        def blocks() -> Iterator[F64]:
            reverberators = Reverberators(
                len(settings.layout), sound_wav.RATE_HZ, settings.reverberation_s
            )
            mix = SpatialMix(sources, panner, reverberators, time.rate_hz, sound_wav.RATE_HZ)
            return mix.blocks(count)

        return sound_wav.write(
            blocks,
            settings.layout,
            path,
            count=count,
            start_s=float(time.times_s(np.zeros(1, np.int64))[0]),
        )


def _held(places: F64) -> F64:
    """Places with gaps filled by the last known one: a sound fades out where it was."""
    known = ~np.isnan(places).any(axis=1)
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    first = int(np.argmax(known))
    return np.asarray(places[np.where(last < 0, first, last)])


def write_sound(
    scene: bpy.types.Scene,
    path: Path,
    settings: SoundSettings,
    *,
    track: Path | None = None,
    progress: Progress = lambda share: None,
) -> int:
    """Write the sound of a scene of the open file as ``path``; returns the number of sources.

    ``track`` holds what is felt of just this scene, if it has been recorded already.

    Raises
    ------
    InputError
        The scene cannot be read, or nothing of it sounds.
    OutputError
        The file cannot be written.
    """
    reader = SceneReader(scene, with_positions=True, with_far=True)
    engine = Engine(reader.description, tolerance=reader.tolerance)
    time = reader.description.time
    samples = sound_wav.sample_count(time.sample_count, time.rate_hz)
    sound_wav.refuse_large(settings.layout, path, count=samples)  # before all is evaluated
    recorder = SoundRecorder(reader.description, settings)
    count = max(len(reader.sample_indices), 1)
    done = 0
    for block in reader.blocks():
        recorder.add(block, engine.evaluate(block) if track is None else [])
        done += len(block.own_indices)
        progress(done / count)
    if track is not None:
        with TrackReader(track) as recorded:
            recorder.add_felt(recorded.runs())
    recorder.write(path)
    return len(recorder.sources())
