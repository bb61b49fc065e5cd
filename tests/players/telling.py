# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference player after ``docs/formats/clip.md``, on whole rasters: no clip is read here.

Written from the page alone, for comparison with players: every row of a raster is present, without
encoding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster

F64 = npt.NDArray[np.float64]
_EARLY = 0.000001


class Telling:
    """Player of rasters.

    Parameters
    ----------
    played : sequence of (DeviceConfig, Raster)
    clips : mapping
        Named clips: first row, last row, and a looping flag.
    """

    def __init__(
        self,
        played: Sequence[tuple[DeviceConfig, Raster]],
        clips: Mapping[str, tuple[int, int, bool]] | None = None,
    ) -> None:
        controls = [c for device, _ in played for a in device.actuators for c in a.type.controls]
        self.parameters = [control.name for control in controls]
        self.low = np.array([control.lowest for control in controls])
        self.high = np.array([control.highest for control in controls])
        self.neutral = np.array([control.neutral for control in controls])
        self.values = np.concatenate([raster.values for _, raster in played], axis=1)
        self.rate_hz = float(played[0][1].rate_hz)
        sizes = [len(a.type.controls) for device, _ in played for a in device.actuators]
        self.actuators = [slice(e - n, e) for n, e in zip(sizes, np.cumsum(sizes), strict=True)]
        self.strength = np.isin(np.arange(len(controls)), [a.start for a in self.actuators])
        scale = np.where(self.high > self.low, self.high - self.low, 1.0)
        at = np.rint((self.values - self.low) / scale * 65535.0)
        middle = np.rint((self.neutral - self.low) / scale * 65535.0)
        self.away = np.abs(at - middle)  # (T, C) steps away from the neutral value
        self.clips = dict(clips or {})
        self.play()

    def play(self) -> None:
        self._begin(0, len(self.values) - 1)

    def named(self, name: str) -> None:
        first, last, loops = self.clips[name]
        self._begin(first, last)
        self.loop(loops)

    def _begin(self, first: int, last: int) -> None:
        self.first, self.last = first, last
        self.start_s, self.end_s = first / self.rate_hz, (last + 1) / self.rate_hz
        self.factors = np.ones(len(self.low))
        self.loops = self.paused = False
        self.playing = True
        self.gain_is = 1.0
        self.seek(self.start_s)

    def row(self, seconds: float) -> int:
        return min(max(math.floor(seconds * self.rate_hz + _EARLY), self.first), self.last)

    def seek(self, seconds: float) -> None:
        self.position_s = min(max(seconds, self.start_s), self.end_s)
        self.shown = self.row(self.position_s) - 1

    def pause(self, is_paused: int) -> None:
        self.paused = bool(is_paused)

    def loop(self, loops: int) -> None:
        self.loops = bool(loops)

    def gain(self, gain: float) -> None:
        self.gain_is = gain

    def parameter(self, name: str, factor: float) -> None:
        self.factors[[item == name for item in self.parameters]] = factor

    def stop(self) -> None:
        self.playing = False
        self.seek(self.start_s)

    def silence(self) -> F64:
        self.paused = True
        return self.neutral

    def advance(self, seconds: float) -> F64:
        """Return the values of all columns, (C,)."""
        if not self.playing or self.paused:
            return self.neutral
        before, self.position_s = self.shown, self.position_s + seconds
        if self.position_s < self.end_s:
            now = self.row(self.position_s)
            rows = list(range(before + 1, now + 1)) or [now]
        elif self.loops:
            past_s, length_s = self.position_s - self.end_s, self.end_s - self.start_s
            rows = list(range(before + 1, self.last + 1))
            self.position_s = self.start_s + (past_s - length_s * math.floor(past_s / length_s))
            now = self.row(self.position_s)
            rows += list(range(self.first, (now if past_s < length_s else self.last) + 1))
        else:
            rows = list(range(before + 1, self.last + 1))
            self.stop()
            self.position_s, now = self.end_s, self.last
            if not rows:
                return self.neutral
        self.shown = now
        return self.strongest(rows)

    def strongest(self, rows: list[int]) -> F64:
        """Return the values of the strongest row, the latest of equals, per actuator, (C,)."""
        actual = self.neutral.copy()
        for actuator in self.actuators:
            away = self.away[rows, actuator.start]
            actual[actuator] = self.values[
                rows[len(rows) - 1 - int(np.argmax(away[::-1]))], actuator
            ]
        scale = self.factors * np.where(self.strength, self.gain_is, 1.0)
        middle = np.where(self.strength, self.neutral, 0.0)
        return np.where(
            scale == 1.0, actual, np.clip(middle + scale * (actual - middle), self.low, self.high)
        )

    @property
    def slack(self) -> F64:
        """Allowed difference per column, (C,): a 65535th of full scale, enlarged by gains."""
        scale = np.maximum(self.factors * np.where(self.strength, self.gain_is, 1.0), 1.0)
        step = (self.high - self.low) / 65535.0 * scale
        rounding = 1e-6 * np.maximum(np.abs(self.low), np.abs(self.high))  # of 32-bit floats
        return np.asarray(step + rounding)
