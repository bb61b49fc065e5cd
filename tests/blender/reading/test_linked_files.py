# SPDX-License-Identifier: GPL-3.0-or-later
"""Linked files of a .blend: a file change is a scene change, a missing file gives a message."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hfx_scenes
import pytest

from hfx_blender import cli
from hfx_blender.blender import compat
from hfx_blender.blender.linked_files import linked_files
from hfx_blender.errors import InputError
from hfx_blender.files import hashes

bpy = pytest.importorskip("bpy")

IsLeftOut = Callable[..., bool]


@pytest.fixture
def is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> IsLeftOut:
    """Export with --resume; whether nothing had to be done."""

    def export(blend: Path, out: Path | None = None) -> bool:
        folder = out or tmp_path / "out"
        capsys.readouterr()
        arguments = ["export", str(blend), "-o", str(folder), "--device", "none"]
        assert cli.run([*arguments, "--resume", "--json"]) == 0
        text = capsys.readouterr().out
        return bool(
            json.loads(text[text.index("\n{") :] if "\n{" in text else text).get("unchanged")
        )

    return export


@pytest.fixture(scope="module")
def base(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene(1)
    return hfx_scenes.save(tmp_path_factory.mktemp("base") / "base.blend")


def _user(base: Path, folder: Path, name: str) -> Any:
    """A saved scene with an object, linked by each test to a file in the same folder."""
    bpy.ops.wm.open_mainfile(filepath=str(base))
    second = bpy.data.objects.new("Other", bpy.data.meshes.new("Other"))
    second.data.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    bpy.context.scene.collection.objects.link(second)
    hfx_scenes.save(folder / f"{name}.blend")
    return second


def _mesh_cache(other: Any, folder: Path) -> list[Path]:
    modifier = other.modifiers.new("Cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "MDD", "//motion.mdd"
    path = folder / "motion.mdd"
    path.write_bytes(struct.pack(">ii2f", 2, 3, 0.0, 1.0) + bytes(72))
    return [path]


def _alembic(other: Any, folder: Path) -> list[Path]:
    path = folder / "rig.abc"
    path.write_bytes(b"not one that can be read")
    bpy.ops.cachefile.open(filepath=str(path))
    other.modifiers.new("C", "MESH_SEQUENCE_CACHE").cache_file = bpy.data.cache_files[0]
    return [path]


def _row(other: Any, folder: Path) -> list[Path]:
    paths = [folder / f"f_{k:04d}_x.png" for k in (1, 2, 3)]
    for path in paths:
        path.write_bytes(path.name.encode())
    image = bpy.data.images.new("Row", 4, 4)
    image.source, image.filepath_raw = "SEQUENCE", "//f_0001_x.png"
    image.use_fake_user = True
    return [paths[2], paths[1]]


def _tiles(other: Any, folder: Path) -> list[Path]:
    paths = [folder / f"skin.{k}.png" for k in (1001, 1002)]
    for path in paths:
        path.write_bytes(path.name.encode())
    image = bpy.data.images.new("Tiles", 4, 4, tiled=True)
    image.source, image.filepath_raw = "TILED", "//skin.<UDIM>.png"
    image.use_fake_user = True
    return [paths[1]]


def _sound(other: Any, folder: Path) -> list[Path]:
    path = folder / "hum.wav"
    path.write_bytes(b"RIFF")
    bpy.data.sounds.load(str(path)).use_fake_user = True
    return [path]


def _baked(other: Any, folder: Path) -> list[Path]:
    other.modifiers.new("N", "NODES").bake_directory = "//bakes"
    path = folder / "bakes" / "deep" / "0001.json"
    path.parent.mkdir(parents=True)
    path.write_text("{}")
    return [path]


def _imported(other: Any, folder: Path) -> list[Path]:
    tree = bpy.data.node_groups.new("G", "GeometryNodeTree")
    tree.use_fake_user = True
    tree.nodes.new("GeometryNodeImportOBJ").inputs["Path"].default_value = "//part.obj"
    path = folder / "part.obj"
    path.write_text("v 0 0 0\n")
    return [path]


def _external_cache(other: Any, folder: Path) -> list[Path]:
    cache = other.modifiers.new("Cloth", "CLOTH").point_cache
    cache.use_external, cache.filepath = True, "//points"
    path = folder / "points" / "a_000001_00.bphys"
    path.parent.mkdir()
    path.write_bytes(b"BPHYSICS")
    other.modifiers[0].show_viewport = False
    return [path]


REACHES = [
    _mesh_cache, _alembic, _row, _tiles, _sound, _baked, _imported, _external_cache,
]  # fmt: skip


@pytest.mark.parametrize(
    ("reach", "tells_owners"),
    [(item, True) for item in REACHES]
    + [(item, False) for item in (_mesh_cache, _row, _baked, _external_cache)],
    ids=lambda each: each.__name__[1:] if callable(each) else "" if each else "before 4.4",
)
def test_what_a_scene_reaches_counts(
    base: Path,
    tmp_path: Path,
    is_left_out: IsLeftOut,
    reach: Callable[[Any, Path], list[Path]],
    tells_owners: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not tells_owners:
        monkeypatch.setattr(compat, "TELLS_OWNERS_OF_PATHS", False)
    folder = tmp_path / "here"
    folder.mkdir()
    user = _user(base, folder, "user")
    if reach is _imported and not hasattr(bpy.types, "GeometryNodeImportOBJ"):
        pytest.skip("this Blender has no such node")
    paths = reach(user, folder)
    blend = hfx_scenes.save(folder / "user.blend")
    assert not is_left_out(blend) and is_left_out(blend)
    for path in paths:
        path.write_bytes(path.read_bytes() + b"!")
        assert not is_left_out(blend) and is_left_out(blend), "changed"
        path.rename(tmp_path / "away")
        assert not is_left_out(blend) and is_left_out(blend), "gone"
        (tmp_path / "away").rename(path)
        assert not is_left_out(blend) and is_left_out(blend), "back"
    shutil.move(folder, tmp_path / "there")
    if reach not in (_alembic, _sound):  # Alembic and sound have absolute paths
        assert is_left_out(tmp_path / "there" / "user.blend")


def _library(path: Path, of: Path | None = None) -> None:
    """A library with 'Carrier', parented to an object of a second library."""
    bpy.ops.wm.read_homefile(use_empty=True)
    carrier = bpy.data.objects.new(f"Carrier {path.stem}", None)
    bpy.context.scene.collection.objects.link(carrier)
    if of is not None:
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
        with bpy.data.libraries.load(str(of), link=True, relative=True) as (_, into):
            into.objects = [f"Carrier {of.stem}"]
        bpy.context.scene.collection.objects.link(into.objects[0])  # a parent alone is no user
        carrier.parent = into.objects[0]
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def test_libraries_of_libraries_that_go_and_come_back(
    base: Path, tmp_path: Path, is_left_out: IsLeftOut, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "lib").mkdir()
    far, near = tmp_path / "lib" / "far.blend", tmp_path / "lib" / "near.blend"
    _library(far)
    _library(near, far)
    _user(base, tmp_path, "user")
    with bpy.data.libraries.load(str(near), link=True, relative=True) as (_, into):
        into.objects = ["Carrier near"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    bpy.data.objects["Ball"].parent = into.objects[0]
    blend = hfx_scenes.save(tmp_path / "user.blend")
    assert {name for name in linked_files() if name.endswith(".blend")} == {
        "//lib/far.blend",
        "//lib/near.blend",
    }
    assert not is_left_out(blend) and is_left_out(blend)
    for path in (far, near):
        path.rename(tmp_path / "away.blend")
        assert not is_left_out(blend) and is_left_out(blend)
        report = json.loads((tmp_path / "out" / "user.report.json").read_text())
        assert report["made_from"]["files"][f"//lib/{path.name}"] is None
        [messages] = [text for text in report["warnings"] if f"'//lib/{path.name}'" in text]
        assert "is missing" in messages
        capsys.readouterr()
        arguments = ["export", str(blend), "-o", str(tmp_path / "strict"), "--device", "none"]
        assert cli.run([*arguments, "--strict"]) == 3
        assert path.name in capsys.readouterr().err
        (tmp_path / "away.blend").rename(path)
        assert not is_left_out(blend) and is_left_out(blend)


@pytest.mark.parametrize("is_renamed", [False, True])
@pytest.mark.parametrize("is_only_effect", [False, True])
def test_missing_linked_effects_are_named(
    registered: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    is_renamed: bool,
    is_only_effect: bool,
) -> None:
    hfx_scenes.small_scene(5)
    bpy.data.objects["Ball"].name = "Far Ball"
    library = hfx_scenes.save(tmp_path / "lib.blend")
    hfx_scenes.small_scene(5)
    if is_only_effect:
        bpy.data.objects.remove(bpy.data.objects["Ball"])
        bpy.data.objects.remove(bpy.data.objects["Touch"])
    with bpy.data.libraries.load(str(library), link=True, relative=True) as (_, into):
        into.objects = ["Far Ball"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    blend = hfx_scenes.save(tmp_path / "user.blend")
    library.unlink()
    if is_renamed:
        hfx_scenes.small_scene(5)
        hfx_scenes.save(library)
    capsys.readouterr()
    arguments = ["export", str(blend), "-o", str(tmp_path / "out"), "--device", "none"]
    assert cli.run(arguments) == (3 if is_only_effect else 0)
    said = "".join(capsys.readouterr())
    assert "inked data-blocks are missing from library 'lib.blend' (//lib.blend)" in said
    assert "object 'Far Ball'" in said


def test_what_a_library_reaches_counts(base: Path, tmp_path: Path, is_left_out: IsLeftOut) -> None:
    (tmp_path / "lib").mkdir()
    user = _user(base, tmp_path / "lib", "library")
    [cache] = _mesh_cache(user, tmp_path / "lib")
    library = hfx_scenes.save(tmp_path / "lib" / "library.blend")
    _user(base, tmp_path, "user")
    with bpy.data.libraries.load(str(library), link=True, relative=True) as (_, into):
        into.objects = ["Other"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    blend = hfx_scenes.save(tmp_path / "user.blend")
    assert "//lib/motion.mdd" in linked_files()
    assert not is_left_out(blend) and is_left_out(blend)
    cache.write_bytes(cache.read_bytes()[:-1] + b"!")
    assert not is_left_out(blend) and is_left_out(blend)


def test_what_is_in_the_file_itself_is_not_missing(base: Path, tmp_path: Path) -> None:
    emitter = _user(base, tmp_path, "user")
    emitter.modifiers.new("Emitter", "PARTICLE_SYSTEM")
    text = bpy.data.texts.new("Note")
    text.filepath = "//gone.txt"
    picture = tmp_path / "packed.png"
    created = bpy.data.images.new("Made", 4, 4)
    created.filepath_raw, created.file_format = str(picture), "PNG"
    created.save()
    image = bpy.data.images.load(str(picture))
    image.pack()
    image.use_fake_user = True
    bpy.data.images.remove(created)
    picture.unlink()
    blend = hfx_scenes.save(tmp_path / "user.blend")
    assert cli.run(["export", str(blend), "-o", str(tmp_path / "o"), "--strict"]) == 0


def test_a_folder_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hashes, "MOST_FILES", 3)
    for k in range(4):
        (tmp_path / f"{k}").write_text("")
    with pytest.raises(InputError, match="more than 3 files"):
        hashes.state_of(tmp_path)


def test_a_folder_where_a_file_should_be_costs_nothing_but_a_warning(
    base: Path, tmp_path: Path, is_left_out: IsLeftOut, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hashes, "MOST_FILES", 3)
    (tmp_path / "many").mkdir()
    for k in range(4):
        (tmp_path / "many" / f"{k}").write_text("")
    _user(base, tmp_path, "user")
    image = bpy.data.images.new("Root", 4, 4)
    image.source, image.filepath_raw, image.use_fake_user = "FILE", "//many", True
    blend = hfx_scenes.save(tmp_path / "user.blend")
    assert not is_left_out(blend)
    report = json.loads((tmp_path / "out" / "user.report.json").read_text())
    (sentence,) = [warning for warning in report["warnings"] if "//many" in warning]
    assert "image 'Root' is a folder" in sentence
    assert report["made_from"]["files"]["//many"] == hashes.FOLDER
    assert is_left_out(blend), "a folder that stays one changes nothing"
    (tmp_path / "many").rename(tmp_path / "gone")
    assert not is_left_out(blend)
