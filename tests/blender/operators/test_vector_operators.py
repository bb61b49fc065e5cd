# SPDX-License-Identifier: GPL-3.0-or-later
"""Vector sensations in Blender: sliders, keyframes, export to a single device, files, formats."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender import cli
from hfx_blender.authoring.effects import effect_exchange, effect_file
from hfx_blender.authoring.paths import vector_sensations
from hfx_blender.devices.configuration import load_device
from hfx_blender.errors import InputError
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.playback.preview.preview_layers import Preview
from hfx_tools.formats.npz_reader import read as read_npz


@pytest.fixture
def vector(scene: Any) -> Any:
    scene.render.fps = 25
    scene.frame_start, scene.frame_end = 0, 24
    scene.frame_set(0)
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_vector_sensation(device="mango_pad", name="Curves")
    return bpy.context.object


def _strengths(folder: Path, device: str) -> np.ndarray:
    """Intended strengths: the pad's tactors answer 10 ms late and get their values a row
    earlier.
    """
    raster = read_npz(folder / f"a.{device}.raster.npz")
    values = np.roll(raster.values, 1, axis=0)
    return values[1:, [c.parameter == "amplitude_m_s2" for c in raster.columns]]


def test_a_new_one_has_a_slider_for_each_actuator_and_is_silent(vector: Any) -> None:
    device = load_device("mango_pad")
    assert [item.name for item in vector.hfx.drive] == [
        actuator.id for actuator in device.actuators
    ]
    assert vector.hfx.amplitude == device.actuators[0].type.strength.highest
    assert not any(item.value for item in vector.hfx.drive)
    with pytest.raises(RuntimeError, match="no actuator for temperature"):
        bpy.ops.hfx.add_vector_sensation(device="mango_pad", modality="temperature")


def test_it_needs_a_body(scene: Any) -> None:
    assert not bpy.ops.hfx.add_vector_sensation.poll()
    assert not bpy.ops.hfx.key_actuators.poll()


def test_curves_reach_their_actuators_and_no_other_device(vector: Any, tmp_path: Path) -> None:
    vector_sensations.set_curve(vector, "r1c2", [(0, 0.0), (12, 1.0), (24, 0.0)])
    vector.hfx.drive["r3c3"].value = 0.25
    vector.hfx.amplitude, vector.hfx.intensity = 8.0, 0.5
    devices = tuple(load_device(name) for name in ("mango_pad", "waist_belt"))
    report = export_scene(
        bpy.context.scene, tmp_path, "a", ExportSettings(formats=("npz",), devices=devices)
    )
    pad = _strengths(tmp_path, "mango_pad")
    ids = [actuator.id for actuator in devices[0].actuators]
    frames = np.arange(1, 100) / 4.0
    expected = 8.0 * 0.5 * np.clip(1.0 - np.abs(frames - 12.0) / 12.0, 0.0, 1.0)
    assert pad[:, ids.index("r1c2")] == pytest.approx(expected, abs=1e-5)
    assert pad[:, ids.index("r3c3")] == pytest.approx(1.0)
    others = [k for k, item in enumerate(ids) if item not in ("r1c2", "r3c3")]
    assert not pad[:, others].any() and not _strengths(tmp_path, "waist_belt").any()
    assert report.engine["stepping"] == "sampled F-curves, stepped no scene"
    assert not report.unrendered  # the pad plays every channel
    alone = export_scene(
        bpy.context.scene, tmp_path, "b", ExportSettings(formats=("npz",), devices=devices[1:])
    )
    assert [item["effect"] for item in alone.unrendered] == ["Curves"]


def test_a_driven_slider_is_read_by_stepping(vector: Any, tmp_path: Path) -> None:
    driver = vector.driver_add("hfx.drive[0].value").driver
    driver.expression = "frame / 100"
    device = load_device("mango_pad")
    export_scene(
        bpy.context.scene, tmp_path, "a", ExportSettings(formats=("npz",), devices=(device,))
    )
    strength = _strengths(tmp_path, "mango_pad")[3::4, 0]
    assert strength == pytest.approx(vector.hfx.amplitude * np.arange(1, 25) / 100, abs=1e-5)


def test_all_actuators_are_keyed_at_once(vector: Any) -> None:
    bpy.ops.hfx.key_actuators(value=0.5)
    bpy.context.scene.frame_set(10)
    bpy.ops.hfx.key_actuators(value=0.0)
    bpy.context.scene.frame_set(5)
    assert all(0.1 < item.value < 0.4 for item in vector.hfx.drive)


def test_it_is_saved_and_loaded_with_its_curves(vector: Any, tmp_path: Path) -> None:
    vector_sensations.set_curve(vector, "r2c1", [(10, 0.0), (20, 1.0)])
    vector.hfx.drive["r1c1"].value = 0.75
    file = tmp_path / "v.hfxeffect"
    bpy.ops.hfx.save_effects(filepath=str(file))
    sensation = effect_file.load(file)
    effect_file.save(sensation, tmp_path / "again.hfxeffect")
    assert effect_file.load(tmp_path / "again.hfxeffect") == sensation
    body = vector.hfx.body
    (created,) = effect_exchange.place_sensation(
        bpy.context.scene, sensation, body=body, frame=100.0
    )
    assert created.hfx.device == "mango_pad" and created.hfx.drive["r1c1"].value == 0.75
    bpy.context.scene.frame_set(105)
    assert created.hfx.drive["r2c1"].value == pytest.approx(0.5)


def test_it_cannot_be_without_a_device(vector: Any, tmp_path: Path) -> None:
    vector.hfx.drive.clear()
    with pytest.raises(InputError, match="'Curves' drives no actuators"):
        export_scene(bpy.context.scene, tmp_path, "a", ExportSettings())
    with pytest.raises(InputError, match="has no actuator 'x'; it has: none"):
        vector_sensations.set_curve(vector, "x", [(0, 1.0)])


def test_the_viewport_is_coloured_by_points_and_not_by_curves(vector: Any) -> None:
    vector.hfx.drive[0].value = 1.0
    preview = Preview()
    preview.describe(bpy.context)
    assert preview.layers("PAPER") == [] and not preview.fault
    bpy.ops.hfx.add_spot(modality="vibration")
    bpy.context.view_layer.update()
    preview.invalidate()
    preview.describe(bpy.context)
    (layer,) = preview.layers("PAPER")
    shown = layer.positions[layer.shown.colours[:, 3] > 0]
    assert len(shown) and np.abs(shown - [0.0, 0.047, 1.25]).max() < 0.12


def test_every_format_of_samples_takes_points_and_curves(vector: Any, tmp_path: Path) -> None:
    vector.hfx.drive[0].value = 1.0
    bpy.ops.hfx.add_spot(modality="vibration", name="Point")
    bpy.ops.hfx.path_from_library(name="across_back")
    bpy.ops.hfx.move_along_path(seconds=1.0)
    export_scene(
        bpy.context.scene,
        tmp_path,
        "a",
        ExportSettings(formats=("track", "jsonl", "hjif", "glb"), record=("positions",)),
    )
    written = [str(path) for path in tmp_path.iterdir() if path.suffix in (".jsonl", ".hjif")]
    assert len(written) == 2 and cli.run(["validate", *written]) == 0
    lines = [json.loads(line) for line in (tmp_path / "a.samples.jsonl").read_text().splitlines()]
    assert [effect["kind"] for effect in lines[0]["effects"]] == ["actuators", "spot"]
    hjif = json.loads((tmp_path / "a.hjif").read_text())
    text = json.dumps(hjif)
    assert "Point" in text and "Curves" not in text


def test_info_tells_what_they_are(
    vector: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bpy.ops.hfx.add_spot(modality="pressure", name="Point")
    bpy.ops.hfx.path_from_library(name="along_spine")
    file = tmp_path / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    capsys.readouterr()
    assert cli.run(["info", str(file), "--json"]) == 0
    (scene,) = json.loads(capsys.readouterr().out)["scenes"]
    curves, point = scene["effects"]
    assert (curves["kind"], curves["device"], curves["actuators"]) == (
        "actuators",
        "mango_pad",
        10,
    )
    assert point["kind"] == "spot" and 0.4 < point["path_m"] < 0.6
