# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx export``: haptic tracks and device files from .blend scenes."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import traceback
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

from .. import blender_session
from ..console import Console
from ..engine.tolerance import Tolerance
from ..engine.tolerance import parse as parse_tolerance
from ..errors import HfxError, UsageError

SOME_FAILED = 5


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
        type=_names,
        metavar="F,...",
        help="track, hjif, jsonl, glb; for devices csv, npz, wav, wav24, wavfloat, ahap, haptic, "
        "he, he1, openharmony, openxr, tact (default: track; csv for devices)",
    )
    parser.add_argument("--frames", type=_frames, metavar="A:B", help="both included")
    parser.add_argument("--rate", type=_rate, metavar="HZ", help="samples a second")
    parser.add_argument(
        "--tolerance",
        type=_tolerance,
        metavar="T",
        help="preview, standard, exact, paper, or values such as 3mm,5ms (default: the scene's)",
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
        type=_names,
        default=(),
        metavar="WHAT,...",
        help="also record positions, velocities, depth of each vertex",
    )
    parser.add_argument(
        "--strict", action="store_true", help="a warning about a scene is an error: exit code 3"
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="worker processes")
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Export each scene; one that fails does not stop the others."""
    blender_session.start()
    _check(options)
    if options.jobs > 1 and len(options.scenes) > 1 and not blender_session.inside_blender():
        is_new = not options.output.exists()
        try:
            results = _export_in_workers(options, console)
        except KeyboardInterrupt:
            # Each worker leaves the folder to the others; here none of them is left.
            if is_new:
                with suppress(OSError):
                    options.output.rmdir()
            raise
    else:
        results = [_export_one(path, options, console) for path in options.scenes or [None]]
    console.result(results if len(results) > 1 else results[0])
    failed = [result for result in results if "error" in result]
    if not failed:
        return 0
    return SOME_FAILED if len(results) > 1 else int(failed[0]["exit_code"])


def _check(options: argparse.Namespace) -> None:
    """Refuse what no scene could be exported with, before any of them is opened."""
    from ..devices.configuration import load_device
    from ..engine.on_demand import ON_DEMAND
    from ..export import FORMATS

    unknown = [name for name in options.formats or () if name not in FORMATS]
    if unknown:
        raise UsageError(f"-f {unknown[0]}: expected some of {', '.join(FORMATS)}")
    for name in options.device or ():
        if name != "none":
            load_device(name)
    unknown = sorted(set(options.record) - ON_DEMAND)
    if unknown:
        raise UsageError(f"--record {unknown[0]}: expected some of {', '.join(sorted(ON_DEMAND))}")
    if options.jobs < 1:
        raise UsageError(f"--jobs {options.jobs}: expected at least 1")
    same = [stem for stem, n in Counter(path.stem for path in options.scenes).items() if n > 1]
    if same:
        raise UsageError(f"several scenes are named '{same[0]}': their results would collide")


def _export_one(path: Path | None, options: argparse.Namespace, console: Console) -> dict[str, Any]:
    """One scene; the result, or what is wrong with it."""
    title = "the open file" if path is None else path.name
    try:
        if path is not None:
            blender_session.open_blend(path)
        return _export_open_file(title, options, console)
    except HfxError as error:
        where = "" if path is not None and str(path) in str(error) else f"{title}: "
        console.warn(f"hfx: {where}{error}")
        return {"input": title, "error": str(error), "exit_code": error.exit_code}
    except BrokenPipeError:  # nobody reads our output any more; that ends the command
        raise
    except Exception as error:  # the other scenes are not to suffer for our defects
        console.warn(f"hfx: {title}: a defect of hfx, please report it:\n{traceback.format_exc()}")
        return {"input": title, "error": f"a defect of hfx ({error!r})", "exit_code": 1}


def _export_open_file(title: str, options: argparse.Namespace, console: Console) -> dict[str, Any]:
    import bpy

    from ..devices.configuration import load_device
    from ..export import ExportSettings, export_scene, scene_devices, scene_named
    from ..report import describe

    scene = scene_named(options.scene)
    if options.device:
        devices = tuple(load_device(name) for name in options.device if name != "none")
    else:
        devices = scene_devices(scene)
    formats = options.formats or (("track", "csv") if devices else ("track",))
    settings = ExportSettings(
        formats=formats,
        devices=devices,
        frames=options.frames,
        rate_hz=options.rate,
        tolerance=options.tolerance,
        full_precision=options.full_precision,
        record=options.record,
        strict=options.strict,
    )
    stem = Path(bpy.data.filepath).stem or "untitled"
    report = export_scene(scene, options.output, stem, settings, console.progress(title))
    console.say(describe(report))
    return {"input": title, **report.as_dict()}


def _export_in_workers(options: argparse.Namespace, console: Console) -> list[dict[str, Any]]:
    """Each scene in a process of its own, so that a crash costs one scene only."""
    progress = console.progress(f"{len(options.scenes)} scenes")
    running: set[subprocess.Popen[str]] = set()
    with ThreadPoolExecutor(options.jobs) as pool:
        jobs = [pool.submit(_export_in_worker, path, options, running) for path in options.scenes]
        results = []
        try:
            for job in jobs:
                results.append(job.result())
                progress(len(results) / len(jobs))
                if "error" in results[-1]:
                    console.warn(f"hfx: {results[-1]['input']}: {results[-1]['error']}")
                else:
                    console.say(f"{results[-1]['input']}: {len(results[-1]['files'])} files")
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in list(running):
                _interrupt(worker)
            raise
    return results


def _interrupt(worker: subprocess.Popen[str]) -> None:
    if os.name == "nt":
        worker.terminate()
    else:
        worker.send_signal(signal.SIGINT)  # it tidies up after itself


def _export_in_worker(
    path: Path, options: argparse.Namespace, running: set[subprocess.Popen[str]]
) -> dict[str, Any]:
    worker = subprocess.Popen(
        _worker_command(path, options),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=blender_session.child_environment(),
        start_new_session=True,  # Ctrl-C comes from us, once
    )
    running.add(worker)
    try:
        out, err = worker.communicate()
    finally:
        running.discard(worker)
    try:
        found: dict[str, Any] = json.loads(out)
        return found
    except ValueError:
        last_line = err.strip().rpartition("\n")[2]
        return {
            "input": path.name,
            "error": f"its worker process ended with code {worker.returncode} ({last_line})",
            "exit_code": 1,
        }


def _worker_command(path: Path, options: argparse.Namespace) -> list[str]:
    """The same export of one scene; values are joined to their options, so that none of them
    is taken for an option itself."""
    command = [sys.executable, "-m", "hfx_blender.cli", "export", "--json"]
    command.append(f"--output={options.output}")
    if options.formats:
        command.append(f"--formats={','.join(options.formats)}")
    if options.frames:
        command.append(f"--frames={options.frames[0]}:{options.frames[1]}")
    if options.rate:
        command.append(f"--rate={options.rate}")
    if options.tolerance:
        command.append(f"--tolerance={options.tolerance.name}")
    command += [f"--device={name}" for name in options.device or ()]
    if options.scene:
        command.append(f"--scene={options.scene}")
    if options.full_precision:
        command.append("--full-precision")
    if options.strict:
        command.append("--strict")
    if options.record:
        command.append(f"--record={','.join(options.record)}")
    return [*command, "--", str(path)]


def _names(text: str) -> tuple[str, ...]:
    """Names with commas between them, each once."""
    return tuple(dict.fromkeys(text.split(",")))


def _frames(text: str) -> tuple[int, int]:
    try:
        first, last = (int(part) for part in text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected A:B, two frames, found '{text}'") from None
    return first, last


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
        raise argparse.ArgumentTypeError(f"expected 0 to 10000 Hz, found '{text}'")
    return rate
