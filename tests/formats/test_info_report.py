# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx info`` and ``hfx validate`` of reports, effects, paths, and foreign JSON."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path

import pytest

from hfx_blender import cli
from hfx_blender.files import resources
from hfx_blender.files.atomic import stored_json

REPORT = {
    "scene": "Garage",
    "files": [{"name": "a.csv", "bytes": 3, "sha256": "0" * 64}],
    "felt": [{"effect": "Fire", "body": "Avatar", "seconds": 2.0}],
    "unrendered": [],
    "warnings": ["a device is missing"],
    "notes": [],
}


def info(capsys, path, *more):
    code = cli.run(["info", str(path), *more])
    return code, *capsys.readouterr()


@pytest.mark.parametrize(
    ("content", "state", "complete"),
    [(b"abc", "there", "yes"), (b"abcd", "of another size", "no"), (None, "missing", "no")],
)
def test_a_report_lists_written_files_and_their_presence(
    tmp_path, capsys, content, state, complete
):
    path = tmp_path / "x.report.json"
    path.write_text(json.dumps(REPORT))
    if content is not None:
        (tmp_path / "a.csv").write_bytes(content)
    code, out, _ = info(capsys, path, "--json")
    facts = json.loads(out)
    assert code == 0
    assert (facts["scene"], facts["complete"]) == ("Garage", complete)
    assert facts["files"] == [{"name": "a.csv", "bytes": 3, "state": state}]
    assert facts["felt"] == REPORT["felt"]
    code, out, _ = info(capsys, path)
    assert code == 0 and "Fire" in out and "a device is missing" in out


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "'scene' is missing"),
        ([], "allowed is an export's report"),
        (REPORT | {"files": 1}, "files is 1"),
        (REPORT | {"files": [{"name": "../a", "bytes": 1}]}, "files[0].name"),
        (REPORT | {"files": [{"name": "a" * 256, "bytes": 1}]}, "files[0].name"),
        (REPORT | {"files": [{"name": "ä" * 128, "bytes": 1}]}, "files[0].name"),
        (REPORT | {"files": [{"name": "/".join(["a" * 200] * 6), "bytes": 1}]}, "files[0].name"),
        (REPORT | {"files": [{"name": "a"}]}, "files[0]: 'bytes' is missing"),
        (REPORT | {"felt": [{}]}, "felt[0] is {}"),
        (REPORT | {"felt": [1]}, "felt[0] is 1"),
        (REPORT | {"warnings": [None]}, "warnings[0] is null"),
    ],
)
def test_an_invalid_report_is_refused_in_one_line(tmp_path, capsys, content, message):
    path = tmp_path / "x.report.json"
    path.write_text(json.dumps(content))
    code, out, err = info(capsys, path)
    assert code == 3 and not out
    assert err.count("\n") == 1 and str(path) in err and message in err


def test_foreign_json_is_reported(tmp_path, capsys):
    path = tmp_path / "x.other.json"
    path.write_text('{"channels": []}')
    code, _, err = info(capsys, path)
    assert code == 3 and "expected a device configuration, an export's report" in err


@pytest.mark.skipif(os.name == "nt", reason="has no pipes with names")
def test_a_pipe_in_place_of_an_earlier_report_is_not_waited_for(tmp_path):
    path = tmp_path / "scene.report.json"
    os.mkfifo(path)
    keeps_it_open = os.open(path, os.O_RDWR)  # else a reader waits for ever
    try:
        os.write(keeps_it_open, b"{}")
        reader = threading.Thread(target=lambda: actual.append(stored_json(path)), daemon=True)
        actual: list[object] = []
        reader.start()
        reader.join(20)
        assert actual == [None]
    finally:
        os.close(keeps_it_open)


