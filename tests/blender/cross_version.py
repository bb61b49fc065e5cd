# SPDX-License-Identifier: GPL-3.0-or-later
"""Script for another Blender: dumps the haptic frames of a demo, or measures memory.

python cross_version.py compare MAJOR MINOR PATCH THEIRS.blend FILE.blend FILE.npz RATE_HZ
python cross_version.py memory FOLDER SAMPLES
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np

from hfx_blender.processes import blender_session
from hfx_tools.command_process.signal_watch import leave

bpy = blender_session.start()


def compare(major: str, minor: str, patch: str, theirs: str, blend: str, *rest: str) -> None:
    """Dump the demo made by the older of two Blenders: this version and the given version.

    The demo's .blend is copied or written to ``blend``; prints this version.
    """
    if bpy.app.version < (int(major), int(minor), int(patch)):
        from hfx_tools.demo import garage

        garage.build()
        bpy.ops.wm.save_as_mainfile(filepath=blend)
    else:
        shutil.copyfile(theirs, blend)
    dump(blend, *rest)
    sys.stdout.write("\nVERSION " + " ".join(map(str, bpy.app.version)) + "\n")


def dump(blend: str, result: str, rate_hz: str) -> None:
    """Vertices, level and parameters of every sample, keyed by effect and sample index."""
    import oracle

    blender_session.open_blend(Path(blend))
    evaluation = oracle.evaluate(bpy.context.scene, rate_hz=int(rate_hz))
    np.savez(
        result,
        **{
            f"{name}|{index}|{what}": value
            for name, samples in evaluation.samples.items()
            for index, sample in samples.items()
            for what, value in (
                ("vertices", sample.vertices),
                ("weights", sample.weights),
                ("values", np.append(sample.parameters, sample.level)),
            )
        },
    )


def memory(folder: str, samples: str) -> None:
    """Export a short and a long scene; print the peak memory before, between and after, bytes."""
    import oracle

    from hfx_blender.engine.tolerance import PAPER
    from hfx_blender.export.scene_export import ExportSettings, export_scene

    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.hfx.rate = 100, 100
    body = oracle.add_avatar()
    ball = oracle.add_volume("Ball", "temperature", "SPHERE", (0.0, 0.0, 1.1), radius=0.5)
    oracle.key(ball, "location", [(1, (0, 0, 1.1)), (40, (0, 0.2, 1.3)), (80, (0, 0, 0.9))])
    ball.hfx.falloff = "smooth"
    oracle.add_painted("Hum", "vibration", body)
    scene.frame_set(1)
    peaks = [_peak()]
    for count in (int(samples) // 10, int(samples)):
        scene.frame_start, scene.frame_end = 1, count
        report = export_scene(scene, Path(folder), f"long{count}", ExportSettings(tolerance=PAPER))
        assert report.engine["times_evaluated"] == count
        peaks.append(_peak())
    sys.stdout.write("\nPEAKS " + " ".join(map(str, peaks)) + "\n")


def _peak() -> int:
    # getrusage is unusable here: its peak includes the peak of the parent process.
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    (line,) = (line for line in lines if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024


if __name__ == "__main__":
    command, *arguments = sys.argv[1:]
    {"compare": compare, "memory": memory}[command](*arguments)
    leave(0)
