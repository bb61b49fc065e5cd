# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx export``: haptic tracks and device files from .blend scenes."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any

from ..engine.tolerance import Tolerance
from ..engine.tolerance import parse as parse_tolerance
from ..errors import UsageError
from ..export.batch.local_workers import LocalWorkers, ThisProcess, Workers
from ..export.batch.pieces import MOST_PIECES, folder_of, pieces_folder, remove_folder
from ..export.batch.units import ExportOptions, Outcome, Unit
from ..files.atomic import atomic_file, inputs_kept, refuse_taken
from ..formats.clip import COARSEST, DETAIL
from ..formats.registry import EXPORTED, FORMATS, refuse_unknown, suffixes
from ..processes import blender_session
from ..processes.start import cores
from ..text import name_key, printable
from .arguments import expanded
from .console import Console

SOME_FAILED = 5
_OF_A_PIECE = ("piece", "samples", "files")  # of its record, in the result


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "export", help="export scenes", description="Export haptic tracks from .blend scenes."
    )
    in_blender = blender_session.inside_blender()
    parser.add_argument(
        "scenes",
        nargs="*" if in_blender else "+",
        type=Path,
        metavar="SCENE.blend",
        help="files to export" + ("; none: the open file" if in_blender else ""),
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("."), metavar="DIR")
    parser.add_argument(
        "-f",
        "--formats",
        action="extend",
        type=_names,
        metavar="F,...",
        help=f"{_names_of_formats(False)}; for devices {_names_of_formats(True)} (default: track; "
        "csv for devices)",
    )
    parser.add_argument("--frames", type=_frames, metavar="A:B", help="both included")
    parser.add_argument("--rate", type=_rate, metavar="HZ", help="samples a second")
    parser.add_argument(
        "--tolerance",
        type=_tolerance,
        metavar="T",
        help="preview, standard, exact, paper, or values such as 3mm,5ms,5%%: limits of the "
        "errors of edges, "
        "motion and strength; a contact may begin late by the ms plus the time that its "
        "approach takes for the mm (default: the scene's)",
    )
    parser.add_argument(
        "--device",
        action="append",
        metavar="NAME",
        help="a device by name or file; 'none' for no device (default: the scene's own)",
    )
    parser.add_argument("--scene", metavar="NAME", help="a scene of the file by name")
    parser.add_argument(
        "--full-precision", action="store_true", help="weights as 32-bit floats, not 8 bits"
    )
    parser.add_argument(
        "--record",
        action="extend",
        type=_names,
        default=[],
        metavar="WHAT,...",
        help="also record positions, velocities, depth of each vertex",
    )
    parser.add_argument(
        "--strict", action="store_true", help="a warning about a scene is an error: exit code 3"
    )
    parser.add_argument(
        "--per-clip",
        action="store_true",
        help="each named clip as files of its own, from time 0, instead of the whole timeline",
    )
    parser.add_argument(
        "--clip-detail",
        type=int,
        choices=range(COARSEST + 1),
        default=DETAIL,
        metavar="N",
        help="level of detail of bodies in game clips: 0 is all vertices, each level has about a "
        f"quarter of those before it (default: {DETAIL})",
    )
    work = parser.add_argument_group("many scenes, long scenes")
    work.add_argument("--jobs", type=int, default=1, metavar="N", help="worker processes")
    work.add_argument(
        "--cores",
        type=int,
        metavar="N",
        help="processor cores to use, shared among the workers (default: all of this machine); "
        "long scenes are evaluated on several, with the same results",
    )
    work.add_argument(
        "--resume",
        action="store_true",
        help="skip scenes that are completely exported already, if neither the scene nor "
        "what it links, an option or a version has changed",
    )
    work.add_argument(
        "--time-limit",
        type=_seconds,
        metavar="SECONDS",
        help="stop a scene, or a part of it, that takes longer",
    )
    work.add_argument(
        "--split",
        type=int,
        metavar="FRAMES",
        help="record scenes in parts of this many frames (default: the last long scenes, in as "
        "many parts as there are workers); the results are the same",
    )
    work.add_argument(
        "--piece",
        type=_piece,
        metavar="K/N",
        help="record only piece K of N, for --merge; on a farm each piece is a job",
    )
    work.add_argument(
        "--merge",
        action="store_true",
        help="combine the pieces into the files of one export; needs the same options",
    )
    work.add_argument("--report", type=Path, metavar="FILE", help="write the result as JSON")
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    parser.set_defaults(run=run)


def _names_of_formats(of_devices: bool) -> str:
    """Formats of an export that devices are needed for, or the others."""
    infos = (FORMATS[id] for id in EXPORTED)
    names = [i.id for i in infos if of_devices == (i.is_of_device or bool(i.write_played))]
    return ", ".join(names)


