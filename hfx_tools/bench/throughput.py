# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches: two workers against one, writing against evaluating, memory over scenes and frames.

A batch is ten copies of the demo's garage, exported by one worker and by two in turn, timed from
the start of the first process to the last file. Writing is timed on a recorded track, format by
format, with rendering for the device apart; in processor seconds, independent of other load on
the machine. Memory is the peak of a process (Linux); each length is exported in a new process.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hfx_blender.export.batch import batch
from hfx_blender.export.batch.units import ExportOptions, Outcome, Unit
from hfx_blender.processes import blender_session

from .. import processes
from ..command_process.temporary_folder import temporary_folder
from ..export_workers.local_workers import LocalWorkers

SCENES = 10
TARGET_SPEEDUP = 1.8
DEVICE = "pressure_vest"
_VIBRATING = "back_pad"

_WRITING = """
import json, os, sys, tempfile, time
from pathlib import Path
from hfx_blender.processes import blender_session
bpy = blender_session.start()
from hfx_blender.devices.configuration import load_device
from hfx_tools.commands.conversion import TARGETS
from hfx_tools.track_rendering import render_devices
from hfx_blender.engine.track import TrackReader
from hfx_blender.export.scene_export import ExportSettings, SceneExport
from hfx_blender.formats import writing
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.formats.registry import FORMATS
from hfx_blender.export.recording import record_track
from hfx_blender.engine.stepwise import finish
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.formats.glb.glb_scene import VolumeRecorder
blender_session.open_blend(Path(sys.argv[1]))
devices = tuple(load_device(name) for name in sys.argv[3].split(","))
folder = Path(sys.argv[2])
export = SceneExport(bpy.context.scene, ExportSettings())
found = {}
def take(name, start, stop=None):  # the best: other work on the machine only makes it longer
    taken = (stop or time.process_time()) - start
    found[name] = min(found.get(name, taken), taken)
for _ in range(3):  # the first time loads models and modules
    start = time.process_time()
    engine = Engine(export.reader.description, tolerance=export.tolerance)
    for block in export.reader.blocks():
        engine.evaluate(block)
    take("evaluating", start)
    engine = Engine(export.reader.description, tolerance=export.tolerance)
    start = time.process_time()
    finish(record_track(export.reader, engine, folder / "x.hfxtrack"))
    take("evaluating and track", start)
    volumes = VolumeRecorder(export.reader.description)
    seen = list(export.reader.blocks())
    start = time.process_time()
    for block in seen:
        volumes.add(block)
    models = [load_model(id) for id in {e.model_id for e in export.reader.description.effects}]
    volumes.write(models, folder / "x", None)
    take("glb", start)
    with TrackReader(folder / "x.hfxtrack") as track:
        for name in (id for id in TARGETS if not FORMATS[id].write_played):
            chosen = FORMATS[name].is_of_device
            wanted = set(FORMATS[name].modalities or MODALITIES)
            mine = [d for d in devices if chosen and wanted <= set(d.modalities)]
            mine = mine[:1] or list(devices[:1])
            start = time.process_time()
            output = render_devices(track, mine) if chosen else []
            played = [(folder / f"x.{device.id}", device, raster) for device, raster in output]
            rendered = time.process_time()
            try:
                writing.write_all((name,), played, track, mine, folder / "x")
            except Exception as error:
                sys.stderr.write(f"{name}: {error}")
                continue
            take(name, rendered)
            if chosen:
                take("rendering for " + mine[0].id, start, rendered)
sys.stderr.write("found=" + json.dumps(found))
sys.stderr.flush()
os._exit(0)
"""

_LENGTH = """
import os, resource, sys
from pathlib import Path
from hfx_blender.processes import blender_session
bpy = blender_session.start()
from hfx_blender.devices.configuration import load_device
from hfx_blender.export.scene_export import ExportSettings, export_scene
blender_session.open_blend(Path(sys.argv[1]))
scene = bpy.context.scene
count = int(sys.argv[3])
for obj in bpy.data.objects:  # the same over and over: clips do not end, motion repeats
    if obj.hfx.role == "EFFECT":
        obj.animation_data_clear()
devices = tuple(load_device(name) for name in sys.argv[4].split(",") if name)
formats = ("track", "csv") if devices else ("track",)
settings = ExportSettings(formats, devices, frames=(0, count - 1), threads=1)
export_scene(scene, Path(sys.argv[2]), "x", settings)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
sys.stderr.write(f"found={peak * 1024}")
sys.stderr.flush()
os._exit(0)
"""


