# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists of trials for PsychoPy and jsPsych, and theirs back."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from study_doubles import make

from hfx_blender.cli import run
from hfx_tools.study.folder import Study
from hfx_tools.study.tables import read_table

PLAN = {
    "name": "pairs",
    "design": "paired",
    "factors": {"duration_ms": [50, 60]},
    "compare": {"strength": [0.25, 0.5]},
    "device": "back_pad",
    "participants": 2,
    "training": 1,
}


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return make(tmp_path, PLAN)


def test_psychopy_gets_a_row_for_each_trial_with_names_of_python(study: Study) -> None:
    assert run(["study", "export", str(study.folder), "--for", "psychopy"]) == 0
    folder = study.folder / "exchange" / "psychopy"
    assert len(list(folder.iterdir())) == 4
    with open(folder / "participant-01_trials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert all(name.isidentifier() for name in rows[0])
    listed = read_table(study.folder / "participant-01" / "trials.tsv")
    for row, trial in zip(rows, listed, strict=True):
        assert {name: row[name] for name in trial} == trial
        assert (study.folder / row["stimulus_first"]).is_file()
        assert row["stimulus_first"] != row["stimulus_second"]


def test_jspsych_gets_timeline_variables_and_gives_them_back(study: Study, tmp_path: Path) -> None:
    assert run(["study", "export", str(study.folder), "--for", "jspsych"]) == 0
    path = study.folder / "exchange" / "jspsych" / "participant-01_trials.json"
    rows = json.loads(path.read_text())
    assert [row["trial"] for row in rows] == [1, 2, 3, 4]
    assert {row["strength_first"] for row in rows} == {0.25, 0.5}
    theirs = tmp_path / "theirs.json"
    theirs.write_text(json.dumps([{**row, "iti": 200} for row in rows[::-1]]))
    assert run(["study", "import", str(study.folder), "2", str(theirs)]) == 0
    listed = read_table(study.folder / "participant-02" / "trials.tsv")
    assert [row["strength_first"] for row in listed] == [
        str(row["strength_first"]) for row in rows[::-1]
    ]
    assert [row["trial"] for row in listed] == ["1", "2", "3", "4"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("duration_ms,strength_first\n50,0.25\n", "row 1 has no 'strength_second'"),
        (
            "duration_ms;strength_first;strength_second\n55;0.25;0.5\n",
            "duration_ms is '55', allowed is one of 50, 60",
        ),
        ("duration_ms,strength_first,strength_second\n", "has no rows"),
        (
            "kind,duration_ms,strength_first,strength_second\nwarm-up,50,0.25,0.5\n",
            "kind is 'warm-up', allowed is one of trial, catch",
        ),
    ],
)
def test_a_bad_list_leaves_the_trials_as_they_were(
    study: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    path = study.folder / "participant-01" / "trials.tsv"
    before = path.read_bytes()
    (tmp_path / "conditions.csv").write_text(text)
    arguments = ["study", "import", str(study.folder), "1", str(tmp_path / "conditions.csv")]
    assert run(arguments) == 3
    assert message in capsys.readouterr().err
    assert path.read_bytes() == before
    study.data_file("01").parent.mkdir(parents=True)
    study.data_file("01").write_text("onset\n")
    assert run(arguments) == 2


def test_the_device_of_the_command_gives_the_files(tmp_path: Path, capfd) -> None:
    plan = {name: value for name, value in PLAN.items() if name != "device"}
    folder = make(tmp_path, plan).folder
    path = folder / "exchange" / "jspsych" / "participant-01_trials.json"
    assert run(["study", "export", str(folder), "--for", "jspsych"]) == 0
    assert "--device" in capfd.readouterr().err
    assert "stimulus_first" not in json.loads(path.read_text())[0]
    called = ["study", "export", str(folder), "--for", "jspsych", "--device", "back_pad"]
    assert run(called) == 0
    assert all((folder / row["stimulus_first"]).is_file() for row in json.loads(path.read_text()))
