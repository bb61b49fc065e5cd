# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx export``: haptic tracks and device files from .blend scenes."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

from .. import blender_session
from ..console import Console
from ..errors import HfxError, UsageError

SOME_FAILED = 5


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "export", help="export scenes", description="Export haptic tracks from .blend scenes."
    )
    in_blender = _in_blender()
    parser.add_argument(
        "scenes",
        nargs="*" if in_blender else "+",
        type=Path,
        metavar="SCENE.blend",
        help="files to export" + ("; none: the open file" if in_blender else ""),
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("."), metavar="DIR")
    parser.add_argument(
        "-f", "--formats", metavar="F,...", help="track, csv, wav (default: track; csv for devices)"
    )
    parser.add_argument("--frames", type=_frames, metavar="A:B", help="both included")
    parser.add_argument("--rate", type=_rate, metavar="HZ", help="samples a second")
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
        type=lambda text: tuple(text.split(",")),
        default=(),
        metavar="WHAT,...",
        help="also record positions, velocities, depth of each vertex",
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="worker processes")
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Export each scene; one that fails does not stop the others."""
    _check(options)
    if options.jobs > 1 and len(options.scenes) > 1 and not _in_blender():
        results = _export_in_workers(options, console)
    else:
        results = [_export_one(path, options, console) for path in options.scenes or [None]]
    console.result(results if len(results) > 1 else results[0])
    failed = [result for result in results if "error" in result]
    if not failed:
        return 0
    return SOME_FAILED if len(results) > 1 else int(failed[0]["exit_code"])


def _check(options: argparse.Namespace) -> None:
    from ..engine.evaluate import ON_DEMAND

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
        console.warn(f"hfx: {title}: {error}")
        return {"input": title, "error": str(error), "exit_code": error.exit_code}


def _export_open_file(title: str, options: argparse.Namespace, console: Console) -> dict[str, Any]:
    import bpy

    from ..devices.configuration import load_device
    from ..export import ExportSettings, export_scene, scene_named
    from ..report import describe

    scene = scene_named(options.scene)
    names = options.device or [device.name for device in scene.hfx.devices]
    devices = tuple(load_device(name) for name in names if name != "none")
    formats = options.formats or ("track,csv" if devices else "track")
    settings = ExportSettings(
        formats=tuple(dict.fromkeys(formats.split(","))),
        devices=devices,
        frames=options.frames,
        rate_hz=options.rate,
        full_precision=options.full_precision,
        record=options.record,
    )
    stem = Path(bpy.data.filepath).stem or "untitled"
    report = export_scene(scene, options.output, stem, settings, console.progress(title))
    console.say(describe(report))
    return {"input": title, **report.as_dict()}


def _export_in_workers(options: argparse.Namespace, console: Console) -> list[dict[str, Any]]:
    """Each scene in a process of its own, so that a crash costs one scene only."""
    progress = console.progress(f"{len(options.scenes)} scenes")
    with ThreadPoolExecutor(options.jobs) as pool:
        jobs = [pool.submit(_export_in_worker, path, options) for path in options.scenes]
        results = []
        for job in jobs:
            results.append(job.result())
            progress(len(results) / len(jobs))
            if "error" in results[-1]:
                console.warn(f"hfx: {results[-1]['input']}: {results[-1]['error']}")
            else:
                console.say(f"{results[-1]['input']}: {len(results[-1]['files'])} files")
    return results


def _export_in_worker(path: Path, options: argparse.Namespace) -> dict[str, Any]:
    command = [sys.executable, "-m", "hfx_blender.cli", "export", str(path), "--json"]
    command += ["-o", str(options.output)]
    if options.formats:
        command += ["-f", options.formats]
    if options.frames:
        command += ["--frames", f"{options.frames[0]}:{options.frames[1]}"]
    if options.rate:
        command += ["--rate", str(options.rate)]
    for name in options.device or ():
        command += ["--device", name]
    if options.scene:
        command += ["--scene", options.scene]
    if options.full_precision:
        command.append("--full-precision")
    if options.record:
        command += ["--record", ",".join(options.record)]
    root = str(Path(__file__).resolve().parents[2])
    paths = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths}
    )
    try:
        found: dict[str, Any] = json.loads(done.stdout)
        return found
    except ValueError:
        return {
            "input": path.name,
            "error": f"its worker process ended with code {done.returncode}",
            "exit_code": 1,
        }


def _frames(text: str) -> tuple[int, int]:
    try:
        first, last = (int(part) for part in text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected A:B, two frames, found '{text}'") from None
    return first, last


def _rate(text: str) -> Fraction:
    try:
        rate = Fraction(text)
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if not 0 < rate <= 10000:
        raise argparse.ArgumentTypeError(f"expected 0 to 10000 Hz, found '{text}'")
    return rate


def _in_blender() -> bool:
    """Whether this runs inside a whole Blender, not the module: it has a file open already."""
    import importlib

    return "bpy" in sys.modules and not importlib.import_module("bpy").app.module
