# SPDX-License-Identifier: GPL-3.0-or-later
"""Roughness parameters of profiles and surfaces: ISO 4287, estimated by ISO 4288.

Rmax is the largest depth of a single sampling length, as in the textile paper (DIN 4768; unnamed in
ISO 4287). The filter is the Gaussian profile filter of ISO 16610-21 (formerly ISO 11562) with
transmission 1/2 at the cut-off. Its mean line is that of all R parameters; no further mean is
subtracted within a sampling length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.errors import InputError

CUTOFF_M: Final = 2.5e-3
"""Usual cut-off for Ra of 2 to 10 micrometres, and the sampling length."""

SAMPLING_LENGTHS: Final = 5

LENGTHS: Final = ("ra_m", "rq_m", "rz_m", "rmax_m", "pt_m", "rsm_m")
SHAPES: Final = ("rsk", "rku")
"""Parameters in order of display: lengths, and dimensionless parameters."""

_ALPHA: Final = float(np.sqrt(np.log(2.0) / np.pi))  # transmission 1/2 at the cut-off

_LEAST_HEIGHT: Final = 0.1
_LEAST_WIDTH: Final = 0.01
"""Least height, share of Rz, and width, share of a sampling length, of a peak or valley that counts
for RSm (ISO 4287, 3.2.8)."""

_FLAT: Final = 1e-12
"""Share of the profile's heights below which deviations are rounding."""


@dataclass(frozen=True)
class Roughness:
    """Roughness parameters; lengths in metres.

    Means over sampling lengths, except Rmax, RSm and Pt.
    """

    ra_m: float  # arithmetic mean deviation
    rq_m: float  # root mean square deviation
    rz_m: float  # highest peak to lowest valley
    rmax_m: float  # largest depth of a single sampling length
    pt_m: float  # highest peak to lowest valley, unfiltered, over all lengths
    rsk: float | None  # skewness; None: flat profile
    rku: float | None  # kurtosis, 3 for Gaussian heights; None: flat profile
    rsm_m: float | None  # mean width of a peak with its valley; None: no complete element
    cutoff_m: float
    sampling_lengths: int


def roughness_of_profile(heights_m: F64, spacing_m: float, cutoff_m: float = CUTOFF_M) -> Roughness:
    """Roughness of a measured profile (N,) of even spacing, without its form (tilt).

    One cut-off at each end is run-up of the filter. The rest is evaluated in up to five sampling
    lengths, one cut-off long each. Raises InputError for a profile that is shorter than three
    cut-offs, or not finite.
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
    # The waviness by the Gaussian of ISO 16610-21 is the mean line.
    x = np.arange(-reach, reach + 1) * spacing_m / (_ALPHA * cutoff_m)
    kernel = np.exp(-np.pi * x**2)
    waves = np.convolve(heights, kernel / kernel.sum(), "valid")
    deviations = evaluated - waves[: len(evaluated)]
    parts = deviations.reshape(lengths, per_length)
    depths = parts.max(axis=1) - parts.min(axis=1)
    squares = np.mean(parts**2, axis=1)
    # Skewness and kurtosis divide by the deviations, so flat lengths have none.
    is_rough = np.sqrt(squares) > _FLAT * np.abs(evaluated).max()
    rz = float(depths.mean())
    return Roughness(
        ra_m=float(np.abs(parts).mean()),
        rq_m=float(np.sqrt(squares).mean()),
        rz_m=rz,
        rmax_m=float(depths.max()),
        pt_m=float(np.ptp(evaluated)),
        rsk=_mean(np.mean(parts[is_rough] ** 3, axis=1) / squares[is_rough] ** 1.5),
        rku=_mean(np.mean(parts[is_rough] ** 4, axis=1) / squares[is_rough] ** 2),
        rsm_m=_mean_width_m(deviations, spacing_m, rz, cutoff_m) if is_rough.any() else None,
        cutoff_m=cutoff_m,
        sampling_lengths=int(lengths),
    )


def _mean(values: npt.ArrayLike) -> float | None:
    """Mean of values (n,); None without values."""
    array = np.asarray(values, np.float64)
    return float(array.mean()) if array.size else None


def _mean_width_m(deviations: F64, spacing_m: float, rz_m: float, cutoff_m: float) -> float | None:
    """RSm: mean width of profile elements, each a peak and an adjacent valley; None without any.

    Peaks and valleys lie between crossings of the mean line. A peak or valley that is too low or
    narrow belongs to the part before it. Elements that start with a peak and elements that start
    with a valley count equally, so that a mirrored profile has the same width.
    """
    # Crossings of the mean line, interpolated linearly; between two lies one peak or valley.
    is_above = deviations > 0.0
    last = np.flatnonzero(is_above[1:] != is_above[:-1])
    if len(last) < 3:
        return None
    crossings = last + deviations[last] / (deviations[last] - deviations[last + 1])
    ends = np.concatenate([[0.0], crossings, [len(deviations) - 1.0]])
    heights = np.maximum.reduceat(np.abs(deviations), np.concatenate([[0], last + 1]))
    counts = heights >= _LEAST_HEIGHT * rz_m
    counts &= np.diff(ends) * spacing_m >= _LEAST_WIDTH * cutoff_m
    which = np.flatnonzero(counts)
    if not len(which):
        return None
    is_peak = is_above[np.append(0, last + 1)][which]
    # Skipped parts merge into the part before, so only changes of sign are edges of elements.
    edges = ends[which[1:][is_peak[1:] != is_peak[:-1]]]
    return _mean((edges[2:] - edges[:-2]) * spacing_m)


def roughness_of_surface(
    field: HeightField,
    cutoff_m: float = CUTOFF_M,
    *,
    direction_rad: float = 0.0,
    profiles: int = 16,
) -> Roughness:
    """Mean roughness of random profiles across a surface in one direction, of constant seed.

    Profiles of a tiling surface have five sampling lengths, else as many as fit (see
    :func:`roughness_of_profile`). Raises InputError for a surface too small for the cut-off.
    """
    # Denser than the texels, so that slanted profiles skip none.
    spacing = 0.5 * min(field.texel_m)
    way = np.array([np.cos(direction_rad), np.sin(direction_rad)])
    full = (SAMPLING_LENGTHS + 2) * cutoff_m
    size = np.asarray(field.size_m)
    rng = np.random.default_rng(0)
    # Random starts with a fixed seed, so that results are repeatable.
    if field.tiles:
        starts = rng.uniform(0.0, size, (profiles, 2))
        length = full
    else:
        # The longest profile that fits, with room for different starts.
        room = [s / abs(w) if abs(w) > 1e-9 else np.inf for s, w in zip(size, way, strict=True)]
        length = float(min(full, 0.9 * min(room)))
        low = np.maximum(0.0, -length * way)
        starts = rng.uniform(low, low + size - np.abs(length * way), (profiles, 2))
    along = np.arange(int(length / spacing) + 2) * spacing
    results = [
        roughness_of_profile(field.sample(start + along[:, None] * way), spacing, cutoff_m)
        for start in starts
    ]
    means: dict[str, Any] = {
        name: _mean([value for result in results if (value := getattr(result, name)) is not None])
        for name in (*LENGTHS, *SHAPES)
    }
    return replace(results[0], **means)