def run(options: argparse.Namespace, console: Console) -> int:
    """Export each scene; one that fails does not stop the others."""
    from ..export.batch import batch
    from ..files.staging import staging

    options.scenes = expanded(options.scenes)
    _check(options)
    in_process = _in_process(options)
    if in_process:
        blender_session.start()
    outcomes: list[Outcome] = []
    tell = _Teller(console, outcomes, _given_paths(options))
    with staging(_stage_folder(options), "hfx-export") as stage:
        units = _units(options, stage.resolve())
        title = units[0].title if len(units) == 1 else f"{len(units)} scenes"
        workers = _workers(options)
        try:
            outcomes[:] = batch.run(
                units,
                workers,
                resume=options.resume,
                progress=console.progress(title),
                tell=tell.brief if len(units) > 1 else tell.fully,
            )
        except KeyboardInterrupt:
            tell.interrupted(len(units))
            raise
        finally:
            workers.close()
            results = [_result(outcome) for outcome in outcomes]
            if options.report is not None and results:
                _write_report(options.report, options.output, results)
    for unit in units if options.merge else ():
        remove_folder(folder_of(unit))
    console.result(results if len(results) > 1 else results[0])
    return _exit_code(results, is_named=bool(options.formats and options.device))


def _exit_code(results: Sequence[dict[str, Any]], is_named: bool) -> int:
    """Exit code for the results of scenes; ``is_named``: their formats and devices were."""
    failed = [result for result in results if "error" in result]
    if not failed:
        if any(each.get("silent_devices") for each in results):
            return SOME_FAILED
        # A named result that could not be written is no success, though all else is complete.
        return SOME_FAILED if is_named and any(each.get("left_out") for each in results) else 0
    return SOME_FAILED if len(results) > 1 else int(failed[0]["exit_code"])


def _stage_folder(options: argparse.Namespace) -> Path:
    """Folder in which the one for unfinished files is made.

    That of a job of a farm, which may be killed, goes away with the pieces.
    """
    output: Path = options.output
    if len(options.scenes) != 1:
        return output
    pieces = pieces_folder(output, options.scenes[0].stem)
    return pieces if options.piece is not None or (options.merge and pieces.is_dir()) else output


def _in_process(options: argparse.Namespace) -> bool:
    """Test that this process does the work itself: one scene gains nothing from another process."""
    if blender_session.inside_blender():
        return True
    asked = options.jobs > 1 or options.time_limit is not None
    return len(options.scenes) <= 1 and not asked


def _workers(options: argparse.Namespace) -> Workers:
    if _in_process(options):
        return ThisProcess()
    return LocalWorkers(options.jobs, options.time_limit)


def _units(options: argparse.Namespace, stage: Path) -> list[Unit]:
    asked = ExportOptions(
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
    )
    return [
        Unit(
            kind="join" if options.merge else "scene" if options.piece is None else "piece",
            input=None if path is None else os.path.abspath(path),
            folder=os.path.abspath(options.output),
            stem=_open_stem() if path is None else path.stem,
            stage=str(stage),
            options=asked,
            part_frames=options.split,
            cores=_cores_of_each(options),
            piece=options.piece,
        )
        for path in options.scenes or [None]
    ]


