# SPDX-License-Identifier: GPL-3.0-or-later
"""Hidden folders of unfinished results: removed at the end of the block, or by the next run."""

from __future__ import annotations

import errno
import os
import platform
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.files import atomic, staging
from hfx_blender.files.atomic import temporary_name
from hfx_blender.files.staging import stage_folder

HOLD = """
import sys
from pathlib import Path
from hfx_blender.files.staging import stage_folder
with stage_folder(Path(sys.argv[1]), "scene") as stage:
    (stage / "half").write_text("x")
    print(stage, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Start another process with a folder in ``tmp_path``."""
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process
        process.kill()


def _stage_of(holder: subprocess.Popen[str]) -> Path:
    assert holder.stdout is not None
    return Path(holder.stdout.readline().strip())


def test_a_folder_is_hidden_and_gone_afterwards(tmp_path: Path) -> None:
    with pytest.raises(KeyError), stage_folder(tmp_path, "scene") as stage:
        assert stage.parent == tmp_path and stage.name.startswith(".scene.")
        (stage / "half").write_text("x")
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_that_of_a_killed_run_is_removed_by_the_next(
    tmp_path: Path, holder: subprocess.Popen[str]
) -> None:
    left = _stage_of(holder)
    holder.kill()
    holder.wait()
    assert (left / "half").is_file()
    with stage_folder(tmp_path, "other") as stage:
        assert list(tmp_path.iterdir()) == [stage]


def test_that_of_a_living_run_stays(tmp_path: Path, holder: subprocess.Popen[str]) -> None:
    alive = _stage_of(holder)
    with stage_folder(tmp_path, "other"), stage_folder(tmp_path, "other"):
        assert (alive / "half").is_file()
    assert list(tmp_path.iterdir()) == [alive]


def test_that_of_another_machine_stays(
    tmp_path: Path, holder: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    left = _stage_of(holder)
    holder.kill()
    holder.wait()
    monkeypatch.setattr(atomic.platform, "node", lambda: "elsewhere")
    staging.remove_abandoned(tmp_path)
    assert (left / "half").is_file()


def test_the_owner_of_a_stage_is_written_as_it_is_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file ``owner`` is binary: Windows writes the line end of a text as two bytes."""
    opened, flags = os.open, []

    def watch(path: Any, flag: int, *mode: int, **options: Any) -> int:
        flags.append(flag)
        return opened(path, flag, *mode, **options)

    monkeypatch.setattr(os, "O_BINARY", os.O_SYNC, raising=False)  # any flag without effect here
    monkeypatch.setattr(os, "open", watch)
    with stage_folder(tmp_path, "scene"):
        made = [flag for flag in flags if flag & os.O_CREAT]
    assert made and all(flag & os.O_SYNC == os.O_SYNC for flag in made)


@pytest.mark.parametrize("name", ["held", "below/held"])
def test_a_file_that_is_open_elsewhere_is_removed_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Windows refuses to remove the second name of a replaced track while a viewer has it open."""
    unlink = os.unlink

    def refuse(path: Any, **options: Any) -> None:
        if os.path.basename(path) == "held":
            raise PermissionError(errno.EACCES, "The process cannot access the file", str(path))
        unlink(path, **options)

    with monkeypatch.context() as patch:
        patch.setattr(os, "unlink", refuse)
        with stage_folder(tmp_path, "scene") as stage:
            (stage / name).parent.mkdir(exist_ok=True)
            (stage / name).write_text("x")
            (stage / "other").write_text("x")
        staging.remove_abandoned(tmp_path)  # still open
        assert (stage / name).is_file() and not (stage / "other").exists()
    staging.remove_abandoned(tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("owner", [None, b"", b"locked\n", f"{platform.node()}\n".encode()])
@pytest.mark.parametrize("name", [".scene.abc.tmp", ".cache.tmp", ".a.0123456789abcdef.tmp"])
def test_unknown_folders_stay(tmp_path: Path, name: str, owner: bytes | None) -> None:
    strange = tmp_path / name
    strange.mkdir()
    (strange / "thesis").write_text("precious")
    if owner is not None:
        (strange / "owner").write_bytes(owner)
        os.utime(strange / "owner", (0, 0))
    staging.remove_abandoned(tmp_path)
    assert (strange / "thesis").is_file()


@pytest.mark.parametrize("owner", [None, b""])
def test_an_empty_stage_is_removed_once_old(tmp_path: Path, owner: bytes | None) -> None:
    """A process was killed on a full disk, with an empty ``owner`` or before writing the file."""
    stage = tmp_path / temporary_name("scene")
    stage.mkdir()
    if owner is not None:
        (stage / "owner").write_bytes(owner)
    staging.remove_abandoned(tmp_path)
    assert stage.is_dir()  # just created by another run
    for path in (*stage.iterdir(), stage):
        os.utime(path, (0, 0))
    staging.remove_abandoned(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_old_stage_without_an_owner_stays(tmp_path: Path) -> None:
    stage = tmp_path / temporary_name("scene")
    stage.mkdir()
    (stage / "thesis").write_text("precious")
    os.utime(stage, (0, 0))
    staging.remove_abandoned(tmp_path)
    assert (stage / "thesis").is_file()


def test_a_link_is_never_followed(tmp_path: Path) -> None:
    real = tmp_path / "real"
    real.mkdir()
    (real / "owner").write_bytes(b"locked\n")
    link = tmp_path / temporary_name("scene")
    link.symlink_to(real)
    staging.remove_abandoned(tmp_path)
    assert (real / "owner").is_file() and link.is_symlink()


@pytest.mark.parametrize("call", ["write", "close"])
def test_a_folder_on_a_full_disk_is_gone_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """Writing ``owner`` fails, by a limit on file sizes or by a fault at closing."""
    close = os.close

    def full(descriptor: int) -> None:
        os.close = close
        close(descriptor)
        raise OSError(errno.EDQUOT, "Disk quota exceeded")

    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    previous = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with monkeypatch.context() as patch:
        if call == "close":
            patch.setattr(os, "close", full)
        else:
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
        try:
            with pytest.raises(KeyError), stage_folder(tmp_path, "scene"):
                raise KeyError
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            signal.signal(signal.SIGXFSZ, previous)
    assert list(tmp_path.iterdir()) == []


def test_a_long_name_is_shortened(tmp_path: Path) -> None:
    with stage_folder(tmp_path, "ä" * 400) as stage:
        assert len(stage.name.encode()) < 255


def test_without_locks_a_stage_is_never_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOTSUP, "Operation not supported")

    with monkeypatch.context() as patch:
        patch.setattr(staging, "take_lock", no_locks)
        with stage_folder(tmp_path, "scene") as stage:
            patch.undo()
            staging.remove_abandoned(tmp_path)
            assert stage.is_dir()
    assert list(tmp_path.iterdir()) == []
