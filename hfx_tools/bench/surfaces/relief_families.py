# SPDX-License-Identifier: GPL-3.0-or-later
"""Families of relief outside the network's training set.

The drawing rules differ from all of ``hfx_tools/relief/families.py``: swept profiles, discs and
rings laid on one another, a pattern grown by reaction and diffusion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy import ndimage

from hfx_blender.engine.arrays import F64

HeldOut = Callable[[np.random.Generator, int], F64]


def _grid(n: int) -> tuple[F64, F64]:
    line = np.arange(n) / n
    return line[:, None] + np.zeros((n, n)), line[None, :] + np.zeros((n, n))


def _ropes(rng: np.random.Generator, n: int) -> F64:
    """Twisted ropes side by side."""
    y, x = _grid(n)
    ropes, turns = rng.integers(4, 11), rng.integers(8, 22)
    across = 2.0 * ((y * ropes) % 1.0) - 1.0
    body = np.sqrt(np.maximum(1.0 - across**2, 0.0))
    strands = np.abs(np.sin(np.pi * (turns * x + 0.8 * np.arcsin(across) / np.pi * 2)))
    return body * (0.75 + 0.25 * strands)


def _chevrons(rng: np.random.Generator, n: int) -> F64:
    """Blocks of a tyre's tread."""
    y, x = _grid(n)
    columns, rows = 2 * rng.integers(1, 4), rng.integers(4, 11)
    zigzag = np.abs(((x * columns) % 1.0) - 0.5)
    groove = np.abs(((y * rows + 1.3 * zigzag) % 1.0) - 0.5)
    split = np.abs(((x * columns / 2) % 1.0) - 0.5)
    return np.minimum(np.clip(12 * (groove - 0.1), 0, 1), np.clip(25 * (split - 0.03), 0, 1))


def _laid(
    rng: np.random.Generator, n: int, count: int, radius: float, profile: Callable[[F64], F64]
) -> F64:
    """Round bodies laid one after another on top of the previous heights."""
    heights = np.zeros((n, n))
    reach = int(radius * n * 1.2) + 1
    span = np.arange(-reach, reach + 1)
    for _ in range(count):
        cy, cx = rng.integers(0, n, 2)
        size = radius * n * rng.uniform(0.8, 1.2)
        body_ = profile(np.hypot(*np.meshgrid(span, span)) / size)
        window = np.ix_((cy + span) % n, (cx + span) % n)
        under = heights[window]
        base = np.median(under[body_ > 0.0]) if (body_ > 0.0).any() else 0.0
        heights[window] = np.where(body_ > 0.0, np.maximum(under, 0.7 * base + body_), under)
    return heights


def _coins(rng: np.random.Generator, n: int) -> F64:
    """Coins with a rim."""
    radius = rng.uniform(0.04, 0.1)
    rim = rng.uniform(0.1, 0.5)

    def profile(r: F64) -> F64:
        return np.clip((1.0 - r) / 0.06, 0, 1) * (1.0 + rim * (np.abs(r - 0.88) < 0.08))

    return _laid(rng, n, int(0.9 / radius**2 / 3), radius, profile)


def _mail(rng: np.random.Generator, n: int) -> F64:
    """Rings of chain mail in rows."""
    y, x = _grid(n)
    count = 2 * rng.integers(3, 8)
    heights = np.zeros((n, n))
    for shift in (0.0, 0.5):
        v, u = (y * count + shift) % 1.0 - 0.5, (x * count + shift) % 1.0 - 0.5
        wire = 1.0 - ((np.hypot(u, v) - 0.38) / 0.1) ** 2
        lean = 0.3 * u if shift else -0.3 * u
        heights = np.maximum(
            heights, np.where(wire > 0, np.sqrt(np.maximum(wire, 0)) + 0.4 + lean, 0)
        )
    return heights


def _popcorn(rng: np.random.Generator, n: int) -> F64:
    """Clusters of half balls of many sizes, as on a sprayed ceiling."""
    heights = np.zeros((n, n))
    for radius in (0.012, 0.025, 0.045):
        count = int(0.25 / radius**2 / 3)
        balls = _laid(rng, n, count, radius, lambda r: np.sqrt(np.maximum(1 - r * r, 0.0)))
        heights += radius * 30 * ndimage.gaussian_filter(balls, 0.7, mode="wrap")
    return heights


