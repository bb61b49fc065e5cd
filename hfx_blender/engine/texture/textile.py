# SPDX-License-Identifier: GPL-3.0-or-later
"""Textile renderer: perceived strength of a window of heights (textiles on the phone, eq. 1-5).

Heights along the finger's path, at an even rate, are Fourier-transformed over an update window,
weighted by the sensitivity of the skin's receptors, and summed to a drive level.
"""

from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, stacked_product
from .height_field import HeightField
from .stroke import Stroke

RATE_HZ: Final = 2000.0
"""Least rate of the heights; raised by a whole factor where a step would skip a texel."""

WINDOW_S: Final = 0.05  # update window of the paper
MAX_FACTOR: Final = 64
"""Bound of the factor of ``RATE_HZ``; beyond lie strokes of metres per second over fine maps."""

_MOST_UNLIKE: Final = 40
"""Largest number of scalar products faster than a Fourier transform of a window."""


def receptor_weights(frequencies_hz: npt.ArrayLike) -> F64:
    """Weights of equation 4 at frequencies in Hz: 1/6 below 10, 1/2 below 40, 1 below 800, else 0.
    Thresholds of slow and rapid receptors; signs do not count."""
    f = np.abs(np.asarray(frequencies_hz, np.float64))
    return np.select([f < 10.0, f < 40.0, f < 800.0], [1.0 / 6.0, 0.5, 1.0], 0.0)


def weighted_rms(heights_m: F64, rate_hz: float) -> F64:
    """Weighted RMS (...) of windows of heights (..., n), metres: root of equation 3 without c_v.

    The mean is subtracted. F is the unitary discrete Fourier transform, summed over positive and
    negative frequencies; with all weights 1 this is the plain RMS for any length of the window
    (Parseval).
    """
    n = heights_m.shape[-1]
    heights = heights_m - heights_m[..., :1]  # constant windows become exactly 0
    vectors = _deficit_vectors(n, rate_hz)
    if vectors.shape[1] > _MOST_UNLIKE:
        spectrum = np.fft.rfft(heights - heights.mean(axis=-1, keepdims=True), axis=-1)
        shares = _multiplicity(n) * receptor_weights(np.fft.rfftfreq(n, 1.0 / rate_hz)) ** 2
        # einsum, because OpenBLAS would start threads for a matrix product.
        power = np.einsum("...k,k->...", spectrum.real**2 + spectrum.imag**2, shares)
        return np.asarray(np.sqrt(power) / n)
    # By Parseval's theorem the weighted sum is the mean square minus the share of frequencies with
    # a weight below 1, which are few.
    rows = heights.reshape(-1, n)
    power = np.einsum("rk,rk->r", rows, rows) / n
    deficits = stacked_product(rows[None], vectors.T).reshape(len(rows), -1)
    power -= np.einsum("rk,rk->r", deficits, deficits)
    return np.sqrt(np.maximum(power, 0.0)).reshape(heights.shape[:-1])


def _multiplicity(n: int) -> F64:
    """Multiplicity (n // 2 + 1,) of a real transform's frequencies: 2, but 1 for 0 and Nyquist."""
    times = np.full(n // 2 + 1, 2.0)
    times[0] = 1.0
    if n % 2 == 0:
        times[-1] = 1.0
    return times


@lru_cache(maxsize=16)
def _deficit_vectors(n: int, rate_hz: float) -> F64:
    """Vectors (n, m) whose squared products with a window are subtracted from its mean square.
    Sines and cosines of the frequencies with a weight below 1: mean, below 40 Hz, from 800 Hz
    on."""
    weights = receptor_weights(np.fft.rfftfreq(n, 1.0 / rate_hz))
    weights[0] = 0.0  # the mean
    lost = _multiplicity(n) * (1.0 - weights**2)
    waves = np.flatnonzero(lost)
    angle = 2.0 * np.pi * (np.outer(np.arange(n), waves) % n) / n
    columns = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    columns *= np.sqrt(np.tile(lost[waves], 2)) / n
    is_there = np.ones(columns.shape[1], np.bool_)
    is_there[len(waves) :] = (waves > 0) & (2 * waves != n)  # their sine vanishes
    return np.ascontiguousarray(columns[:, is_there])


def drive_levels(
    field: HeightField,
    stroke: Stroke,
    drive_per_m: float,
    window_s: float = WINDOW_S,
    step_s: float | None = None,
) -> F64:
    """Drive levels P of equation 3 at the end of each complete step of a stroke. Shape
    (floor(duration / step_s),); above 1 a device is at its limit. A window ends with its step,
    whose duration is ``window_s`` by default. Before the stroke the finger rests at its start."""
    step_s = window_s if step_s is None else step_s
    count = int(np.floor(stroke.duration_s / step_s * (1.0 + 1e-12)))
    begins = stroke.times_s[0] + step_s * np.arange(1, count + 1) - window_s
    levels = np.zeros(count)
    # Smallest whole factor of the rate without a step of more than a texel within a window.
    rates = stroke.texels_per_s(field.texel_m)
    firsts = np.maximum(np.searchsorted(stroke.times_s, begins, "right") - 1, 0)
    stops = np.searchsorted(stroke.times_s, begins + window_s, "left")
    fastest = [rates[a:b].max(initial=0.0) for a, b in zip(firsts, stops, strict=True)]
    factors = np.ceil(np.array(fastest) / RATE_HZ * (1.0 - 1e-9)).clip(1, MAX_FACTOR).astype(int)
    # Windows of equal rate have equally many heights and share one call.
    for factor in np.unique(factors).tolist():
        same_factor = np.flatnonzero(factors == factor)
        rate = RATE_HZ * factor
        # Sampled at the middle of steps, so that a reversed stroke has the same heights.
        times = begins[same_factor, None] + (np.arange(round(window_s * rate)) + 0.5) / rate
        levels[same_factor] = drive_per_m * weighted_rms(field.sample(stroke.at(times)), rate)
    return levels
