# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports of scenes with a device script: each way of export, and the reported facts."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy
import pytest
from hfx_scenes import contents_of, names_in, save, small_scene

from hfx_blender import cli
from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects
from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live import approval
from hfx_blender.engine.track import SUFFIX, TrackReader
from hfx_blender.errors import InputError
from hfx_blender.export.report import describe
from hfx_blender.export.scene_export import ExportSettings, SceneExport, export_scene
from hfx_blender.files import resources
from hfx_blender.files.hashes import sha256_of
from hfx_blender.playback.timeline import timeline_record
from hfx_tools.formats import npz_reader

FRAMES = 60  # at 25 fps and 100 Hz: 244 samples, two chunks of a track
STATEFUL = """
level = 0.0


def render(haptics):
    global level
    level += 0.1 * (sum(haptics.values[::2]) + len(haptics.felt) - level) + 0.001 * haptics.time_s
    return [level % 12.0, 60.0 + level % 90.0] * 8
"""
FAILS = "def render(haptics):\n    return 1 / (haptics.time_s < 1.5) and haptics.values\n"
NAME = "my_band_left"


@pytest.fixture
def folder(registered: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The user's own devices: a band with a script; an avatar in the scene."""
    created = tmp_path / "devices"
    created.mkdir()
    text = (resources.device_configs() / "forearm_band.json").read_text()
    (created / "my_band.json").write_text(text.replace('"forearm_band"', '"my_band"'))
    monkeypatch.setenv("HFX_DEVICES", str(created))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    scene = small_scene(FRAMES)
    scene.hfx.rate = 100.0
    bpy.ops.hfx.add_painted(modality="vibration", name="Buzz")
    bpy.ops.hfx.fill_part(part="forearm", side="both")
    clips.add_clip(bpy.context.object, 5, 45)
    yield created
    bpy.ops.wm.read_homefile(use_empty=True)


def scripted(folder: Path, source: str, *, is_approved: bool = True) -> Any:
    (folder / "my_band.py").write_text(source)
    script = approval.script_of(NAME)
    assert script is not None
    if is_approved:
        approval.approve(script)
    return load_device(NAME)


def settings(*names: str, **more: Any) -> ExportSettings:
    devices = tuple(map(load_device, names))
    return ExportSettings(("track", "csv", "npz", "wav"), devices, threads=1, **more)


def test_the_same_bytes_in_one_go_and_in_parts(folder: Path, tmp_path: Path) -> None:
    scripted(folder, STATEFUL)
    requests = settings(NAME, "peltier_sleeve_left")
    scene = bpy.context.scene
    once = export_scene(scene, tmp_path / "once", "x", requests)
    assert not once.silent_devices
    export_scene(scene, tmp_path / "again", "x", requests)
    export = SceneExport(scene, requests)
    count = export.reader.time.sample_count
    cut = [0, 128, count]
    parts = [
        export.record_part((first, stop), tmp_path / f"{first}{SUFFIX}", tmp_path / f"{first}.npz")
        for first, stop in pairwise(cut)
    ]
    SceneExport(scene, requests).merge_parts(parts, tmp_path / "merged", "x")
    expected = contents_of(tmp_path / "once")
    assert len(expected) == 8  # track; csv, npz, wav with JSON of the band; csv, npz; report
    del expected["x.report.json"]  # counts samples looked at twice
    for second in ("again", "merged"):
        contents = contents_of(tmp_path / second)
        assert {name: contents[name] for name in expected} == expected, second
    raster = npz_reader.read(tmp_path / "once" / f"x.{NAME}.raster.npz")
    assert len(raster.values) == count and raster.values[-1, 0] != raster.values[-2, 0]


def test_the_operator_runs_scripts_of_the_devices_that_a_scene_names(
    folder: Path, tmp_path: Path
) -> None:
    scripted(folder, "def render(haptics):\n    return [2.0, 100.0] * 8\n")
    bpy.context.scene.hfx.devices.add().name = NAME
    bpy.ops.hfx.export(filepath=str(tmp_path / "out" / f"x{SUFFIX}"), formats={"npz"})
    raster = npz_reader.read(tmp_path / "out" / f"x.{NAME}.raster.npz")
    assert (raster.values[:, ::2] == 2.0).all()
    with pytest.raises(RuntimeError, match="may name devices only"):
        bpy.context.scene.hfx.devices.add().name = str(folder / "my_band.json")
        bpy.ops.hfx.export(filepath=str(tmp_path / "no" / f"x{SUFFIX}"), formats={"npz"})


def earlier_files(out: Path) -> tuple[list[str], list[str]]:
    """Files of an earlier export for the band, and unrelated files.

    Unrelated files stay, though the earlier report lists them too.
    """
    mine = [f"x.{NAME}.csv", f"x.Early.{NAME}.raster.npz"]
    theirs = [f"x.{NAME}.wav", "x.insoles.he", f"y.{NAME}.csv", f"../x.{NAME}.he"]
    out.mkdir()
    for name in (*mine, *theirs):
        (out / name).write_text("earlier")
    files = [{"name": name, "sha256": sha256_of(out / name)} for name in (*mine, *theirs)]
    (out / f"x.{NAME}.wav").write_text("by hand")
    listed = {"files": [*files, {"name": f"x.{NAME}.he", "sha256": "gone"}, {"name": 3}, None]}
    (out / "x.report.json").write_text(json.dumps(listed))
    return mine, [name.removeprefix("../") for name in theirs]


@pytest.mark.parametrize(("source", "is_approved"), [(STATEFUL, False), (FAILS, True)])
def test_a_device_whose_script_does_not_run_is_left_out_of_what_is_complete(
    folder: Path, tmp_path: Path, source: str, is_approved: bool
) -> None:
    scripted(folder, source, is_approved=is_approved)
    mine, theirs = earlier_files(tmp_path / "out")
    report = export_scene(bpy.context.scene, tmp_path / "out", "x", settings(NAME, "insoles"))
    names = names_in(tmp_path / "out")
    assert set(mine).isdisjoint(names) and set(theirs) <= {*names, *names_in(tmp_path)}
    assert [name for name in names if "x.my_band" in name] == [f"x.{NAME}.wav"], "changed since"
    assert {f"{name} of an earlier export is removed" for name in mine} <= set(report.notes)
    assert not any(name in note for name in theirs for note in report.notes)
    assert {"x.hfxtrack", "x.insoles.csv", "x.insoles.wav", "x.report.json"} <= set(names)
    (sentence,) = report.silent_devices
    assert sentence in report.warnings
    assert str(folder / "my_band.py") in sentence
    reason = "at 1.500 s (frame 37.5): ZeroDivisionError" if is_approved else "not approved"
    assert reason in sentence
    stored = json.loads((tmp_path / "out" / "x.report.json").read_text())
    assert stored["silent_devices"] == [sentence] and sentence in stored["warnings"]
    assert "insoles.csv" in describe(report)
    with pytest.raises(InputError, match=r"my_band\.py"):
        export_scene(bpy.context.scene, tmp_path / "no", "x", settings(NAME, strict=True))
    assert not names_in(tmp_path / "no")


def test_scripts_begin_anew_with_each_clip_and_fail_for_all_of_them(
    folder: Path, tmp_path: Path
) -> None:
    (_, late), *_ = clips.strips_of(bpy.context.object)
    late.name = "Late"
    clips.add_clip(bpy.context.object, 0, 4).name = "Early"
    scripted(folder, "n = 0\ndef render(h):\n    global n\n    n += 1\n    return [n, 60.0] * 8\n")
    requests = settings(NAME, per_clip=True)
    export_scene(bpy.context.scene, tmp_path / "out", "x", requests)
    for clip in ("Early", "Late"):
        raster = npz_reader.read(tmp_path / "out" / f"x.{clip}.{NAME}.raster.npz")
        assert raster.values[0, 0] == 1.0
    fails = "def render(h):\n    return 1 / (h.time_s < 1.0) and h.values\n"
    requests = settings(scripted(folder, fails).id, "insoles", per_clip=True)
    report = export_scene(bpy.context.scene, tmp_path / "no", "x", requests)
    assert not [name for name in names_in(tmp_path / "no") if "my_band" in name]
    assert "x.Early.insoles.csv" in names_in(tmp_path / "no")
    assert len(report.silent_devices) == 1


def test_the_command_ends_with_5_and_resumes_when_the_script_has_changed(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    source, out = save(tmp_path / "x.blend"), tmp_path / "out"

    def export(to: Path, *more: str) -> int:
        requests = ["-f", "track,csv", "--device", NAME, "--device", "insoles", "--cores", "1"]
        return cli.run(["export", str(source), "-o", str(to), *requests, *more])

    scripted(folder, STATEFUL, is_approved=False)
    assert export(out) == 5
    errors = capfd.readouterr().err
    assert "my_band.py is not approved" in errors
    assert "x.insoles.csv" in names_in(out) and f"x.{NAME}.csv" not in names_in(out)
    assert export(out, "--resume") == 5  # unchanged: the file is still missing
    assert "my_band.py is not approved" in capfd.readouterr().err
    advice = re.search(r"'hfx (device approve .*?)'", errors)
    assert advice is not None and cli.run(shlex.split(advice[1])) == 0
    capfd.readouterr()
    assert export(out, "--resume") == 0
    assert "exported before" not in capfd.readouterr().out
    assert export(out, "--resume") == 0
    assert "exported before" in capfd.readouterr().out
    expected = contents_of(out)
    assert f"x.{NAME}.csv" in expected
    assert export(tmp_path / "jobs", "--jobs", "2", "--split", "32") == 0
    for piece in ("1/2", "2/2"):
        assert export(tmp_path / "pieces", "--piece", piece) == 0
    assert export(tmp_path / "pieces", "--merge") == 0
    del expected["x.report.json"]
    for second in ("jobs", "pieces"):
        contents = contents_of(tmp_path / second)
        assert {name: contents[name] for name in expected} == expected, second
    scripted(folder, "def render(haptics):\n    return [2.0, 100.0] * 8\n")
    assert export(out, "--resume") == 0
    assert (out / f"x.{NAME}.csv").read_bytes() != expected[f"x.{NAME}.csv"]


def test_opening_a_scene_and_looking_at_it_runs_no_script(folder: Path, tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    scripted(folder, f"open({str(mark)!r}, 'w')\ndef render(h):\n    return h.values\n")
    bpy.context.scene.hfx.devices.add().name = NAME
    path = save(tmp_path / "x.blend")
    bpy.ops.wm.open_mainfile(filepath=str(path))
    *_, actual = timeline_record.record(bpy.context.scene, may_step=True)
    assert actual is not None and not mark.exists()
    (note,) = actual.notes
    assert NAME in note and "without its script" in note
    export_scene(bpy.context.scene, tmp_path / "out", "x", settings(NAME))
    assert mark.exists()
    with TrackReader(tmp_path / "out" / f"x{SUFFIX}") as track:
        assert track.header.time.sample_count


def test_a_clip_in_which_nothing_is_felt_and_a_script_without_numbers_are_told(
    folder: Path, tmp_path: Path
) -> None:
    (_, first), *_ = clips.strips_of(bpy.context.object)
    first.name = "Felt"
    far = effects.add_volume(bpy.context.scene, "vibration", "SPHERE")
    far.location.x = 50.0
    clips.add_clip(far, 1, 5).name = "Unfelt"
    scripted(folder, "def render(h):\n    return [float('nan')] * 16\n")
    requests = ExportSettings(("hjif", "csv"), (load_device(NAME),), threads=1, per_clip=True)
    report = export_scene(bpy.context.scene, tmp_path / "out", "x", requests)
    assert "x.Felt.hjif" in names_in(tmp_path / "out")
    assert "x.Unfelt.hjif" not in names_in(tmp_path / "out")
    (sentence,) = report.left_out
    assert "'Unfelt'" in sentence and "HJIF" in sentence and sentence in report.warnings
    assert any("gave no number at" in warning for warning in report.warnings)
    requests = ExportSettings(("csv",), (load_device(NAME),), threads=1, strict=True)
    with pytest.raises(InputError, match="gave no number at"):
        export_scene(bpy.context.scene, tmp_path / "no", "x", requests)
