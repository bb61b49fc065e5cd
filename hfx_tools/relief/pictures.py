# SPDX-License-Identifier: GPL-3.0-or-later
"""Synthetic photographs of relief: colours, suns, sky, shadows, gloss, camera, JPEG.

Lengths are in texels, so slopes are without unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F32, F64
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.mcha import blurred_slope
from hfx_blender.engine.texture.relief.linear_light import linear_to_srgb

from . import families
from . import patterns as p

SLOPE_BLUR: Final = 1.0
"""Blur of the target slopes, texels."""

_LUMINANCE_QUANTA: Final = np.add.outer(np.arange(8), np.arange(8)) * 9.0 + 12.0
"""Quantization steps, growing with frequency like JPEG's example tables at quality 50."""

_DCT: Final = np.sqrt(np.where(np.arange(8) == 0, 1.0, 2.0) / 8.0)[:, None] * np.cos(
    np.pi * np.arange(8)[:, None] * (np.arange(8) + 0.5) / 8.0
)


@dataclass(frozen=True, eq=False)
class Sample:
    """Picture with its true relief.

    Parameters
    ----------
    picture : (N, N, 3) uint8
        sRGB.
    heights : (N, N) float32
        Heights in texels.
    slope : (N, N) float32
        Sobel magnitude of the heights after a blur of one texel.
    roughness : (N, N) float32
        0 glossy to 1 dull.
    """

    picture: npt.NDArray[np.uint8]
    heights: F32
    slope: F32
    roughness: F32


def sample(rng: np.random.Generator, texels: int = 192, *, flat: float = 0.12) -> Sample:
    """Draw a random sample; with probability ``flat``, a print without relief."""
    relief = families.draw(rng, texels)
    is_flat = rng.random() < flat
    slope = 0.0 if is_flat else np.exp(rng.uniform(np.log(0.03), np.log(1.5)))
    return photograph(rng, relief, slope)


def photograph(rng: np.random.Generator, relief: families.Relief, slope: float) -> Sample:
    """Photograph a relief scaled to an RMS slope (0: a flat print), in random light and colours."""
    heights = scaled(relief.heights, slope)
    shape = heights.shape
    colours = colours_of(rng, relief, is_print=slope == 0.0)
    roughness = _roughness(rng, relief)
    light = _shade(rng, heights, colours, roughness)
    return Sample(
        _camera(rng, light),
        heights.astype(np.float32),
        slope_of(heights) if slope > 0.0 else np.zeros(shape, np.float32),
        roughness.astype(np.float32),
    )


def slope_of(heights: F64) -> F32:
    """Target slopes (N, N) of tileable heights (N, N), both in texels."""
    return blurred_slope(HeightField(heights, (1.0, 1.0)), SLOPE_BLUR)


def scaled(heights: F64, slope: float) -> F64:
    """Scale heights to an RMS slope and mean 0; constant heights become 0."""
    heights = heights - heights.mean()
    present = float(np.sqrt(np.mean(slope_of(heights) ** 2)))
    return heights * (slope / present) if present > 0.0 else heights * 0.0


def _normalize(values: F64) -> F64:
    """Scale values to 0..1 between the first and last percentile, clipped."""
    low, high = np.quantile(values[::3, ::3], (0.01, 0.99))
    return np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0)


def _palette(rng: np.random.Generator, count: int) -> F64:
    """Random colours (count, 3) in linear light, of similar or different hues."""
    hue = rng.random() + rng.choice([0.03, 0.15, 1.0]) * rng.uniform(-1, 1, count)
    saturation = rng.beta(1.0, 2.0) * rng.uniform(0.5, 1.0, count)
    value = np.exp(rng.uniform(np.log(0.04), np.log(0.9), count))
    value = value[0] * (value / value[0]) ** rng.uniform(0.1, 1.0)
    wheel = 0.5 + 0.5 * np.cos(2 * np.pi * (hue[:, None] - np.array([0.0, 1 / 3, 2 / 3])))
    return value[:, None] * (1.0 - saturation[:, None] * (1.0 - wheel))


