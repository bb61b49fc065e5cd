# SPDX-License-Identifier: GPL-3.0-or-later
"""Cost of an export, relative to stepping the same scene without the add-on.

One scene, read in each of the three ways: the demo's garage and walker, with five volumes on
three models moving along in permanent contact with about 900 vertices; one sample a frame. The
rig has no constraints, or some, or a driver reading the scene, so that no scratch scene can
reproduce the pose. The unchanged demo is measured too, at 100 samples a second.

Each pair is measured in separate processes, in turn, without start-up time: A is the time of
``scene.frame_set`` over the whole range in a process without this package; the export reads,
evaluates, records, renders all devices of the demo and writes track and CSV files, at two
tolerances.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hfx_blender.processes import blender_session

from .. import processes
from ..command_process.temporary_folder import temporary_folder

_STEP = """
import bpy, os, sys, time
bpy.ops.wm.open_mainfile(filepath=sys.argv[1], load_ui=False, use_scripts=False)
scene = bpy.context.scene
scene.frame_set(scene.frame_start)
start = time.perf_counter()
for frame in range(scene.frame_start, scene.frame_end + 1):
    scene.frame_set(frame)
sys.stderr.write(f"seconds={time.perf_counter() - start}")
sys.stderr.flush()
os._exit(0)
"""

_EXPORT = """
import json, os, sys, time
from pathlib import Path
from hfx_blender.processes import blender_session
bpy = blender_session.start()
from hfx_tools.demo import garage
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.tolerance import PRESETS
from hfx_blender.export.scene_export import ExportSettings, export_scene
blender_session.open_blend(Path(sys.argv[1]))
devices = tuple(load_device(name) for name in garage.DEVICES)
bpy.context.scene.frame_set(bpy.context.scene.frame_start)
start = time.perf_counter()
settings = ExportSettings(("track", "csv"), devices, tolerance=PRESETS[sys.argv[3]])
report = export_scene(bpy.context.scene, Path(sys.argv[2]), "bench", settings)
seconds = time.perf_counter() - start
sys.stderr.write("report=" + json.dumps(report.engine) + f"\\nseconds={seconds}")
sys.stderr.flush()
os._exit(0)
"""


@dataclass(frozen=True)
class Kind:
    """Variant of the scene, with a target ratio per tolerance; None: no target."""

    name: str
    title: str
    targets: tuple[float, float] | None
    change: Callable[[Any], None]  # edits the demo; the argument is the walker's armature


def add_volumes(body: Any) -> None:
    """Replace the demo's effects by five volumes parented to a body, one sample a frame."""
    import bpy

    bpy.data.batch_remove([obj for obj in bpy.data.objects if obj.hfx.role == "EFFECT"])
    bpy.context.scene.hfx.rate = bpy.context.scene.render.fps
    for modality, shape, size, position in _VOLUMES:
        bpy.ops.hfx.add_volume(modality=modality, shape=shape, name=f"Bench {modality} {shape}")
        volume = bpy.context.object
        volume.hfx.radius, volume.hfx.height, volume.hfx.size = size, 3 * size, (2 * size,) * 3
        volume.parent, volume.location = body, position
        volume.hfx.falloff = "smooth" if shape == "SPHERE" else "none"


_VOLUMES = (
    ("vibration", "SPHERE", 0.05, (0.28, 0.0, 0.85)),
    ("vibration", "CUBOID", 0.22, (0.0, 0.0, 0.0)),
    ("pressure", "CAPSULE", 0.07, (-0.15, 0.05, 1.3)),
    ("wind", "CUBOID", 0.1, (0.1, -0.2, 1.5)),
    ("temperature", "SPHERE", 0.3, (0.0, -0.3, 1.2)),
)
"""Modality, shape, radius or half an edge (m), and location relative to the walker (m)."""


def _constrain(body: Any) -> None:
    """Add the volumes, a constraint of the head toward the camera, and limits of the wrists."""
    import bpy

    add_volumes(body)

    head = body.pose.bones["head"].constraints.new("DAMPED_TRACK")
    head.target, head.influence = bpy.data.objects["Camera"], 0.3
    for side in "LR":
        limit = body.pose.bones[f"wrist.{side}"].constraints.new("LIMIT_ROTATION")
        limit.owner_space = "LOCAL"


