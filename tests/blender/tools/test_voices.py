# SPDX-License-Identifier: GPL-3.0-or-later
"""Voices of sound sources: files of Speakers, frequencies of effects, and pitch by age."""

from __future__ import annotations

import wave
from fractions import Fraction
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender import cli
from hfx_blender.authoring import clips
from hfx_blender.engine.evaluate import Engine
from hfx_blender.errors import InputError
from hfx_blender.reading.scene_reader import SceneReader
from hfx_tools.spatial_sound.hearing import Hearing
from hfx_tools.spatial_sound.loudspeakers import LAYOUTS, Panner
from hfx_tools.spatial_sound.scene_sound import SoundRecorder, write_sound
from hfx_tools.spatial_sound.sound_settings import SoundSettings
from hfx_tools.spatial_sound.spatial_mix import Reverberators, SoundSource, SpatialMix
from hfx_tools.spatial_sound.speakers import voices_of

OWN = SoundSettings(voices="own")


def wav_file(path: Path, samples: np.ndarray, rate: int = 48_000) -> Path:
    """Write 16 bits with Python's own module."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes((samples * 32767).astype("<i2").tobytes())
    return path


@pytest.fixture
def ball(scene: Any) -> Any:
    scene.frame_start, scene.frame_end = 0, 23
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", radius=0.2, name="Ball")
    effect = bpy.context.object
    effect.location, effect.hfx.frequency = (0.0, -0.6, 1.2), 130.0
    return effect


def speaker(parent: Any, path: Path, name: str = "Speaker") -> Any:
    obj = bpy.data.objects.new(name, bpy.data.speakers.new(name))
    bpy.context.scene.collection.objects.link(obj)
    obj.parent, obj.data.sound = parent, bpy.data.sounds.load(str(path))
    return obj


def sources(settings: SoundSettings) -> list[SoundSource]:
    reader = SceneReader(bpy.context.scene, with_positions=True, with_far=True)
    engine = Engine(reader.description, tolerance=reader.tolerance)
    voices = voices_of(reader.description, reader.found.effects)
    recorder = SoundRecorder(reader.description, settings, voices)
    for block in reader.blocks():
        recorder.add(block, engine.evaluate(block))
    return recorder.sources()


def test_a_volume_sounds_with_the_file_of_its_speaker(ball: Any, tmp_path: Path) -> None:
    samples = np.sin(np.arange(4800) / 7.0) * 0.5
    data = speaker(ball, wav_file(tmp_path / "hum.wav", samples)).data
    data.volume, data.pitch = 0.5, 2.0
    (source,) = sources(OWN)
    assert source.sound == pytest.approx(0.5 * samples, abs=1e-4)
    # A file of 0.1 s at twice the speed: 20 repetitions a second.
    assert source.frequencies_hz == pytest.approx(20.0)
    data.muted = True
    (source,) = sources(OWN)
    assert source.sound is None and source.frequencies_hz == pytest.approx(130.0)


def test_without_a_speaker_the_vibration_gives_the_pitch(ball: Any) -> None:
    (source,) = sources(SoundSettings())
    assert source.frequencies_hz == pytest.approx(SoundSettings().tone_hz(0))
    for frame, hertz in ((0, 200.0), (23, 100.0)):
        ball.hfx.frequency = hertz
        ball.hfx.keyframe_insert("frequency", frame=frame)
    (source,) = sources(OWN)
    assert source.frequencies_hz[0] == pytest.approx(200.0)
    assert (np.diff(source.frequencies_hz) <= 1e-6).all() and source.frequencies_hz[-1] < 101.0
    ball.hfx.modality = "pressure"
    (source,) = sources(OWN)
    assert source.frequencies_hz == pytest.approx(SoundSettings().tone_hz(0))


def test_pitch_falls_along_the_scale_from_each_start(ball: Any) -> None:
    """Pentatonic downwards: C, A, G, E, D, C is 0, 3, 5, 8, 10, 12 semitones down."""
    settings = SoundSettings(voices="own", ageing_s=0.1)
    steps = settings.aged(np.array([0.0, 0.09, 0.1, 0.25, 0.35, 0.45, 0.55, 1.0, 99.0]))
    semitones = [0, 0, 3, 5, 8, 10, 12, 24, 24]
    assert steps == pytest.approx(2.0 ** (-np.array(semitones) / 12.0))
    assert SoundSettings().aged(np.array([5.0])) == pytest.approx(1.0)
    clips.add_clip(ball, 6, 12)
    clips.add_clip(ball, 18, 22)
    (source,) = sources(settings)
    times = np.arange(len(source.frequencies_hz)) / (len(source.frequencies_hz) / 1.0)
    for start_s in (6 / 24, 18 / 24):  # 24 frames a second
        age = times - start_s
        chosen = (age > 0.02) & (age < 0.08)
        assert source.frequencies_hz[chosen] == pytest.approx(130.0)
        chosen = (age > 0.12) & (age < 0.15)
        assert source.frequencies_hz[chosen] == pytest.approx(130.0 * 2 ** (-3 / 12))


def test_a_file_begins_with_its_source_and_repeats() -> None:
    """A click 20 ms into a file of 0.25 s; the source is on from 0.1 s, its ramp from 0.09 s."""
    sound = np.zeros(12_000)
    sound[960] = 1.0
    amplitudes = np.zeros(80)
    amplitudes[10:] = 0.5
    source = SoundSource(
        "click", np.tile([[0.5, 0.0, 0.0]], (80, 1)), amplitudes, np.full(80, 4.0), sound
    )
    layout = LAYOUTS["stereo"]
    panner = Panner(layout, Hearing(), "vbap")
    reverberators = Reverberators(len(layout), 48_000, 0.1)
    mix = SpatialMix([source], panner, reverberators, Fraction(100), 48_000)
    heard = np.abs(np.concatenate(list(mix.blocks(38_400)))).sum(axis=1)
    for second in (0.11, 0.36, 0.61):
        middle = round(48_000 * second)
        assert np.argmax(heard[middle - 3000 : middle + 3000]) == 3000


def test_the_command_writes_own_voices(ball: Any, tmp_path: Path) -> None:
    speaker(ball, wav_file(tmp_path / "hum.wav", np.sin(np.arange(4800) / 7.0)))
    blend = tmp_path / "x.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    files = {}
    for name, arguments in {
        "plain": [],
        "scale": ["--voices", "scale"],
        "own": ["--voices", "own", "--ageing", "0.2"],
    }.items():
        folder = tmp_path / name
        assert cli.run(["sound", str(blend), "-o", str(folder), *arguments]) == 0
        files[name] = (folder / "x.sound.wav").read_bytes()
    assert files["plain"] == files["scale"] != files["own"]
    assert cli.run(["sound", str(blend), "--ageing", "-1"]) == 2


def test_a_missing_file_is_named(ball: Any, tmp_path: Path) -> None:
    path = wav_file(tmp_path / "hum.wav", np.zeros(480))
    speaker(ball, path, "Voice")
    path.unlink()
    with pytest.raises(InputError, match=r"Speaker 'Voice': .*hum.wav"):
        write_sound(bpy.context.scene, tmp_path / "x.sound.wav", OWN)
