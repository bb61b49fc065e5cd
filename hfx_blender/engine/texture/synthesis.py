# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct synthesis: the height under a moving finger as a waveform, for wide-band actuators."""

from __future__ import annotations

from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from .height_field import HeightField
from .roughness import gaussian_waviness
from .stroke import Stroke

F64 = npt.NDArray[np.float64]

WAVINESS_M: Final = 8e-3
"""Waves longer than this are form, felt by the moving finger itself, not vibration."""

FULL_M_S: Final = 2e-3
"""From rest to this speed the waveform is faded in, so that a resting finger is silent."""

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

    The amplitude is root 2 times the RMS; the frequency is that of zero crossings (Rice), by
    differences of neighbours: exact for a sine over whole halves of its period.

    Parameters
    ----------
    waveform : (..., n) float64

    Returns
    -------
    (...) float64, (...) float64
        Unit of the waveform; Hz, 0 where it is silent.
    """
    power = np.mean(waveform**2, axis=-1)
    moved = np.mean(np.diff(waveform, axis=-1) ** 2, axis=-1)
    # For a sine, mean (difference)^2 = 4 sin^2(pi f / rate) mean (value)^2.
    share = np.clip(np.sqrt(moved / np.where(power > 0.0, power, 1.0)) / 2.0, 0.0, 1.0)
    frequency = np.where(power > 0.0, np.arcsin(share) * rate_hz / np.pi, 0.0)
    return np.sqrt(2.0 * power), frequency


_KNOWN: WeakKeyDictionary[HeightField, HeightField] = WeakKeyDictionary()


def without_waviness(field: HeightField) -> HeightField:
    """The field without the waves that direct synthesis leaves out; made once for each field."""
    if field not in _KNOWN:
        waves = gaussian_waviness(field, WAVINESS_M)
        _KNOWN[field] = HeightField(field.heights_m - waves, field.texel_m, field.tiles)
    return _KNOWN[field]


def _factor(field: HeightField, stroke: Stroke, rate_hz: float) -> int:
    steps = np.abs(np.diff(stroke.points_m, axis=0)) / np.asarray(field.texel_m)
    fastest = float((steps.max(axis=1) / np.diff(stroke.times_s)).max())
    return int(np.clip(np.ceil(fastest / rate_hz * (1.0 - 1e-9)), 1, _MAX_FACTOR))


def _fade(stroke: Stroke, times: F64, rate_hz: float) -> F64:
    """From 0 at rest to 1 in motion, smoothed evenly to both sides in time."""
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
