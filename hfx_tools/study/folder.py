# SPDX-License-Identifier: GPL-3.0-or-later
"""Folder of a study: plan, lists of trials, and data in the layout of BIDS."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from hfx_blender.errors import InputError, OutputError, UsageError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.files.staging import place, staging
from hfx_blender.files.strict_json import read_bytes
from hfx_blender.version import __version__

from .design import Trial, columns_of, training_of, trials_of
from .plan import Plan, Value, plan_of, read_plan
from .tables import NOTHING, Row, read_table, write_table

PLAN: Final = "plan.json"
BIDS_VERSION: Final = "1.10.0"
_IGNORED: Final = f"{PLAN}\nparticipant-*\nstimuli\nreport.html\nexchange\n"
_README: Final = """\
Study of touch, made by hfx (HFX for Blender).

plan.json: the plan. participant-NN/: trials of a participant. stimuli/: values of devices, named
by their content; stimuli/stimuli.tsv lists hashes and conditions. sub-NN/beh/: answers, a row for
each trial. No names of persons are stored. 'hfx study delete FOLDER NN' deletes all data of a
participant.
"""


class Study:
    """Existing folder of a study. Raises InputError for a folder without a valid plan."""

    def __init__(self, folder: Path) -> None:
        if not (folder / PLAN).is_file():
            fault = f"it has no {PLAN}" if folder.is_dir() else "there is no such folder"
            raise InputError(f"{folder}: {fault}; 'hfx study make PLAN -o FOLDER' makes a study.")
        self.folder = folder
        self.plan = plan_of(read_bytes(folder / PLAN), folder / PLAN)

    @property
    def task(self) -> str:
        """Label of the task in file names, letters and digits."""
        return re.sub(r"[^A-Za-z0-9]", "", self.plan.name) or "study"

    def data_file(self, participant: str, suffix: str = "_events.tsv") -> Path:
        """File of a participant's answers, or with another suffix; may be missing."""
        name = f"sub-{participant}_task-{self.task}{suffix}"
        return self.folder / f"sub-{participant}" / "beh" / name

    def label(self, text: str) -> str:
        """Label of a participant, "01" for "1", "01" or "sub-01"; UsageError for other texts."""
        digits = text.removeprefix("sub-").removeprefix("participant-")
        if not re.fullmatch(r"[0-9]{1,3}", digits) or not int(digits):
            raise UsageError(f"participant {text[:60]}: expected a number from 1 to 999")
        return label_of(int(digits))

    def trials(self, participant: str) -> tuple[list[Trial], list[Trial]]:
        """Training and trials of a participant, from the folder; lists of deleted participants, and
        of further ones, are made again. InputError for an unusable list."""
        number = int(participant)
        folder = self.folder / f"participant-{participant}"
        if not (folder / "trials.tsv").exists():
            write_lists(folder, self.plan, number)
        columns = columns_of(self.plan)
        lists = []
        for name in ("training.tsv", "trials.tsv"):
            path = folder / name
            rows = read_table(path, columns) if path.exists() else []
            lists.append([self.parsed(row, path) for row in rows])
        return lists[0], lists[1]

    def participants(self) -> list[str]:
        """Labels of participants with answers, ascending."""
        pattern = f"sub-*/beh/sub-*_task-{self.task}_events.tsv"
        return sorted(
            path.parents[1].name.removeprefix("sub-") for path in self.folder.glob(pattern)
        )

    def delete(self, participant: str) -> list[Path]:
        """Delete all data and lists of a participant; returns the deleted folders. UsageError if
        there are none."""
        folders = [self.folder / f"{kind}-{participant}" for kind in ("sub", "participant")]
        present = [folder for folder in folders if folder.is_dir()]
        if not present:
            raise UsageError(f"participant {participant}: {self.folder} has no data of them")
        for folder in present:
            try:
                shutil.rmtree(folder)
            except OSError as error:
                raise OutputError(
                    f"{error.filename}: cannot be deleted ({error.strerror})."
                ) from error
        self.write_participants()
        return present

    def write_participants(self) -> None:
        """Write the table of participants, those with answers, and its description; without
        answers remove both, as BIDS refuses a table without participants."""
        table, description = (self.folder / f"participants.{suffix}" for suffix in ("tsv", "json"))
        rows = [{"participant_id": f"sub-{label}"} for label in self.participants()]
        if rows:
            text = "Number of the participant; no names are stored."
            write_json(description, {"participant_id": {"Description": text}})
            write_table(table, ["participant_id"], rows)
        else:
            table.unlink(missing_ok=True)
            description.unlink(missing_ok=True)

    def parsed(self, row: Row, path: Path) -> Trial:
        """Trial of a row of text: values of factors as in the plan. InputError for other values."""
        plan, parsed = self.plan, dict[str, Value](row)
        parsed["trial"] = int(row["trial"]) if row["trial"].isdigit() else row["trial"]
        tables: dict[str, tuple[Value, ...]] = {**plan.factors, **plan.random}
        for name, values in plan.compare.items():
            tables |= {f"{name}_first": values, f"{name}_second": values}
        if plan.level_factor:
            column = "start" if plan.design == "adjustment" else plan.level_factor
            is_open = plan.design == "staircase"
            tables[column] = (*plan.levels, NOTHING) if is_open else plan.levels
        if plan.has_intervals and plan.level_factor:
            tables["target"] = ("first", "second")
        for name, values in tables.items():
            texts = {value if isinstance(value, str) else repr(value): value for value in values}
            if row[name] not in texts:
                raise InputError(
                    f"{path}: trial {row['trial']}: {name} is '{row[name][:60]}', allowed is one "
                    f"of {', '.join(texts)}."
                )
            parsed[name] = texts[row[name]]
        return parsed


def label_of(number: int) -> str:
    """Label of a participant in names of folders: "01"."""
    return f"{number:02d}"


def make(source: str | Path, folder: Path) -> Study:
    """Make the folder of a study: plan, lists of trials and files of BIDS, all or none. Raises
    InputError for an unusable plan and OutputError for a folder with files."""
    plan = read_plan(source)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{folder}: is not empty; name a new folder for the study.")
    with staging(folder, plan.name, folder.absolute().parent) as staged:
        stage = staged / "study"
        stage.mkdir()
        (stage / PLAN).write_bytes(read_bytes(plan.path))
        for number in range(1, plan.participants + 1):
            write_lists(stage / f"participant-{label_of(number)}", plan, number)
        _write_descriptions(stage, plan)
        files = sorted(path for path in stage.rglob("*") if path.is_file())
        place(files, folder, stage)
    return Study(folder)


def write_lists(folder: Path, plan: Plan, number: int) -> None:
    """Write the lists of trials of a participant; OutputError for an unwritable folder."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}).") from error
    columns = columns_of(plan)
    if plan.training:
        write_table(folder / "training.tsv", columns, training_of(plan, number))
    write_table(folder / "trials.tsv", columns, trials_of(plan, number))


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a JSON file for readers; OutputError for an unwritable file."""
    with atomic_file(path) as file:
        file.write((json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode())


def _write_descriptions(folder: Path, plan: Plan) -> None:
    """Write the files of a BIDS data set that describe the whole study."""
    write_json(
        folder / "dataset_description.json",
        {
            "Name": plan.title,
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "raw",
            "GeneratedBy": [{"Name": "hfx", "Version": __version__}],
        },
    )
    (folder / "README").write_text(_README, encoding="utf-8")
    (folder / ".bidsignore").write_text(_IGNORED, encoding="utf-8")