def _mud(rng: np.random.Generator, n: int) -> F64:
    """Dry mud: plates with edges curled up at the cracks."""
    count = rng.integers(12, 60)
    points = rng.random((count, 2)) * n
    seeds = np.ones((3 * n, 3 * n), bool)
    labels = np.zeros((3 * n, 3 * n), int)
    for k, (a, b) in enumerate(points.astype(int)):
        for da in (0, n, 2 * n):
            for db in (0, n, 2 * n):
                seeds[a + da, b + db] = False
                labels[a + da, b + db] = k
    where = ndimage.distance_transform_edt(seeds, return_distances=False, return_indices=True)
    owner = labels[tuple(where)][n : 2 * n, n : 2 * n]
    border = np.zeros((n, n), bool)
    for axis in (0, 1):
        border |= owner != np.roll(owner, 1, axis)
    crack = ndimage.distance_transform_edt(~np.tile(border, (3, 3)))[n : 2 * n, n : 2 * n]
    wide = n / np.sqrt(count)
    curl = np.exp(-crack / (0.15 * wide))
    return np.clip(crack / max(0.03 * wide, 1.2), 0, 1) * (0.6 + 0.5 * curl)


def _herringbone(rng: np.random.Generator, n: int) -> F64:
    """Parquet blocks in a herringbone bond."""
    size = n // int(rng.choice([8, 12, 16]))
    row, column = np.indices((n, n))
    i, j = row // size, column // size
    phase = (i - j) % 4
    level = np.ones((n, n))
    v, u = row % size, column % size
    joint = max(1.0, 0.06 * size)
    for side, open_at in (
        (v, (0, 2, 3)),
        (size - 1 - v, (0, 1, 3)),
        (u, (0, 1, 2)),
        (size - 1 - u, (1, 2, 3)),
    ):
        edge = np.clip(side / joint - 0.3, 0, 1)
        level = np.where(np.isin(phase, open_at), np.minimum(level, edge), level)
    return ndimage.gaussian_filter(level, 0.6, mode="wrap")


def _peel(rng: np.random.Generator, n: int) -> F64:
    """Orange peel of sprayed paint: smooth hills, softly clipped."""
    sigma = rng.uniform(0.008, 0.03) * n
    base = ndimage.gaussian_filter(rng.standard_normal((n, n)), sigma, mode="wrap")
    return np.tanh(rng.uniform(0.7, 2.0) * base / base.std())


def _labyrinth(rng: np.random.Generator, n: int) -> F64:
    """Ridges of brain coral, grown by activation and inhibition."""
    sigma = rng.uniform(0.008, 0.02) * n
    state = rng.standard_normal((n, n))
    for _ in range(12):
        near = ndimage.gaussian_filter(state, sigma, mode="wrap")
        state = np.tanh(6.0 * (near - ndimage.gaussian_filter(state, 1.7 * sigma, mode="wrap")))
    return ndimage.gaussian_filter(state, max(0.3 * sigma, 0.7), mode="wrap")