def colours_of(rng: np.random.Generator, relief: families.Relief, *, is_print: bool) -> F64:
    """Albedo (N, N, 3): random colours that follow, contradict or ignore the relief."""
    n = len(relief.heights)
    kinds = ["even", "follow", "contradict", "print", "cells", "patches", "grain"]
    odds = np.array([0.0, 0.5, 0, 3.0, 1.0, 1.0, 0.5] if is_print else [1.2, 1, 1, 1.6, 1, 1, 0.7])
    colours = np.ones((n, n, 3))
    for turn in range(1 if rng.random() < 0.6 else 2):
        kind = rng.choice(kinds, p=odds / odds.sum())
        if kind == "follow" or kind == "contradict":
            share = _normalize(relief.heights)
            share = share if kind == "follow" else 1.0 - share
            share = share ** rng.uniform(0.4, 2.5)
        elif kind == "print":
            share = _print(rng, n)
        elif kind == "cells" and relief.cells is not None:
            share = p.random_by_cell(rng, relief.cells)
        elif kind == "patches" or kind == "cells":
            share = _normalize(p.noise(rng, n, 1.0, 0.1, fall=1.5))
        elif kind == "grain":
            share = _normalize(
                p.noise(rng, n, rng.uniform(4, 30) / n, 2.0 / n, fall=rng.uniform(0, 1))
            )
        else:
            share = np.zeros((n, n))
        palette = _palette(rng, int(rng.integers(2, 5)))
        if turn:  # a second layer of colour is fainter
            palette = 1.0 + 0.6 * (palette / palette.max() - 1.0)
        at = np.linspace(0.0, 1.0, len(palette))
        colours *= np.stack([np.interp(share, at, palette[:, k]) for k in range(3)], -1)
    grain = np.exp(rng.uniform(0.0, 0.08) * rng.standard_normal((n, n)))
    return np.clip(colours * grain[..., None], 0.005, 0.98)


def _print(rng: np.random.Generator, n: int) -> F64:
    """Printed pattern (N, N), 0..1: shapes of a random family, with sharp or soft borders."""
    spread = _normalize(families.draw_one(rng, n).heights)
    if rng.random() < 0.6:
        levels = int(rng.integers(2, 6))
        return np.floor(spread * levels * 0.999) / (levels - 1)
    return spread


def _roughness(rng: np.random.Generator, relief: families.Relief) -> F64:
    n = len(relief.heights)
    level = rng.beta(2.0, 1.3)
    kind = rng.random()
    if kind < 0.6:
        change = np.zeros((n, n))
    elif kind < 0.8:
        change = (_normalize(relief.heights) - 0.5) * rng.uniform(-0.5, 0.5)
    else:
        change = 0.1 * p.noise(rng, n, 0.8, 0.1)
    return np.clip(level + change, 0.02, 1.0)


def _blur(grid: F64, sigma: float) -> F64:
    """Blur a tileable grid by a Gaussian, by Fourier transform."""
    rows = np.fft.fftfreq(grid.shape[0])[:, None]
    columns = np.fft.rfftfreq(grid.shape[1])
    transfer = np.exp(-2.0 * (np.pi * sigma) ** 2 * (rows**2 + columns**2))
    if grid.ndim == 3:
        transfer = transfer[..., None]
    return np.fft.irfft2(np.fft.rfft2(grid, axes=(0, 1)) * transfer, grid.shape[:2], axes=(0, 1))


def _shadow(heights: F64, direction: F64, rise: float, soft: float) -> F64:
    """Visible share of the sun (N, N), 0 in full shadow.

    Parameters
    ----------
    direction : (2,)
        Unit vector (row, column) toward the sun.
    rise : float
        Tangent of the sun's elevation.
    soft : float
        Width of the penumbra as a share of the distance to the shadow's edge.
    """
    lit = np.ones(heights.shape)
    reach = min(float(np.ptp(heights)) / rise, len(heights) / 2.0)
    distances = np.unique(np.round(np.geomspace(1.0, max(reach, 1.5), 14)))
    for distance in distances:
        shift = np.round(-direction * distance).astype(int)
        above = np.roll(heights, tuple(shift), (0, 1)) - heights - distance * rise
        np.minimum(lit, np.clip(0.5 - above / (soft * distance + 0.3), 0.0, 1.0), out=lit)
    return lit


