# SPDX-License-Identifier: GPL-3.0-or-later
"""Summary of the demo in words: samples and devices of each task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.track import TrackReader

from .garage import TASKS, Task

if TYPE_CHECKING:
    from hfx_blender.export.scene_export import ExportReport


def summarise(track: TrackReader, rasters: Sequence[Raster], report: ExportReport) -> str:
    """A few lines for each of the study's tasks."""
    lines = []
    for task in TASKS:
        lines.append(f"\n{task.name}  {task.title}  ({task.start_s:g} s to {task.end_s:g} s)")
        for felt in report.felt:
            if felt["effect"] in task.effects:
                lines.append(
                    f"    {felt['effect']:<14} {felt['modality']:<12} felt for "
                    f"{felt['seconds']:4.2f} s on {felt['mean_vertices']:6.0f} vertices"
                )
        lines.append(
            "    played by      " + (", ".join(players(task, track, rasters)) or "nothing")
        )
    lost = [
        f"    {each['effect']}: {each['seconds']:.2f} s ({each['share']:.0%})"
        for each in report.unrendered
    ]
    if lost:
        lines += ["\nFelt by the body but played by none of these devices:", *lost]
    lines += ["", *(f"warning: {text}" for text in report.warnings)]
    return "\n".join(lines)


def players(task: Task, track: TrackReader, rasters: Sequence[Raster]) -> list[str]:
    """Devices that play anything of a task's effects."""
    ids = {effect.id for effect in track.header.effects if effect.name in task.effects}
    return [
        raster.device_id
        for raster in rasters
        if any(felt.stream.effect_id in ids and np.any(felt.is_rendered) for felt in raster.felt)
    ]
