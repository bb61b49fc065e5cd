# SPDX-License-Identifier: GPL-3.0-or-later
"""Reliefs of random rules: random profiles over random distances, joined in pairs.

The shapes imitate no material, so that a network generalizes to light on unknown shapes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64

from . import patterns as p

Distance = Callable[[np.random.Generator, int, float], F64]
"""Values (N, N), with steps of 1 per feature, from random generator, texels, and size of features
as a share of the square."""


def composed(rng: np.random.Generator, texels: int, feature: float) -> F64:
    """Heights (N, N) of one or two random patterns."""
    heights = _pattern(rng, texels, feature)
    operation = rng.choice(["one", "higher", "lower", "inside", "on top", "one"])
    if operation == "one":
        return heights
    size = float(np.clip(feature * 2.0 ** rng.uniform(-2.0, 2.0), 6.0 / texels, 0.5))
    pattern = _pattern(rng, texels, size)
    if operation == "higher":
        return np.maximum(heights, pattern + rng.uniform(-0.5, 0.5))
    if operation == "lower":
        return np.minimum(heights, pattern + rng.uniform(-0.5, 0.5))
    if operation == "inside":
        border = float(np.quantile(pattern, rng.uniform(0.3, 0.7)))
        mask = p.smooth_step(pattern, border, border + 0.1)
        return heights * mask + rng.uniform(0.0, 0.5) * (1.0 - mask)
    return heights + rng.uniform(0.05, 0.3) * np.clip(2.0 * heights, 0.0, 1.0) * pattern


def _pattern(rng: np.random.Generator, texels: int, feature: float) -> F64:
    """Heights (N, N), 0..1: a random profile over a random distance."""
    distance = _DISTANCES[rng.integers(len(_DISTANCES))](rng, texels, feature)
    if rng.random() < 0.3:
        distance = distance + rng.uniform(0.05, 0.3) * p.noise(rng, texels, 2 * feature, feature)
    knots = np.cumsum(rng.uniform(0.1, 1.0, rng.integers(3, 8)))
    heights = rng.random(len(knots))
    if rng.random() < 0.5:  # two levels with bevels
        heights = (heights > rng.uniform(0.3, 0.7)).astype(float)
    repeats = rng.random() < 0.5 or np.ptp(distance) > 3.0
    share = distance % 1.0 if repeats else np.clip(np.abs(distance), 0.0, 1.0)
    if rng.random() < 0.4:  # round, as of rods and balls
        return np.sqrt(np.clip(1.0 - (2.0 * share - 1.0) ** 2, 0.0, 1.0))
    table = np.interp(np.arange(256) / 256, knots / knots[-1], heights, period=1.0)
    width = rng.uniform(0.0, 12.0)
    if width > 1.0:  # softened
        table = np.fft.irfft(
            np.fft.rfft(table) * np.exp(-2.0 * (np.pi * width * np.fft.rfftfreq(256)) ** 2), 256
        )
    return np.interp(share, np.arange(256) / 256, table, period=1.0)


def _straight(rng: np.random.Generator, texels: int, feature: float) -> F64:
    rows, columns = p.warped_places(rng, texels, rng.uniform(0.0, 0.4) * feature, 3 * feature)
    angle, count = rng.uniform(0.0, np.pi), 1.0 / feature
    return round(count * np.sin(angle)) * rows + max(1, round(count * np.cos(angle))) * columns


def _from_points(rng: np.random.Generator, texels: int, feature: float) -> F64:
    cells = _cells(rng, texels, feature)
    return cells.first / feature


def _from_borders(rng: np.random.Generator, texels: int, feature: float) -> F64:
    cells = _cells(rng, texels, feature)
    return (cells.second - cells.first) / feature


def _cells(rng: np.random.Generator, texels: int, feature: float) -> p.Cells:
    moved = p.warped_places(rng, texels, rng.uniform(0.0, 0.3) * feature, 2 * feature)
    return p.cells(
        rng,
        texels,
        max(2, round(1.0 / feature)),
        jitter=rng.uniform(0.0, 1.0),
        stretch=rng.choice([1.0, 1.0, rng.uniform(1.0, 4.0)]),
        moved=moved,
    )


def _contours(rng: np.random.Generator, texels: int, feature: float) -> F64:
    return p.noise(
        rng,
        texels,
        2.0 * feature,
        feature * rng.uniform(0.2, 1.0),
        stretch=rng.choice([1.0, 1.0, rng.uniform(1.0, 6.0)]),
    ) * rng.uniform(0.3, 1.5)


def _lattice(rng: np.random.Generator, texels: int, feature: float) -> F64:
    """Distance (N, N) from the nearest point of a lattice, by a random norm."""
    rows, columns = p.warped_places(rng, texels, rng.uniform(0.0, 0.05) * feature)
    down = 2 * max(1, round(0.5 / feature))
    along = max(1, round(down * rng.uniform(0.5, 1.5)))
    y = rows * down
    x = columns * along + rng.choice([0.0, 0.5]) * (np.floor(y) % 2)
    v, u = 2.0 * np.abs(y % 1.0 - 0.5), 2.0 * np.abs(x % 1.0 - 0.5)
    power = rng.choice([1.0, 2.0, 8.0])
    return (v**power + u**power) ** (1.0 / power) / 1.42


_DISTANCES: Final[tuple[Distance, ...]] = (
    _straight, _from_points, _from_borders, _contours, _lattice,
)  # fmt: skip
