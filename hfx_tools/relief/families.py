# SPDX-License-Identifier: GPL-3.0-or-later
"""Families of relief in the network's training set: the library's recipes and those below.

A family makes tileable heights (N, N) in any unit, and optionally an id (N, N) of the cell (stone,
brick) of each texel, for colours by cell. ``feature`` is the size of the largest parts as a share
of the square.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.texture.procedural import MATERIALS

from . import patterns as p
from .composed import composed


class Relief(NamedTuple):
    """Heights (N, N) in any unit; cells (N, N) or None."""

    heights: F64
    cells: I64 | None = None


Family = Callable[[np.random.Generator, int, float], Relief]


def _fractal(rng: np.random.Generator, n: int, feature: float) -> Relief:
    return Relief(p.noise(rng, n, feature, 3.0 / n, fall=rng.uniform(0.3, 1.6)))


def _ridged(rng: np.random.Generator, n: int, feature: float) -> Relief:
    base = p.noise(rng, n, feature, 4.0 / n, fall=1.2)
    return Relief(1.0 - np.abs(base) ** rng.uniform(0.5, 1.0))


def _billow(rng: np.random.Generator, n: int, feature: float) -> Relief:
    return Relief(np.abs(p.noise(rng, n, feature, 0.4 * feature)) ** rng.uniform(0.7, 1.2))


def _brushed(rng: np.random.Generator, n: int, feature: float) -> Relief:
    thin = max(0.3 * feature, 4.0 / n)
    stretch = rng.uniform(6.0, 40.0)
    return Relief(p.noise(rng, n, thin, 2.5 / n, stretch=stretch, fall=rng.uniform(0.0, 0.8)))


def _count(feature: float, least: int = 2) -> int:
    return max(least, round(1.0 / feature))


def _pebbles(rng: np.random.Generator, n: int, feature: float) -> Relief:
    moved = p.warped_places(rng, n, 0.1 * feature, 2.0 * feature)
    c = p.cells(rng, n, _count(feature), moved=moved)
    gap = (c.second - c.first) / feature
    dome = np.clip(gap / rng.uniform(0.3, 0.9), 0.0, 1.0)
    heights = (1.0 - (1.0 - dome) ** 2) * (0.6 + 0.4 * p.random_by_cell(rng, c.index))
    return Relief(heights, c.index)


def _cracks(rng: np.random.Generator, n: int, feature: float) -> Relief:
    moved = p.warped_places(rng, n, rng.uniform(0.05, 0.25) * feature, feature)
    c = p.cells(rng, n, _count(feature), moved=moved)
    width = max(rng.uniform(0.04, 0.15) * feature, 2.0 / n)
    return Relief(p.smooth_step(c.second - c.first, 0.0, width), c.index)


def _bricks(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.warped_places(rng, n, rng.uniform(0.0, 0.03) * feature)
    courses = 2 * max(1, round(0.5 / feature))
    across = max(1, round(courses / rng.uniform(1.0, 3.0)))
    y = rows * courses
    offset = rng.choice([0.0, 0.5, 1.0 / 3.0])
    x = columns * across + offset * (np.floor(y) % 2)
    index = (np.floor(y).astype(np.int64) % courses) * across + np.floor(x).astype(
        np.int64
    ) % across
    edge = np.minimum(
        np.minimum(y % 1.0, 1.0 - y % 1.0),
        np.minimum(x % 1.0, 1.0 - x % 1.0) * courses / across,
    )
    joint, bevel = rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.2)
    level = p.smooth_step(edge, joint, joint + bevel)
    rough = rng.uniform(0.0, 0.15) * p.noise(rng, n, 0.3 * feature + 8.0 / n, 3.0 / n)
    return Relief(level * (1.0 + rough + rng.uniform(0, 0.3) * p.random_by_cell(rng, index)), index)


def _hexagons(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.warped_places(rng, n, rng.uniform(0.0, 0.03) * feature)
    side = 2 * max(1, round(0.5 / feature))
    a = np.cos(2 * np.pi * side * rows)
    b = np.cos(np.pi * side * (rows + 2 * columns))
    c = np.cos(np.pi * side * (rows - 2 * columns))
    dome = (a + b + c) / 3.0
    sign = rng.choice([-1.0, 1.0])
    return Relief(sign * p.smooth_step(dome, rng.uniform(-0.5, -0.1), rng.uniform(0.0, 0.9)))


def _planks(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, _ = p.places(n)
    count = _count(feature)
    y = rows * count
    index = np.floor(y).astype(np.int64)
    edge = np.minimum(y % 1.0, 1.0 - y % 1.0)
    grain = p.noise(rng, n, 0.3 * feature + 6.0 / n, 3.0 / n, stretch=rng.uniform(8, 30), fall=0.6)
    level = p.smooth_step(edge, 0.02, rng.uniform(0.05, 0.12))
    return Relief(level + rng.uniform(0.02, 0.2) * grain, index)


def _ribs(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.warped_places(rng, n, rng.uniform(0.0, 0.08) * feature)
    phase = _count(feature) * rows + rng.integers(-3, 4) * columns
    wave = 0.5 + 0.5 * np.cos(2 * np.pi * phase)
    return Relief(wave ** rng.uniform(0.3, 3.0))


def _grooves(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, _ = p.warped_places(rng, n, rng.uniform(0.0, 0.05) * feature)
    phase = (_count(feature) * rows) % 1.0
    width, bevel = rng.uniform(0.15, 0.6), rng.uniform(0.03, 0.2)
    edge = np.minimum(phase, 1.0 - phase)
    return Relief(p.smooth_step(edge, 0.5 * width - bevel / 2, 0.5 * width + bevel / 2))


def _weave(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.warped_places(rng, n, rng.uniform(0.0, 0.06) * feature)
    count = 2 * max(1, round(1.0 / feature))
    y, x = rows * count, columns * count
    shift = rng.integers(1, 4)
    period = rng.choice([2, 3, 4])
    count_ok = count - count % period or period
    y, x = rows * count_ok, columns * count_ok
    over = ((np.floor(x) + shift * np.floor(y)) % period) < max(1, period // 2)
    warp = np.sqrt(np.clip(1.0 - (2 * (x % 1.0) - 1.0) ** 2, 0, 1))
    weft = np.sqrt(np.clip(1.0 - (2 * (y % 1.0) - 1.0) ** 2, 0, 1))
    bulge = rng.uniform(0.2, 0.8)
    up = warp * (1 - bulge + bulge * np.sin(np.pi * (y % 1.0)))
    down = weft * (1 - bulge + bulge * np.sin(np.pi * (x % 1.0)))
    return Relief(np.where(over, up, down), over.astype(np.int64))


def _knit(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.warped_places(rng, n, rng.uniform(0.0, 0.04) * feature)
    count = _count(feature)
    x, y = columns * count, rows * round(count * rng.uniform(1.0, 1.5))
    heights = np.zeros((n, n))
    for side in (-1.0, 1.0):
        axis = 0.5 + side * 0.25
        lean = y + side * 1.2 * (x % 1.0 - axis)
        thread = np.clip(1.0 - ((x % 1.0 - axis) / 0.25) ** 2, 0.0, 1.0)
        heights = np.maximum(
            heights, np.sqrt(thread) * (0.55 + 0.45 * np.sin(np.pi * (lean % 1.0)))
        )
    return Relief(heights)


def _leather(rng: np.random.Generator, n: int, feature: float) -> Relief:
    moved = p.warped_places(rng, n, 0.2 * feature, feature)
    coarse = p.cells(rng, n, _count(feature), jitter=1.0, moved=moved)
    fine = p.cells(rng, n, _count(feature / 2.3), jitter=1.0, moved=moved)
    gap = p.smooth_step((coarse.second - coarse.first) / feature, 0.0, 0.35)
    small = p.smooth_step((fine.second - fine.first) / feature, 0.0, 0.2)
    return Relief(gap + rng.uniform(0.2, 0.6) * small)


def _studs(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.places(n)
    count = 2 * max(1, round(0.5 / feature))
    y = rows * count
    x = columns * count + rng.choice([0.0, 0.5]) * (np.floor(y) % 2)
    radius = np.hypot(y % 1.0 - 0.5, x % 1.0 - 0.5) / rng.uniform(0.2, 0.5)
    if rng.random() < 0.5:
        return Relief(np.sqrt(np.clip(1.0 - radius**2, 0.0, 1.0)))
    return Relief(rng.choice([-1.0, 1.0]) * (1.0 - p.smooth_step(radius, 0.7, 1.0)))


def _treads(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.places(n)
    count = 2 * max(1, round(0.5 / feature))
    y, x = rows * count, columns * count
    even = ((np.floor(x) + np.floor(y)) % 2) < 1
    dy, dx = y % 1.0 - 0.5, x % 1.0 - 0.5
    u, v = np.where(even, dy + dx, dy - dx), np.where(even, dy - dx, dy + dx)
    shape = 1.0 - np.hypot(u / 0.65, v / rng.uniform(0.15, 0.35))
    return Relief(p.smooth_step(shape, 0.0, rng.uniform(0.2, 0.8)))


def _dimples(rng: np.random.Generator, n: int, feature: float) -> Relief:
    count = round(rng.uniform(0.3, 1.2) / feature**2)
    dents = p.scattered(rng, n, min(count, 500), 0.5 * feature, 0.5 * feature)
    return Relief(-dents)


def _scratches(rng: np.random.Generator, n: int, feature: float) -> Relief:
    spread = rng.uniform(0.05, np.pi)
    scattered = p.scattered(
        rng, n, rng.integers(20, 90), rng.uniform(0.1, 0.4), 2.0 / n, angles=(0.0, spread)
    )
    return Relief(rng.choice([-1.0, -1.0, 1.0]) * scattered)


def _terraces(rng: np.random.Generator, n: int, feature: float) -> Relief:
    base = p.noise(rng, n, 2 * feature, max(0.2 * feature, 4.0 / n), fall=1.4) * rng.uniform(1, 3)
    step = np.floor(base)
    return Relief(step + p.smooth_step(base - step, 0.0, rng.uniform(0.1, 0.4)))


def _ripples(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.warped_places(rng, n, rng.uniform(0.1, 0.5) * feature, 4 * feature)
    phase = _count(feature) * rows + rng.integers(-2, 3) * columns
    lean = rng.uniform(-0.4, 0.4)
    turn = 2 * np.pi * phase
    return Relief(np.sin(turn + lean * np.sin(turn)))


def _wrinkles(rng: np.random.Generator, n: int, feature: float) -> Relief:
    base = p.noise(rng, n, feature, 0.4 * feature, stretch=rng.uniform(1.0, 5.0))
    fold = np.exp(-np.abs(base) * rng.uniform(2.0, 5.0))
    return Relief(rng.choice([-1.0, 1.0]) * p.warped(fold, rng, 0.15 * feature, 2 * feature))


def _knurls(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.places(n)
    count = _count(feature)
    a = np.abs(2 * ((count * (rows + columns)) % 1.0) - 1.0)
    b = np.abs(2 * ((count * (rows - columns)) % 1.0) - 1.0)
    knurls = (np.minimum(a, b), a + b, a * b)[rng.integers(3)]
    return Relief(np.minimum(knurls, knurls.max() * rng.uniform(0.6, 1.0)))


def _scales(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.places(n)
    count = 2 * max(1, round(0.5 / feature))
    heights, index = np.zeros((n, n)), np.zeros((n, n), np.int64)
    for layer in (0, 1, -1):
        y = rows * count + layer
        row = np.floor(y)
        x = columns * count + 0.5 * (row % 2)
        dy, dx = y % 1.0 + (0.0 if layer == 0 else 0.5 * abs(layer)), x % 1.0 - 0.5
        inside = np.hypot(np.maximum(dy - 0.5, 0.0) * 1.6, dx) < 0.5
        tilt = np.where(inside, 0.3 + 0.7 * dy, 0.0) * np.sqrt(np.clip(1 - (1.8 * dx) ** 2, 0, 1))
        index = np.where(tilt > heights, ((row * count + np.floor(x)) % (count * count)), index)
        heights = np.maximum(heights, tilt)
    return Relief(heights, index.astype(np.int64))


def _fibres(rng: np.random.Generator, n: int, feature: float) -> Relief:
    spread = rng.uniform(0.3, np.pi)
    count = min(int(rng.uniform(1.0, 3.0) / (feature * max(0.15 * feature, 2.0 / n) * 4)), 400)
    width = max(rng.uniform(0.08, 0.2) * feature, 2.0 / n)
    return Relief(p.scattered(rng, n, count, 1.2 * feature, width, angles=(0.0, spread), piled=1.5))


def _chips(rng: np.random.Generator, n: int, feature: float) -> Relief:
    count = min(int(rng.uniform(0.8, 2.5) / feature**2), 400)
    narrow = rng.uniform(0.3, 1.0)
    scattered = p.scattered(
        rng, n, count, 0.5 * feature, 0.5 * feature * narrow, profile="box", piled=2.0
    )
    return Relief(scattered)


def _bark(rng: np.random.Generator, n: int, feature: float) -> Relief:
    moved = p.warped_places(rng, n, 0.3 * feature, 2 * feature)
    c = p.cells(rng, n, _count(feature), jitter=1.0, stretch=rng.uniform(2.0, 5.0), moved=moved)
    plates = p.smooth_step(c.second - c.first, 0.0, 0.5 * feature)
    fine = p.noise(rng, n, 0.5 * feature + 6.0 / n, 3.0 / n, stretch=4.0, fall=0.7)
    return Relief(plates + rng.uniform(0.05, 0.25) * fine, c.index)


def _strokes(rng: np.random.Generator, n: int, feature: float) -> Relief:
    scattered = p.scattered(
        rng, n, rng.integers(8, 40), feature, max(0.12 * feature, 2.5 / n), profile="box"
    )
    plate = p.smooth_step(scattered, 0.0, 0.8)
    return Relief(rng.choice([-1.0, 1.0]) * plate, (scattered > 0.5).astype(np.int64))


def _sponge(rng: np.random.Generator, n: int, feature: float) -> Relief:
    holes = np.zeros((n, n))
    for size in (1.0, 0.5, 0.3):
        radius = max(0.4 * feature * size, 2.0 / n)
        count = min(int(0.25 / radius**2), 300)
        holes = np.maximum(holes, size**0.5 * p.scattered(rng, n, count, radius, radius))
    return Relief(-holes)


def _perforated(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.warped_places(rng, n, rng.uniform(0.0, 0.03) * feature)
    count = _count(feature)
    y, x = 2 * np.pi * count * rows, 2 * np.pi * count * columns
    wires = np.maximum(np.cos(y), np.cos(x)) if rng.random() < 0.5 else np.cos(y) + np.cos(x)
    return Relief(p.smooth_step(wires, rng.uniform(-0.6, 0.2), rng.uniform(0.4, 1.0)))


def _rings(rng: np.random.Generator, n: int, feature: float) -> Relief:
    c = p.cells(rng, n, 2, moved=p.warped_places(rng, n, 0.1 * feature))
    wave = np.cos(2 * np.pi * c.first / max(0.6 * feature, 6.0 / n))
    return Relief(np.maximum(wave, rng.uniform(-1.0, 0.3)))


def _dunes(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, _ = p.warped_places(rng, n, rng.uniform(0.1, 0.3) * feature, 3 * feature)
    phase = (_count(feature) * rows) % 1.0
    crest = rng.uniform(0.6, 0.95)
    heights = np.where(phase < crest, phase / crest, (1.0 - phase) / (1.0 - crest))
    return Relief(heights + 0.03 * p.noise(rng, n, 6.0 / n, 2.5 / n, fall=0.0))


def _flakes(rng: np.random.Generator, n: int, feature: float) -> Relief:
    base = p.noise(rng, n, 2 * feature, 3.0 / n, fall=rng.uniform(1.0, 1.6))
    cut = rng.uniform(-0.8, 0.8)
    plate = p.smooth_step(base, cut, cut + rng.uniform(0.1, 0.4))
    fine = p.noise(rng, n, 8.0 / n, 3.0 / n)
    return Relief(plate + rng.uniform(0.0, 0.1) * fine, (base > cut).astype(np.int64))


def _cobbles(rng: np.random.Generator, n: int, feature: float) -> Relief:
    moved = p.warped_places(rng, n, 0.06 * feature, feature)
    c = p.cells(rng, n, _count(feature), jitter=rng.uniform(0.1, 0.5), moved=moved)
    gap = p.smooth_step((c.second - c.first) / feature, 0.02, rng.uniform(0.2, 0.7))
    return Relief(gap * (0.7 + 0.3 * p.random_by_cell(rng, c.index)), c.index)


def _facets(rng: np.random.Generator, n: int, feature: float) -> Relief:
    c = p.cells(rng, n, _count(feature), jitter=1.0)
    rows, columns = p.places(n)
    count = int(c.index.max()) + 1
    a, b = rng.normal(size=(2, count))
    y, x = np.sin(2 * np.pi * rows) / (2 * np.pi), np.sin(2 * np.pi * columns) / (2 * np.pi)
    tilt = (a[c.index] * y + b[c.index] * x) / feature
    return Relief(0.3 * tilt + p.smooth_step((c.second - c.first) / feature, 0.0, 0.15), c.index)


def _grit(rng: np.random.Generator, n: int, feature: float) -> Relief:
    small = max(0.2 * feature, 3.0 / n)
    grains = p.scattered(rng, n, rng.integers(50, 400), small, small, piled=0.5)
    return Relief(grains + 0.2 * p.noise(rng, n, feature, small))


def _crumpled(rng: np.random.Generator, n: int, feature: float) -> Relief:
    total = np.zeros((n, n))
    for octave in range(3):
        c = p.cells(rng, n, _count(feature / 1.7**octave), jitter=1.0)
        total += 0.6**octave * c.first
    return Relief(rng.choice([-1.0, 1.0]) * total)


def _stitched(rng: np.random.Generator, n: int, feature: float) -> Relief:
    rows, columns = p.places(n)
    count = _count(feature)
    y, x = (count * (rows + columns)) % 1.0, (count * (rows - columns)) % 1.0
    pillow = (np.sin(np.pi * y) * np.sin(np.pi * x)) ** rng.uniform(0.3, 1.0)
    return Relief(pillow + 0.05 * p.noise(rng, n, 8.0 / n, 3.0 / n))


OWN: Final[dict[str, Family]] = {
    family.__name__.lstrip("_"): family
    for family in (
        _fractal, _ridged, _billow, _brushed, _pebbles, _cracks, _bricks, _hexagons, _planks,
        _ribs, _grooves, _weave, _knit, _leather, _studs, _treads, _dimples, _scratches,
        _terraces, _ripples, _wrinkles, _knurls, _scales, _fibres, _chips, _bark, _strokes,
        _sponge, _perforated, _rings, _dunes, _flakes, _cobbles, _facets, _grit, _crumpled,
        _stitched,
    )
}  # fmt: skip
"""Families of this module, by name."""


def _recipe(name: str) -> Family:
    def make(rng: np.random.Generator, n: int, feature: float) -> Relief:
        # The recipe's own size is used, so that a texel is smaller than the recipe's features.
        field, _ = MATERIALS[name].make(n, int(rng.integers(2**31)))
        return Relief(field.heights_m)

    return make


LIBRARY: Final[dict[str, Family]] = {name: _recipe(name) for name in MATERIALS}


def draw(rng: np.random.Generator, texels: int) -> Relief:
    """Draw a relief of random family, feature size and direction; sometimes a mix of two."""
    relief = draw_one(rng, texels)
    if rng.random() < 0.25:
        second = draw_one(rng, texels)
        share = 10.0 ** rng.uniform(-1.3, -0.3)
        heights = _unit(relief.heights) + share * _unit(second.heights)
        if rng.random() < 0.3:  # two materials side by side
            mask = p.smooth_step(p.noise(rng, texels, 1.0, 0.2, fall=1.5), -0.1, 0.1)
            heights = mask * _unit(relief.heights) + (1.0 - mask) * share * _unit(second.heights)
        relief = Relief(heights, relief.cells)
    return relief


def draw_one(rng: np.random.Generator, texels: int) -> Relief:
    """Draw a relief of one random family, with random feature size and direction."""
    kind = rng.random()
    families = LIBRARY if kind < 0.12 else OWN
    name = list(families)[rng.integers(len(families))]
    feature = 2.0 ** rng.uniform(np.log2(8.0 / texels), np.log2(0.45))
    if kind > 0.75:
        relief = Relief(composed(rng, texels, feature))
    else:
        relief = families[name](rng, texels, feature)
    turn, flip = int(rng.integers(4)), rng.random() < 0.5

    def placed(grid: np.ndarray) -> np.ndarray:
        grid = np.rot90(grid, turn)
        return np.ascontiguousarray(grid.T if flip else grid)

    return Relief(placed(relief.heights), None if relief.cells is None else placed(relief.cells))


def _unit(heights: F64) -> F64:
    spread = heights.std()
    return (heights - heights.mean()) / (spread if spread > 0.0 else 1.0)
