# SPDX-License-Identifier: GPL-3.0-or-later
"""Feel This Sound: an effect with a clip that follows a sound strip or a file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from scipy.io import wavfile

from hfx_blender.authoring import clips, media
from hfx_blender.authoring.effects import effects
from hfx_blender.blender import compat
from hfx_blender.errors import InputError

pytestmark = pytest.mark.skipif(
    not bpy.app.build_options.audaspace, reason="this Blender is built without Audaspace"
)


def test_a_blender_without_sound_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "aud", None)
    with pytest.raises(InputError, match="built without sound"):
        media.sound_of(tmp_path / "x.wav")


@pytest.fixture
def beats(tmp_path: Path) -> Path:
    """Four seconds: at 1, 2 and 3 s a beat that decays, of 200 Hz."""
    t = np.arange(4 * 8000) / 8000
    sound = np.exp(-(t % 1.0) / 0.15) * np.sin(2.0 * np.pi * 200.0 * t) * (t >= 1.0)
    wavfile.write(tmp_path / "beats.wav", 8000, (sound * 20_000).astype(np.int16))
    return tmp_path / "beats.wav"


def activation(effect: bpy.types.Object, frames: np.ndarray) -> np.ndarray:
    ((_, strip),) = clips.strips_of(effect)
    return np.array([clips.activation_at(strip, frame - strip.frame_start) for frame in frames])


@pytest.fixture
def body(scene: Any) -> Any:
    scene.render.fps = 100
    scene.frame_end = 600
    bpy.ops.hfx.add_avatar()
    return scene


def test_a_file_is_felt_from_the_current_frame_on(body: Any, beats: Path) -> None:
    body.frame_set(51)
    assert bpy.ops.hfx.feel_sound(filepath=str(beats), part="fingers") == {"FINISHED"}
    effect = bpy.context.object
    assert effect.name == "beats" and len(effects.area(effect)[0]) > 0
    frames = np.arange(100.0, 440.0)
    since = (frames - 51.0) / 100.0
    expected = np.exp(-(since % 1.0) / 0.15) * (since >= 1.0)
    assert np.corrcoef(activation(effect, frames), expected)[0, 1] > 0.95
    # The logarithm of 200 Hz over 20 to 8000 Hz, which span 65 to 300 Hz.
    hertz = 65.0 + 235.0 * np.log(200.0 / 20.0) / np.log(8000.0 / 20.0)
    ((_, strip),) = clips.strips_of(effect)
    curve = clips.curve_in(strip, "hfx.frequency")
    assert curve is not None and curve.evaluate(strip.action_frame_start + 230.0) == pytest.approx(
        hertz, abs=5.0
    )


def test_a_trimmed_strip_is_felt_where_it_lies(body: Any, beats: Path) -> None:
    body.frame_set(11)
    bpy.ops.hfx.add_sound(filepath=str(beats))
    (strip,) = compat.strips(body.sequence_editor)
    strip.frame_offset_start = 150  # the first beat and half a second are cut
    strip.frame_start += 100
    assert strip.frame_final_start == 261
    assert bpy.ops.hfx.feel_sound(strip=strip.name, place="POINT", strength=0.5) == {"FINISHED"}
    effect = bpy.context.object
    assert effect.hfx.kind == "SPOT"
    ((_, clip),) = clips.strips_of(effect)
    assert clip.frame_start == pytest.approx(261.0, abs=0.01)
    frames = np.arange(262.0, 400.0)
    values = activation(effect, frames)
    assert values.max() == pytest.approx(0.5, abs=0.07)
    assert abs(frames[values.argmax()] - (261 + 50)) <= 2.0, "the second beat, 2 s into the sound"
    clip_end = clip.frame_end
    assert clip_end == pytest.approx(261 + 250, abs=1.0)


def test_a_clip_is_added_to_the_active_effect_of_any_modality(body: Any, beats: Path) -> None:
    bpy.ops.hfx.add_on_part(modality="pressure", part="fingers")
    effect = bpy.context.object
    bpy.ops.hfx.feel_sound(filepath=str(beats), place="EFFECT")
    ((_, strip),) = clips.strips_of(effect)
    assert clips.curve_in(strip, "hfx.frequency") is None, "a pressure has no frequency"
    assert clips.curve_in(strip, "hfx.activation") is not None


def test_what_cannot_be_followed_is_named(body: Any, beats: Path, tmp_path: Path) -> None:
    (tmp_path / "text.wav").write_text("no sound")
    wavfile.write(tmp_path / "silence.wav", 8000, np.zeros(8000, np.int16))
    before = len(body.objects)
    for arguments, message in (
        ({"filepath": str(tmp_path / "text.wav")}, "cannot be read as a sound"),
        ({"filepath": str(tmp_path / "silence.wav")}, "is silent"),
        ({"filepath": str(tmp_path / "gone.wav")}, "there is no such file"),
        ({"strip": "gone"}, "no sound strip"),
        ({"filepath": str(beats), "frequencies": (300.0, 60.0)}, "must exceed"),
        ({"filepath": str(beats), "band": (300.0, 60.0)}, "must exceed"),
    ):
        with pytest.raises(RuntimeError, match=message):
            bpy.ops.hfx.feel_sound(**arguments)
    assert len(body.objects) == before
