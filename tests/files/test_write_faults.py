# SPDX-License-Identifier: GPL-3.0-or-later
"""Disk faults at any step of writing: one message, exit code 3, and no leftovers.

Each write, close, flush to the disk and rename of a conversion fails once, in turn; and real limits
on file sizes end the conversion at many bytes.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from faulty_disk import faulty_disk
from format_cases import raster_for
from test_hjif import BEAT, track_of

from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.formats.rasters import npz_raster

_MOST_STEPS = 16  # per conversion, evenly spaced
DEVICE = "forearm_band_left"
OF_RASTERS = ("csv", "npz", "wav", "ahap", "haptic", "he", "he1")
OF_RASTERS += ("openharmony", "openxr", "tact", "hjif")
OF_TRACKS = ("hjif", "jsonl", "clip", "npz")


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
    with faulty_disk() as disk:
        assert cli.run(_arguments(sources, kind, to, tmp_path)) == 0, capsys.readouterr().err
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert before and disk.steps >= 4
    (tmp_path / "new").mkdir()
    for failing in range(0, disk.steps, -(-disk.steps // _MOST_STEPS)):
        folder, expected = [(tmp_path, before), (tmp_path / "new", {})][failing % 2]
        capsys.readouterr()
        with faulty_disk(failing):
            code = cli.run(_arguments(sources, kind, to, folder))
        lines = [line for line in capsys.readouterr().err.splitlines() if line]
        assert code == 3 and len(lines) == 1 and lines[0].startswith("hfx: "), (failing, lines)
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
        lines = [line for line in capsys.readouterr().err.splitlines() if line]
        assert code == 3 and len(lines) == 1 and "File too large" in lines[0], (most, lines)
        assert list(folder.iterdir()) == []
