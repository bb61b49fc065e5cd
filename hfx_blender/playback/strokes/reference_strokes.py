# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference fabrics for calibration: rendered on connected devices and as sound, at a given c_v."""

from __future__ import annotations

from functools import cache

import numpy as np

from ...blender.events import call_soon, remove_timers
from ...engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture
from ...engine.texture.height_field import HeightField
from ...engine.texture.procedural import reference_fabrics, woven
from ...engine.texture.stroke import line
from ...engine.texture.stroke_rendering import StrokeSignal, render_stroke
from ..live.live import live
from .stroke_pad import StrokeSound

SECONDS = 2.0
WAVEFORM_HZ = 8000.0
_SIZE_M = 0.02
_TEXELS = 512
_DIRECTION_RAD = np.radians(20.0)  # along the threads nothing would change


@cache
def fabric(name: str) -> HeightField:
    """Height field of a reference fabric, given by its name (a key of ``reference_fabrics()``)."""
    return woven(reference_fabrics()[name], _SIZE_M, _TEXELS)


def felt(name: str, speed_m_s: float, drive_per_m: float) -> StrokeSignal:
    """Signal of an even stroke of :data:`SECONDS` over a reference fabric, at a calibration c_v
    of ``drive_per_m``.
    """
    texture = SurfaceTexture(fabric(name), None, SurfaceRenderer.TEXTILE, drive_per_m)
    stroke = line((0.0, 0.0), float(_DIRECTION_RAD), speed_m_s * SECONDS, speed_m_s)
    return render_stroke(texture, stroke, waveform_rate_hz=WAVEFORM_HZ)


class ReferenceStroke:
    """Stroke played as sound and on connected devices; a new stroke replaces the current one.

    Attributes
    ----------
    signal : StrokeSignal or None
        None while silent.
    step : int
        Index of the next time step.
    """

    def __init__(self) -> None:
        self.signal: StrokeSignal | None = None
        self.step = 0
        self._sound: StrokeSound | None = None

    def play(self, signal: StrokeSignal, full_m_s2: float) -> None:
        """Play a stroke by a timer; acceleration ``full_m_s2`` is the full volume of its sound."""
        self.stop()
        self.signal, self.step = signal, 0
        self._sound = StrokeSound(full_m_s2)
        self._sound.play(signal.waveform_m_s2, signal.waveform_rate_hz)
        call_soon(self._next)

    def stop(self) -> None:
        """Stop stroke and sound, and send silence to the devices; no effect between strokes."""
        remove_timers(self._next)
        if self._sound is not None:
            self._sound.close()
        if self.signal is not None:
            live.send_vibration(0.0, float(self.signal.frequency_hz[0]))
        self.signal = self._sound = None

    def _next(self) -> float | None:
        signal, step = self.signal, self.step
        if signal is None:
            return None
        if step >= len(signal.times_s):
            self.stop()
            return None
        live.send_vibration(float(signal.amplitude_m_s2[step]), float(signal.frequency_hz[step]))
        self.step += 1
        return signal.step_s


reference_stroke = ReferenceStroke()
