# SPDX-License-Identifier: GPL-3.0-or-later
"""Atomic files: complete or absent."""

import errno
import os
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import pytest
from track_synthetic import header, run

from hfx_blender.engine.track import TrackBody, TrackReader, TrackWriter
from hfx_blender.errors import OutputError
from hfx_blender.export import result_files
from hfx_blender.files import atomic
from hfx_blender.files.atomic import (
    atomic_file,
    inputs_kept,
    move,
    passing,
    temporary_name,
)
from hfx_blender.files.locks import LOCKED_BYTE, take_lock
from hfx_blender.files.staging import place
from hfx_blender.formats.written import name_part


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_appears_when_the_block_ends(tmp_path):
    path = tmp_path / "a.bin"
    with atomic_file(path) as file:
        file.write(b"new")
        assert not path.exists()
    assert path.read_bytes() == b"new" and names(tmp_path) == ["a.bin"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, SystemExit, GeneratorExit])
def test_after_any_exception_the_old_file_stands(tmp_path, error):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    with pytest.raises(error), atomic_file(path) as file:
        file.write(b"new")
        raise error
    assert path.read_bytes() == b"old" and names(tmp_path) == ["a.bin"]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_failure_at_the_end(tmp_path, monkeypatch, call):
    path = tmp_path / "a.bin"

    def fail(*arguments):
        names = (*map(str, arguments),) if call == "replace" else ()
        raise OSError(errno.EIO, "Input/output error", *names[:1])

    monkeypatch.setattr(os, call, fail)
    with pytest.raises(OutputError, match=r"a\.bin: cannot be written \(Input/output error"):
        with atomic_file(path) as file:
            file.write(b"new")
    assert names(tmp_path) == []


def test_a_folder_failing_to_sync_keeps_its_files(tmp_path, monkeypatch):
    (tmp_path / "old").write_bytes(b"old")
    fsync, calls = os.fsync, []

    def fail_second(descriptor):
        calls.append(descriptor)
        if len(calls) % 2 == 0:
            raise OSError(errno.EIO, "Input/output error")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", fail_second)
    for name in ("old", "new"):
        with pytest.raises(OutputError, match=f"{name}: cannot be written"):
            with atomic_file(tmp_path / name) as file:
                file.write(b"new")
    assert names(tmp_path) == ["old"] and (tmp_path / "old").read_bytes() == b"old"


@pytest.mark.parametrize("has_links", [True, False])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_of_several_files_all_come_or_none(tmp_path, monkeypatch, number, has_links):
    """Renaming one of three results fails; two results replace earlier files. FAT and many network
    file systems have no hard links."""
    stage, folder = tmp_path / "stage", tmp_path / "folder"
    stage.mkdir()
    folder.mkdir()
    for name in "abc":
        (stage / name).write_text(f"new {name}")
    for name in "ac":
        (folder / name).write_text(f"old {name}")
    replace, calls = os.replace, []

    def fail(source, target):
        calls.append(target)
        if len(calls) == number:
            raise OSError(errno.EIO, "Input/output error", str(source), None, str(target))
        replace(source, target)

    def no_link(source, target, **_):
        raise OSError(errno.EPERM, "Operation not permitted", str(source), None, str(target))

    if not has_links:
        monkeypatch.setattr(os, "link", no_link)
    monkeypatch.setattr(os, "replace", fail)
    with passing(stage), pytest.raises(OSError, match="Input/output"):
        move([stage / name for name in "abc"], folder)
    assert {path.name: path.read_text() for path in folder.iterdir()} == {
        "a": "old a",
        "c": "old c",
    }


@pytest.mark.parametrize("is_windows", [True, False])
def test_on_windows_a_file_that_a_scanner_has_open_is_renamed_later(
    tmp_path, monkeypatch, is_windows
):
    replace, refused = os.replace, []

    def busy(source, target):
        if len(refused) < 3:
            refused.append(target)
            raise PermissionError(errno.EACCES, "The process cannot access the file", str(source))
        replace(source, target)

    monkeypatch.setattr(atomic, "_IS_WINDOWS", is_windows)
    monkeypatch.setattr(os, "replace", busy)
    with nullcontext() if is_windows else pytest.raises(OutputError, match="cannot access"):
        with atomic_file(tmp_path / "a.csv") as file:
            file.write(b"new")
    assert names(tmp_path) == (["a.csv"] if is_windows else [])


