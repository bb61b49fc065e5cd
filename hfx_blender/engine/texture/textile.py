# SPDX-License-Identifier: GPL-3.0-or-later
"""The textile renderer: how strongly a window of heights is felt (textiles on the phone, eq. 1-5).

The heights along the finger's way, at an even rate, are transformed by Fourier over one update
window, weighted by the sensitivity of the skin's receptors, and summed to one drive level.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64
from ..matmul import stacked_product
from .height_field import HeightField
from .stroke import Stroke

RATE_HZ: Final = 2000.0
"""Lowest rate of the heights; raised by a whole factor where a step would skip a texel."""

WINDOW_S: Final = 0.05
"""The update window of the paper."""

MAX_FACTOR: Final = 64
"""Bound of that factor: a stroke of metres per second over a fine map is no surface any more."""


_MOST_UNLIKE: Final = 40
"""Products that are quicker than a Fourier transform of a window."""


def receptor_weights(frequencies_hz: npt.ArrayLike) -> F64:
    """Weights of equation 4: thresholds of the skin's slow and rapid receptors."""
    f = np.abs(np.asarray(frequencies_hz, np.float64))
    return np.select([f < 10.0, f < 40.0, f < 800.0], [1.0 / 6.0, 0.5, 1.0], 0.0)


def weighted_rms(heights_m: F64, rate_hz: float) -> F64:
    """Root of equation 3 without c_v: the weighted RMS of heights, in metres.

    The mean is taken away first. F is the unitary discrete Fourier transform, and its sum goes
    over positive and negative frequencies, so that with all weights 1 this is the plain RMS,
    whatever the length of the window (Parseval).

    Parameters
    ----------
    heights_m : (..., n) float64

    Returns
    -------
    (...) float64
    """
    n = heights_m.shape[-1]
    heights = heights_m - heights_m[..., :1]  # first: what is constant becomes exactly nothing
    unlike = _unlike_full(n, rate_hz)
    if unlike.shape[1] > _MOST_UNLIKE:
        return _by_fourier(heights, rate_hz)
    rows = heights.reshape(-1, n)
    power = np.einsum("rk,rk->r", rows, rows) / n
    less = stacked_product(rows[None], unlike.T).reshape(len(rows), -1)
    power -= np.einsum("rk,rk->r", less, less)
    return np.sqrt(np.maximum(power, 0.0)).reshape(heights.shape[:-1])


def _by_fourier(heights: F64, rate_hz: float) -> F64:
    """Weighted RMS by its definition, with a Fourier transform."""
    n = heights.shape[-1]
    spectrum = np.fft.rfft(heights - heights.mean(axis=-1, keepdims=True), axis=-1)
    # Not a matrix product: OpenBLAS would wake threads for it.
    shares = _multiplicity(n) * receptor_weights(np.fft.rfftfreq(n, 1.0 / rate_hz)) ** 2
    power = np.einsum("...k,k->...", spectrum.real**2 + spectrum.imag**2, shares)
    rms: F64 = np.sqrt(power) / n
    return rms


def _multiplicity(n: int) -> F64:
    """Multiplicity of each frequency of a real transform: 2 for positive and negative, 1 at the
    ends.
    """
    times = np.full(n // 2 + 1, 2.0)
    times[0] = 1.0
    if n % 2 == 0:
        times[-1] = 1.0
    return times


@lru_cache(maxsize=16)
def _unlike_full(n: int, rate_hz: float) -> F64:
    """Vectors whose squared products with a window are to be subtracted from its mean square, (n,
    m).

    By Parseval's theorem the sum over all frequencies is the mean square; most have weight 1,
    and only the others are transformed: the mean, 20 Hz and what is not felt any more.
    """
    weights = receptor_weights(np.fft.rfftfreq(n, 1.0 / rate_hz))
    weights[0] = 0.0  # the mean
    lost = _multiplicity(n) * (1.0 - weights**2)
    waves = np.flatnonzero(lost)
    angle = 2.0 * np.pi * (np.outer(np.arange(n), waves) % n) / n
    columns = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    columns *= np.sqrt(np.tile(lost[waves], 2)) / n
    is_there = np.ones(columns.shape[1], np.bool_)
    is_there[len(waves) :] = (waves > 0) & (2 * waves != n)  # their sine is nothing
    return np.ascontiguousarray(columns[:, is_there])


def drive_levels(
    field: HeightField,
    stroke: Stroke,
    drive_per_m: float,
    window_s: float = WINDOW_S,
    step_s: float | None = None,
) -> F64:
    """Levels P of equation 3 at the end of each step of a stroke; an incomplete one is dropped.

    A window ends with its step, which is as long as it by default. Before the stroke the finger
    rests where it begins.

    Returns
    -------
    (floor(duration / step_s),) float64
        Drive levels; above 1 a device is at its limit.
    """
    step_s = window_s if step_s is None else step_s
    count = int(np.floor(stroke.duration_s / step_s * (1.0 + 1e-12)))
    begins = stroke.times_s[0] + step_s * np.arange(1, count + 1) - window_s
    levels = np.zeros(count)
    factors = np.array([_factor(field, stroke, t, window_s) for t in begins], np.int64)
    for factor in np.unique(factors).tolist():
        mine = np.flatnonzero(factors == factor)
        rate = RATE_HZ * factor
        # In the middle of steps, so that a reversed stroke meets the same heights.
        times = begins[mine, None] + (np.arange(round(window_s * rate)) + 0.5) / rate
        levels[mine] = drive_per_m * weighted_rms(field.sample(stroke.at(times)), rate)
    return levels


def _factor(field: HeightField, stroke: Stroke, begin_s: float, window_s: float) -> int:
    """Factor by which the rate must be raised so that no step in a window exceeds a texel."""
    first = max(int(np.searchsorted(stroke.times_s, begin_s, "right")) - 1, 0)
    last = int(np.searchsorted(stroke.times_s, begin_s + window_s, "left"))
    steps = np.abs(np.diff(stroke.points_m[first : last + 1], axis=0))
    seconds = np.diff(stroke.times_s[first : last + 1])
    texels = (steps / np.asarray(field.texel_m)).max(axis=1) / seconds
    per_sample = float(texels.max()) / RATE_HZ if len(texels) else 0.0
    return int(np.clip(np.ceil(per_sample * (1.0 - 1e-9)), 1, MAX_FACTOR))
