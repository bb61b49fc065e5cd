# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx study``: makes, runs and reports studies of touch."""

from __future__ import annotations

import argparse
import math
import shutil
from pathlib import Path
from typing import Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console

from . import study_run


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "study",
        help="compare and measure touch with participants",
        description="Make studies of touch from a plan, run them on devices, and report the "
        "results (docs/study.md).",
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    sub = actions.add_parser("make", help="make a study's folder from a plan")
    sub.add_argument(
        "plan", metavar="PLAN", help="a .json, or a shipped plan: mango96, textile-pse, board"
    )
    sub.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="new folder")
    sub.add_argument(
        "--device",
        action="append",
        metavar="NAME",
        help="render stimuli for this device now (default: of the plan; else at the first run)",
    )
    add_json(sub, _make)
    study_run.add_parser(actions)
    sub = actions.add_parser(
        "report",
        help="analyse the answers",
        description="Analyse the answers by the design of the plan, and write report.html, one "
        "page that prints.",
    )
    _add_folder(sub)
    add_json(sub, _report)
    sub = actions.add_parser("export", help="write the lists of trials for PsychoPy or jsPsych")
    _add_folder(sub)
    sub.add_argument("--for", dest="program", choices=("psychopy", "jspsych"), required=True)
    sub.add_argument(
        "--device",
        action="append",
        metavar="NAME",
        help="name the files of the stimuli for this device (default: of the plan)",
    )
    add_json(sub, _export)
    sub = actions.add_parser("import", help="take a participant's list from PsychoPy or jsPsych")
    _add_folder(sub)
    sub.add_argument("participant", metavar="NN", help="number of the participant")
    sub.add_argument("file", type=Path, metavar="FILE", help="conditions (.csv) or a list (.json)")
    add_json(sub, _import)
    sub = actions.add_parser("delete", help="delete all data of a participant")
    _add_folder(sub)
    sub.add_argument("participant", metavar="NN", help="number of the participant")
    add_json(sub, _delete)


def _add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of 'hfx study make'")


def _make(options: argparse.Namespace, console: Console) -> int:
    from ..study import folder
    from ..study.plan import read_plan
    from ..study.plan_values import kind_of, labels_of, refuse_values
    from ..study.stimuli import StimulusLibrary, conditions_of, devices_of

    plan = read_plan(options.plan)
    refuse_values(plan)
    conditions_of(plan)
    study = folder.make(options.plan, options.output)
    # Takes are named relative to the original plan.
    study.plan = plan
    count = 0
    has_devices = "device" in {**plan.factors, **plan.random, **plan.compare}
    try:
        if options.device or plan.device or has_devices or kind_of(plan) == "file":
            devices = devices_of(plan, options.device or ())
            progress = console.progress("stimuli")
            count = len(StimulusLibrary(study, devices, progress))
    except BaseException:
        shutil.rmtree(options.output, ignore_errors=True)
        raise
    for name in labels_of(plan):
        console.warn(f"{options.plan}: no stimulus depends on factors.{name}.")
    training, trials = study.trials(folder.label_of(1))
    console.say(
        f"{options.output}: {plan.participants} participants, {len(trials)} trials each, "
        f"{len(training)} of training, {count} stimuli"
    )
    console.result(
        {
            "folder": str(options.output),
            "participants": plan.participants,
            "trials": len(trials),
            "training": len(training),
            "stimuli": count,
        }
    )
    return 0


def _report(options: argparse.Namespace, console: Console) -> int:
    from ..study import report
    from ..study.analysis import analysed
    from ..study.folder import Study

    study = Study(options.folder)
    results = analysed(study)
    path = report.write(study, results)
    console.say(f"{path}: {results['participants']} participants, {results['trials']} trials")
    console.result({"file": str(path), **_without_nan(results)})
    return 0


def _without_nan(value: Any) -> Any:
    """Copy of a result with None for numbers that are not finite, which JSON does not have."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _export(options: argparse.Namespace, console: Console) -> int:
    from ..study import exchange
    from ..study.folder import Study
    from ..study.stimuli import StimulusLibrary, devices_of

    study = Study(options.folder)
    library = None
    if options.device or study.plan.device:
        library = StimulusLibrary(study, devices_of(study.plan, options.device or ()))
    else:
        console.warn("hfx: the lists name no files of stimuli; name the device with --device.")
    paths = exchange.write(study, options.program, library)
    console.say(f"wrote {len(paths)} files in {paths[0].parent}")
    console.result({"files": [str(path) for path in paths]})
    return 0


def _import(options: argparse.Namespace, console: Console) -> int:
    from ..study import exchange
    from ..study.folder import Study

    study = Study(options.folder)
    label = study.label(options.participant)
    trials = exchange.read(study, label, options.file)
    console.say(f"participant {label}: {len(trials)} trials of {options.file}")
    console.result({"participant": label, "trials": len(trials)})
    return 0


def _delete(options: argparse.Namespace, console: Console) -> int:
    from ..study.folder import Study

    study = Study(options.folder)
    deleted = study.delete(study.label(options.participant))
    for path in deleted:
        console.say(f"deleted {path}")
    console.result({"deleted": [str(path) for path in deleted]})
    return 0
