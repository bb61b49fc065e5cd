# SPDX-License-Identifier: GPL-3.0-or-later
"""While an animation plays, actuators that answer late are given what is felt a little later.

Not while scrubbing or dragging: nobody knows what comes then.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    from ..engine.rendering.device import DeviceConfig

LEAST_MS = 5.0
"""What answers sooner is not compensated: a picture itself is shown later than that."""

_NEAR_MS = LEAST_MS
_NEAR_SHARE = 0.05
"""A latency is compensated to within so much, whichever is more."""


def latencies_ms(device: DeviceConfig) -> tuple[float, ...]:
    """The latencies of a device's actuators that are worth looking ahead for, ascending."""
    found = {actuator.type.latency_ms for actuator in device.actuators}
    return tuple(sorted(each for each in found if each >= LEAST_MS))


def frame_ahead(scene: bpy.types.Scene, latency_ms: float) -> float:
    """The frame that is shown when a value given now is felt; playback begins again at its end."""
    fps = scene.render.fps / scene.render.fps_base
    # On as coarse a grid as does not matter, so that frames are met again and known by then.
    parts = max(1, ceil(500.0 / (fps * max(_NEAR_MS, _NEAR_SHARE * latency_ms))))
    frame = scene.frame_current_final + round(latency_ms / 1000.0 * fps * parts) / parts
    first, last = scene.frame_start, scene.frame_end
    if scene.use_preview_range:
        first, last = scene.frame_preview_start, scene.frame_preview_end
    if frame < last + 1 or scene.frame_current_final > last:
        return float(frame)
    return float(first + (frame - last - 1) % (last + 1 - first))
