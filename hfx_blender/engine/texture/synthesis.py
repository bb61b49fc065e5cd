# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct synthesis: the height under a moving finger as a waveform, for wide-band actuators."""

from __future__ import annotations

from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from ..arrays import F64
from .height_field import HeightField
from .roughness import gaussian_waviness
from .stroke import Stroke

WAVINESS_M: Final = 8e-3
"""Waves longer than this are form, felt by the moving finger itself, not vibration."""

FULL_M_S: Final = 2e-3
"""Speed up to which the waveform is faded in, so that a resting finger is silent."""

_MOST_OF_PAIRS: Final = 3.0
"""Largest ratio of one of a sine's two parts, a quarter of a period apart, to their mean in a
window; in one of half a period or more it is never reached."""

_FADE_S: Final = 4e-3
_LOBES: Final = 8  # of the low-pass before decimation, each side
_MAX_FACTOR: Final = 64


def profile(field: HeightField, stroke: Stroke, rate_hz: float) -> F64:
    """Height under the finger without waviness, from the stroke's begin to its end.

    Where a step would skip a texel, the profile is taken at a whole multiple of the rate and
    low-passed before it is thinned: nothing is skipped and nothing folds back.

    Returns
    -------
    (floor(duration * rate) + 1,) float64
        Metres; silent where the finger rests.
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
    """Peak amplitude and frequency of the sine that is like each window of a waveform.

    Of a sine, ``x[k - 1] + x[k + 1] = 2 c x[k]`` with c the cosine of its angle from value to
    value, and ``(x[k + 1] - x[k])^2 / (2 - 2 c) + (x[k + 1] + x[k])^2 / (2 + 2 c)`` is the square
    of its amplitude, at every k: exact in windows that hold no whole number of periods, too. Of
    other waveforms the amplitude is root 2 times the RMS and the frequency that of zero crossings
    (Rice), but for what begin and end of a window add.

    Parameters
    ----------
    waveform : (..., n) float64
        Three values or more; its mean over time is nothing.

    Returns
    -------
    (...) float64, (...) float64
        Unit of the waveform; Hz, 0 where it is silent.
    """
    change = waveform[..., 1:] - waveform[..., :-1]
    changes = np.einsum("...k,...k->...", change, change)
    squares = np.einsum("...k,...k->...", waveform, waveform)
    first, last = waveform[..., 0], waveform[..., -1]
    ends = first * first + last * last
    pairs = squares - 0.5 * ends
    sums = np.maximum(4.0 * pairs - changes, 0.0)
    inside = np.maximum(squares - ends, 0.0)
    lagged = pairs - 0.5 * (changes + first * waveform[..., 1] + waveform[..., -2] * last)
    some = np.where(pairs > 0.0, pairs, 1.0)
    cosine = lagged / np.where(inside > 0.0, inside, np.inf)
    # A ramp is a sine without frequency and without bounds.
    cosine = np.minimum(cosine, 1.0 - changes / (2.0 * _MOST_OF_PAIRS * some))
    cosine = np.maximum(cosine, sums / (2.0 * _MOST_OF_PAIRS * some) - 1.0)
    cosine = np.minimum(np.maximum(cosine, -1.0), 1.0)
    tiny = np.finfo(np.float64).tiny
    power = changes / np.maximum(2.0 - 2.0 * cosine, tiny)
    power += sums / np.maximum(2.0 + 2.0 * cosine, tiny)
    frequency = np.where(pairs > 0.0, np.arccos(cosine) * (rate_hz / (2.0 * np.pi)), 0.0)
    return np.sqrt(power / (waveform.shape[-1] - 1)), frequency


_KNOWN: WeakKeyDictionary[HeightField, HeightField] = WeakKeyDictionary()


def without_waviness(field: HeightField) -> HeightField:
    """Remove the waviness that direct synthesis leaves out; cached for each field."""
    if field not in _KNOWN:
        waves = gaussian_waviness(field, WAVINESS_M)
        _KNOWN[field] = HeightField(field.heights_m - waves, field.texel_m, field.tiles)
    return _KNOWN[field]


def _factor(field: HeightField, stroke: Stroke, rate_hz: float) -> int:
    steps = np.abs(np.diff(stroke.points_m, axis=0)) / np.asarray(field.texel_m)
    fastest = float((steps.max(axis=1) / np.diff(stroke.times_s)).max())
    return int(np.clip(np.ceil(fastest / rate_hz * (1.0 - 1e-9)), 1, _MAX_FACTOR))


def _fade(stroke: Stroke, times: F64, rate_hz: float) -> F64:
    """Gain from 0 at rest to 1 in motion, smoothed symmetrically in time."""
    share = np.clip(stroke.speed_at(times) / FULL_M_S, 0.0, 1.0)
    if share.min() == 1.0:
        return share
    half = max(int(_FADE_S * rate_hz / 2.0), 1)
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(share, half, "edge")
    return np.convolve(padded, window / window.sum(), "valid")


def _low_pass(factor: int) -> F64:
    reach = _LOBES * factor
    x = np.arange(-reach, reach + 1) / factor
    kernel = np.sinc(0.9 * x) * np.hanning(2 * reach + 3)[1:-1]
    lowpass: F64 = kernel / kernel.sum()
    return lowpass
