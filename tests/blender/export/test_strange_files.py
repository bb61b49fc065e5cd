# SPDX-License-Identifier: GPL-3.0-or-later
"""Unsuitable files named by a .blend or a command.

Reading a pipe would never end; secrets and files of remote machines are no sound or picture;
results must not replace their sources.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import wave
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hfx_scenes
import numpy as np
import pytest

from hfx_blender import cli
from hfx_blender.errors import InputError
from hfx_blender.files import blend_paths
from hfx_blender.files.hashes import NOT_READ, is_elsewhere, state_of

bpy = pytest.importorskip("bpy")
pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes with names")


def _make_pipe(path: Path) -> None:
    """A pipe with a writer closing at once, so that a defect fails without hanging."""
    os.mkfifo(path)
    # The thread may open the pipe when the test's current folder is another one again.
    absolute = path.absolute()
    threading.Thread(target=lambda: absolute.open("wb").close(), daemon=True).start()


@pytest.fixture(scope="module")
def base(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene(1)
    return hfx_scenes.save(tmp_path_factory.mktemp("base") / "base.blend")


def _plane() -> Any:
    mesh = bpy.data.meshes.new("Plane")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    plane = bpy.data.objects.new("Plane", mesh)
    bpy.context.scene.collection.objects.link(plane)
    return plane


def _picture(path: Path) -> Any:
    image = bpy.data.images.new("Made", 8, 8)
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)
    return bpy.data.images.load(str(path))


def _displaced(folder: Path) -> Path:
    """A picture read by Blender on opening the file."""
    texture = bpy.data.textures.new("T", "IMAGE")
    texture.image = _picture(folder / "skin.png")
    _plane().modifiers.new("D", "DISPLACE").texture = texture
    return folder / "skin.png"


def _unused(folder: Path) -> Path:
    _picture(folder / "skin.png").use_fake_user = True
    return folder / "skin.png"


def _sound(folder: Path) -> Path:
    with wave.open(str(folder / "hum.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        file.writeframes(bytes(800))
    bpy.data.sounds.load(str(folder / "hum.wav")).use_fake_user = True
    return folder / "hum.wav"


def _volume(folder: Path) -> Path:
    (folder / "smoke.vdb").write_bytes(b"none")
    smoke = bpy.data.volumes.new("Smoke")
    smoke.filepath = str(folder / "smoke.vdb")
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Smoke", smoke))
    return folder / "smoke.vdb"


def _mesh_cache(folder: Path, is_shown: bool = True) -> Path:
    """A path of a modifier, read by Blender on opening the file if the modifier is shown."""
    modifier = _plane().modifiers.new("Cache", "MESH_CACHE")
    modifier.filepath, modifier.show_viewport = str(folder / "motion.mdd"), is_shown
    (folder / "motion.mdd").write_bytes(b"none")
    return folder / "motion.mdd"


def _hidden_mesh_cache(folder: Path) -> Path:
    return _mesh_cache(folder, is_shown=False)


def _import_node(folder: Path) -> Path:
    """A path in a node with a neutral name."""
    tree = bpy.data.node_groups.new("Tree", "GeometryNodeTree")
    tree.use_fake_user = True
    length = tree.nodes.new("FunctionNodeStringLength")
    length.inputs[0].default_value = str(folder / "points.csv")
    (folder / "points.csv").write_text("x")
    return folder / "points.csv"


def _linked(source: Path) -> None:
    """Link a plane from a .blend into an empty file."""
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(source), link=True) as (there, linked):
        linked.objects = [name for name in there.objects if name.startswith("Plane")]
    for plane in linked.objects:
        bpy.context.scene.collection.objects.link(plane)


def _library(folder: Path) -> Path:
    _plane()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "props.blend"), copy=True)
    _linked(folder / "props.blend")
    return folder / "props.blend"


def _file_of_a_library(folder: Path) -> Path:
    """A path stored only in the library, relative to the library's folder."""
    (folder / "shared").mkdir()
    victim = _displaced(folder / "shared")
    props = folder / "shared" / "props.blend"
    bpy.data.images["skin.png"].filepath = "//skin.png"
    bpy.ops.wm.save_as_mainfile(filepath=str(props), copy=True, relative_remap=False)
    _linked(props)
    return victim


NAMED = [
    *(_displaced, _unused, _sound, _volume, _mesh_cache, _hidden_mesh_cache, _import_node),
    *(_library, _file_of_a_library),
]


