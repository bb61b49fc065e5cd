# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists of trials for PsychoPy (conditions file, CSV) and jsPsych (timeline variables, JSON).

PsychoPy reads a CSV file with a row for each trial and names of columns that are Python names
(psychopy.data.importConditions). jsPsych takes a list of objects as ``timeline_variables``.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from hfx_blender.errors import InputError, UsageError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.files.strict_json import parse, read_bytes

from .design import Trial, columns_of
from .folder import Study, write_lists
from .plan import Conditions, as_text
from .stimuli import StimulusLibrary, intervals_of
from .tables import NOTHING, Row, write_table

SUFFIXES: Final = {"psychopy": ".csv", "jspsych": ".json"}
FOLDER: Final = "exchange"


def write(study: Study, program: str, library: StimulusLibrary | None = None) -> list[Path]:
    """Write the lists of all participants for a program into ``exchange/``; returns the paths.

    With ``library`` each trial has the files of its stimuli, relative to the study's folder.
    Raises OutputError for an unwritable file.
    """
    paths = []
    folder = study.folder / FOLDER / program
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(1, study.plan.participants + 1):
        label = f"{number:02d}"
        training, trials = study.trials(label)
        for name, rows in (("training", training), ("trials", trials)):
            if rows:
                path = folder / f"participant-{label}_{name}{SUFFIXES[program]}"
                full = [{**row, **_files(study, row, library)} for row in rows]
                with atomic_file(path) as file:
                    file.write(_encoded(program, full))
                paths.append(path)
    return paths


def read(study: Study, participant: str, path: Path) -> list[Trial]:
    """Replace a participant's list of trials by the list of a PsychoPy or jsPsych file; returns the
    trials. Further columns are left out.

    Raises InputError for a file with missing columns or values outside the plan, and UsageError for
    a participant with answers; the list is as before then.
    """
    if study.data_file(participant).exists():
        raise UsageError(f"participant {participant}: has answers; the list stays as it is")
    columns = columns_of(study.plan)
    rows = _decoded(path)
    texts: list[Row] = []
    for number, row in enumerate(rows, 1):
        defaults = {"trial": number, "kind": "trial"}
        filled = {**defaults, **{name: row[name] for name in columns if name in row}}
        missing = [name for name in columns if name not in filled]
        if missing:
            raise InputError(
                f"{path}: row {number} has no '{missing[0]}'; needed are {', '.join(columns)}."
            )
        # A list of another program is counted anew.
        filled["trial"] = number
        if filled["kind"] not in ("trial", "catch"):
            raise InputError(
                f"{path}: row {number}: kind is '{str(filled['kind'])[:60]}', allowed is one of "
                "trial, catch."
            )
        texts.append({name: _text(filled[name]) for name in columns})
    if not texts:
        raise InputError(f"{path}: has no rows.")
    trials = [study.parsed(row, path) for row in texts]
    folder = study.folder / f"participant-{participant}"
    if not folder.exists():
        write_lists(folder, study.plan, int(participant))
    write_table(folder / "trials.tsv", columns, trials)
    return trials


def _files(study: Study, trial: Trial, library: StimulusLibrary | None) -> Mapping[str, Any]:
    """Files of a trial's stimuli; empty without a library, and for levels chosen in a session."""
    plan = study.plan
    is_open = plan.design == "adjustment" or trial.get(plan.level_factor) == NOTHING
    if library is None or is_open:
        return {}
    conditions: list[Conditions] = intervals_of(plan, trial)
    names = ["stimulus_first", "stimulus_second"] if plan.has_intervals else ["stimulus"]
    return {
        name: f"stimuli/{library[one].name}.csv"
        for name, one in zip(names, conditions, strict=True)
    }


def _encoded(program: str, rows: list[dict[str, Any]]) -> bytes:
    if program == "jspsych":
        import json

        return (json.dumps(rows, indent=1, ensure_ascii=False) + "\n").encode()
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _decoded(path: Path) -> list[dict[str, Any]]:
    """Rows of a file: .json a list of objects, else CSV with commas, semicolons or tabs."""
    content = read_bytes(path)
    if path.suffix.lower() == ".json":
        rows = parse(content, str(path))
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise InputError(f"{path}: is no list of objects, as timeline_variables are.")
        return rows
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8.") from None
    first = text.partition("\n")[0]
    separator = max(",;\t", key=first.count)
    try:
        return list(csv.DictReader(io.StringIO(text), delimiter=separator, strict=True))
    except csv.Error as error:
        raise InputError(f"{path}: is no table of CSV ({error}).") from None


def _text(value: Any) -> str:
    """Text of a value in the list; "n/a" for an empty cell, and for other types than of plans."""
    if isinstance(value, str):
        return value or NOTHING
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return as_text(value) if is_number else NOTHING