def measure(
    *,
    short: bool = False,
    rounds: int = 3,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, Any]:
    """Run all measurements of batches; plain data, seconds and bytes."""
    blender_session.start()
    from . import scenes

    with temporary_folder() as name:
        folder = Path(name)
        first = scenes.build("demo", folder / "scene0.blend")
        blends = [first, *(folder / f"scene{k}.blend" for k in range(1, SCENES))]
        for path in blends[1:]:
            shutil.copyfile(first, path)
        result: dict[str, Any] = {"scenes": SCENES, "processors": os.cpu_count()}
        result["workers"] = _workers(blends, folder, 1 if short else rounds, progress)
        progress(0.8)
        devices = f"{DEVICE},{_VIBRATING},forearm_band_left"
        result["writing_s"] = json.loads(_child(_WRITING, first, folder, devices))
        progress(0.9)
        # Shorter exports would need less: the first seconds of the demo are nearly empty.
        counts = (400, 1600) if short else (400, 1600, 6400)
        result["memory_by_frames"] = {
            kind: [
                [count, int(_child(_LENGTH, first, folder, str(count), devices_))]
                for count in counts
            ]
            for kind, devices_ in (("track", ""), ("track and csv", DEVICE))
        }
        progress(1.0)
    return result


def _workers(
    blends: list[Path], folder: Path, rounds: int, progress: Callable[[float], None]
) -> dict[str, Any]:
    seconds: dict[int, list[float]] = {1: [], 2: []}
    memory: list[int] = []
    loads: list[float] = []
    for k in range(2 * rounds):
        jobs = 1 + k % 2
        taken, held = _run(blends, folder / f"out{k}", jobs)
        seconds[jobs].append(taken)
        if jobs == 1:
            memory = held
        loads.append(os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0)
        progress(0.8 * (k + 1) / (2 * rounds))
    ratios = [one_s / two_s for one_s, two_s in zip(seconds[1], seconds[2], strict=True)]
    return {
        "one_s": seconds[1],
        "two_s": seconds[2],
        "speedup": statistics.median(ratios),
        "best_speedup": max(ratios),
        "target": TARGET_SPEEDUP,
        "load": max(loads),
        "memory_by_scenes": memory,
    }


def _run(blends: list[Path], folder: Path, jobs: int) -> tuple[float, list[int]]:
    """Seconds of a batch, and bytes held by the first worker after each scene.

    Raises
    ------
    RuntimeError
        A scene failed.
    """
    stage = folder / "stage"
    stage.mkdir(parents=True)
    options = ExportOptions(formats=("track", "csv"), devices=(DEVICE,))
    units = [
        Unit("scene", str(path), str(folder), path.stem, str(stage), options) for path in blends
    ]
    held: list[int] = []
    workers = LocalWorkers(jobs)

    def tell(unit: Unit, outcome: Outcome) -> None:
        if "error" in outcome:
            raise RuntimeError(outcome["error"])
        held.append(_resident(workers.pids[0]))

    start = time.perf_counter()
    try:
        batch.run(units, workers, tell=tell)
        return time.perf_counter() - start, held
    finally:
        workers.close()


def _resident(pid: int) -> int:
    """Resident memory of a process, bytes; 0 on a system without ``/proc``."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, ValueError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _child(program: str, *arguments: Path | str) -> str:
    done = processes.run(processes.program(program, *arguments))
    _, has_value, value = done.stderr.rpartition("found=")
    if not has_value:
        raise RuntimeError(f"a measured process failed:\n{done.stderr}")
    return value


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` for a terminal."""
    workers = result["workers"]
    one_s, two_s = statistics.median(workers["one_s"]), statistics.median(workers["two_s"])
    lines = [
        f"a batch of {result['scenes']} scenes, {result['processors']} processors, "
        f"load {workers['load']:.1f}",
        f"  one worker {one_s:.1f} s, two {two_s:.1f} s: {workers['speedup']:.2f} times as fast "
        f"(best {workers['best_speedup']:.2f}, target {workers['target']})",
        "  memory of one worker after each scene, MB: "
        + ", ".join(f"{held / 1e6:.0f}" for held in workers["memory_by_scenes"]),
        "one scene, seconds of processor, and as a share of evaluating it (target: below 100 %):",
    ]
    writing = result["writing_s"]
    lines += [
        f"  {name:28}{seconds:8.3f}{seconds / writing['evaluating']:8.0%}"
        for name, seconds in writing.items()
    ]
    lines.append("most memory held, MB, by frames:")
    for kind, peaks in result["memory_by_frames"].items():
        held = ", ".join(f"{count}: {most / 1e6:.0f}" for count, most in peaks)
        lines.append(f"  {kind:28}{held}")
    return "\n".join(lines)
