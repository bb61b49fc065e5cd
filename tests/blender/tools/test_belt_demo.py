# SPDX-License-Identifier: GPL-3.0-or-later
"""The belt's demo, small: contents, contacts, sound, and synchronous timing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from scipy.io import wavfile

from hfx_blender.authoring.effects import effects
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.track import TrackHeader
from hfx_blender.errors import InputError, UsageError
from hfx_blender.files import limits
from hfx_blender.formats.sound import wav
from hfx_blender.reading.scene_reader import SceneReader
from hfx_tools.demo import belt, demo_charts
from hfx_tools.spatial_sound import scene_sound
from hfx_tools.spatial_sound.loudspeakers import LAYOUTS, parse
from hfx_tools.spatial_sound.scene_sound import SoundRecorder, write_sound
from hfx_tools.spatial_sound.sound_settings import SoundSettings


def test_the_scene_holds_a_walker_with_a_belt_and_a_swarm(registered: Any) -> None:
    scene = belt.build(particles=6, duration_s=0.5)
    assert [device.name for device in scene.hfx.devices] == ["waist_belt"]
    assert len(effects.bodies_of(scene)) == 1 and not effects.effects_of(scene)
    reader = SceneReader(scene)
    kinds = [[item.kind for item in e.area.response] for e in reader.description.effects]
    assert kinds and all(kind == ["impact", "proximity"] for kind in kinds)


@pytest.fixture
def standing(scene: Any) -> Any:
    """A standing body, and a ball circling the waist at a hand's breadth in two seconds."""
    scene.render.fps = 25
    scene.frame_start, scene.frame_end = 0, 49
    scene.hfx.rate = 50.0
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", radius=0.05, name="Ball")
    ball = bpy.context.object
    bpy.ops.hfx.add_response_filter(kind="proximity")
    ball.hfx.response[0].reach, ball.hfx.response[0].influence = 0.2, 1.0
    pivot = bpy.data.objects.new("Pivot", None)
    scene.collection.objects.link(pivot)
    pivot.location = (0.0, -0.05, 1.08)
    ball.parent = pivot
    ball.location = (0.0, -0.25, 0.0)  # before the belly
    for frame, turn in ((0, 0.0), (50, 2.0 * np.pi)):
        pivot.rotation_euler[2] = turn
        pivot.keyframe_insert("rotation_euler", index=2, frame=frame)
    from hfx_blender.blender import compat

    for curve in compat.fcurves(pivot):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    return scene


def test_what_circles_the_waist_goes_round_the_belt_and_the_loudspeakers(
    standing: Any, tmp_path: Path
) -> None:
    reader = SceneReader(standing)
    engine, device = Engine(reader.description), load_device("waist_belt")
    models = {e.model_id: load_model(e.model_id) for e in reader.description.effects}
    header = TrackHeader.of(reader.description, models, settings={}, tools={})
    renderer = Renderer(header, device, load_model)
    layout = LAYOUTS["ring8"]
    recorder = SoundRecorder(reader.description, SoundSettings(layout=layout, reverberation_s=0.1))
    for block in reader.blocks():
        runs = engine.evaluate(block)
        renderer.add(runs)
        recorder.add(block, runs)
    raster = renderer.raster()
    path = tmp_path / "ball.sound.wav"
    recorder.write(path)
    rate, heard = wavfile.read(path)
    rows = len(raster.values)
    assert heard.shape == (wav.sample_count(rows, raster.rate_hz, rate), 8)
    assert len(heard) / rate == pytest.approx(rows / float(raster.rate_hz))
    strengths = raster.values[:, ::2]
    assert [column.actuator for column in raster.columns[::2]] == [
        "front", "front_left", "left", "back_left", "back", "back_right", "right", "front_right",
    ]  # fmt: skip
    frames = heard.reshape(rows, -1, 8).astype(float)
    loudness = np.sqrt(np.square(frames).mean(axis=1))
    for eighth in range(8):
        row = rows * eighth // 8  # turning from the front to the left, as the ring counts
        assert np.argmax(loudness[row + 1]) == eighth
        assert eighth in np.argsort(strengths[row + 1])[-2:]
    demo_charts.draw_belt(raster, path, layout, tmp_path / "belt.svg")
    drawn = (tmp_path / "belt.svg").read_text()
    assert drawn.count("front_left") == 1 and "+45°" in drawn


def test_sources_are_as_loud_as_they_are_felt(standing: Any) -> None:
    reader = SceneReader(standing)
    engine = Engine(reader.description)
    settings = SoundSettings(tone=0.0, touch=1.0)
    recorder = SoundRecorder(reader.description, settings)
    expected = np.zeros(reader.time.sample_count)
    for block in reader.blocks():
        runs = engine.evaluate(block)
        recorder.add(block, runs)
        for run in runs:
            expected[run.indices] = run.levels
    (source,) = recorder.sources()
    np.testing.assert_allclose(source.amplitudes, expected, atol=1e-6)
    assert expected.any()
    distances = np.linalg.norm(source.places_m, axis=1)
    assert ((distances > 0.1) & (distances < 0.6)).all()


def test_sound_that_no_file_holds_is_refused_before_it_is_made(
    standing: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    standing.frame_end = standing.frame_start + 24 * 9000  # 64 channels of 9000 s: 77 GiB
    monkeypatch.setattr(Engine, "evaluate", lambda *block: pytest.fail("evaluated"))
    settings = SoundSettings(layout=parse(",".join(map(str, range(64)))))
    with pytest.raises(InputError, match=r"64 channels of .*4 GiB at most"):
        write_sound(standing, tmp_path / "x.sound.wav", settings)
    monkeypatch.setattr(scene_sound, "MEMORY", limits.Limit(1e6, "bytes"))
    with pytest.raises(limits.TooLargeError, match=r"1 sources at .* would take"):
        write_sound(standing, tmp_path / "x.sound.wav", SoundSettings())
    assert not list(tmp_path.iterdir())


def test_options_of_the_sound_that_make_no_sense_are_wrong_usage() -> None:
    from hfx_blender.cli import build_parser
    from hfx_tools.commands.sound import settings_of

    parser = build_parser()
    for arguments in (
        ["--loudspeakers", "sixty"],
        ["--reference", "0"],
        ["--audible", "nan"],
        ["--reference", "1e-300"],
        ["--audible", "1e300"],
        ["--air", "1e300"],
        ["--loudspeakers", ",".join(map(str, range(65)))],
        ["--loudspeakers", "cube8", "--panning", "ring"],
    ):
        with pytest.raises(UsageError):
            settings_of(parser.parse_args(["sound", "x.blend", *arguments]))
