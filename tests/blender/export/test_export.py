# SPDX-License-Identifier: GPL-3.0-or-later
"""Export called as a function: files, report, and the scene afterwards."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import bpy
import hfx_scenes
import numpy as np
import pytest
from hfx_scenes import names_in

from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.samples import Sample
from hfx_blender.engine.tolerance import parse as parse_tolerance
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError, UsageError
from hfx_blender.export.batch import journal
from hfx_blender.export.report import ExportReport
from hfx_blender.export.scene_export import ExportSettings, export_scene, scene_named
from hfx_blender.formats.device_files import haptic
from hfx_blender.formats.written import Written


@pytest.fixture
def small(registered: Any) -> Any:
    return hfx_scenes.small_scene()


def export(scene: Any, folder: Path, **settings: Any) -> ExportReport:
    return export_scene(scene, folder, "x", ExportSettings(**settings))


def felt_at(folder: Path, time_s: float) -> dict[str, Sample]:
    with TrackReader(folder / "x.hfxtrack") as track:
        names = {effect.id: effect.name for effect in track.header.effects}
        return {names[s.stream.effect_id]: s for s in track.samples_at(time_s)}


def test_the_report_is_what_is_on_disk(small: Any, tmp_path: Path) -> None:
    device = load_device("back_pad")
    report = export(small, tmp_path, formats=("track", "csv", "wav"), devices=(device,))
    stored = json.loads((tmp_path / "x.report.json").read_text())
    assert names_in(tmp_path) == sorted(path.name for path in report.files)
    for item in stored["files"]:
        content = (tmp_path / item["name"]).read_bytes()
        assert item["bytes"] == len(content)
        assert item["sha256"] == hashlib.sha256(content).hexdigest()
    assert len(stored["files"]) == len(report.files) - 1  # all but the report itself
    assert stored["engine"]["contacts"] > 0


def test_what_a_device_plays_otherwise_is_noted(small: Any, tmp_path: Path) -> None:
    ball = bpy.data.objects["Ball"].hfx
    ball.amplitude, ball.frequency = 1000.0, 7.0
    devices = load_device("back_pad"), load_device("fan_heater")
    notes = export(small, tmp_path, devices=devices).notes
    cut = "device 'back_pad' cuts effect 'Ball' to an actuator's limits for 0.40 s (100%)"
    assert cut in notes
    assert "device 'back_pad' plays effect 'Ball' at another frequency for 0.40 s (100%)" in notes
    [lacking] = [note for note in notes if "'fan_heater' plays no" in note]
    assert "pressure, vibration" in lacking


@pytest.mark.parametrize(
    ("in_scene", "chosen", "expected"),
    [
        ("STANDARD", None, "standard"),
        ("PAPER", None, "paper"),
        ("CUSTOM", None, "4mm,20ms"),
        ("PAPER", parse_tolerance("7mm,30ms"), "7mm,30ms"),
    ],
)
def test_the_tolerance_is_the_scenes_unless_it_is_chosen(
    small: Any, tmp_path: Path, in_scene: str, chosen: Any, expected: str
) -> None:
    assert small.hfx.tolerance == "STANDARD"
    small.frame_end = 1
    small.hfx.tolerance, small.hfx.tolerance_custom = in_scene, "4mm,20ms"
    report = export(small, tmp_path, tolerance=chosen)
    assert report.engine["tolerance"] == expected
    with TrackReader(tmp_path / "x.hfxtrack") as track:
        assert track.header.settings["tolerance"] == expected


def test_a_tolerance_that_is_none_is_told(small: Any, tmp_path: Path) -> None:
    small.hfx.tolerance, small.hfx.tolerance_custom = "CUSTOM", "a bit"
    with pytest.raises(InputError, match="Scene 'Scene': tolerance 'a bit'"):
        export(small, tmp_path)
    assert names_in(tmp_path) == []


def test_progress_rises_to_the_end(small: Any, tmp_path: Path) -> None:
    small.frame_end = 600
    shares: list[float] = []
    export_scene(small, tmp_path, "x", ExportSettings(), shares.append)
    assert len(shares) > 10 and shares == sorted(shares)
    assert 0.0 < shares[0] and shares[-1] == 1.0


def test_the_scene_is_left_as_it_was(small: Any, tmp_path: Path) -> None:
    small.frame_set(3, subframe=0.25)
    bpy.data.objects["Touch"].select_set(True)
    before = _scene_state(small)
    export(small, tmp_path)
    assert _scene_state(small) == before


@pytest.mark.parametrize("fault", [KeyboardInterrupt, InputError, MemoryError])
def test_a_broken_off_export_leaves_files_and_scene_as_they_were(
    small: Any, tmp_path: Path, fault: type[BaseException]
) -> None:
    small.frame_set(7)
    before = _scene_state(small)

    def stop(_share: float) -> None:
        raise fault("stop")

    with pytest.raises(fault):
        export_scene(small, tmp_path / "out", "x", ExportSettings(), stop)
    assert names_in(tmp_path) == []
    assert _scene_state(small) == before


def _scene_state(scene: Any) -> tuple[object, ...]:
    return (
        scene.frame_current,
        scene.frame_subframe,
        bpy.context.scene.name,
        bpy.context.object.name,
        sorted(obj.name for obj in bpy.context.selected_objects),
        sorted(item.name for item in bpy.data.scenes),
        sorted(item.name for item in bpy.data.objects),
        sorted(collection.name for collection in bpy.data.collections),
    )


def test_a_mesh_is_felt_like_the_box_that_it_is(small: Any, tmp_path: Path) -> None:
    size, position, turn = (0.5, 0.3, 0.7), (0.2, 0.0, 1.1), (0.3, 0.2, 0.1)
    bpy.ops.hfx.add_volume(modality="vibration", shape="CUBOID", name="Box", size=size)
    bpy.context.object.location, bpy.context.object.rotation_euler = position, turn
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=position, rotation=turn)
    bpy.context.object.scale = size
    bpy.ops.hfx.volume_from_mesh(modality="vibration", name="Mesh")
    export(small, tmp_path)
    samples = felt_at(tmp_path, 0.2)
    assert len(samples["Box"].vertices) > 100
    assert samples["Mesh"].vertices.tolist() == samples["Box"].vertices.tolist()
    assert np.allclose(samples["Mesh"].weights, samples["Box"].weights)


def test_what_is_never_on_is_told_as_not_felt(small: Any, tmp_path: Path) -> None:
    for name in ("Ball", "Touch"):
        bpy.context.view_layer.objects.active = bpy.data.objects[name]
        bpy.ops.hfx.add_clip(start=500.0, duration=1.0)
    report = export(small, tmp_path, formats=("track", "csv"), devices=(load_device("back_pad"),))
    assert report.felt == ()
    assert report.unrendered == ()
    assert felt_at(tmp_path, 0.2) == {}
    assert len((tmp_path / "x.back_pad.csv").read_text().splitlines()) == 41


def test_each_body_has_files_of_its_own(small: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.add_avatar()
    second = bpy.context.object
    second.name, second.location = "../no folder", (5, 0, 0)
    report = export(small, tmp_path, formats=("csv",), devices=(load_device("back_pad"),))
    second_name = "%2E.%2Fno folder"
    files = {
        "x/Avatar/back_pad/x.Avatar.back_pad.csv",
        f"x/{second_name}/back_pad/x.{second_name}.back_pad.csv",
    }
    actual = {
        path.relative_to(tmp_path).as_posix() for path in tmp_path.glob("**/*.*") if path.is_file()
    }
    assert actual == {*files, "x.report.json"} and names_in(tmp_path) == ["x", "x.report.json"]
    stored = json.loads((tmp_path / "x.report.json").read_text())
    assert {item["name"] for item in stored["files"]} == files
    assert cli.run(["validate", str(tmp_path / "x.report.json")]) == 0
    assert journal.has_files(stored, tmp_path)
    (tmp_path / min(files)).write_bytes(b"other")
    assert not journal.has_files(stored, tmp_path)
    assert cli.run(["validate", str(tmp_path / "x.report.json")]) == 3
    samples = {(item["effect"], item["body"]): item["seconds"] for item in report.felt}
    assert samples["Ball", "Avatar"] == 0.4 and samples["Ball", "../no folder"] == 0.0
    assert ("Touch", "../no folder") not in samples  # painted on the second body


def test_wav_leaves_out_devices_that_do_not_vibrate(small: Any, tmp_path: Path) -> None:
    devices = (load_device("back_pad"), load_device("fan_heater"))
    report = export(small, tmp_path, formats=("wav",), devices=devices)
    assert "x.back_pad.wav" in names_in(tmp_path)
    assert not [name for name in names_in(tmp_path) if "fan_heater" in name]
    assert any("'fan_heater'" in warning for warning in report.warnings)


def test_a_file_that_would_not_be_valid_is_left_out_and_told(
    small: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gate stands after the writers, as for conversions."""
    chosen = haptic.write_signals

    def write(*arguments: Any) -> Written:
        written = chosen(*arguments)
        written.files[0].write_text('{"version": {"major": 1}}')
        return written

    monkeypatch.setattr(haptic, "write_signals", write)
    report = export(small, tmp_path, formats=("haptic",), devices=(load_device("back_pad"),))
    (messages,) = report.left_out
    name = messages.partition(" ")[0]
    assert name.endswith(".haptic") and "would not be valid, and is not written: " in messages
    assert messages in report.warnings and "HAPTIC-" in messages
    others = [item for item in names_in(tmp_path) if item.endswith(".haptic")]
    assert others and name not in others
    assert names_in(tmp_path) == sorted(path.name for path in report.files)


