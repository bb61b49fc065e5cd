# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx bench``: measurement of cost and accuracy on this machine, and of usual alternatives."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import UsageError
from hfx_blender.files.staging import make_folder
from hfx_blender.processes import blender_session

from ..command_process.temporary_folder import temporary_folder

NAMES = ("export", "trade", "volumes", "economy", "naive", "batch", "texture", "relief", "words")

_DESCRIPTION = """\
Measure on this machine. Every measurement names the machine, versions and sizes.

  export    an export against stepping the same scene without this add-on
  trade     a scene at every setting: time, contacts, actuators, onsets, memory
  volumes   inside tests: speed against trimesh and embree, exactness
  economy   cost of vertices, volumes and bodies without contact; one live evaluation
  naive     comparison with usual scripts for Blender
  batch     two workers against one, writing against evaluating, memory over scenes and frames
  texture   haptic surfaces: roughness, identification, maps, contacts
  relief    relief estimated from pictures against the true relief
  words     surfaces from words: recognized kinds, comparatives, classified strokes
  safety    time from any failure to a silent device; 1,000 times each, about an hour
  live      cost of devices in Blender per frame, and delay of a frame at the port
  preview   cost of the viewport's colours and actuators per frame of playback
  all       all of them but safety, live and preview (the default)
"""


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "bench",
        help="measure cost and accuracy",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "name",
        nargs="?",
        default="all",
        metavar="NAME",
        choices=(*NAMES, "safety", "live", "preview", "all"),
    )
    parser.add_argument(
        "scene",
        nargs="?",
        metavar="SCENE",
        help="for trade: a .blend, or demo, crowded, fast, fine (default: demo)",
    )
    parser.add_argument("--short", action="store_true", help="rough figures in about a minute")
    parser.add_argument("--rounds", type=int, metavar="N", help="number of timed runs")
    parser.add_argument("--history", type=Path, metavar="FILE", help="append the result to a file")
    parser.add_argument("--frames", type=_frames, metavar="A:B", help="for trade: range of frames")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="for trade: write CSV and plot"
    )
    parser.add_argument("--busy", action="store_true", help="for safety: with every processor busy")
    parser.add_argument(
        "--only",
        action="append",
        metavar="ROW",
        help="for safety: only this row, such as 'operator stops'; repeatable",
    )
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Run the measurements, print text or JSON, and append to the history; returns 0."""
    from ..bench import machine

    if options.rounds is not None and options.rounds < 1:
        raise UsageError(f"--rounds {options.rounds}: expected at least 1")
    if options.name != "trade" and (options.scene or options.output or options.frames):
        raise UsageError("SCENE, --frames and --output belong to 'hfx bench trade'")
    results: dict[str, Any] = {}
    for name in NAMES if options.name == "all" else (options.name,):
        result, text = _MEASURES[name](options, console.progress(f"Measuring {name}"))
        results[name] = result
        console.say(f"{text}\n", several_lines=True)
    record = {"machine": machine.describe(), "short": options.short, **results}
    console.say(machine.as_line(record["machine"]))
    if options.history is not None:
        count = machine.append(options.history, record)
        console.say(f"{options.history}: {count} measurements")
    console.result(record)
    return 0


_Progress = Callable[[float], None]


def _export(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench import export_cost

    result = export_cost.measure(options.rounds or (1 if options.short else 5), progress)
    return result, export_cost.as_text(result)


def _trade(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench.trade import trade_report

    result = measure_trade(
        options.scene or "demo",
        short=options.short,
        rounds=options.rounds,
        frames=options.frames,
        progress=progress,
    )
    text = f"{trade_report.as_text(result)}\n\n{trade_report.LEGEND}"
    if options.output is not None:
        make_folder(options.output)
        for path in trade_report.write(result, options.output):
            text += f"\n{path}"
    return result, text


def measure_trade(
    scene: str,
    *,
    short: bool = False,
    rounds: int | None = None,
    frames: tuple[int, int] | None = None,
    progress: _Progress = lambda share: None,
) -> dict[str, Any]:
    """Open or build a scene and measure speed against accuracy; plain data.

    ``short`` restricts ``frames`` None to about half a second of the scene.
    """
    bpy = blender_session.start()

    from ..bench import scenes
    from ..bench.trade import trade

    with temporary_folder() as folder:
        if scene in scenes.names():
            path = scenes.build(scene, Path(folder) / f"{scene}.blend")
        else:
            path = Path(scene)
        blender_session.open_blend(path)
        opened = bpy.context.scene
        if short and frames is None:
            start = opened.frame_start
            frames = start, min(start + opened.render.fps // 2, opened.frame_end)
            if scene in scenes.names():
                frames = scenes.short_frames(scene)
        result = trade.measure(
            opened,
            tolerances=trade.settings(sweep=not short),
            frames=frames,
            rounds=rounds or (1 if short else 7),
            reference_rate_hz=None if short else trade.REFERENCE_RATE_HZ,
            progress=progress,
        )
    return {"name": path.stem, **result}


def _volumes(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench import volumes

    rounds = options.rounds or (7 if options.short else 31)
    result = volumes.measure(short=options.short, rounds=rounds, progress=progress)
    return result, volumes.as_text(result)


def _economy(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench import economy

    rounds = options.rounds or (3 if options.short else 9)
    result = economy.measure(short=options.short, rounds=rounds, progress=progress)
    return result, economy.as_text(result)


def _naive(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    blender_session.start()

    from ..bench import naive, numpy_script

    meshes = naive.measure(short=options.short, progress=lambda share: progress(share / 2))
    formulas = numpy_script.measure(
        short=options.short, progress=lambda share: progress((1.0 + share) / 2)
    )
    texts = naive.as_text(meshes), numpy_script.as_text(formulas)
    return {"mesh": meshes, "formulas": formulas}, "\n\n".join(texts)


def _batch(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench import throughput

    result = throughput.measure(short=options.short, rounds=options.rounds or 3, progress=progress)
    return result, throughput.as_text(result)


def _words(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench.surfaces import words

    result = words.measure(short=options.short, progress=progress)
    return result, words.as_text(result)


def _texture(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench.surfaces import texture

    result = texture.measure(short=options.short, progress=progress)
    return result, texture.as_text(result)


def _relief(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench.surfaces import relief

    result = relief.measure(short=options.short, progress=progress)
    return result, relief.as_text(result)


def _safety(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench.safety import safety

    rounds = options.rounds or 1000
    for name in options.only or ():
        if name not in safety.ROWS:
            raise UsageError(f"--only '{name}': expected one of {', '.join(safety.ROWS)}")
    only = options.only or safety.ROWS
    result = safety.measure(
        short=options.short, rounds=rounds, busy=options.busy, only=only, progress=progress
    )
    return result, safety.as_text(result)


def _live(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench import live_cost

    frames = options.rounds or 1000
    result = live_cost.measure(short=options.short, frames=frames, progress=progress)
    return result, live_cost.as_text(result)


def _preview(options: argparse.Namespace, progress: _Progress) -> tuple[Any, str]:
    from ..bench import preview_cost

    rounds = options.rounds or (3 if options.short else 9)
    result = preview_cost.measure(short=options.short, rounds=rounds, progress=progress)
    return result, preview_cost.as_text(result)


_MEASURES: dict[str, Callable[[argparse.Namespace, _Progress], tuple[Any, str]]] = {
    "export": _export,
    "trade": _trade,
    "volumes": _volumes,
    "economy": _economy,
    "naive": _naive,
    "batch": _batch,
    "texture": _texture,
    "relief": _relief,
    "words": _words,
    "safety": _safety,
    "live": _live,
    "preview": _preview,
}


def _frames(text: str) -> tuple[int, int]:
    from hfx_blender.commands.export_options import frames as parsed

    return parsed(text)