@pytest.mark.parametrize("named", NAMED)
def test_a_pipe_that_a_scene_names_is_refused(
    base: Path, tmp_path: Path, named: Callable[[Path], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(base))
    victim = named(tmp_path)
    blend = hfx_scenes.save(tmp_path / "scene.blend")
    victim.unlink()
    _make_pipe(victim)
    bpy.ops.wm.read_homefile(use_empty=True)
    out = str(tmp_path / "out")
    for words in (["info", str(blend)], ["export", str(blend), "-o", out, "--device", "none"]):
        assert cli.run(words) == 3
        (line,) = capsys.readouterr().err.splitlines()
        assert victim.name in line and "is a pipe" in line
    assert not list((tmp_path / "out").glob("*"))


def test_a_damaged_blend_is_left_to_blender(base: Path, tmp_path: Path) -> None:
    """Bytes changed in the compressed and in the plain file; cut at any length."""
    bpy.ops.wm.open_mainfile(filepath=str(base))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "plain.blend"), compress=False)
    rng = np.random.default_rng(5)
    for source in (base, tmp_path / "plain.blend"):
        whole = source.read_bytes()
        for k in range(40):
            content = bytearray(whole[: rng.integers(len(whole))] if k % 2 else whole)
            for position in rng.integers(max(len(content), 1), size=20 if len(content) else 0):
                content[position] = rng.integers(256)
            (tmp_path / "bad.blend").write_bytes(content)
            blend_paths.refuse_endless(tmp_path / "bad.blend")


