# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct synthesis: heights under a moving finger as a waveform, for wide-band actuators."""

from __future__ import annotations

from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from ..arrays import F64
from .height_field import HeightField
from .roughness import gaussian_waviness
from .stroke import Stroke

WAVINESS_M: Final = 8e-3
"""Wavelength above which heights are form, felt by the moving finger, not vibration."""

FULL_M_S: Final = 2e-3
"""Speed of full amplitude; slower motion fades to silence at rest."""

_MOST_OF_PAIRS: Final = 3.0
"""Largest ratio of a quadrature part of a sine to the mean of both parts in a window; unreached in
windows of half a period or more."""

_FADE_S: Final = 4e-3
_LOBES: Final = 8  # lobes of the decimation filter on each side
_MAX_FACTOR: Final = 64


def profile(field: HeightField, stroke: Stroke, rate_hz: float) -> F64:
    """Heights under the finger without waviness, from start to end of a stroke, metres.

    Shape (floor(duration * rate) + 1,); silent at rest. Where a step would skip a texel, heights
    are sampled at a multiple of the rate and low-passed before decimation, without loss or
    aliasing.
    """
    surface = without_waviness(field)
    factor = _factor(surface, stroke, rate_hz)
    fine = rate_hz * factor
    count = int(np.floor(stroke.duration_s * rate_hz * (1.0 + 1e-12))) + 1
    reach = _LOBES * factor if factor > 1 else 0
    times = stroke.times_s[0] + np.arange(-reach, (count - 1) * factor + reach + 1) / fine
    heights = surface.sample(stroke.at(times), "cubic") * _fade(stroke, times, fine)
    if factor > 1:
        heights = np.convolve(heights, _low_pass(factor), "valid")
    return np.asarray(heights[::factor])


def amplitude_and_frequency(waveform: F64, rate_hz: float) -> tuple[F64, F64]:
    """Peak amplitude and frequency (...) of the sine equivalent to each window of a waveform.

    Windows (..., n) have at least three values, without a mean. Frequency is Hz, 0 in silence. For
    a sine, with c the cosine of its phase step, ``x[k - 1] + x[k + 1] = 2 c x[k]``, and ``(x[k + 1]
    - x[k])^2 / (2 - 2 c) + (x[k + 1] + x[k])^2 / (2 + 2 c)`` is its squared amplitude at every k,
    so the result is exact also in windows without a whole number of periods. For further waveforms
    the amplitude is sqrt(2) times the RMS and the frequency that of zero crossings (Rice), but for
    the ends of the window.
    """
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


def _factor(field: HeightField, stroke: Stroke, rate_hz: float) -> int:
    """Smallest whole factor of ``rate_hz``, 1 to 64, without a step of more than a texel."""
    steps = np.abs(np.diff(stroke.points_m, axis=0)) / np.asarray(field.texel_m)
    fastest = float((steps.max(axis=1) / np.diff(stroke.times_s)).max())
    return int(np.clip(np.ceil(fastest / rate_hz * (1.0 - 1e-9)), 1, _MAX_FACTOR))


def _fade(stroke: Stroke, times: F64, rate_hz: float) -> F64:
    """Gain (n,) at evenly spaced times: 0 at rest, 1 from 2 mm/s on, smoothed over 4 ms."""
    share = np.clip(stroke.speed_at(times) / FULL_M_S, 0.0, 1.0)
    if share.min() == 1.0:
        return share
    half = max(int(_FADE_S * rate_hz / 2.0), 1)
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(share, half, "edge")
    return np.convolve(padded, window / window.sum(), "valid")


def _low_pass(factor: int) -> F64:
    """Windowed-sinc filter (16 factor + 1,) for decimation by a factor, with sum 1."""
    reach = _LOBES * factor
    x = np.arange(-reach, reach + 1) / factor
    kernel = np.sinc(0.9 * x) * np.hanning(2 * reach + 3)[1:-1]
    lowpass: F64 = kernel / kernel.sum()
    return lowpass
