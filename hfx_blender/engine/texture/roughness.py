# SPDX-License-Identifier: GPL-3.0-or-later
"""Roughness of a profile and of a surface: Ra, Rz and Rmax.

Definitions: ISO 4287 (Ra, Rz), with Rmax the largest single depth of the sampling lengths, as
the textile paper uses it. Filter: the Gaussian profile filter of ISO 16610-21 (formerly
ISO 11562), whose transmission is one half at the cut-off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64
from .height_field import HeightField

CUTOFF_M: Final = 2.5e-3
"""The usual cut-off for Ra of 2 to 10 micrometres; also the sampling length."""

SAMPLING_LENGTHS: Final = 5

_ALPHA: Final = float(np.sqrt(np.log(2.0) / np.pi))


@dataclass(frozen=True)
class Roughness:
    """Roughness parameters, metres."""

    ra_m: float  # arithmetic mean deviation
    rz_m: float  # mean over the sampling lengths of highest peak to lowest valley
    rmax_m: float  # the largest of those
    cutoff_m: float
    sampling_lengths: int


def roughness_of_profile(heights_m: F64, spacing_m: float, cutoff_m: float = CUTOFF_M) -> Roughness:
    """Roughness of a measured profile.

    One cut-off at each end is the filter's run-up and is not evaluated. The rest holds as many
    sampling lengths (each one cut-off long) as fit, five at most.

    Parameters
    ----------
    heights_m : (N,) float64
        Evenly spaced.

    Raises
    ------
    InputError
        The profile is shorter than three cut-offs, or holds what is not a number.
    """
    heights = np.asarray(heights_m, np.float64)
    if heights.ndim != 1 or not np.isfinite(heights).all():
        raise InputError("Roughness: a profile is a row of finite heights.")
    if not (spacing_m > 0.0 and cutoff_m > 0.0 and np.isfinite([spacing_m, cutoff_m]).all()):
        raise InputError("Roughness: spacing and cut-off must be above 0.")
    reach = int(np.ceil(cutoff_m / spacing_m))
    per_length = round(cutoff_m / spacing_m)
    lengths = min((len(heights) - 2 * reach) // max(per_length, 1), SAMPLING_LENGTHS)
    if lengths < 1 or per_length < 2:
        raise InputError(
            f"Roughness: a profile of {1e3 * spacing_m * len(heights):g} mm at steps of "
            f"{1e3 * spacing_m:g} mm cannot be judged at a cut-off of {1e3 * cutoff_m:g} mm; "
            "expected three cut-offs or more, and two steps in each."
        )
    evaluated = heights[reach : reach + lengths * per_length]
    waves = np.convolve(heights, _kernel(reach, spacing_m, cutoff_m), "valid")
    parts = (evaluated - waves[: len(evaluated)]).reshape(lengths, per_length)
    # The mean line of each sampling length is its own.
    parts = parts - parts.mean(axis=1, keepdims=True)
    depths = parts.max(axis=1) - parts.min(axis=1)
    return Roughness(
        float(np.abs(parts).mean()),
        float(depths.mean()),
        float(depths.max()),
        cutoff_m,
        int(lengths),
    )


def roughness_of_surface(
    field: HeightField,
    cutoff_m: float = CUTOFF_M,
    *,
    direction_rad: float = 0.0,
    profiles: int = 16,
) -> Roughness:
    """Mean roughness of some profiles across a surface, all in one direction.

    A surface that tiles is long enough for five sampling lengths; one that does not gives as
    many as fit (see :func:`roughness_of_profile`).

    Raises
    ------
    InputError
        The surface is too small for the cut-off.
    """
    spacing = 0.5 * min(field.texel_m)
    way = np.array([np.cos(direction_rad), np.sin(direction_rad)])
    full = (SAMPLING_LENGTHS + 2) * cutoff_m
    size = np.asarray(field.size_m)
    rng = np.random.default_rng(0)
    if field.tiles:
        starts = rng.uniform(0.0, size, (profiles, 2))
        length = full
    else:
        room = [s / abs(w) if abs(w) > 1e-9 else np.inf for s, w in zip(size, way, strict=True)]
        length = float(min(full, 0.9 * min(room)))
        low = np.maximum(0.0, -length * way)
        starts = rng.uniform(low, low + size - np.abs(length * way), (profiles, 2))
    along = np.arange(int(length / spacing) + 2) * spacing
    found = [
        roughness_of_profile(field.sample(start + along[:, None] * way), spacing, cutoff_m)
        for start in starts
    ]
    return Roughness(
        float(np.mean([each.ra_m for each in found])),
        float(np.mean([each.rz_m for each in found])),
        float(np.mean([each.rmax_m for each in found])),
        cutoff_m,
        found[0].sampling_lengths,
    )


def gaussian_waviness(field: HeightField, cutoff_m: float) -> F64:
    """Waviness: low-pass of a surface by the areal Gaussian filter of a cut-off, (H, W) metres.

    The transmission at wavelength l is ``2 ** -((cutoff / l) ** 2)``, by Fourier; a surface that
    does not tile is mirrored at its edges.
    """
    heights = field.heights_m
    rows, columns = heights.shape
    if not field.tiles:
        heights = np.concatenate([heights, heights[::-1]])
        heights = np.concatenate([heights, heights[:, ::-1]], axis=1)
    across = np.fft.rfftfreq(heights.shape[1], field.texel_m[0])
    along = np.fft.fftfreq(heights.shape[0], field.texel_m[1])
    kept = np.exp2(-((cutoff_m * along[:, None]) ** 2)) * np.exp2(-((cutoff_m * across) ** 2))
    waves = np.fft.irfft2(np.fft.rfft2(heights) * kept, heights.shape)
    return np.asarray(waves[:rows, :columns])


def _kernel(reach: int, spacing_m: float, cutoff_m: float) -> F64:
    """Weights of ISO 16610-21 up to one cut-off to each side; their sum is 1."""
    x = np.arange(-reach, reach + 1) * spacing_m / (_ALPHA * cutoff_m)
    weights = np.exp(-np.pi * x**2)
    kernel: F64 = weights / weights.sum()
    return kernel