def _cores_of_each(options: argparse.Namespace) -> int:
    """Number of cores for each worker."""
    return max((options.cores or cores()) // (1 if _in_process(options) else options.jobs), 1)


def _given_paths(options: argparse.Namespace) -> list[tuple[str, str]]:
    """Paths in full, and as the user gave them; files before their folders."""
    found = [(os.path.abspath(path), str(path)) for path in options.scenes]
    folder, given = os.path.abspath(options.output), options.output
    if folder != os.path.dirname(folder):  # not the root, which begins every path
        found.append(
            (os.path.join(folder, ""), os.path.join("" if str(given) == "." else given, ""))
        )
        found.append((folder, str(given)))
    return found


def _open_stem() -> str:
    import bpy

    return Path(bpy.data.filepath).stem or "untitled"


class _Teller:
    """Reporter of scenes' outcomes, as soon as they are known."""

    def __init__(
        self, console: Console, outcomes: list[Outcome], given: list[tuple[str, str]]
    ) -> None:
        self._console = console
        self._given = given  # paths: in full, and as the user gave them
        self._outcomes = outcomes

    def fully(self, unit: Unit, outcome: Outcome) -> None:
        """Report one scene in full."""
        self._note(unit, outcome)
        if "text" in outcome:
            self._console.say(self._as_given(outcome["text"]), several_lines=True)

    def brief(self, unit: Unit, outcome: Outcome) -> None:
        """Report one of many scenes."""
        self._note(unit, outcome)
        if "report" in outcome and "unchanged" not in outcome:
            report = outcome["report"]
            warnings = len(report["warnings"])
            also = f", {warnings} warning{'s' * (warnings > 1)}" if warnings else ""
            self._console.say(f"{unit.title}: {len(report['files'])} files{also}")
        elif "piece" in outcome and "unchanged" not in outcome:
            self._console.say(f"{unit.title}: {outcome['text']}")

    def _as_given(self, text: str) -> str:
        """Show paths as the user gave them: a unit has them in full, for other processes."""
        for full, given in self._given:
            text = text.replace(full, given)
        return text

    def _note(self, unit: Unit, outcome: Outcome) -> None:
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
        """Report the rest of a batch, if any."""
        complete = sum("error" not in outcome for outcome in self._outcomes)
        if complete:
            self._console.warn(
                f"hfx: {complete} of {count} scenes are complete; --resume goes on with the others"
            )


def _result(outcome: Outcome) -> dict[str, Any]:
    """The machine-readable result of one scene."""
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
    made = (folder / each["name"] for each in chain(*(r.get("files", ()) for r in results)))
    with inputs_kept(made), atomic_file(path) as file:
        file.write((json.dumps(summary, indent=1) + "\n").encode())


def _check(options: argparse.Namespace) -> None:
    """Reject options with which no scene could be exported, before any is opened."""
    from ..devices.configuration import load_device
    from ..engine.areas.on_demand import ON_DEMAND

    refuse_unknown(options.formats or (), "-f")
    for name in options.device or ():
        if name != "none":
            load_device(name)
    unknown = sorted(set(options.record) - ON_DEMAND)
    if unknown:
        raise UsageError(f"--record {unknown[0]}: expected some of {', '.join(sorted(ON_DEMAND))}")
    for name, what in (("jobs", "1"), ("cores", "1"), ("split", "1 frame")):
        count = getattr(options, name)
        if count is not None and count < 1:
            raise UsageError(f"--{name} {count}: expected at least {what}")
    if options.piece is not None and options.merge:
        raise UsageError("--merge: comes after all pieces, in a command without --piece")
    if options.split is not None and (options.piece is not None or options.merge):
        raise UsageError("--split: makes parts within one command; --piece K/N has pieces already")
    if options.report is not None:
        with inputs_kept(options.scenes):
            refuse_taken(options.report)
        _refuse_result(options)
    for path in (*options.scenes, options.output):
        blender_session.refuse_name(path)
    _refuse_same_names([path.stem for path in options.scenes])


def _refuse_same_names(stems: Sequence[str]) -> None:
    """Refuse scenes whose results a file system may take for the same files."""
    known: dict[str, str] = {}
    for stem in stems:
        key = name_key(stem)
        if known.get(key) == stem:
            raise UsageError(f"several scenes are named '{stem}': their results would collide")
        if key in known:
            raise UsageError(
                f"scenes '{known[key]}' and '{stem}' have names that are one where case or "
                "accents do not count: their results would collide; rename one of them"
            )
        known[key] = stem


def _refuse_result(options: argparse.Namespace) -> None:
    """Refuse a report of the command that has the name of a result of a scene.

    Raises
    ------
    UsageError
        It has, whichever of the formats is written.
    """
    from ..export.report import REPORT_SUFFIX

    folder = Path(os.path.realpath(options.output))
    report = Path(os.path.realpath(options.report.parent)) / options.report.name
    of_results = (REPORT_SUFFIX, *suffixes(options.formats or EXPORTED))
    for stem in [path.stem for path in options.scenes] or [_open_stem()]:
        is_there = report.parent == folder or folder / stem in report.parents
        is_result = report.name.startswith(f"{stem}.") and report.name.endswith(of_results)
        is_piece = report.parent == pieces_folder(folder, stem) and "-of-" in report.name
        if (is_there and is_result) or is_piece:
            raise UsageError(
                f"--report {options.report}: is a result of this export, of '{stem}'; choose "
                "another name, such as batch.json"
            )


def _names(text: str) -> list[str]:
    """Names with commas between them."""
    return text.split(",")


def _frames(text: str) -> tuple[int, int]:
    try:
        first, last = (int(part) for part in text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected A:B, two frames, found '{text}'") from None
    return first, last


def _piece(text: str) -> tuple[int, int]:
    try:
        number, count = (int(part) for part in text.split("/"))
    except ValueError:
        number = count = 0
    if not 1 <= number <= count <= MOST_PIECES:
        raise argparse.ArgumentTypeError(
            f"expected K/N, such as 1/8, with K from 1 to N and N to {MOST_PIECES}, found '{text}'"
        )
    return number, count


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not 0.0 < seconds < 1e9:
        raise argparse.ArgumentTypeError(f"expected seconds, found '{text}'")
    return seconds


def _tolerance(text: str) -> Tolerance:
    try:
        return parse_tolerance(text)
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _rate(text: str) -> Fraction:
    try:
        rate = Fraction(text)
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if not 0 < rate <= 10000:
        raise argparse.ArgumentTypeError(f"expected more than 0, at most 10000 Hz, found '{text}'")
    return rate