def test_a_blender_without_zstandard_still_refuses_pipes(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A compressed file is left to Blender in this case; a plain file is read."""
    bpy.ops.wm.open_mainfile(filepath=str(base))
    victim = _unused(tmp_path)
    for is_compressed in (True, False):
        path = str(tmp_path / f"{is_compressed}.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path, compress=is_compressed, copy=True)
    victim.unlink()
    _make_pipe(victim)
    monkeypatch.setitem(sys.modules, "zstandard", None)
    blend_paths.refuse_endless(tmp_path / "True.blend")
    with pytest.raises(InputError, match=r"skin\.png' of its image is a pipe"):
        blend_paths.refuse_endless(tmp_path / "False.blend")


PIPES = """
info p.json|info p.hfxtrack|info p.blend|info p.npz|convert p.hfxtrack o.csv --device insoles
convert p.he o.haptic|validate p.hjif|validate p.wav|validate p.report.json|validate p.json
play p.hfxtrack --device insoles --to simulator
export p.blend|export SCENE --device p.json|sound p.blend|texture info p.png --size 1,1
texture info p.ply|texture info p.texture.json|texture info p.blend
texture stroke gravel-fine --path p.csv -o o.csv|texture info gravel-fine --roughness p.png
device check p.json|device import p.json --name x
texture generate --back-end folder --picture p.png -o out
"""


@pytest.mark.parametrize("words", [item for item in PIPES.replace("\n", "|").split("|") if item])
def test_a_pipe_as_an_argument_is_refused(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    arguments = [str(base) if word == "SCENE" else word for word in words.split()]
    for name in arguments:
        if name.startswith("p."):
            _make_pipe(Path(name))
    assert cli.run(arguments) in (2, 3)
    assert "Traceback" not in (errors := capsys.readouterr().err) and "p." in errors


def test_only_files_of_known_kinds_are_hashed(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    secret = tmp_path / "id_rsa"
    secret.write_text("secret")
    bpy.ops.wm.open_mainfile(filepath=str(base))
    image = bpy.data.images.new("Key", 4, 4)
    image.source, image.filepath_raw, image.use_fake_user = "FILE", str(secret), True
    far = bpy.data.images.new("Far", 4, 4)
    far.source, far.filepath_raw, far.use_fake_user = "FILE", "\\\\server\\share\\far.png", True
    blend = hfx_scenes.save(tmp_path / "scene.blend")
    arguments = ["export", str(blend), "-o", str(tmp_path / "out"), "--device", "none", "--json"]
    assert cli.run(arguments) == 0
    out = capsys.readouterr().out
    result = json.loads(out[out.index("{") :])
    files = {Path(name).name: state for name, state in result["made_from"]["files"].items()}
    assert files["id_rsa"] == NOT_READ and len(files["scene.blend"]) == 64
    assert [state for name, state in files.items() if name.endswith("far.png")] == [NOT_READ]
    warnings = " ".join(result["warnings"])
    assert "id_rsa' of image 'Key' has an unknown file type" in warnings
    assert "'Far' is on another machine" in warnings
    assert cli.run([*arguments, "--resume"]) == 0  # unread files may have changed
    out = capsys.readouterr().out
    assert "unchanged" not in json.loads(out[out.index("{") :])


@pytest.mark.parametrize(
    ("path", "beside", "is_far"),
    [
        ("\\\\server\\share\\a.wav", "/home/a.blend", True),
        ("//server/share/a.wav", "/home/a.blend", True),
        ("smb://server/a.wav", "/home/a.blend", True),
        ("https://server/a.wav", None, True),
        ("//SERVER/other/a.wav", "//server/share/a.blend", False),
        ("//other/share/a.wav", "//server/share/a.blend", True),
        ("C:/sounds/a.wav", "D:/a.blend", False),
        ("C:\\sounds\\a.wav", None, False),
        ("/home/a.wav", "/home/a.blend", False),
        ("a.wav", None, False),
    ],
)
def test_paths_of_other_machines(path: str, beside: str | None, is_far: bool) -> None:
    assert is_elsewhere(Path(path), beside and Path(beside)) is is_far
    if is_far:
        assert state_of(Path(path), beside and Path(beside)) == NOT_READ


def test_a_track_of_another_machine_or_kind_is_not_opened(registered: Any, tmp_path: Path) -> None:
    from hfx_blender.playback.live.live import live
    from hfx_blender.playback.live.live_sources import TrackSource

    scene = bpy.context.scene
    pipe = tmp_path / "p.hfxtrack"
    _make_pipe(pipe)
    for path, messages in (
        (str(pipe), "no plain file"),
        ("/etc/passwd", "is no track"),
        (str(tmp_path), "is no track"),
        ("\\\\server\\share\\a.hfxtrack", "another machine"),
    ):
        scene.hfx.live_track = path
        with pytest.raises(InputError, match=messages):  # state after opening a file with the path
            TrackSource().open(bpy.context)
    scene.hfx.live_track = "\\\\server\\share\\b.hfxtrack"  # the user chooses the path
    with pytest.raises(InputError, match="no such file"):
        live.tracks.open(bpy.context)
    scene.hfx.live_track = ""


def test_a_report_replaces_neither_a_scene_nor_a_result(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.blend"
    scene.write_bytes(base.read_bytes())
    (tmp_path / "link").symlink_to(scene)
    out = tmp_path / "out"
    arguments = ["export", str(scene), "-o", str(out), "--device", "none"]
    for report in (scene, tmp_path / "link"):
        assert cli.run([*arguments, "--report", str(report)]) == 3
        assert "a file that is read" in capsys.readouterr().err
    assert scene.read_bytes() == base.read_bytes() and not out.exists()
    assert cli.run([*arguments, "--report", str(out / "scene.hfxtrack")]) == 2
    assert not out.exists()


def test_an_export_never_replaces_what_it_is_made_from(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A scene's own sound has the result's name, by a link or on a case-insensitive disk."""
    bpy.ops.wm.open_mainfile(filepath=str(base))
    sound = _sound(tmp_path)
    blend = hfx_scenes.save(tmp_path / "scene.blend")
    os.link(sound, tmp_path / "scene.hfxtrack")
    before = sound.read_bytes()
    assert cli.run(["export", str(blend), "-o", str(tmp_path), "--device", "none"]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "scene.hfxtrack: cannot be written (it is a file that is read" in line
    assert sound.read_bytes() == before == (tmp_path / "scene.hfxtrack").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir() if path.name[0] == ".") == []


def test_patterns_are_expanded_by_the_command(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a1.blend", "a[1].blend", "b.blend"):
        (tmp_path / name).write_bytes(base.read_bytes())
    assert cli.run(["export", "a[1].blend", "-o", "one", "--device", "none"]) == 0
    assert [path.name for path in Path("one").glob("*.hfxtrack")] == ["a[1].hfxtrack"]
    assert cli.run(["export", "*1.blend", "a1.blend", "-o", "two", "--device", "none"]) == 0
    assert [path.name for path in Path("two").glob("*.hfxtrack")] == ["a1.hfxtrack"]
    assert cli.run(["validate", "two/*.hfxtrack", "one/*.report.json"]) == 0
    capsys.readouterr()
    for words in (["export", "*.blond"], ["validate", "b.blend", "*.hji?"]):
        assert cli.run(words) == 3
        (line,) = capsys.readouterr().err.splitlines()
        assert words[-1] in line and "matches this pattern" in line