def test_settings_that_make_no_sense_are_wrong_usage() -> None:
    for settings, word in (
        ({"formats": ("mp3",)}, "mp3"),
        ({"formats": ("csv",)}, "device"),
        ({"formats": ("wav",), "devices": (load_device("fan_heater"),)}, "vibration"),
    ):
        with pytest.raises(UsageError, match=word):
            ExportSettings(**settings)


def test_what_is_named_twice_is_written_once(small: Any, tmp_path: Path) -> None:
    pads = (load_device("back_pad"), load_device("back_pad"))
    report = export(small, tmp_path, formats=("csv", "csv"), devices=pads, frames=(1, 2))
    assert [path.name for path in report.files] == ["x.back_pad.csv", "x.report.json"]
    options = cli.build_parser().parse_args("export x.blend -f csv -f wav,csv".split())
    assert options.formats == ["csv", "wav", "csv"]


def test_another_scene_of_the_file(small: Any, tmp_path: Path) -> None:
    attic = bpy.data.scenes.new("Attic")
    assert scene_named(None) == small and scene_named("Attic") == attic
    with pytest.raises(InputError, match=r"'Cellar'.*'Attic', 'Scene'"):
        scene_named("Cellar")
    for name in ("Avatar", "Avatar Skin", "Ball"):
        attic.collection.objects.link(bpy.data.objects[name])
    attic.frame_start, attic.frame_end, attic.render.fps = 0, 49, 50
    report = export(attic, tmp_path)
    assert [(item["effect"], item["seconds"]) for item in report.felt] == [("Ball", 1.0)]
    assert bpy.context.scene == small


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc")
def test_files_are_on_the_disk_before_they_have_their_names(
    small: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import hfx_blender.files.atomic as atomic_files

    done: list[tuple[str, str]] = []
    real, real_replace = atomic_files.os.fsync, atomic_files.os.replace

    def fsync(descriptor: int) -> None:
        done.append(("synced", Path(f"/proc/self/fd/{descriptor}").resolve().name))
        real(descriptor)

    def replace(file: Path, target: Path) -> None:
        if target.parent == tmp_path:
            done.append(("named", target.name))
        real_replace(file, target)

    monkeypatch.setattr(atomic_files.os, "fsync", fsync)
    monkeypatch.setattr(atomic_files.os, "replace", replace)
    export(small, tmp_path)
    named = [name for what, name in done if what == "named"]
    assert {"x.hfxtrack", "x.report.json"} <= set(named)
    first = done.index(("named", named[0]))
    assert {("synced", name) for name in named} <= set(done[:first])
    assert done[-1] == ("synced", tmp_path.name)
