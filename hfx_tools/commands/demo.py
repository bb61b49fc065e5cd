# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx demo``: the garage of HFX Studio's study, from an empty scene to the results."""

from __future__ import annotations

import argparse
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.files.staging import make_folder
from hfx_blender.processes import blender_session, start
from hfx_blender.text import printable

from .. import processes

if TYPE_CHECKING:
    from hfx_blender.export.report import ExportReport

_PICTURE_LIMIT_S = 900


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "demo",
        help="build, export and draw the garage scene",
        description="Build a scene (tasks T1 to T4 of HFX Studio's study, or another), save "
        "it, export it, and draw the haptic samples.",
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("hfx_demo"), metavar="DIR")
    parser.add_argument(
        "--scene",
        choices=("garage", "belt", "life", "surfaces"),
        default="garage",
        help="belt: particles around a walker with a belt of 8 motors, with sound; "
        "life: particles that meet, have offspring and age, on the belt and with sound; "
        "surfaces: a fingertip strokes 4 x 4 squares of four materials, played by two phones",
    )
    parser.add_argument("--no-pictures", action="store_true", help="leave out the pictures")
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Build, save, reopen and export the scene, draw, and report; returns 0."""
    if options.scene in ("belt", "life"):
        from .demo_belt import run as run_belt

        return run_belt(options, console)
    if options.scene == "surfaces":
        from .demo_surfaces import run as run_surfaces

        return run_surfaces(options, console)
    bpy = blender_session.start()

    from hfx_blender.devices.configuration import load_device
    from hfx_blender.engine.track import TrackReader
    from hfx_blender.export.scene_export import ExportSettings, export_scene

    from ..demo import garage
    from ..demo.demo_charts import draw_track
    from ..demo.scene_file import build_and_open
    from ..demo.summary import summarise
    from ..track_rendering import render_devices

    folder: Path = options.output
    make_folder(folder)
    console.say("Building the garage ...")
    scene_file = folder / "garage.blend"
    build_and_open(garage.build, scene_file)
    devices = tuple(load_device(name) for name in garage.DEVICES)
    report = export_scene(
        bpy.context.scene,
        folder,
        "garage",
        ExportSettings(("track", "csv", "wav"), devices),
        console.progress("Exporting"),
    )
    track_file = folder / "garage.hfxtrack"
    with TrackReader(track_file) as track:
        rasters = [raster for _, raster in render_devices(track, devices)]
        draw_track(track, rasters, folder / "chart.svg")
        console.say(summarise(track, rasters, report), several_lines=True)
    pictures = None
    if not options.no_pictures:
        pictures = _draw(scene_file, track_file, folder, console)
    _say_files(console, folder, report, pictures)
    console.result({**report.as_dict(), "folder": str(folder), "pictures": pictures})
    return 0


def _draw(
    scene_file: Path, track_file: Path, folder: Path, console: Console
) -> dict[str, str] | None:
    """Draw the pictures; returns the path of the sheet, or None (with a warning) on failure."""
    console.say()
    console.say("Drawing four pictures; this can take a minute ...")
    if blender_session.inside_blender():  # a second Python process with bpy is not possible
        problem = _draw_here(scene_file, track_file, folder)
    else:
        problem = _draw_apart(scene_file, track_file, folder)
    if problem is not None:
        console.warn(f"hfx: no pictures: this machine could not draw them ({problem})")
        return None
    return {"felt": str(folder / "felt.png")}


def _draw_here(scene_file: Path, track_file: Path, folder: Path) -> str | None:
    """Draw in this process; returns the error, or None."""
    from ..demo import avatar_pictures

    try:
        avatar_pictures.draw(scene_file, track_file, folder)
    except RuntimeError as error:
        return str(error).strip()
    return None


def _draw_apart(scene_file: Path, track_file: Path, folder: Path) -> str | None:
    """Draw in a separate process (rendering may crash); returns the error, or None."""
    command = start.command("hfx_tools.demo.picture_process", scene_file, track_file, folder)
    try:
        done = processes.run(command, _PICTURE_LIMIT_S)
    except subprocess.TimeoutExpired:
        return f"it took longer than {_PICTURE_LIMIT_S} s"
    except OSError as error:
        return str(error)
    if done.returncode == 0:
        return None
    last_line = done.stderr.strip().rpartition("\n")[2]
    return last_line or f"the drawing process ended with code {done.returncode}"


def _say_files(
    console: Console, folder: Path, report: ExportReport, pictures: dict[str, str] | None
) -> None:
    lines = [
        "",
        f"In {folder}:",
        "  garage.blend     the scene: open it in Blender, change it, export it again with",
        f"                   hfx export {folder / 'garage.blend'} -o {folder}",
        "  garage.hfxtrack  haptic samples, independent of devices",
        "  garage.*.csv     output of each device; *.wav for vibration actuators",
        "  chart.svg        samples and outputs over time",
    ]
    if pictures:
        lines.append("  felt.png         the avatar at one moment of each task (T1.png ... T4.png)")
    console.say("\n".join(map(printable, lines)), several_lines=True)
