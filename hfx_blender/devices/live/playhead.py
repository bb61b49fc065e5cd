# SPDX-License-Identifier: GPL-3.0-or-later
"""Playhead of an animation, and the frames that are shown when late actuators answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Final

from ...engine.rendering.device import DeviceConfig

LEAST_MS: Final = 5.0
"""Shortest latency that is compensated, ms: a picture itself is shown later than that."""

_NEAR_SHARE: Final = 0.05
"""A latency is compensated to within so much of it, or to :data:`LEAST_MS`, whichever is more."""


def latencies_ms(device: DeviceConfig) -> tuple[float, ...]:
    """The latencies of a device's actuators that are worth looking ahead for, ascending."""
    found = {actuator.type.latency_ms for actuator in device.actuators}
    return tuple(sorted(each for each in found if each >= LEAST_MS))


def frames_ahead(latency_ms: float, fps: float) -> float:
    """Number of frames until a late actuator answers.

    On as coarse a grid as does not matter, so that frames are met again and known by then.
    """
    parts = max(1, ceil(500.0 / (fps * max(LEAST_MS, _NEAR_SHARE * latency_ms))))
    return round(latency_ms / 1000.0 * fps * parts) / parts


def parts_between(latencies_ms: Sequence[float], fps: float, step: int = 1) -> tuple[float, ...]:
    """Fractions of a frame by which lookahead frames differ from whole ones, ascending."""
    return tuple(sorted({round(step * frames_ahead(ms, fps) % 1.0, 6) for ms in latencies_ms}))


@dataclass(frozen=True)
class Playhead:
    """Frame that is shown, and the direction of playback.

    Attributes
    ----------
    frame : float
    first, last : int
        Playback goes from one to the other, and begins again.
    fps : float
    is_playing : bool
        While scrubbing and dragging nobody knows what comes next.
    step : int
        1; -1 where it plays in reverse.
    """

    frame: float
    first: int
    last: int
    fps: float
    is_playing: bool = False
    step: int = 1

    def after(self, latency_ms: float) -> float:
        """Frame that is shown when a value sent now is felt."""
        return self._wrapped(self.frame + self.step * frames_ahead(latency_ms, self.fps))

    def next(self, frames: int) -> Playhead:
        """Playhead some frames later."""
        return replace(self, frame=self._wrapped(self.frame + self.step * frames))

    def _wrapped(self, frame: float) -> float:
        """Wrap a frame as playback does: after the last comes the first; in reverse, the
        opposite.
        """
        count = self.last + 1 - self.first
        if self.step > 0 and frame >= self.last + 1 and self.frame <= self.last:
            return self.first + (frame - self.last - 1) % count
        if self.step < 0 and frame < self.first <= self.frame:
            return self.last - (self.first - 1 - frame) % count
        return frame
