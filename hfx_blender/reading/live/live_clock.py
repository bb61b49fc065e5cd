# SPDX-License-Identifier: GPL-3.0-or-later
"""Time of the open scene: the timeline's while it plays, the clock's while things are dragged."""

from __future__ import annotations

import time
from collections.abc import Callable

import bpy

from ...blender.scene_units import fps_of

LONGEST_STEP_S = 0.3
"""Two moments that are farther apart have nothing to do with each other."""


class LiveClock:
    """Clock that separates the moments of one scene.

    Parameters
    ----------
    scene : bpy.types.Scene
    now : callable
        Seconds of a clock that never goes back.
    """

    def __init__(self, scene: bpy.types.Scene, now: Callable[[], float] = time.monotonic) -> None:
        self._scene = scene
        self._now = now
        self._frame_s = self._clock_s = self._time_s = 0.0
        self._is_first = True

    def _scene_s(self) -> float:
        scene = self._scene
        fps = fps_of(scene)
        return float(scene.frame_current_final - scene.frame_start) / fps

    def tick(self) -> tuple[float, float | None]:
        """Advance to the present; returns the time, and the step since the last moment (None if
        unrelated).
        """
        frame_s, clock_s = self._scene_s(), self._now()
        if frame_s != self._frame_s or self._is_first:
            step = frame_s - self._frame_s
            time_s = frame_s
        else:
            step = clock_s - self._clock_s
            time_s = self._time_s + step
        follows = not self._is_first and 0.0 < step <= LONGEST_STEP_S
        if follows and frame_s != self._frame_s:
            step = time_s - self._time_s  # on a frame that was dragged on, time went on
            follows = 0.0 < step
        self._frame_s, self._clock_s, self._time_s = frame_s, clock_s, time_s
        self._is_first = False
        return time_s, step if follows else None

    def ahead_s(self) -> float:
        """Present time, if only the clock has moved since the last moment."""
        return self._time_s + (self._now() - self._clock_s)