def _drive(body: Any) -> None:
    """Add the volumes, and a driver from the scene to the scale of a bone."""
    import bpy

    add_volumes(body)
    driver = body.pose.bones["spine01"].driver_add("scale", 0).driver
    driver.type = "SUM"
    variable = driver.variables.new()
    target = variable.targets[0]
    target.id_type, target.id = "SCENE", bpy.context.scene
    target.data_path = "render.fps_base"


TOLERANCES = ("standard", "paper")

KINDS = (
    Kind("constraints", "rig with constraints", (0.60, 0.40), _constrain),
    Kind("curves", "rig without constraints", (0.35, 0.25), add_volumes),
    Kind("own scene", "the own scene must be stepped", (1.15, 1.15), _drive),
    Kind("demo", "the demo itself, 100 samples a second", None, lambda body: None),
)


def measure(
    rounds: int = 5, progress: Callable[[float], None] = lambda share: None
) -> dict[str, Any]:
    """Measure seconds of each run and, per kind of scene, the ratios export / stepping."""
    from ..demo import garage

    bpy = blender_session.start()
    with temporary_folder() as name:
        folder = Path(name)
        for kind in KINDS:
            garage.build()
            (body,) = (obj for obj in bpy.data.objects if obj.hfx.role == "BODY")
            kind.change(body)
            bpy.ops.wm.save_as_mainfile(filepath=str(_scene(folder, kind)))
        kinds: dict[str, Any] = {
            kind.name: {
                "stepping_s": [],
                **{name: {"export_s": [], "ratios": []} for name in TOLERANCES},
            }
            for kind in KINDS
        }
        for k in range((rounds + 1) * len(KINDS)):
            kind, scene = KINDS[k % len(KINDS)], _scene(folder, KINDS[k % len(KINDS)])
            row, is_warm = (
                kinds[kind.name],
                k >= len(KINDS),
            )  # the first round warms the disk's cache
            stepping, _ = _run(_STEP, scene)
            if is_warm:
                row["stepping_s"].append(stepping)
            for name in TOLERANCES:
                exporting, engine = _run(_EXPORT, scene, folder, name)
                row[name]["engine"] = engine
                if is_warm:
                    row[name]["export_s"].append(exporting)
                    row[name]["ratios"].append(exporting / stepping)
            progress((k + 1) / ((rounds + 1) * len(KINDS)))
    for kind in KINDS:
        for name, target in zip(TOLERANCES, kind.targets or (None, None), strict=True):
            row = kinds[kind.name][name]
            row |= {"median_ratio": statistics.median(row["ratios"]), "target": target}
    return {
        "kinds": kinds,
        "frames": round(garage.DURATION_S * garage.FPS),
        "blender": bpy.app.version_string,
        "python": sys.version.split()[0],
        "processors": os.cpu_count(),
    }


def _scene(folder: Path, kind: Kind) -> Path:
    return folder / f"{kind.name.replace(' ', '_')}.blend"


def _run(program: str, *arguments: Path | str) -> tuple[float, dict[str, Any]]:
    """Run a program; returns the seconds measured by the program, and the engine's report.

    The report is empty for a program without one.

    Raises
    ------
    RuntimeError
        The program printed no measurement.
    """
    done = processes.run(processes.program(program, *arguments))
    before, has_seconds, seconds = done.stderr.rpartition("seconds=")
    if not has_seconds:
        raise RuntimeError(f"a measured process failed:\n{done.stderr}")
    _, has_report, report = before.rpartition("report=")
    return float(seconds), json.loads(report) if has_report else {}


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` for a terminal."""
    lines = [
        f"export against stepping (A) of the same {result['frames']} frames, "
        f"Blender {result['blender']}, {result['processors']} processors",
        f"{'':40}{'A':>8}{'export':>9}{'ratio':>8}{'lowest':>8}{'target':>8}",
    ]
    for kind in KINDS:
        row = result["kinds"][kind.name]
        stepping = statistics.median(row["stepping_s"])
        engine = row[TOLERANCES[0]]["engine"]
        contacts = engine["contacts"] / max(engine["times_evaluated"], 1)
        lines += [f"  {kind.title}", f"    {engine['stepping']}; {contacts:.0f} contacts a sample"]
        for name in TOLERANCES:
            ratios = row[name]
            target = "" if ratios["target"] is None else f"{ratios['target']:.2f}"
            lines.append(
                f"    {name:36}{stepping:7.2f}s{statistics.median(ratios['export_s']):8.2f}s"
                f"{ratios['median_ratio']:8.2f}{min(ratios['ratios']):8.2f}{target:>8}"
            )
    return "\n".join(lines)