def test_validate_reports_missing_files_of_a_report(tmp_path, capsys):
    path = tmp_path / "x.report.json"
    listed = {"scene": "S", "files": [{"name": "x.csv", "bytes": 2}]}
    path.write_text(json.dumps(listed))
    (tmp_path / "x.csv").write_text("12")
    assert cli.run(["validate", str(path)]) == 0
    (tmp_path / "x.csv").unlink()
    assert cli.run(["validate", str(path)]) == 3
    assert "REPORT-FILE files[0]: 'x.csv' is missing" in capsys.readouterr().out


def test_shipped_effects_and_paths_are_valid_and_described(capsys):
    library = resources.effect_library()
    files = [*sorted(library.glob("*.hfxeffect")), *sorted(library.glob("paths/*.hfxpath"))]
    assert {path.suffix for path in files} == {".hfxeffect", ".hfxpath"}
    assert cli.run(["validate", *map(str, files)]) == 0
    capsys.readouterr()
    code, out, _ = info(capsys, files[0], "--json")
    facts = json.loads(out)
    named = json.loads(files[0].read_text())["effects"]
    assert code == 0 and [effect["effect"] for effect in facts["effects"]] == [
        e["name"] for e in named
    ]
    assert all(item["where"] in of for item, of in zip(facts["effects"], named, strict=True))
    code, out, _ = info(capsys, files[-1], "--json")
    assert json.loads(out)["points"] == len(json.loads(files[-1].read_text())["points_m"])


def test_a_folder_is_checked_recursively(tmp_path, capsys):
    (tmp_path / "Anna").mkdir()
    (tmp_path / "Anna" / "x.haptic").write_text("{}")
    (tmp_path / ".stage").mkdir()
    (tmp_path / ".stage" / "y.haptic").write_text("{}")
    (tmp_path / "notes.txt").write_text("not ours")
    (tmp_path / "chart.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"><g/></svg>')
    (tmp_path / "scene.blend").write_bytes(b"BLENDER-v405")
    assert cli.run(["validate", str(tmp_path), "--json"]) == 5
    actual = {Path(item["file"]).name: item for item in json.loads(capsys.readouterr().out)}
    assert {name: item["is_valid"] for name, item in actual.items()} == {
        "x.haptic": False,
        "chart.svg": True,
        "scene.blend": False,  # no block follows its first bytes
    }
    (tmp_path / "chart.svg").write_text("<svg><g></svg>")
    (tmp_path / "scene.blend").write_bytes(b"something")
    assert cli.run(["validate", str(tmp_path)]) == 3
    (tmp_path / "empty").mkdir()
    assert cli.run(["validate", str(tmp_path / "empty")]) == 3


@pytest.mark.parametrize("name", ["x.hfxclip", "x.hfxtrack", "x.hjif", "x.report.json", "x"])
def test_special_files_are_refused_without_waiting(tmp_path, capsys, name):
    gone, link, pipe = tmp_path / "none" / name, tmp_path / f"of.{name}", tmp_path / name
    link.symlink_to(gone)
    os.mkfifo(pipe)
    for path, message in (
        (gone, "there is no such file"),
        (link, "there is no such file"),
        (pipe, "it is no plain file"),
        (tmp_path, "it is a folder"),
    ):
        code, _, err = info(capsys, path)
        assert code == 3 and err == f"hfx: {path}: {message}.\n"
        if path != tmp_path:
            assert cli.run(["validate", str(path)]) == 3
            assert capsys.readouterr().err == f"hfx: {path}: {message}.\n"
    if name != "x":
        assert cli.run(["validate", str(tmp_path)]) == 3  # the link: a pipe is no file
        assert str(link) in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".hfxeffect", ".hfxpath"])
def test_a_damaged_effect_or_path_is_not_valid(tmp_path, capsys, suffix):
    path = tmp_path / f"x{suffix.upper()}"
    path.write_text('{"schema": "hfx-path", "version": 1, "name": 3}')
    assert cli.run(["validate", str(path), "--json"]) == 3
    document = json.loads(capsys.readouterr().out)
    assert not document["is_valid"] and str(path) in document["error"]
    assert info(capsys, path)[0] == 3