def _letters(rng: np.random.Generator, n: int) -> F64:
    """Signs of bars on a grid, raised or sunk."""
    cells = int(rng.integers(5, 11))
    size = n // cells
    page = np.zeros((n, n))
    pen = max(2, size // 7)
    for i in range(cells):
        for j in range(cells):
            for _ in range(3):
                a, b = rng.integers(1, size - pen - 1, 2)
                length = rng.integers(size // 3, size - 2)
                top, left = i * size, j * size
                if rng.random() < 0.5:
                    page[top + a : top + a + pen, left + 1 : left + 1 + length] = 1.0
                else:
                    page[top + 1 : top + 1 + length, left + b : left + b + pen] = 1.0
    return rng.choice([-1.0, 1.0]) * ndimage.gaussian_filter(
        page, rng.uniform(0.6, 1.6), mode="wrap"
    )


def _interference(rng: np.random.Generator, n: int) -> F64:
    """Crossed waves in five directions, nearly a quasicrystal."""
    y, x = _grid(n)
    count = rng.uniform(6, 18)
    total = np.zeros((n, n))
    for k in range(5):
        angle = np.pi * k / 5.0
        a, b = round(count * np.cos(angle)), round(count * np.sin(angle))
        total += np.cos(2 * np.pi * (a * x + b * y) + rng.uniform(0, 6))
    return total


def _rivets(rng: np.random.Generator, n: int) -> F64:
    """Overlapping metal sheets with rivets along the seams."""
    y, x = _grid(n)
    sheets, rivets = int(rng.integers(2, 5)), int(rng.integers(8, 17))
    v = (y * sheets) % 1.0
    step = np.clip(v / 0.03, 0, 1) * (1.0 - v)
    du = ((x * rivets) % 1.0 - 0.5) / rivets
    dv = (v - 0.12) / sheets
    r = np.hypot(du, dv) / (0.28 / rivets)
    return 0.8 * step + 0.6 * np.sqrt(np.maximum(1.0 - r * r, 0.0))


def _gullies(rng: np.random.Generator, n: int) -> F64:
    """Branching gullies down a slope."""
    wide = ndimage.gaussian_filter(rng.standard_normal((n, n)), (0.08 * n, 0.01 * n), mode="wrap")
    thin = ndimage.gaussian_filter(rng.standard_normal((n, n)), (0.02 * n, 0.005 * n), mode="wrap")
    shift = np.cumsum(rng.normal(0, 0.5, n))
    shift -= np.linspace(0, shift[-1], n)
    rows = np.abs(wide / wide.std()) + 0.4 * np.abs(thin / thin.std())
    return np.stack([np.roll(row, round(s)) for row, s in zip(rows, shift, strict=True)])


def _braid(rng: np.random.Generator, n: int) -> F64:
    """Three-strand braids in columns."""
    y, x = _grid(n)
    columns, turns = int(rng.integers(2, 6)), int(rng.integers(4, 9))
    u = (x * columns) % 1.0
    heights = np.zeros((n, n))
    for k in range(3):
        t = 2 * np.pi * (turns * y + k / 3.0)
        middle, lift = 0.5 + 0.28 * np.sin(t), 0.3 * np.sin(2 * t)
        inside = 1.0 - ((u - middle) / 0.17) ** 2
        heights = np.maximum(
            heights, np.where(inside > 0, np.sqrt(np.maximum(inside, 0)) + lift + 0.3, 0)
        )
    return heights


def _terry(rng: np.random.Generator, n: int) -> F64:
    """Loops of towelling: dense short arcs."""
    heights = np.zeros((n, n))
    count = int(rng.integers(1200, 2500))
    radius = max(2.0, rng.uniform(0.010, 0.02) * n)
    for _ in range(count):
        cy, cx = rng.uniform(0, n, 2)
        a, sweep = rng.uniform(0, 2 * np.pi), rng.uniform(2, 5)
        t = np.linspace(a, a + sweep, int(8 * radius))
        rows = np.round(cy + radius * np.sin(t)).astype(int) % n
        columns = np.round(cx + radius * np.cos(t)).astype(int) % n
        heights[rows, columns] = np.maximum(heights[rows, columns], rng.uniform(0.5, 1.0))
    return ndimage.gaussian_filter(heights, 0.9, mode="wrap")


def _spirals(rng: np.random.Generator, n: int) -> F64:
    """Carved spirals on square tiles."""
    y, x = _grid(n)
    tiles, arms = int(rng.integers(2, 5)), float(rng.uniform(3, 6))
    v, u = (y * tiles) % 1.0 - 0.5, (x * tiles) % 1.0 - 0.5
    r = np.hypot(u, v)
    wave = np.cos(np.arctan2(v, u) + 2 * np.pi * arms * 2 * r)
    return np.clip((0.46 - r) / 0.04, 0, 1) * np.clip(2.5 * wave, -1, 1)


FAMILIES: Final[dict[str, HeldOut]] = {
    draw.__name__.lstrip("_"): draw
    for draw in (
        _ropes, _chevrons, _coins, _mail, _popcorn, _mud, _herringbone, _peel, _labyrinth,
        _letters, _interference, _rivets, _gullies, _braid, _terry, _spirals,
    )
}  # fmt: skip
