# SPDX-License-Identifier: GPL-3.0-or-later
"""Cloths drawn at random, by families, for the correlation of drive and roughness.

Sets of 36. Periods are 0.2 to 2 mm (ribs and knits to 4 mm) and depths 15 to 600 micrometres, at
most half of the period, evenly spread over their logarithm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.texture import procedural
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.procedural import noise

COUNT: Final = 36
TEXELS: Final = 512
_PERIODS_M: Final = (0.2e-3, 2e-3)
_DEPTHS_M: Final = (15e-6, 600e-6)
_DIRECTIONS: Final = (0.0, np.pi / 6.0, np.pi / 4.0, np.pi / 3.0, np.pi / 2.0, 0.2)

Rng = np.random.Generator


@dataclass(frozen=True, eq=False)
class Cloth:
    """Piece of cloth, with thread period and relief depth in metres."""

    kind: str
    period_m: float
    depth_m: float
    field: HeightField


def dealt_weaves(seed: int, texels: int = TEXELS) -> list[Cloth]:
    """Build each weave in six periods, from fine shirting to rough tweed.

    Depths and directions are shuffled among the periods, so surfaces differ in more than scale.
    """
    rng = np.random.default_rng(seed)
    weaves = []
    for draft in procedural.DRAFTS:
        depths = rng.permutation(np.geomspace(*_DEPTHS_M, 6))
        directions = rng.permutation(_DIRECTIONS)
        for k, period in enumerate(np.geomspace(*_PERIODS_M, 6).tolist()):
            depth = min(float(depths[k]), 0.5 * period)
            weaves.append(_woven(rng, draft, period, depth, float(directions[k]), texels, seed))
    return weaves


def drawn_weaves(seed: int, texels: int = TEXELS) -> list[Cloth]:
    """Build :data:`COUNT` weaves with random parameters within the bounds of all cloths."""
    rng = np.random.default_rng([seed, 1])
    weaves = []
    for _ in range(COUNT):
        period, depth = _measures(rng, _PERIODS_M)
        draft, direction = str(rng.choice(list(procedural.DRAFTS))), float(rng.uniform(0.0, np.pi))
        weaves.append(_woven(rng, draft, period, depth, direction, texels, seed))
    return weaves


def _woven(
    rng: Rng, draft: str, period: float, depth: float, direction: float, texels: int, seed: int
) -> Cloth:
    dive = float(rng.uniform(0.4, 0.9))
    cloth = procedural.Weave(draft, period, depth, direction, dive, 0.01 * depth)
    return Cloth(draft, period, depth, procedural.woven(cloth, _size_m(period), texels, seed))


def _size_m(period: float) -> float:
    return max(0.02, 12.0 * period)


def _measures(rng: Rng, periods_m: tuple[float, float]) -> tuple[float, float]:
    """Random period and depth, metres."""
    period, depth = (
        float(np.exp(rng.uniform(*np.log(bounds)))) for bounds in (periods_m, _DEPTHS_M)
    )
    return period, min(depth, 0.5 * period)


Shape = Callable[[Rng, int, float, float], F64]
"""Heights (N, N) of any scale from random generator, texels a side, size and period in metres."""


def _corduroy(rng: Rng, texels: int, size_m: float, period_m: float) -> F64:
    """Round ribs of pile with grooves between them."""
    phase = _across(rng, texels, size_m, period_m)
    return np.abs(np.sin(np.pi * phase)) ** rng.uniform(0.4, 1.0) + _pile(rng, texels, size_m)


def _threads(rng: Rng, texels: int, size_m: float, period_m: float) -> F64:
    """Round threads side by side, each a little higher or lower than the next."""
    phase = _across(rng, texels, size_m, period_m)
    count = max(round(size_m / period_m), 1)
    lift = rng.normal(0.0, 0.1, 4 * count)[np.floor(phase).astype(np.int64) % (4 * count)]
    across = 2.0 * (phase - np.floor(phase)) - 1.0
    return np.sqrt(np.maximum(1.0 - 0.95 * across**2, 0.0)) + lift + _pile(rng, texels, size_m)


def _knit(rng: Rng, texels: int, size_m: float, period_m: float) -> F64:
    """Wales of loops: two slanting legs each, one loop above the other."""
    x, y = _plane(texels)
    wales = max(round(size_m / period_m), 1)
    courses = max(round(size_m / (period_m * rng.uniform(0.6, 0.9))), 1)
    wale, course = wales * x % 1.0, courses * y % 1.0
    leg = np.abs(2.0 * wale - 1.0)  # 0 in the middle of a wale, 1 between two
    slant = np.sin(2.0 * np.pi * (course + 0.5 * leg))
    return np.sin(np.pi * leg) * (1.0 + 0.4 * slant) + _pile(rng, texels, size_m)


def _grain(rng: Rng, texels: int, size_m: float, period_m: float) -> F64:
    """Leather: smooth noise about the period, its valleys sharp."""
    waves = noise(rng, texels, size_m, 2.0 * period_m, 0.5 * period_m, fall=0.5)
    return -(np.abs(waves) ** rng.uniform(0.6, 1.0))


def _felt(rng: Rng, texels: int, size_m: float, period_m: float) -> F64:
    """Fibres in all directions: noise of waves up to the period, the finer the lower."""
    return noise(rng, texels, size_m, period_m, 0.1e-3, fall=rng.uniform(0.3, 1.0))


def _plane(texels: int) -> tuple[F64, F64]:
    steps = (np.arange(texels) + 0.5) / texels
    return steps[None, :], steps[:, None]


def _across(rng: Rng, texels: int, size_m: float, period_m: float) -> F64:
    """Count of ribs (N, N) along a random direction; whole numbers of ribs fit both sides."""
    x, y = _plane(texels)
    angle = rng.uniform(-np.pi / 3.0, np.pi / 3.0)
    ribs = size_m / period_m
    return max(round(ribs * np.cos(angle)), 1) * x + round(ribs * np.sin(angle)) * y


def _pile(rng: Rng, texels: int, size_m: float) -> F64:
    return 0.03 * noise(rng, texels, size_m, 0.6e-3, 0.15e-3, fall=0.0)


_FAMILIES: Final[dict[str, tuple[Shape, tuple[float, float]]]] = {
    "corduroy": (_corduroy, (0.8e-3, 4e-3)),
    "threads": (_threads, _PERIODS_M),
    "knit": (_knit, (0.5e-3, 4e-3)),
    "grain": (_grain, _PERIODS_M),
    "felt": (_felt, _PERIODS_M),
}


def _of_family(name: str) -> Callable[..., list[Cloth]]:
    shape, periods_m = _FAMILIES[name]

    def drawn(seed: int, texels: int = TEXELS) -> list[Cloth]:
        rng = np.random.default_rng([seed, *name.encode()])
        cloths = []
        for _ in range(COUNT):
            period, depth = _measures(rng, periods_m)
            size = _size_m(period)
            heights = shape(rng, texels, size, period)
            low, high = np.quantile(heights, [0.005, 0.995])
            texel = size / texels
            field = HeightField(heights * (depth / (high - low)), (texel, texel))
            cloths.append(Cloth(name, period, depth, field))
        return cloths

    return drawn


RECIPES: Final[dict[str, Callable[..., list[Cloth]]]] = {
    "dealt weaves": dealt_weaves,
    "drawn weaves": drawn_weaves,
    **{name: _of_family(name) for name in _FAMILIES},
}
