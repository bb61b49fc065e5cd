# SPDX-License-Identifier: GPL-3.0-or-later
"""What exporting the demo costs, against stepping the same scene without the add-on.

Both are measured in processes of their own, in turn, without their start-up: A is the time of
``scene.frame_set`` over the whole range where this package was never loaded; the export
reads, evaluates, records, renders all of the demo's devices and writes track and CSV files.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .. import blender_session

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
import os, sys, time
from pathlib import Path
from hfx_blender import blender_session
bpy = blender_session.start()
from hfx_blender.demo import garage
from hfx_blender.devices.configuration import load_device
from hfx_blender.export import ExportSettings, export_scene
blender_session.open_blend(Path(sys.argv[1]))
devices = tuple(load_device(name) for name in garage.DEVICES)
bpy.context.scene.frame_set(bpy.context.scene.frame_start)
start = time.perf_counter()
settings = ExportSettings(("track", "csv"), devices)
export_scene(bpy.context.scene, Path(sys.argv[2]), "bench", settings)
sys.stderr.write(f"seconds={time.perf_counter() - start}")
sys.stderr.flush()
os._exit(0)
"""


def measure(
    rounds: int = 5, progress: Callable[[float], None] = lambda share: None
) -> dict[str, Any]:
    """Seconds of each run, and the ratios export / stepping pair by pair."""
    from ..demo import garage

    bpy = blender_session.start()
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "garage.blend"
        garage.build()
        bpy.ops.wm.save_as_mainfile(filepath=str(scene))
        stepping, exporting = [], []
        for k in range(rounds + 1):
            pair = _seconds(_STEP, scene), _seconds(_EXPORT, scene, Path(folder))
            if k:  # the first pair warms the disk's cache
                stepping.append(pair[0])
                exporting.append(pair[1])
            progress((k + 1) / (rounds + 1))
    ratios = [b / a for a, b in zip(stepping, exporting, strict=True)]
    return {
        "stepping_s": stepping,
        "export_s": exporting,
        "ratios": ratios,
        "median_ratio": statistics.median(ratios),
        "frames": round(garage.DURATION_S * garage.FPS),
        "blender": bpy.app.version_string,
        "python": sys.version.split()[0],
        "processors": os.cpu_count(),
    }


def _seconds(program: str, *arguments: Path) -> float:
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        capture_output=True,
        text=True,
        env=blender_session.child_environment(),
    )
    _, found, seconds = done.stderr.rpartition("seconds=")
    if not found:
        raise RuntimeError(f"a measured process failed:\n{done.stderr}")
    return float(seconds)


def as_text(result: dict[str, Any]) -> str:
    """The measurement for a terminal."""
    lines = ["  stepping    export    export / stepping"]
    for a, b, ratio in zip(result["stepping_s"], result["export_s"], result["ratios"], strict=True):
        lines.append(f"  {a:6.2f} s  {b:6.2f} s  {ratio:8.2f}")
    lines.append(
        f"median {result['median_ratio']:.2f}  (demo, {result['frames']} frames, Blender "
        f"{result['blender']}, {result['processors']} processors)"
    )
    return "\n".join(lines)
