# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of a stroke over a surface as a vibration, by the surface's renderer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ..arrays import F64
from .haptic_map import STANDARD_GRAVITY
from .lookup import strongest_in_steps
from .stroke import Stroke
from .surface_texture import SurfaceRenderer, SurfaceTexture
from .synthesis import amplitude_and_frequency, profile
from .textile import WINDOW_S, drive_levels


@dataclass(frozen=True, eq=False)
class StrokeSignal:
    """Vibration over time.

    Amplitude and frequency ``i`` hold from ``times_s[i]`` for ``step_s``.
    """

    times_s: F64  # (N,) start of each step
    step_s: float
    amplitude_m_s2: F64  # (N,) peak
    frequency_hz: F64  # (N,)
    waveform_m_s2: F64  # (M,) from times_s[0]
    waveform_rate_hz: float

    @property
    def duration_s(self) -> float:
        return len(self.times_s) * self.step_s


def carrier(amplitude: F64, frequency_hz: F64, step_s: float, rate_hz: float) -> F64:
    """Sine with the amplitudes and frequencies (N,) of steps, and a continuous phase.

    Shape (round(N * step_s * rate_hz),), in the unit of the amplitude; ``rate_hz`` is that of the
    result.
    """
    count = round(len(amplitude) * step_s * rate_hz)
    which = np.minimum(
        (np.arange(count) / (rate_hz * step_s) + 1e-9).astype(np.int64), len(amplitude) - 1
    )
    phase = 2.0 * np.pi * np.cumsum(frequency_hz[which]) / rate_hz
    waveform: F64 = amplitude[which] * np.sin(phase - phase[:1])
    return waveform


def render_stroke(
    texture: SurfaceTexture,
    stroke: Stroke,
    *,
    step_s: float | None = None,
    window_s: float | None = None,
    waveform_rate_hz: float = 8000.0,
) -> StrokeSignal:
    """Render a stroke as a vibration, in whole steps from its start.

    Raises InputError for a stroke shorter than a step, or a step or rate not above zero.

    Parameters
    ----------
    step_s : float, optional
        Time between values of amplitude and frequency; by default the device's update time.
    window_s : float, optional
        Window before the end of each step for ``TEXTILE`` and ``DIRECT``; by default ``WINDOW_S``
        as in exports, or the step if longer.
    waveform_rate_hz : float
        Sample rate of the waveform; 8 kHz suffices for skin, 48 kHz is for ears.
    """
    step = texture.device.update_s if step_s is None else step_s
    if not (np.isfinite([step, waveform_rate_hz]).all() and step > 0.0 and waveform_rate_hz > 0.0):
        raise InputError(
            f"Stroke: steps of {step:g} s at {waveform_rate_hz:g} Hz; expected more than 0."
        )
    count = int(np.floor(stroke.duration_s / step * (1.0 + 1e-12)))
    if count < 1:
        raise InputError(
            f"Stroke: it lasts {stroke.duration_s:g} s, less than one step of {step:g} s."
        )
    window = max(WINDOW_S, step) if window_s is None else window_s
    if texture.renderer is SurfaceRenderer.DIRECT:
        return _direct(texture, stroke, step, window, count, waveform_rate_hz)
    if texture.renderer is SurfaceRenderer.TEXTILE:
        assert texture.height is not None
        levels = drive_levels(texture.height, stroke, texture.drive_per_m, window, step)
        amplitude = texture.device.amplitude_m_s2(levels)
        frequency = np.full(count, texture.device.carrier_hz)
    else:
        assert texture.map is not None
        intensity, sharpness = strongest_in_steps(texture.map, stroke, step, count)
        amplitude = texture.device.amplitude_m_s2(intensity)
        frequency = texture.device.frequency_of(sharpness)
    return StrokeSignal(
        stroke.times_s[0] + step * np.arange(count),
        step,
        amplitude,
        frequency,
        carrier(amplitude, frequency, step, waveform_rate_hz),
        waveform_rate_hz,
    )


def _direct(
    texture: SurfaceTexture,
    stroke: Stroke,
    step: float,
    window_s: float,
    count: int,
    rate_hz: float,
) -> StrokeSignal:
    """Signal with the heights along the stroke, times ``drive_per_m``, as waveform, for wide-band
    actuators; a product of 1 is full scale.

    ``step`` is in seconds, ``count`` the number of steps. Amplitude and frequency are those of the
    unclipped waveform in ``window_s`` before each step's end; amplitude and waveform, in m/s^2, are
    cut at full scale.
    """
    assert texture.height is not None
    full = texture.device.amplitude_g[1] * STANDARD_GRAVITY
    drive = texture.drive_per_m * profile(texture.height, stroke, rate_hz)
    length = max(round(window_s * rate_hz), 3)
    begins = np.rint(step * rate_hz * np.arange(1, count + 1)).astype(np.int64) - length
    window = np.clip(begins[:, None] + np.arange(length), 0, len(drive) - 1)
    amplitude, frequency = amplitude_and_frequency(drive[window], rate_hz)  # before clipping
    return StrokeSignal(
        stroke.times_s[0] + step * np.arange(count),
        step,
        full * np.minimum(amplitude, 1.0),
        frequency,
        full * np.clip(drive, -1.0, 1.0),
        rate_hz,
    )
