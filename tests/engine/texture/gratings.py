# SPDX-License-Identifier: GPL-3.0-or-later
"""Sinusoidal gratings with signals known by arithmetic; strokes at uneven times."""

from __future__ import annotations

import numpy as np

from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.stroke import Stroke


def grating(
    wavelength_m: float, amplitude_m: float = 20e-6, texels: int = 64, phase: float = 0.0
) -> HeightField:
    """Return waves along x, one per tile."""
    x = (np.arange(texels) + 0.5) / texels
    wave = amplitude_m * np.sin(2.0 * np.pi * x + phase)
    return HeightField(np.tile(wave, (2, 1)), (wavelength_m / texels, wavelength_m / texels))


def uneven(stroke: Stroke, rng: np.random.Generator, gaps_s: tuple[float, float]) -> Stroke:
    """Resample the stroke at uneven times; phones report positions every 15 to 70 ms."""
    count = int(stroke.duration_s / gaps_s[0]) + 1
    times = stroke.times_s[0] + np.cumsum(rng.uniform(*gaps_s, count))
    times = times[times < stroke.times_s[-1] - 1e-9]
    times = np.concatenate([stroke.times_s[:1], times, stroke.times_s[-1:]])
    return Stroke(times, stroke.at(times))
