# SPDX-License-Identifier: GPL-3.0-or-later
"""Faults of the disk at any step of writing: one message, exit code 3, and nothing is left.

Each write, close, flush to the disk and renaming of a conversion fails once, in turn; and real
limits on the size of a file end it at many bytes.
"""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from format_cases import raster_for
from test_hjif import BEAT, track_of

from hfx_blender import atomic_files, cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.formats import npz_raster

_MOST_STEPS = 16  # of one conversion: all of a small one, evenly many of a larger one
_ERRNOS = (errno.ENOSPC, errno.EFBIG, errno.EIO, errno.EDQUOT)
DEVICE = "forearm_band_left"
OF_RASTERS = ("csv", "npz", "wav", "wav24", "wavfloat", "ahap", "ahap-sqrt", "haptic", "he", "he1")
OF_RASTERS += ("openharmony", "openxr", "tact", "hjif")
OF_TRACKS = ("hjif", "jsonl", "jsonl-compact", "clip", "npz")


class _Disk:
    """Counts steps of writing, and lets one fail."""

    def __init__(self, failing: int | None) -> None:
        self.steps = 0
        self._failing = failing

    def step(self) -> None:
        self.steps += 1
        if self.steps - 1 == self._failing:
            number = _ERRNOS[self.steps % len(_ERRNOS)]
            raise OSError(number, os.strerror(number))


@contextmanager
def _disk(failing: int | None = None) -> Iterator[_Disk]:
    disk = _Disk(failing)

    class Raw(io.FileIO):
        def write(self, content: Any) -> int:
            disk.step()
            return super().write(content)

        def close(self) -> None:
            is_first = not self.closed
            super().close()
            if is_first:
                disk.step()

    def counted(call: Callable[..., Any]) -> Callable[..., Any]:
        def step(*arguments: Any, **more: Any) -> Any:
            disk.step()
            return call(*arguments, **more)

        return step

    with pytest.MonkeyPatch.context() as patch:
        for name in ("fsync", "replace"):
            patch.setattr(atomic_files.os, name, counted(getattr(os, name)))
        atomic_files._WatchedFile.__bases__ = (Raw,)
        try:
            yield disk
        finally:
            atomic_files._WatchedFile.__bases__ = (io.FileIO,)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("sources")
    npz_raster.write(raster_for(load_device(DEVICE), rows=40), folder / "x.raster.npz")
    with track_of(folder, "vibration", "volume", BEAT) as track:
        return {"raster": folder / "x.raster.npz", "track": track.path}


def _arguments(sources: dict[str, Path], kind: str, to: str, out: Path) -> list[str]:
    arguments = ["convert", str(sources[kind]), str(out / "o"), "--to", to]
    needs_device = kind == "raster" or to in ("clip", "npz")
    return [*arguments, "--device", DEVICE] if needs_device else arguments


CASES = [("raster", to) for to in OF_RASTERS] + [("track", to) for to in OF_TRACKS]


@pytest.mark.parametrize(("kind", "to"), CASES)
def test_each_step_of_writing_may_fail(
    sources: dict[str, Path], tmp_path: Path, kind: str, to: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    with _disk() as disk:
        assert cli.run(_arguments(sources, kind, to, tmp_path)) == 0, capsys.readouterr().err
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert before and disk.steps >= 4
    (tmp_path / "new").mkdir()
    for failing in range(0, disk.steps, -(-disk.steps // _MOST_STEPS)):
        folder, expected = [(tmp_path, before), (tmp_path / "new", {})][failing % 2]
        capsys.readouterr()
        with _disk(failing):
            code = cli.run(_arguments(sources, kind, to, folder))
        told = [line for line in capsys.readouterr().err.splitlines() if line]
        assert code == 3 and len(told) == 1 and told[0].startswith("hfx: "), (failing, told)
        there = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
        assert there == expected, failing
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]


@pytest.mark.parametrize(("kind", "to"), CASES)
def test_a_file_may_end_at_any_byte(
    sources: dict[str, Path], tmp_path: Path, kind: str, to: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    resource = pytest.importorskip("resource")
    assert cli.run(_arguments(sources, kind, to, tmp_path)) == 0
    size = max(path.stat().st_size for path in tmp_path.iterdir())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    (folder := tmp_path / "new").mkdir()
    for most in {0, 1, size // 2, size - 1}:
        capsys.readouterr()
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, limits[1]))
        try:
            code = cli.run(_arguments(sources, kind, to, folder))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        told = [line for line in capsys.readouterr().err.splitlines() if line]
        assert code == 3 and len(told) == 1 and "File too large" in told[0], (most, told)
        assert list(folder.iterdir()) == []
