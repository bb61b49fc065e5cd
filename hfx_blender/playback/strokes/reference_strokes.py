# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference fabrics for calibration: rendered on connected devices and as sound, at a given c_v."""

from __future__ import annotations

from functools import cache

import numpy as np

from ...blender.events import call_soon, remove_timers
from ...engine.texture.height_field import HeightField
from ...engine.texture.signal import Signal
from ...engine.texture.stroke import line
from ...engine.texture.stroke_rendering import render_stroke
from ...engine.texture.surface_texture import Renderer, SurfaceTexture
from ...engine.texture.weave import reference_fabrics, woven
from ..live.live import live
from .stroke_sound import StrokeSound

SECONDS = 2.0
WAVEFORM_HZ = 8000.0
_SIZE_M = 0.02
_TEXELS = 512
_DIRECTION_RAD = np.radians(20.0)  # along the threads nothing would change


@cache
def fabric(name: str) -> HeightField:
    """Make one of the three reference fabrics, smooth to rough."""
    return woven(reference_fabrics()[name], _SIZE_M, _TEXELS)


def felt(name: str, speed_m_s: float, drive_per_m: float) -> Signal:
    """Render an even stroke over a reference fabric."""
    texture = SurfaceTexture(fabric(name), None, Renderer.TEXTILE, drive_per_m)
    stroke = line((0.0, 0.0), float(_DIRECTION_RAD), speed_m_s * SECONDS, speed_m_s)
    return render_stroke(texture, stroke, waveform_rate_hz=WAVEFORM_HZ)


class _Playing:
    """State of the stroke that plays now; a new one replaces it."""

    def __init__(self) -> None:
        self.signal: Signal | None = None
        self.step = 0
        self.sound: StrokeSound | None = None


_playing = _Playing()


def play(signal: Signal, full_m_s2: float) -> None:
    """Play a stroke as sound and on the connected devices; needs a window to go on."""
    stop()
    _playing.signal, _playing.step = signal, 0
    _playing.sound = StrokeSound(full_m_s2)
    _playing.sound.play(signal.waveform_m_s2, signal.waveform_rate_hz)
    call_soon(_next)


def stop() -> None:
    """Stop the stroke."""
    remove_timers(_next)
    if _playing.sound is not None:
        _playing.sound.close()
    if _playing.signal is not None:
        live.send_vibration(0.0, float(_playing.signal.frequency_hz[0]))
    _playing.signal = _playing.sound = None


def _next() -> float | None:
    signal, step = _playing.signal, _playing.step
    if signal is None:
        return None
    if step >= len(signal.times_s):
        stop()
        return None
    live.send_vibration(float(signal.amplitude_m_s2[step]), float(signal.frequency_hz[step]))
    _playing.step += 1
    return signal.step_s
