# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces folder of a farm after a merge: foreign files stay."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.export import report
from hfx_blender.export.batch import pieces
from hfx_blender.export.batch.units import ExportOptions, Unit
from hfx_blender.files import limits
from hfx_blender.files.atomic import stored_json, temporary_name


def _unit(out: Path) -> Unit:
    return Unit("join", str(out / "a.blend"), str(out), "a", str(out), ExportOptions())


def _piece(folder: Path, number: int, count: int, listed: str) -> None:
    """Write a piece and a record by hand, after docs/farms.md."""
    content = f"{number}".encode()
    (folder / listed).write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    record = {
        "piece": [number, count],
        "samples": [0, 10],
        "recorded": {},
        "made_from": {},
        "files": [{"name": listed, "bytes": len(content), "sha256": digest}],
    }
    (folder / f"{number}-of-{count}.json").write_text(json.dumps(record))


def test_the_pieces_of_all_divisions_go_and_the_folder_with_them(tmp_path: Path) -> None:
    folder = tmp_path / "a.pieces"
    folder.mkdir()
    for number, count in ((1, 2), (2, 2), (3, 4)):
        _piece(folder, number, count, f"{number}-of-{count}.hfxtrack")
    pieces.remove(_unit(tmp_path))
    killed = folder / temporary_name("hfx-export")
    killed.mkdir()
    (killed / "owner").write_bytes(b"locked\n")  # the process and the lock are gone
    pieces.remove_folder(folder)
    assert list(tmp_path.iterdir()) == []


def test_foreign_files_stay(tmp_path: Path) -> None:
    folder = tmp_path / "a.pieces"
    folder.mkdir()
    _piece(folder, 1, 2, "1-of-2.hfxtrack")
    _piece(folder, 2, 2, "farm.log")  # a record with a foreign file
    (folder / "thesis").mkdir()
    (folder / "thesis" / "1-of-2.hfxtrack").write_bytes(b"precious")
    (folder / "2-of-3.json").write_text("{}")  # no record of a piece
    (folder / "3-of-3.hfxtrack").write_bytes(b"precious")  # of no record
    pieces.remove(_unit(tmp_path))
    pieces.remove_folder(folder)
    assert sorted(path.name for path in folder.iterdir()) == [
        "2-of-3.json",
        "3-of-3.hfxtrack",
        "farm.log",
        "thesis",
    ]
    assert (folder / "thesis" / "1-of-2.hfxtrack").is_file()


@given(files=st.integers(0, 30), most=st.integers(100, 4000))
def test_every_written_report_is_read(
    tmp_path_factory: pytest.TempPathFactory, files: int, most: int
) -> None:
    """A report is refused before writing, or read; limits lowered as for a million files."""
    document = {
        "files": [{"name": f"scene.Clip {k}.ahap", "sha256": "0" * 64} for k in range(files)]
    }
    path = tmp_path_factory.mktemp("report") / "a.report.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limits, "MEMORY", limits.Limit(float(most), "bytes"))
        try:
            path.write_bytes(report.encoded_report(document, path.name))
        except limits.TooLargeError as error:
            assert path.name in str(error) and len(json.dumps(document, indent=1)) >= most
        else:
            assert stored_json(path) == document


def test_a_report_of_a_hundred_megabytes_is_read(tmp_path: Path) -> None:
    """5,000 clips on 100 devices."""
    document = {"warnings": ["w" * 1000] * 70_000}
    path = tmp_path / "a.report.json"
    path.write_bytes(report.encoded_report(document, path.name))
    assert path.stat().st_size > 1 << 26 and stored_json(path) == document