def test_no_other_file_of_the_user_is_written_or_removed(tmp_path):
    """Files or links with names of earlier unfinished files belong to the user."""
    (tmp_path / "thesis").write_bytes(b"precious")
    (tmp_path / "a.bin.tmp").symlink_to(tmp_path / "thesis")
    (tmp_path / "b.bin.tmp").write_bytes(b"precious")
    (tmp_path / "a.bin").symlink_to(tmp_path / "thesis")
    (tmp_path / "b.bin").symlink_to(tmp_path / "nowhere")
    for name in "ab":
        with atomic_file(tmp_path / f"{name}.bin") as file:
            file.write(b"new")
    with pytest.raises(OutputError), atomic_file(tmp_path / "none" / "b.bin"):
        pass
    assert (tmp_path / "thesis").read_bytes() == b"precious"
    assert names(tmp_path) == ["a.bin", "a.bin.tmp", "b.bin", "b.bin.tmp", "thesis"]
    assert (tmp_path / "b.bin.tmp").read_bytes() == b"precious"
    assert all((tmp_path / f"{name}.bin").read_bytes() == b"new" for name in "ab")


def test_an_input_file_is_never_replaced_under_any_name(tmp_path):
    scene = tmp_path / "scene.blend"
    scene.write_bytes(b"precious")
    (tmp_path / "link").symlink_to(scene)
    os.link(scene, tmp_path / "second")
    with inputs_kept([scene, tmp_path / "missing"]):
        for name in ("scene.blend", "link", "second"):
            with pytest.raises(OutputError, match=f"{name}: .*a file that is read"):
                with atomic_file(tmp_path / name):
                    pass
            with pytest.raises(OutputError, match="a file that is read"):
                place([tmp_path / "stage" / name], tmp_path)
    with atomic_file(tmp_path / "second") as file:
        file.write(b"new")
    assert scene.read_bytes() == b"precious" and names(tmp_path) == [
        "link",
        "scene.blend",
        "second",
    ]


def test_an_input_file_is_never_replaced_under_another_spelling(tmp_path, monkeypatch):
    """A file system without regard to case may have an inode for each spelling: exFAT by FUSE. Here
    a second file takes the place of the second spelling, and folders list the first one only."""
    for name in ("Zo\u00eb.blend", "ZOE\u0308.Blend"):
        (tmp_path / name).write_text("precious")
    with inputs_kept([tmp_path / "Zo\u00eb.blend"]):
        with atomic_file(tmp_path / "ZOE\u0308.Blend") as file:
            file.write(b"another file")
        monkeypatch.setattr(os, "listdir", lambda folder: ["Zo\u00eb.blend"])
        with pytest.raises(OutputError, match="a file that is read"):
            with atomic_file(tmp_path / "ZOE\u0308.Blend"):
                pass


def test_an_input_file_is_kept_in_a_folder_that_cannot_be_listed(tmp_path, monkeypatch):
    def refuse(folder):
        raise PermissionError(errno.EACCES, "Permission denied", str(folder))

    scene = tmp_path / "scene.blend"
    scene.write_text("precious")
    monkeypatch.setattr(os, "listdir", refuse)
    with inputs_kept([scene]), pytest.raises(OutputError, match="a file that is read"):
        with atomic_file(scene):
            pass


def test_two_results_of_one_name_are_none(tmp_path):
    with passing(tmp_path):
        with atomic_file(tmp_path / "a.he") as file:
            file.write(b"first")
        with pytest.raises(OutputError, match=r"a\.he: .*two results have this name"):
            with atomic_file(tmp_path / "a.he"):
                pass
    assert (tmp_path / "a.he").read_bytes() == b"first" and names(tmp_path) == ["a.he"]


def test_the_hidden_file_of_a_killed_process_goes_with_the_next(tmp_path):
    path = tmp_path / "a[1].bin"
    names_left = [temporary_name(path.name) for _ in range(3)]
    for name in (*names_left, temporary_name("other.bin")):
        (tmp_path / name).write_bytes(b"half")
    os.utime(tmp_path / names_left[0], (0, 0))  # of a process killed long ago
    os.utime(tmp_path / names_left[1], (0, 0))  # of a process still writing
    with open(tmp_path / names_left[1], "r+b") as held:
        take_lock(held.fileno(), LOCKED_BYTE)
        with atomic_file(path) as file:
            file.write(b"new")
    left = {name for name in names(tmp_path) if name != path.name}
    assert len(left) == 3 and names_left[0] not in left and set(names_left[1:]) < left


