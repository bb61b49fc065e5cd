# SPDX-License-Identifier: GPL-3.0-or-later
"""A named device without a valid file costs only the device's output, not the scene."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest
from hfx_scenes import names_in, save, small_scene

from hfx_blender import cli
from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects
from hfx_blender.devices.configuration import load_device
from hfx_blender.errors import InputError
from hfx_blender.export.scene_export import ExportSettings, SceneExport, export_scene
from hfx_blender.files import resources


@pytest.fixture
def scene(registered: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Name an unknown device, a damaged device file and a valid device."""
    folder = tmp_path / "devices"
    folder.mkdir()
    (folder / "torn.json").write_text('{"id": ')
    monkeypatch.setenv("HFX_DEVICES", str(folder))
    created = small_scene(4)
    for name in ("no\x1bbody", "torn", "back_pad"):
        created.hfx.devices.add().name = name
    yield created
    bpy.ops.wm.read_homefile(use_empty=True)


def test_the_command_writes_the_rest_and_ends_with_5(
    scene: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    source, out = save(tmp_path / "x.blend"), tmp_path / "out"
    requests = ["export", str(source), "--cores", "1"]
    assert cli.run([*requests, "-o", str(out)]) == 5
    errors = capfd.readouterr().err
    assert r"'no\x1bbody' plays nothing" in errors and "torn.json" in errors
    assert names_in(out) == ["x.back_pad.csv", "x.hfxtrack", "x.report.json"]
    report = json.loads((out / "x.report.json").read_text())
    assert len(report["silent_devices"]) == 2
    assert set(report["silent_devices"]) <= set(report["warnings"])
    assert cli.run([*requests, "-o", str(out), "--resume"]) == 5
    assert "exported before" not in capfd.readouterr().out
    assert cli.run([*requests, "-o", str(tmp_path / "no"), "--strict"]) == 3
    assert "is unknown" in capfd.readouterr().err and names_in(tmp_path / "no") == []


def test_what_only_a_missing_device_could_play_is_refused_or_left_out(
    scene: Any, tmp_path: Path
) -> None:
    scene.hfx.devices.remove(2)
    path = tmp_path / "out" / "x.hfxtrack"
    bpy.ops.hfx.export(filepath=str(path), formats={"track", "wav"})
    assert names_in(path.parent) == ["x.hfxtrack", "x.report.json"]
    with pytest.raises(RuntimeError, match=r"is unknown.*torn\.json"):
        bpy.ops.hfx.export(filepath=str(path), formats={"wav"})


def test_a_device_that_fits_no_body_costs_itself(scene: Any, tmp_path: Path) -> None:
    text = (resources.device_configs() / "insoles.json").read_text()
    far = json.loads(text.replace('"insoles"', '"far"'))
    far["actuators"][0]["place"]["placement"]["centre_m"] = [0.0, 2.5, 0.0]
    (tmp_path / "devices" / "far.json").write_text(json.dumps(far))
    effects.add_volume(scene, "vibration", "SPHERE")
    devices = tuple(map(load_device, ("far", "back_pad")))
    report = export_scene(scene, tmp_path / "out", "x", ExportSettings(("csv",), devices))
    (sentence,) = report.silent_devices
    assert "device 'far' plays nothing" in sentence and "centre_m [0.0, 2.5, 0.0]" in sentence
    assert names_in(tmp_path / "out") == ["x.back_pad.csv", "x.report.json"]


def test_effects_without_a_clip_are_told_of_where_clips_are_written(
    scene: Any, tmp_path: Path
) -> None:
    clips.add_clip(bpy.data.objects["Touch"], 1, 3)
    settings = ExportSettings(per_clip=True, threads=1)
    report = export_scene(scene, tmp_path / "out", "x", settings)
    (sentence,) = [warning for warning in report.warnings if "--per-clip" in warning]
    assert sentence.endswith("1 (Ball)")
    with pytest.raises(InputError, match=r"1 \(Ball\)"):
        SceneExport(scene, ExportSettings(per_clip=True, strict=True))
