# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of a stroke over a surface as a vibration, by the surface's renderer.

Direct synthesis, for wide-band actuators, plays the heights under the finger as a waveform.
"""

from dataclasses import dataclass
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from ...errors import InputError
from ..arrays import F64
from .haptic_map import STANDARD_GRAVITY, SurfaceRenderer, SurfaceTexture
from .height_field import HeightField, gaussian_waviness
from .lookup import strongest_in_steps
from .stroke import Stroke
from .textile import WINDOW_S, drive_levels


@dataclass(frozen=True, eq=False)
class StrokeSignal:
    """Vibration over time: amplitude and frequency ``i`` from ``times_s[i]`` for ``step_s``."""

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
    """Sine with the amplitudes and frequencies (N,) of steps, and a continuous phase from 0 on.
    Shape (round(N * step_s * rate_hz),), in the unit of the amplitude; ``rate_hz`` is that of the
    result."""
    count = round(len(amplitude) * step_s * rate_hz)
    # The small addend puts a sample on the border of two steps into the later step.
    which = np.minimum(
        (np.arange(count) / (rate_hz * step_s) + 1e-9).astype(np.int64), len(amplitude) - 1
    )
    phase = 2.0 * np.pi * np.cumsum(frequency_hz[which]) / rate_hz
    return np.asarray(amplitude[which] * np.sin(phase - phase[:1]))


def render_stroke(
    texture: SurfaceTexture,
    stroke: Stroke,
    *,
    step_s: float | None = None,
    window_s: float | None = None,
    waveform_rate_hz: float = 8000.0,
) -> StrokeSignal:
    """Render a stroke as a vibration, in whole steps from its start.

    ``step_s`` is the time between values of amplitude and frequency, by default the device's update
    time. ``window_s`` before the end of each step is the window of ``TEXTILE`` and ``DIRECT``, by
    default ``WINDOW_S`` as in exports, or the step if longer. ``waveform_rate_hz`` is the sample
    rate of the waveform; 8 kHz suffices for skin, 48 kHz is for ears. Raises InputError for a
    stroke shorter than a step, or a step or rate not above zero.
    """
    step = texture.device.update_s if step_s is None else step_s
    if not (np.isfinite([step, waveform_rate_hz]).all() and step > 0.0 and waveform_rate_hz > 0.0):
        raise InputError(
            f"Stroke: steps of {step:g} s at {waveform_rate_hz:g} Hz; expected more than 0."
        )
    # The small share keeps the last step of a stroke of whole steps despite rounding.
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


WAVINESS_M: Final = 8e-3
"""Wavelength above which heights are form, felt by the moving finger, not vibration."""

FULL_M_S: Final = 2e-3  # speed of full amplitude; slower motion fades to silence at rest
_MOST_OF_PAIRS: Final = 3.0
"""Largest ratio of a quadrature part of a sine to the mean of both parts in a window; unreached in
windows of half a period or more."""

_FADE_S: Final = 4e-3
_LOBES: Final = 8  # lobes of the decimation filter on each side
_MAX_FACTOR: Final = 64


def profile(field: HeightField, stroke: Stroke, rate_hz: float) -> F64:
    """Heights under the finger without waviness, from start to end of a stroke, metres.

    Shape (floor(duration * rate) + 1,). Fades with speed below 2 mm/s, to silence at rest. Where a
    step would skip a texel, heights are sampled at a multiple of the rate and low-passed before
    decimation, without loss or aliasing; texels are skipped only beyond a multiple of _MAX_FACTOR.
    """
    surface = without_waviness(field)
    # Smallest whole factor of the rate without a step of more than a texel.
    fastest = float(stroke.texels_per_s(surface.texel_m).max())
    factor = int(np.clip(np.ceil(fastest / rate_hz * (1.0 - 1e-9)), 1, _MAX_FACTOR))
    fine = rate_hz * factor
    count = int(np.floor(stroke.duration_s * rate_hz * (1.0 + 1e-12))) + 1
    reach = _LOBES * factor if factor > 1 else 0
    times = stroke.times_s[0] + np.arange(-reach, (count - 1) * factor + reach + 1) / fine
    # Gain by speed: 0 at rest, 1 from 2 mm/s on, smoothed over 4 ms against clicks.
    gain = np.clip(stroke.speed_at(times) / FULL_M_S, 0.0, 1.0)
    if gain.min() < 1.0:
        half = max(int(_FADE_S * fine / 2.0), 1)
        window = np.hanning(2 * half + 3)[1:-1]
        gain = np.convolve(np.pad(gain, half, "edge"), window / window.sum(), "valid")
    heights = surface.sample(stroke.at(times), "cubic") * gain
    if factor > 1:
        # Windowed-sinc low-pass before decimation: its pass band ends at 0.9 of the new band.
        x = np.arange(-reach, reach + 1) / factor
        kernel = np.sinc(0.9 * x) * np.hanning(2 * reach + 3)[1:-1]
        heights = np.convolve(heights, kernel / kernel.sum(), "valid")
    return np.asarray(heights[::factor])


def amplitude_and_frequency(waveform: F64, rate_hz: float) -> tuple[F64, F64]:
    """Peak amplitude and frequency (...) of the sine equivalent to each window of a waveform.

    Windows (..., n) have at least three values, without a mean. Frequency is Hz, 0 in silence.
    Exact for a sine, also in windows without a whole number of periods. For further waveforms the
    amplitude is sqrt(2) times the RMS and the frequency that of zero crossings (Rice), but for the
    ends of the window.
    """
    # For a sine, with c the cosine of its phase step, x[k - 1] + x[k + 1] = 2 c x[k], and
    # (x[k + 1] - x[k])^2 / (2 - 2 c) + (x[k + 1] + x[k])^2 / (2 + 2 c) is its squared amplitude at
    # every k.
    change = waveform[..., 1:] - waveform[..., :-1]
    changes = np.einsum("...k,...k->...", change, change)
    squares = np.einsum("...k,...k->...", waveform, waveform)
    first, last = waveform[..., 0], waveform[..., -1]
    ends = first * first + last * last
    # Sums over successive pairs by summation by parts: each inner value occurs twice, both ends
    # once.
    pairs = squares - 0.5 * ends
    sums = np.maximum(4.0 * pairs - changes, 0.0)
    inside = np.maximum(squares - ends, 0.0)
    lagged = pairs - 0.5 * (changes + first * waveform[..., 1] + waveform[..., -2] * last)
    safe_pairs = np.where(pairs > 0.0, pairs, 1.0)
    cosine = lagged / np.where(inside > 0.0, inside, np.inf)
    # For a ramp the cosine tends to 1 and the amplitude to infinity; these limits bound both.
    cosine = np.minimum(cosine, 1.0 - changes / (2.0 * _MOST_OF_PAIRS * safe_pairs))
    cosine = np.maximum(cosine, sums / (2.0 * _MOST_OF_PAIRS * safe_pairs) - 1.0)
    cosine = np.minimum(np.maximum(cosine, -1.0), 1.0)
    tiny = np.finfo(np.float64).tiny
    power = changes / np.maximum(2.0 - 2.0 * cosine, tiny)
    power += sums / np.maximum(2.0 + 2.0 * cosine, tiny)
    frequency = np.where(pairs > 0.0, np.arccos(cosine) * (rate_hz / (2.0 * np.pi)), 0.0)
    return np.sqrt(power / (waveform.shape[-1] - 1)), frequency


_KNOWN: WeakKeyDictionary[HeightField, HeightField] = WeakKeyDictionary()


def without_waviness(field: HeightField) -> HeightField:
    """Copy of a height field without wavelengths above 8 mm; cached for each field."""
    if field not in _KNOWN:
        waves = gaussian_waviness(field, WAVINESS_M)
        _KNOWN[field] = HeightField(field.heights_m - waves, field.texel_m, field.tiles)
    return _KNOWN[field]