def test_a_folder_that_cannot_sync_is_no_failure(tmp_path, monkeypatch):
    fsync, calls = os.fsync, []

    def file_only(descriptor):
        calls.append(descriptor)
        if len(calls) == 2:
            raise OSError(errno.EINVAL, "Invalid argument")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", file_only)
    with atomic_file(tmp_path / "a.bin") as file:
        file.write(b"new")
    assert len(calls) == 2 and (tmp_path / "a.bin").read_bytes() == b"new"


def test_places_that_cannot_be(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_bytes(b"")
    for path, reason in (
        (tmp_path / "none" / "a.bin", "No such file"),
        (tmp_path / "folder", "there is a folder of that name"),
        (tmp_path / "file" / "a.bin", "Not a directory"),
    ):
        with pytest.raises(OutputError, match=reason) as caught, atomic_file(path):
            pass
        assert str(path) in str(caught.value)
    assert names(tmp_path) == ["file", "folder"] and names(tmp_path / "folder") == []


@pytest.mark.skipif(os.name == "nt", reason="has no such files")
def test_devices_and_pipes_are_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "null").symlink_to("/dev/null")
    with open(tmp_path / "kept", "wb") as stored:
        (tmp_path / "stdout").symlink_to(f"/proc/self/fd/{stored.fileno()}")
        before = {path: path.lstat().st_ino for path in tmp_path.iterdir()}
        for name in ("pipe", "null", "stdout"):
            with pytest.raises(OutputError, match="a device or a pipe"):
                with atomic_file(tmp_path / name):
                    pass
            with pytest.raises(OutputError, match="a device or a pipe"):
                place((Path("elsewhere") / name,), tmp_path)
    assert {path: path.lstat().st_ino for path in tmp_path.iterdir()} == before


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_is_read_only(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="Permission denied"), atomic_file(tmp_path / "a.bin"):
        pass


def test_an_error_about_another_file_keeps_its_name(tmp_path):
    with pytest.raises(FileNotFoundError, match="other"), atomic_file(tmp_path / "a.bin"):
        (tmp_path / "other").read_bytes()
    assert names(tmp_path) == []


# Cases for a whole track, with the container's writes at the end.

HEADER = header(sample_count=600)


def record(path, samples=600, then=None):
    with TrackWriter(path, HEADER) as writer:
        for start in range(0, samples, 100):
            writer.append([run(HEADER, 0, range(start, start + 100), [[1]] * 100, [[1.0]] * 100)])
        if then is not None:
            raise then


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("no"), OutputError("no")])
def test_an_interrupted_track_keeps_the_earlier_file(tmp_path, error):
    path = tmp_path / "a.hfxtrack"
    record(path, 100)
    before = path.read_bytes()
    with pytest.raises(type(error)):
        record(path, then=error)
    assert path.read_bytes() == before and names(tmp_path) == ["a.hfxtrack"]


@pytest.mark.parametrize("budget", range(0, 4000, 157))
def test_a_disk_that_fills_up_at_any_point(tmp_path, budget):
    """Make writes fail after ``budget`` bytes."""
    record(tmp_path / "whole.hfxtrack")
    size = (tmp_path / "whole.hfxtrack").stat().st_size
    whole = (tmp_path / "whole.hfxtrack").read_bytes()
    resource = pytest.importorskip("resource")
    signal = pytest.importorskip("signal")
    previous = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    path = tmp_path / "a.hfxtrack"
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (budget, limits[1]))
        if budget < size:
            with pytest.raises(OutputError, match=r"a\.hfxtrack: cannot be written \(File too"):
                record(path)
            assert names(tmp_path) == ["whole.hfxtrack"]
        else:
            record(path)
            assert path.read_bytes() == whole
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, previous)
    with TrackReader(tmp_path / "whole.hfxtrack") as reader:
        assert sum(map(len, reader.runs())) == 600


