# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatial sound of a scene's haptic volumes, heard by the first body.

A volume sounds as loud as its contact envelope, over a quiet part that is audible before contact.
Its voice is a tone of a scale, or the file of a Speaker parented to it, else the frequency of its
vibration; pitch may fall with age (simpleLife, the piece of Politis, Pugliese and Takala). The
sound is in step with the rasters of devices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

import bpy
import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import AnimationBlock, HapticVolume, SceneDescription, SkinBinding
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError
from hfx_blender.files.limits import MEMORY
from hfx_blender.formats.sound import wav
from hfx_blender.reading.scene_reader import SceneReader

from . import sound_file
from .hearing import ListenerFrame
from .loudspeakers import Panner
from .sound_settings import SoundSettings
from .spatial_mix import Reverberators, SoundSource, SpatialMix
from .speakers import Voice, voices_of

Progress = Callable[[float], None]
_VIBRATION: Final = "vibration"
_FREQUENCY: Final = MODALITIES[_VIBRATION].parameter_names.index("frequency_hz")


class SoundRecorder:
    """Recorder of positions, activation and contact of sound sources, block after block.
    ``voices`` are sounds by effect id. Raises InputError for a scene without volumes, or a first
    body without bones."""

    def __init__(
        self,
        scene: SceneDescription,
        settings: SoundSettings,
        voices: Mapping[str, Voice] | None = None,
    ) -> None:
        self._scene = scene
        self._settings = settings
        self._voices = voices or {}
        self._volumes = [
            k for k, effect in enumerate(scene.effects) if isinstance(effect.area, HapticVolume)
        ]
        if not self._volumes:
            raise InputError(
                f"Scene '{scene.source.get('scene', '')}' has no haptic volume that makes sound."
            )
        if not isinstance(scene.bodies[0].binding, SkinBinding):
            raise InputError(
                f"Body '{scene.bodies[0].name}' has no bones, so it cannot be the listener."
            )
        # Any model serves: all are fitted to the same head, whose frame is needed.
        model_id = scene.effects[self._volumes[0]].model_id
        self._listener = ListenerFrame(scene.bodies[0].binding, load_model(model_id))
        count = scene.time.sample_count
        # Three coordinates, two levels and a frequency, float32 each.
        clause = f"{len(self._volumes):,} sources at {count:,} times would take"
        MEMORY.check(
            24.0 * len(self._volumes) * count, f"Scene '{scene.source.get('scene', '')}'", clause
        )
        # Positions in the listener's space; NaN: silent.
        self._positions = np.full((len(self._volumes), count, 3), np.nan, np.float32)
        self._tones = np.zeros((len(self._volumes), count), np.float32)
        self._touches = np.zeros((len(self._volumes), count), np.float32)
        self._hz = np.zeros((len(self._volumes), count), np.float32)
        self._number = {scene.effects[k].id: n for n, k in enumerate(self._volumes)}

    def add(self, block: AnimationBlock, runs: list[SampleRun]) -> None:
        """Record positions relative to the listener, activation and contact of a block, in order of
        time."""
        rows = np.arange(len(block.indices))[block.own]
        pose = block.poses[0]
        rows = rows[pose.valid[rows]]
        at = block.indices[rows]
        if len(rows):
            to_listener = self._listener.frames(pose, rows)
            for n, k in enumerate(self._volumes):
                # Silent samples stay NaN, and :func:`_held` fills them with the last position.
                effect = block.effects[k]
                if effect.matrices is None or not (effect.levels[rows] > 0.0).any():
                    continue
                origins = effect.matrices[rows][:, :, 3:]
                positions = (to_listener @ origins)[:, :3, 0]
                positions[~(effect.levels[rows] > 0.0)] = np.nan
                self._positions[n, at] = positions
                self._tones[n, at] = effect.levels[rows]
                if self._settings.voices == "own" and self._scene.effects[k].modality == _VIBRATION:
                    self._hz[n, at] = effect.parameters[rows, _FREQUENCY]
        self.add_felt(runs)

    def add_felt(self, runs: Iterable[SampleRun]) -> None:
        """Record the contact levels of volumes on the first body."""
        body = self._scene.bodies[0].id
        for run in runs:
            number = self._number.get(run.stream.effect_id)
            if number is not None and run.stream.body_id == body:
                self._touches[number, run.indices] = run.levels

    def sources(self) -> list[SoundSource]:
        """Sound sources of all volumes that are ever on, each with its own tone; a silent volume
        stays at its last position."""
        sources = []
        settings = self._settings
        for n, k in enumerate(self._volumes):
            if np.isnan(self._positions[n]).all():
                continue
            effect = self._scene.effects[k]
            voice = self._voices.get(effect.id)
            amplitudes = settings.tone * self._tones[n] + settings.touch * self._touches[n]
            frequencies = np.full(len(amplitudes), settings.tone_hz(n))
            if voice is not None:
                frequencies[:] = voice.frequency_hz
            elif self._hz[n].any():
                frequencies = _held(np.where(self._hz[n] > 0.0, self._hz[n], np.nan)[:, None])[:, 0]
            sources.append(
                SoundSource(
                    effect.name,
                    _held(self._positions[n].astype(np.float64)),
                    amplitudes.astype(np.float64),
                    frequencies * settings.aged(self._ages_s(n)),
                    None if voice is None else voice.samples,
                )
            )
        return sources

    def _ages_s(self, number: int) -> F64:
        """Time (T,) since a source was last switched on, seconds; 0 while it is off."""
        is_on = self._tones[number] > 0.0
        rows = np.arange(len(is_on))
        last_off = np.maximum.accumulate(np.where(is_on, -1, rows))
        return np.asarray(np.where(is_on, rows - last_off - 1, 0) / float(self._scene.time.rate_hz))

    def write(self, path: Path) -> float:
        """Write the sound; see :func:`.sound_file.write_sound` for the returned value."""
        settings, time = self._settings, self._scene.time
        sources = self.sources()
        panner = Panner(settings.layout, settings.hearing, settings.scheme)
        count = wav.sample_count(time.sample_count, time.rate_hz)

        def blocks() -> Iterator[F64]:
            # A new mix for each pass: long sound is rendered twice (peak, then file), and
            # reverberation has memory.
            reverberators = Reverberators(
                len(settings.layout), wav.RATE_HZ, settings.reverberation_s
            )
            mix = SpatialMix(sources, panner, reverberators, time.rate_hz, wav.RATE_HZ)
            return mix.blocks(count)

        return sound_file.write_sound(
            blocks,
            settings.layout,
            path,
            count=count,
            start_s=float(time.times_s(np.zeros(1, np.int64))[0]),
        )


def _held(rows: F64) -> F64:
    """Fill gaps of NaN in rows (n, k) with the last known row, for sounds that fade out."""
    # Index of the last known row at each row; rows before the first known one take that one.
    known = ~np.isnan(rows).any(axis=1)
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    first = int(np.argmax(known))
    return np.asarray(rows[np.where(last < 0, first, last)])


def write_sound(
    scene: bpy.types.Scene,
    path: Path,
    settings: SoundSettings,
    *,
    track: Path | None = None,
    progress: Progress = lambda share: None,
) -> int:
    """Write the sound of a scene of the open file; returns the number of sources. ``track`` is a
    recording of exactly this scene; None: the scene is evaluated here. Raises InputError for an
    unreadable or silent scene, OutputError for an unwritable file."""
    reader = SceneReader(scene, with_positions=True, with_far=True)
    engine = Engine(reader.description, tolerance=reader.tolerance)
    time = reader.description.time
    samples = wav.sample_count(time.sample_count, time.rate_hz)
    sound_file.refuse_large(settings.layout, path, count=samples)  # before all is evaluated
    is_own = settings.voices == "own"
    voices = voices_of(reader.description, reader.found.effects) if is_own else {}
    recorder = SoundRecorder(reader.description, settings, voices)
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
