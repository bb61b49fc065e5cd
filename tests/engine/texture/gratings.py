# SPDX-License-Identifier: GPL-3.0-or-later
"""Sinusoidal gratings for tests: surfaces whose signals arithmetic tells."""

from __future__ import annotations

import numpy as np

from hfx_blender.engine.texture.height_field import HeightField


def grating(
    wavelength_m: float, amplitude_m: float = 20e-6, texels: int = 64, phase: float = 0.0
) -> HeightField:
    """Waves along x, one in a tile."""
    x = (np.arange(texels) + 0.5) / texels
    wave = amplitude_m * np.sin(2.0 * np.pi * x + phase)
    return HeightField(np.tile(wave, (2, 1)), (wavelength_m / texels, wavelength_m / texels))