def synced(monkeypatch):
    """Names of the files forced to the disk from now on, in order."""
    real, actual = os.fsync, []

    def fsync(descriptor):
        actual.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")).name)
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    return actual


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="asks Linux for the names")
def test_staged_files_are_synced_once_when_moved(tmp_path, monkeypatch):
    stage, folder = tmp_path / "stage", tmp_path / "folder"
    stage.mkdir()
    folder.mkdir()
    actual = synced(monkeypatch)
    with passing(stage):
        for name in "abc":
            with atomic_file(stage / name) as file:
                file.write(name.encode())
        assert actual == []
        moved = move([stage / name for name in "cab"], folder)
    assert moved == (folder / "c", folder / "a", folder / "b")
    assert [path.read_text() for path in moved] == ["c", "a", "b"]
    assert sorted(actual[:3]) == ["a", "b", "c"] and actual[3:] == ["folder"]
    assert names(stage) == []
    with atomic_file(stage / "d") as file:
        file.write(b"d")
    assert actual[4].startswith(".d.") and actual[5:] == ["stage"]


def test_nothing_is_moved_before_all_is_on_the_disk(tmp_path, monkeypatch):
    stage, folder = tmp_path / "stage", tmp_path / "folder"
    stage.mkdir()
    folder.mkdir()

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    with passing(stage):
        with atomic_file(stage / "a") as file:
            file.write(b"a")
        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match=r"a: cannot be written \(No space"):
            move([stage / "a"], folder)
    assert names(folder) == [] and names(stage) == ["a"]


def test_two_sets_that_come_into_one_folder_at_once_do_not_mix(tmp_path, monkeypatch):
    replace = os.replace

    def slow(file, target):
        time.sleep(0.002)
        replace(file, target)

    monkeypatch.setattr(os, "replace", slow)
    sets = []
    for number in range(3):
        (stage := tmp_path / f"stage{number}").mkdir()
        sets.append([stage / f"{k}.csv" for k in range(15)])
        for path in sets[-1]:
            path.write_text(str(number))
    (folder := tmp_path / "out").mkdir()
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(lambda files: move(files, folder), sets))
    assert len({path.read_text() for path in folder.iterdir()}) == 1


@pytest.mark.parametrize(
    ("name", "stem"),
    [("a\\b", "a%5Cb"), ("12:30", "12%3A30"), ("a\nb", "a%0Ab"), ("é 100%.v2", "é 100%.v2")],
)
@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
def test_a_report_can_list_the_results_of_any_scene(tmp_path, name, stem):
    assert result_files.scene_stem(tmp_path / f"{name}.blend") == stem
    assert result_files.listed(tmp_path, f"{stem}.hfxtrack") == tmp_path / f"{stem}.hfxtrack"


@pytest.mark.parametrize(
    "name", ["../a", "/a", "a/../../b", "a//b", "./a", "", ".", "a\\b", "C:/a", "a\n", 7, None]
)
def test_a_report_names_nothing_outside_its_folder(tmp_path, name):
    assert result_files.listed(tmp_path, name) is None


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("CON", "%43ON"),
        ("nul.txt", "%6Eul.txt"),
        ("Lpt1 .a", "%4Cpt1 .a"),
        ("COM\u00b9", "%43OM\u00b9"),
        ("console", "console"),
        ("COM10", "COM10"),
        ("my con", "my con"),
    ],
)
def test_no_folder_has_the_name_of_a_device_of_windows(name: str, part: str) -> None:
    bodies = [TrackBody("a", name), TrackBody("b", "other")]
    assert result_files.body_parts(bodies) == {"a": part, "b": "other"}


def test_names_of_folders_are_distinct_and_stay_inside():
    names = ["..", ".", "Anna", "anna", "Anna ", "a/b", "", "é" * 60, "%2E."]
    bodies = [TrackBody(f"id{k}", name) for k, name in enumerate(names)]
    parts = list(result_files.body_parts(bodies).values())
    assert len({part.casefold() for part in parts}) == len(names)
    for part in parts:
        assert Path(part).name == part and part[-1] not in ". " and len(part.encode()) <= 110
        stem = Path("out/x")
        assert result_files.device_stem(stem, stem, part, "vest").parents[2] == stem
    assert set(result_files.body_parts(bodies[:1]).values()) == {""}


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("Zoë 手", "Zoë 手"),
        ("Ärger, l'œuvre #2 & [b]; $c", "Ärger, l'œuvre #2 & [b]; $c"),
        ('a/b\\c:d*e?f"g<h>i|j', "a%2Fb%5Cc%3Ad%2Ae%3Ff%22g%3Ch%3Ei%7Cj"),
        ("50%", "50%25"),
        ("a\tb\u202ec", "a%09b%E2%80%AEc"),
        ("", "_"),
    ],
)
def test_only_forbidden_characters_are_escaped(name: str, part: str) -> None:
    assert name_part(name) == part
