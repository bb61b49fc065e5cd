# SPDX-License-Identifier: GPL-3.0-or-later
"""Invalid input of an export: one clear line each, exit code 3, and no written file."""

from __future__ import annotations

import errno
import os
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import hfx_scenes
import pytest
from hfx_scenes import names_in, process

from hfx_blender import cli

NAN = float("nan")
Change = Callable[[], object]


@pytest.fixture(scope="module")
def good_blend(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene()
    return hfx_scenes.save(tmp_path_factory.mktemp("good") / "good.blend")


def export(path: Path, folder: Path, *more: str) -> int:
    return cli.run(["export", str(path), "-o", str(folder), *more])


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Function exporting an invalid file: the single line of the message."""

    def tell(path: Path, *more: str) -> str:
        capsys.readouterr()  # output of the file's creation
        assert export(path, tmp_path / "out", *more) == 3
        out, err = capsys.readouterr()
        assert out == ""
        assert len(err.splitlines()) == 1, err
        assert not (tmp_path / "out").exists()
        return err

    return tell


# Files


def test_files_that_are_no_scenes(
    good_blend: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    content = good_blend.read_bytes()
    (tmp_path / "folder.blend").mkdir()
    for name, wrong in {
        "empty": b"",
        "garbage": bytes(range(256)) * 20,
        "cut": content[: len(content) // 2],
        "head": content[:20],
        "text": b"BLENDER-v405 but not really",
    }.items():
        (tmp_path / f"{name}.blend").write_bytes(wrong)
        line = refused(tmp_path / f"{name}.blend")
        assert line.count(f"{name}.blend") == 1 and "cannot open" in line
    assert "no such file" in refused(tmp_path / "missing.blend")
    assert "folder" in refused(tmp_path / "folder.blend")


def test_blenders_own_words_about_a_broken_file_stay_away(tmp_path: Path) -> None:
    (tmp_path / "broken.blend").write_bytes(b"BLENDER")
    done = process("export", "broken.blend", "-o", "out", cwd=tmp_path)
    assert done.returncode == 3 and done.stdout == ""
    assert len(done.stderr.splitlines()) == 1 and "Traceback" not in done.stderr


# Scenes


def _objects() -> Any:
    return bpy.data.objects


def _without(*names: str) -> Change:
    def change() -> None:
        for name in names:
            _objects().remove(_objects()[name])

    return change


def _setting(name: str, **values: object) -> Change:
    def change() -> None:
        for key, value in values.items():
            setattr(_objects()[name].hfx, key, value)

    return change


def _area(vertices: list[int], weights: list[float]) -> Change:
    def change() -> None:
        _objects()["Touch"]["hfx_vertices"] = vertices
        _objects()["Touch"]["hfx_weights"] = weights

    return change


def _area_of(vertices: object, weights: object) -> Change:
    def change() -> None:
        _objects()["Touch"]["hfx_vertices"] = vertices
        _objects()["Touch"]["hfx_weights"] = weights

    return change


def _nothing_painted() -> None:
    bpy.ops.hfx.add_painted(modality="vibration", name="Blank")


def _painted_on_a_thing() -> None:
    thing = _objects().new("Chair", None)
    bpy.context.scene.collection.objects.link(thing)
    _objects()["Touch"].hfx.body = thing


def _mesh_volume(points: list[tuple[float, ...]], faces: list[tuple[int, ...]]) -> Change:
    def change() -> None:
        mesh = bpy.data.meshes.new("Rock")
        mesh.from_pydata(points, [], faces)
        for k, point in enumerate(points):  # from_pydata may tidy numbers up
            mesh.vertices[k].co = point
        rock = _objects().new("Rock", mesh)
        bpy.context.scene.collection.objects.link(rock)
        bpy.context.view_layer.objects.active = rock
        bpy.ops.hfx.volume_from_mesh(modality="pressure", name="Rock Touch")

    return change


CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
CLOSED = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]


def _edited_rest_pose() -> None:
    body = _objects()["Avatar"]
    bpy.context.view_layer.objects.active = body
    bpy.ops.object.mode_set(mode="EDIT")
    bone = next(bone for bone in body.data.edit_bones if "head" in bone.name.lower())
    bone.head.z += 0.02
    bpy.ops.object.mode_set(mode="OBJECT")


def _other_rig() -> None:
    _without("Avatar", "Touch")()
    rig = _objects().new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    rig.hfx.role = "BODY"


def _disabled(*names: str) -> Change:
    def change() -> None:
        for name in names:
            _objects()[name].hide_viewport = True

    return change


def _disabled_and_unpainted() -> None:
    _without("Touch")()
    _disabled("Avatar", "Avatar Skin")()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_without("Avatar"), ("'Scene'", "no haptic body", "Avatar")),
        (_without("Ball", "Touch"), ("'Scene'", "no haptic effects")),
        (_edited_rest_pose, ("'Avatar'", "mm", "rest pose")),
        (_other_rig, ("'Rig'", "skeleton")),
        (_disabled_and_unpainted, ("'Avatar'", "disabled in viewports")),
        (_disabled("Avatar", "Avatar Skin"), ("'Avatar'", "disabled in viewports")),
        (_disabled("Ball", "Touch"), ("'Scene'", "disabled in viewports")),
    ],
)
def test_a_scene_that_cannot_be_exported(
    good_blend: Path,
    tmp_path: Path,
    refused: Callable[..., str],
    change: Change,
    words: tuple[str, ...],
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(good_blend))
    change()
    line = refused(hfx_scenes.save(tmp_path / "bad.blend"))
    for word in words:
        assert word in line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_nothing_painted, ("'Blank'", "Paint it")),
        (_setting("Touch", modality="vibration"), ("'Touch'", "vibration", "Paint it")),
        (_setting("Touch", model_hash="0" * 64), ("'Touch'", "another edition")),
        (
            _painted_on_a_thing,
            ("'Touch'", "body 'Chair', which is not in the scene", "Move to Body"),
        ),
        (_area([1, 2], [1.0]), ("'Touch'", "2 painted vertices but 1")),
        (_area([1, 99_999], [1.0, 1.0]), ("'Touch'", "99999")),
        (_area([-7, 3], [1.0, 1.0]), ("'Touch'", "-7")),
        (_area([3, 3], [1.0, 1.0]), ("'Touch'", "twice")),
        (_area_of("many", [1.0]), ("'Touch'", "list of numbers")),
        (_area_of([1, 2], 5.0), ("'Touch'", "list of numbers")),
        (_area_of([1.0, 2.0], [1.0, 1.0]), ("'Touch'", "list of numbers")),
        (_mesh_volume(CORNERS, CLOSED[:3]), ("Rock Touch",)),
        (_mesh_volume([], []), ("Rock Touch",)),
        (_mesh_volume(CORNERS, []), ("Rock Touch",)),
        (_mesh_volume([*CORNERS[:3], (0.0, NAN, 1.0)], CLOSED), ("Rock Touch",)),
    ],
)
def test_a_fault_costs_its_effect_alone(
    good_blend: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Change,
    words: tuple[str, ...],
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(good_blend))
    change()
    path = hfx_scenes.save(tmp_path / "bad.blend")
    capsys.readouterr()  # output of the file's creation
    assert export(path, tmp_path / "out") == 0
    out, _ = capsys.readouterr()
    [line] = [line for line in out.splitlines() if "was left out" in line]
    assert line.startswith("  warning: effect '")
    for word in words:
        assert word in line
    for second in {"Touch (pressure)", "Ball (vibration)"}:
        is_other = f"'{second.split()[0]}'" not in line
        assert (f"{second} felt by Avatar" in out) == is_other
    assert export(path, tmp_path / "strict", "--strict") == 3
    assert words[0] in capsys.readouterr().err and names_in(tmp_path / "strict") == []


def test_the_scene_behind_all_of_these_is_good(good_blend: Path, tmp_path: Path) -> None:
    assert export(good_blend, tmp_path / "out") == 0


def test_a_range_without_frames(good_blend: Path, refused: Callable[..., str]) -> None:
    line = refused(good_blend, "--frames", "5:4")
    assert "'Scene'" in line and "5 to 4" in line


def test_a_disabled_effect_is_left_out_and_told(
    good_blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(good_blend))
    collection = bpy.data.collections.new("Elsewhere")
    bpy.context.scene.collection.children.link(collection)
    ball = _objects()["Ball"]
    for owner in ball.users_collection:
        owner.objects.unlink(ball)
    collection.objects.link(ball)
    bpy.context.view_layer.layer_collection.children["Elsewhere"].exclude = True
    assert export(hfx_scenes.save(tmp_path / "less.blend"), tmp_path / "out") == 0
    out, _ = capsys.readouterr()
    assert "warning: effect 'Ball'" in out and "Touch (pressure) felt" in out
    assert "Ball (vibration)" not in out


def test_strict_makes_a_warning_an_error(
    good_blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(good_blend))
    bpy.data.objects["Ball"].hide_viewport = True
    path = hfx_scenes.save(tmp_path / "hidden.blend")
    assert export(path, tmp_path / "strict", "--strict") == 3
    assert "'Ball' is disabled" in capsys.readouterr().err
    assert hfx_scenes.names_in(tmp_path / "strict") == []
    assert export(path, tmp_path / "lenient") == 0


# A volume without extent is valid: no vertex is inside.


@pytest.mark.parametrize("scale", [(0.0, 0.0, 0.0), (1e-20, 1.0, 1.0), (1.0, 1.0, 0.0)])
def test_a_flat_volume_is_felt_by_nobody(
    good_blend: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    scale: tuple[float, float, float],
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(good_blend))
    _objects()["Ball"].scale = scale
    # Off the midline, because vertices lie exactly on the midline.
    _objects()["Ball"].location.x = 0.0123
    assert export(hfx_scenes.save(tmp_path / "flat.blend"), tmp_path / "out") == 0
    reason = "touches no body" if all(scale) else "is flattened, infinite or not a number"
    assert f"Ball (vibration) was not felt: it {reason}" in capsys.readouterr().out


# Devices


def test_unknown_and_broken_devices(
    good_blend: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    line = refused(good_blend, "--device", "glove")
    assert "'glove'" in line and "back_pad" in line
    broken = tmp_path / "broken.json"
    for content in ("{", '{"schema": "hfx-device", "schema": 1}', "[1e999]", "\0"):
        broken.write_text(content)
        assert "broken.json" in refused(good_blend, "--device", str(broken))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (str(hfx_scenes.ROOT / "device_configs" / "back_pad.json"), "device file"),
        ("back_pad.json", "device file"),
        ("../device_configs/back_pad", "device file"),
        ("..\\back_pad", "device file"),
    ],
)
def test_a_scene_names_devices_and_no_files(
    good_blend: Path, tmp_path: Path, refused: Callable[..., str], name: str, words: str
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(good_blend))
    bpy.context.scene.hfx.devices.add().name = name
    path = hfx_scenes.save(tmp_path / "bad.blend")
    assert words in refused(path)
    assert export(path, tmp_path / "out", "--device", "none") == 0


def test_formats_that_need_a_device_say_so(
    good_blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for more, word in (
        (("-f", "csv"), "--device"),
        (("-f", "wav", "--device", "fan_heater"), "vibration"),
    ):
        assert export(good_blend, tmp_path / "out", *more) == 2
        assert word in capsys.readouterr().err
        assert not (tmp_path / "out").exists()


# Unwritable destinations


@pytest.mark.parametrize("below", ["", "deeper/still"])
def test_a_file_in_place_of_the_folder(
    good_blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], below: str
) -> None:
    (tmp_path / "file").write_text("mine")
    assert export(good_blend, tmp_path / "file" / below) == 3
    assert str(tmp_path / "file") in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no /proc here")
def test_a_folder_that_cannot_be_made(good_blend: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert export(good_blend, Path("/proc/hfx")) == 3
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_folder_in_place_of_a_result_leaves_all_as_it_was(
    good_blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out" / "good.report.json").mkdir(parents=True)
    assert export(good_blend, tmp_path / "out") == 3
    assert str(tmp_path / "out" / "good.report.json") in capsys.readouterr().err
    assert names_in(tmp_path / "out") == ["good.report.json"]


@pytest.mark.parametrize("limit", [500, 4000])  # fails in the track, in the CSV
def test_a_write_that_fails_keeps_what_was_there(
    good_blend: Path, tmp_path: Path, limit: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")  # the limit would cut cached modules short
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "good.hfxtrack").write_bytes(b"of yesterday")
    done = process(
        *("export", good_blend, "-o", folder, "--device", "back_pad"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 3, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert str(folder / "good.") in done.stderr and "File too large" in done.stderr
    assert hfx_scenes.contents_of(folder) == {"good.hfxtrack": b"of yesterday"}


def test_a_full_disk(
    good_blend: Path,
    tmp_path: Path,
    refused: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("hfx_blender.files.atomic.os.fsync", full)
    line = refused(good_blend)
    assert str(tmp_path / "out" / "good.hfxtrack") in line and "No space left" in line