def _shade(rng: np.random.Generator, heights: F64, colours: F64, roughness: F64) -> F64:
    """Light (N, N, 3) from a relief to a camera above."""
    down = 0.5 * (np.roll(heights, -1, 0) - np.roll(heights, 1, 0))
    right = 0.5 * (np.roll(heights, -1, 1) - np.roll(heights, 1, 1))
    up = 1.0 / np.sqrt(1.0 + down**2 + right**2)
    # Ambient occlusion: less sky is visible below the surroundings.
    sky = 0.5 + 0.5 * up
    depth = rng.uniform(0.3, 1.5)
    for sigma in (2.0, 5.0, 12.0):
        below = np.maximum(_blur(heights, sigma) - heights, 0.0) / sigma
        sky = sky / (1.0 + depth * below)
    total = sky[..., None] * _tint(rng) * rng.uniform(0.1, 0.9)
    suns = rng.choice([0, 1, 2], p=[0.12, 0.68, 0.2])
    shine = np.zeros(heights.shape)
    power = 2.0 / np.maximum(roughness, 0.08) ** 4
    for _ in range(suns):
        azimuth = rng.uniform(0.0, 2.0 * np.pi)
        elevation = np.radians(rng.uniform(15.0, 80.0))
        azimuth_direction = np.array([np.sin(azimuth), np.cos(azimuth)])
        sun = np.array([*(np.cos(elevation) * azimuth_direction), np.sin(elevation)])
        facing = np.maximum((sun[2] - sun[0] * down - sun[1] * right) * up, 0.0)
        if rng.random() < 0.8:
            facing = facing * _shadow(
                heights, azimuth_direction, np.tan(elevation), rng.uniform(0.02, 0.5)
            )
        strength = rng.uniform(0.4, 1.2) / np.sin(elevation) ** 0.7
        total += facing[..., None] * _tint(rng) * strength
        # Blinn highlight, with a slightly tilted camera.
        half = sun + np.array([*rng.normal(0.0, 0.08, 2), 1.0])
        half /= np.linalg.norm(half)
        near = np.clip((half[2] - half[0] * down - half[1] * right) * up, 0.0, 1.0)
        shine += facing * strength * near**power * np.minimum(power, 60.0)
    gloss = rng.choice([0.0, 1.0], p=[0.35, 0.65]) * rng.uniform(0.002, 0.03)
    return colours * total + (gloss * shine)[..., None]


def _tint(rng: np.random.Generator) -> F64:
    warmth = rng.normal(0.0, 0.08)
    return np.array([1.0 + warmth, 1.0, 1.0 - warmth])


def _camera(rng: np.random.Generator, light: F64) -> npt.NDArray[np.uint8]:
    """Develop light (N, N, 3) to an 8-bit sRGB picture with the faults of a camera."""
    n = len(light)
    light = light * (rng.uniform(0.15, 0.6) / max(float(np.median(light)), 1e-6))
    if rng.random() < 0.7:
        light = np.maximum(_blur(light, rng.uniform(0.3, 1.3)), 0.0)
    if rng.random() < 0.4:  # light falls off toward one side
        rows, columns = p.places(n)
        tilt = rng.normal(0.0, 0.4, 2)
        fall = 1.0 + tilt[0] * (rows - 0.5) + tilt[1] * (columns - 0.5)
        light = light * np.maximum(fall, 0.2)[..., None]
    noise = rng.choice([0.0, 1.0], p=[0.3, 0.7]) * np.exp(rng.uniform(np.log(0.002), np.log(0.03)))
    grain = rng.standard_normal(light.shape)
    light = light + noise * (0.3 + np.sqrt(np.maximum(light, 0.0))) * grain
    light = np.clip(light, 0.0, 1.0)
    codes = linear_to_srgb(light)
    codes = np.clip(0.5 + (codes - 0.5) * rng.uniform(0.85, 1.3) + rng.normal(0, 0.03), 0.0, 1.0)
    if rng.random() < 0.3:  # sharpened
        codes = codes + rng.uniform(0.2, 0.8) * (codes - _blur(codes, 1.2))
    if rng.random() < 0.15:
        codes = np.repeat(codes.mean(axis=2, keepdims=True), 3, axis=2)
    if rng.random() < 0.6:
        codes = jpeg(codes, rng.uniform(35.0, 95.0))
    return np.round(np.clip(codes, 0.0, 1.0) * 255.0).astype(np.uint8)


def jpeg(codes: F64, quality: float) -> F64:
    """Codes (N, N, 3) after JPEG compression at a quality of 1 to 100; N is a multiple of 8."""
    scale = 50.0 / quality if quality < 50.0 else 2.0 - quality / 50.0
    to_ycc = np.array([[0.299, 0.587, 0.114], [-0.169, -0.331, 0.5], [0.5, -0.419, -0.081]])
    n, m = codes.shape[:2]
    planes = (255.0 * codes @ to_ycc.T).reshape(n // 8, 8, m // 8, 8, 3).transpose(4, 0, 2, 1, 3)
    # 8 x 8 cosine transform, with coarser quantization of both colour planes.
    steps = np.maximum(_LUMINANCE_QUANTA * scale, 1.0) * np.array([1.0, 1.6, 1.6]).reshape(
        3, 1, 1, 1, 1
    )
    waves = np.round(_DCT @ planes @ _DCT.T / steps) * steps
    planes = (_DCT.T @ waves @ _DCT).transpose(1, 3, 2, 4, 0).reshape(n, m, 3)
    return planes @ np.linalg.inv(to_ycc).T / 255.0
