# SPDX-License-Identifier: GPL-3.0-or-later
"""Summary of the demo: samples and devices of each task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.track import TrackReader

from .garage import TASKS, Task

if TYPE_CHECKING:
    from hfx_blender.export.report import ExportReport


def summarise(track: TrackReader, rasters: Sequence[Raster], report: ExportReport) -> str:
    """Format effects, devices and warnings of each of the study's tasks for a terminal."""
    lines = []
    for task in TASKS:
        lines.append(f"\n{task.name}  {task.title}  ({task.start_s:g} s to {task.end_s:g} s)")
        for row in report.felt:
            if row["effect"] in task.effects:
                lines.append(
                    f"    {row['effect']:<14} {row['modality']:<12} felt for "
                    f"{row['seconds']:4.2f} s on {row['mean_vertices']:6.0f} vertices"
                )
        lines.append(
            "    played by      " + (", ".join(players(task, track, rasters)) or "nothing")
        )
    lost = [
        f"    {row['effect']}: {row['seconds']:.2f} s ({row['share']:.0%})"
        for row in report.unrendered
    ]
    if lost:
        lines += ["\nFelt by the body but played by none of these devices:", *lost]
    lines += ["", *(f"warning: {text}" for text in report.warnings)]
    return "\n".join(lines)


def players(task: Task, track: TrackReader, rasters: Sequence[Raster]) -> list[str]:
    """Ids of the devices with output for a task's effects."""
    ids = {effect.id for effect in track.header.effects if effect.name in task.effects}
    return [
        raster.device_id
        for raster in rasters
        if any(
            samples.stream.effect_id in ids and np.any(samples.is_rendered)
            for samples in raster.felt
        )
    ]
