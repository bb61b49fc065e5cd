# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx export``: exports haptic tracks and device files from .blend scenes."""

import argparse
import json
import os
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from ..export.batch.pieces import folder_of, pieces_folder, remove_folder
from ..export.batch.units import ExportOptions, Outcome, Unit
from ..export.result_files import scene_stem
from ..files import resources
from ..files.atomic import atomic_file, inputs_kept
from ..files.hashes import sha256_of
from ..processes import blender_session
from ..processes.start import cores
from ..processes.tools_package import tools_module
from ..text import printable
from . import export_options
from .arguments import add_json, expanded
from .console import Console

SOME_FAILED = 5
_OF_A_PIECE = ("piece", "samples", "files")  # fields of a piece's record in the result


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "export", help="export scenes", description="Export haptic tracks from .blend scenes."
    )
    export_options.add_arguments(parser)
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Export each scene, also after a failed scene; returns the exit code."""
    from ..export.batch import batch
    from ..files.staging import staging

    options.scenes = expanded(options.scenes)
    export_options.check(options)
    # Blender starts before the staging folder is made: a missing bpy leaves no folder behind.
    in_process = _in_process(options)
    if in_process:
        blender_session.start()
    outcomes: list[Outcome] = []
    reporter = _Reporter(console, outcomes, _given_paths(options))
    # The hidden folder for unfinished files is in the output folder. For a piece, and a merge with
    # pieces, it is in the folder of pieces: jobs of a farm may be killed, and the removal of that
    # folder after the merge removes their unfinished files as well.
    folder: Path = options.output
    if len(options.scenes) == 1:
        pieces = pieces_folder(options.output, scene_stem(options.scenes[0]))
        if options.piece is not None or (options.merge and pieces.is_dir()):
            folder = pieces
    with staging(folder, "hfx-export") as stage:
        units = _units(options, stage.resolve())
        title = units[0].title if len(units) == 1 else f"{len(units)} scenes"
        # Worker processes load Blender's module, which only pip installs. The Blender program
        # executes the units of work in sequence.
        workers: batch.Workers = batch.ThisProcess()
        if not in_process:
            processes = tools_module("export_workers.local_workers")
            assert processes is not None, "Blender exports in its own process"
            workers = processes.LocalWorkers(options.jobs, options.time_limit)
        try:
            # Now in the order of the scenes; the reporter has added them in order of completion.
            outcomes[:] = batch.run(
                units,
                workers,
                resume=options.resume,
                progress=console.progress(title),
                tell=reporter.brief if len(units) > 1 else reporter.fully,
            )
        # Also after a signal (TerminatedError), whose exit code the caller returns.
        except KeyboardInterrupt:
            reporter.interrupted(len(units))
            raise
        finally:
            # The report comes last, also of an interrupted or failed batch: it lists what is
            # complete.
            workers.close()
            results = [_result(outcome) for outcome in outcomes]
            if options.report is not None and results:
                _write_report(options.report, options.output, results)
    for unit in units if options.merge else ():
        # Pieces of a merged scene have done their work; a failed merge raises before.
        remove_folder(folder_of(unit))
    console.result(results if len(results) > 1 else results[0])
    return _exit_code(results, is_named=bool(options.formats and options.device))


def _exit_code(results: Sequence[dict[str, Any]], is_named: bool) -> int:
    """Exit code for results; ``is_named``: formats and devices were given as options."""
    failed = [result for result in results if "error" in result]
    if not failed:
        if any(result.get("silent_devices") for result in results):
            return SOME_FAILED
        # A requested device file that could not be written is a failure of a complete export.
        return SOME_FAILED if is_named and any(result.get("left_out") for result in results) else 0
    # One code for all failures says more than "some failed".
    codes = {int(result["exit_code"]) for result in failed}
    return codes.pop() if len(failed) == len(results) and len(codes) == 1 else SOME_FAILED


def _in_process(options: argparse.Namespace) -> bool:
    """Test that this process exports; a single scene gains nothing from a worker process."""
    if blender_session.inside_blender():
        return True
    needs_workers = options.jobs > 1 or options.time_limit is not None
    return len(options.scenes) <= 1 and not needs_workers


def _units(options: argparse.Namespace, stage: Path) -> list[Unit]:
    """A unit of work per scene, of the open scene without arguments, with absolute paths."""
    # Cores are shared evenly among the processes that run at a time.
    workers = 1 if _in_process(options) else options.jobs
    cores_of_each = max((options.cores or cores()) // workers, 1)
    settings = ExportOptions(
        formats=None if options.formats is None else tuple(options.formats),
        devices=None if options.device is None else tuple(options.device),
        frames=options.frames,
        rate=None if options.rate is None else str(options.rate),
        tolerance=None if options.tolerance is None else options.tolerance.name,
        full_precision=options.full_precision,
        record=tuple(dict.fromkeys(options.record)),
        strict=options.strict,
        scene=options.scene,
        per_clip=options.per_clip,
        clip_detail=options.clip_detail,
        profile=("", "")
        if not options.profile
        else (options.profile, sha256_of(resources.profiles() / f"{options.profile}.json")),
    )
    return [
        Unit(
            kind="join" if options.merge else "scene" if options.piece is None else "piece",
            # Absolute, as worker processes may run in other folders.
            input=None if path is None else os.path.abspath(path),
            folder=os.path.abspath(options.output),
            stem=export_options.open_stem() if path is None else scene_stem(path),
            stage=str(stage),
            options=settings,
            part_frames=options.split,
            cores=cores_of_each,
            piece=options.piece,
        )
        for path in options.scenes or [None]
    ]


def _given_paths(options: argparse.Namespace) -> list[tuple[str, str]]:
    """Pairs of absolute paths and paths as given by the user; files come before their folders."""
    pairs = [(os.path.abspath(path), str(path)) for path in options.scenes]
    folder, given = os.path.abspath(options.output), options.output
    if folder != os.path.dirname(folder):  # except the root, a prefix of every path
        pairs.append(
            (os.path.join(folder, ""), os.path.join("" if str(given) == "." else given, ""))
        )
        pairs.append((folder, str(given)))
    return pairs


class _Reporter:
    """Prints the outcomes of scenes in order of completion, and collects them."""

    def __init__(
        self, console: Console, outcomes: list[Outcome], given: list[tuple[str, str]]
    ) -> None:
        self._console = console
        self._given = given  # of _given_paths
        self._outcomes = outcomes

    def fully(self, unit: Unit, outcome: Outcome) -> None:
        """Report a scene in full."""
        self._note(unit, outcome)
        if "text" in outcome:
            self._console.say(self._as_given(outcome["text"]), several_lines=True)

    def brief(self, unit: Unit, outcome: Outcome) -> None:
        """Report a scene of many in a line."""
        self._note(unit, outcome)
        if "report" in outcome and "unchanged" not in outcome:
            report = outcome["report"]
            warnings = len(report["warnings"])
            also = f", {warnings} warning{'s' * (warnings > 1)}" if warnings else ""
            self._console.say(f"{unit.title}: {len(report['files'])} files{also}")
        elif "piece" in outcome and "unchanged" not in outcome:
            self._console.say(f"{unit.title}: {outcome['text']}")

    def _as_given(self, text: str) -> str:
        """Replace absolute paths, which units need for other processes, by the user's own."""
        for full, given in self._given:
            text = text.replace(full, given)
        return text

    def _note(self, unit: Unit, outcome: Outcome) -> None:
        """Store an outcome with the user's own paths, and print its error, remarks and silent
        devices."""
        if "error" in outcome:
            outcome["error"] = self._as_given(outcome["error"])
        self._outcomes.append(outcome)
        if "traceback" in outcome:
            text = f"{printable(unit.title)}: a defect of hfx, please report it"
            self._console.warn(f"hfx: {text}:\n{outcome['traceback']}", several_lines=True)
        elif "error" in outcome:
            known = unit.input is not None and Path(unit.input).name in outcome["error"]
            where = "" if known else f"{unit.title}: "
            self._console.warn(f"hfx: {where}{outcome['error']}")
        elif "unchanged" in outcome:
            self._console.say(f"{unit.title}: exported before, nothing has changed")
        for silent in outcome.get("report", {}).get("silent_devices", ()):
            self._console.warn(f"hfx: {unit.title}: {silent}")
        for remark in outcome.get("remarks", ()):
            self._console.say(f"{unit.title}: {self._as_given(remark)}")

    def interrupted(self, count: int) -> None:
        """Warn of an interrupted batch with the number of complete scenes; nothing for none."""
        complete = sum("error" not in outcome for outcome in self._outcomes)
        if complete:
            self._console.warn(
                f"hfx: {complete} of {count} scenes are complete; --resume goes on with the others"
            )


def _result(outcome: Outcome) -> dict[str, Any]:
    """Machine-readable result of a scene."""
    # A failed scene has no report.
    if "error" in outcome:
        return {k: v for k, v in outcome.items() if k in ("input", "error", "exit_code")}
    more: dict[str, Any] = {"unchanged": True} if "unchanged" in outcome else {}
    remarks = outcome.get("remarks") or ()
    more |= {"remarks": list(remarks)} if remarks else {}
    if "piece" in outcome:
        record = outcome["piece"]
        return {"input": outcome["input"], **more, **{k: record[k] for k in _OF_A_PIECE}}
    return {"input": outcome["input"], **more, **outcome["report"]}


def _write_report(path: Path, folder: Path, results: list[dict[str, Any]]) -> None:
    failed = sum("error" in result for result in results)
    unchanged = sum("unchanged" in result for result in results)
    summary = {
        "complete": len(results) - failed,
        "unchanged": unchanged,
        "failed": failed,
        "scenes": results,
    }
    files = chain(*(result.get("files", ()) for result in results))
    # A report in place of a result would destroy the result.
    with inputs_kept(folder / entry["name"] for entry in files), atomic_file(path) as file:
        file.write((json.dumps(summary, indent=1) + "\n").encode())
