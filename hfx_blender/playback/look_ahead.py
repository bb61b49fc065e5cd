# SPDX-License-Identifier: GPL-3.0-or-later
"""While an animation plays, actuators that answer late are given what is felt a little later.

Not while scrubbing or dragging: nobody knows what comes then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    from ..devices.live.haptics import F64
    from ..engine.rendering.device import DeviceConfig
    from ..engine.rendering.moment import MomentRenderer
    from ..engine.samples import SampleRun

LEAST_MS = 5.0
"""What answers sooner is not compensated: a picture itself is shown later than that."""


def latencies_ms(device: DeviceConfig) -> tuple[float, ...]:
    """The latencies of a device's actuators that are worth looking ahead for, ascending."""
    found = {actuator.type.latency_ms for actuator in device.actuators}
    return tuple(sorted(each for each in found if each >= LEAST_MS))


def frame_ahead(scene: bpy.types.Scene, latency_ms: float) -> float:
    """The frame that is shown when a value given now is felt; playback begins again at its end."""
    fps = scene.render.fps / scene.render.fps_base
    frame = scene.frame_current_final + latency_ms / 1000.0 * fps
    first, last = scene.frame_start, scene.frame_end
    if scene.use_preview_range:
        first, last = scene.frame_preview_start, scene.frame_preview_end
    if frame < last + 1 or scene.frame_current_final > last:
        return float(frame)
    return float(first + (frame - last - 1) % (last + 1 - first))


def values_ahead(
    renderer: MomentRenderer,
    now: list[SampleRun],
    runs_in: Callable[[float], list[SampleRun]],
) -> F64:
    """Values (columns,) of which each actuator's are of the time at which it answers.

    Parameters
    ----------
    renderer : MomentRenderer
    now : list of SampleRun
        What is felt now.
    runs_in : callable
        What is felt after some milliseconds.
    """
    import numpy as np

    values = renderer.values(now)
    first = 0
    columns: dict[float, list[int]] = {}
    for actuator in renderer.device.actuators:
        count = len(actuator.type.controls)
        columns.setdefault(actuator.type.latency_ms, []).extend(range(first, first + count))
        first += count
    for latency_ms in latencies_ms(renderer.device):
        mine = np.array(columns[latency_ms])
        values[mine] = renderer.values(runs_in(latency_ms))[mine]
    return values
