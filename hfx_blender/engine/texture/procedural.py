# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural materials: gravel, metal, woven fabric and wood, in variants.

Each is a square that tiles without a seam and depends on the seed only.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64
from .height_field import HeightField
from .surface_names import FABRICS, MATERIAL_TITLES

Recipe = Callable[[np.random.Generator, int, float], F64]
"""Function of a random generator, texels per side and size in metres to heights (N, N), metres."""

KINDS: Final = ("gravel", "metal", "fabric", "wood")

# 1 where the warp lies over the weft; a row for each weft thread, a column for each warp thread.
DRAFTS: Final[dict[str, tuple[str, ...]]] = {
    "plain": ("10", "01"),
    "basket": ("1100", "1100", "0011", "0011"),
    "rib": ("10", "10", "01", "01"),
    "twill": ("1100", "0110", "0011", "1001"),
    "denim": ("110", "011", "101"),
    "satin": ("10000", "00010", "01000", "00001", "00100"),
}


@dataclass(frozen=True)
class Weave:
    """Woven cloth; InputError for an unknown draft, or a period or depth that is not positive."""

    draft: str  # key of ``DRAFTS``
    period_m: float  # distance of adjacent threads
    depth_m: float  # height of the highest thread over the deepest gap
    direction_rad: float = 0.0  # of the weft
    float_share: float = 0.6  # share of the depth that a thread loses below another thread
    fibre_m: float = 0.0  # RMS roughness of the fibres

    def __post_init__(self) -> None:
        if self.draft not in DRAFTS:
            raise InputError(f"Weave '{self.draft}': expected one of {', '.join(DRAFTS)}.")
        for name in ("period_m", "depth_m"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"Weave: {name} is {value:g}; expected more than 0.")


@dataclass(frozen=True)
class ProceduralMaterial:
    """Recipe for heights and roughness of a material."""

    name: str  # key of ``MATERIALS``
    kind: str  # one of ``KINDS``
    title: str
    size_m: float  # side of the square
    roughness: float  # mean, 0..1; rough collisions are dull
    heights: Recipe
    period_m: float  # approximate distance of features

    def make(self, texels: int = 512, seed: int = 0) -> tuple[HeightField, F64]:
        """Height field, lowest height 0, and roughness (texels, texels), 0..1, of one square. Both
        depend on ``seed`` and name only. Raises InputError for fewer than 16 texels."""
        if texels < 16:
            raise InputError(f"Material '{self.name}': {texels} texels; expected 16 or more.")
        # The name is part of the seed, so that materials of one seed have different patterns.
        rng = np.random.default_rng([seed, *self.name.encode()])
        heights = self.heights(rng, texels, self.size_m)
        texel = self.size_m / texels
        field = HeightField(heights - heights.min(), (texel, texel))
        deviation = noise(rng, texels, self.size_m, 4e-3, 1e-3)
        return field, np.clip(self.roughness + 0.05 * deviation, 0.0, 1.0)


def material(name: str) -> ProceduralMaterial:
    """Material of a name; raises InputError if unknown."""
    if name not in MATERIALS:
        raise InputError(f"Material '{name}': expected one of {', '.join(MATERIALS)}.")
    return MATERIALS[name]


def noise(
    rng: np.random.Generator,
    texels: int,
    size_m: float,
    longest_m: float,
    shortest_m: float,
    stretch: float = 1.0,
    fall: float = 1.0,
) -> F64:
    """Tiling noise (N, N) of RMS 1 from waves in a band, ``stretch`` times as long along x.
    Amplitudes are proportional to the wavelength to the power of ``fall``. 0 for an empty band."""
    frequency = np.fft.fftfreq(texels, size_m / texels)
    radius = np.hypot(frequency[None, :] * stretch, frequency[:, None])
    band = (radius >= 1.0 / longest_m) & (radius <= 1.0 / shortest_m)
    # In two dimensions short waves are more numerous: half a power more to fall.
    strength = np.where(band, np.where(radius > 0.0, radius, 1.0) ** -(fall + 0.5), 0.0)
    # White noise, filtered: the Fourier transform is periodic, so the square tiles.
    spectrum = np.fft.fft2(rng.standard_normal((texels, texels))) * strength
    values = np.fft.ifft2(spectrum).real
    scale = values.std()
    return np.asarray(values / scale if scale > 0.0 else values)


def _stones(
    rng: np.random.Generator, texels: int, size_m: float, diameter_m: float, flatness: float
) -> F64:
    """Heights (N, N), 0 to about 1, of adjacent stones on a jittered grid, of random size and
    direction; the highest counts at each point. A low exponent ``flatness`` gives flat tops."""
    spacing = 0.72 * diameter_m  # stones overlap
    per_side = max(round(size_m / spacing), 2)
    grid = (np.stack(np.meshgrid(*[np.arange(per_side)] * 2), -1).reshape(-1, 2) + 0.5) / per_side
    centres = grid * size_m + rng.uniform(-0.4, 0.4, grid.shape) * size_m / per_side
    radii = 0.5 * diameter_m * rng.uniform(0.7, 1.3, len(centres))
    squash = rng.uniform(0.7, 1.0, len(centres))
    turn = rng.uniform(0.0, np.pi, len(centres))
    texel = size_m / texels
    heights = np.zeros((texels, texels))
    # Each stone is drawn on a patch of texels, wrapped at the edges of the square.
    for (cx, cy), radius, narrow, angle in zip(centres, radii, squash, turn, strict=True):
        reach = int(np.ceil(radius / texel))
        i = np.arange(-reach, reach + 1)
        column, row = int(cx / texel) + i, int(cy / texel) + i
        dx = (column + 0.5) * texel - cx
        dy = ((row + 0.5) * texel - cy)[:, None]
        along = np.cos(angle) * dx + np.sin(angle) * dy
        across = (np.cos(angle) * dy - np.sin(angle) * dx) / narrow
        inside = np.maximum(1.0 - (along**2 + across**2) / radius**2, 0.0)
        dome = radius / (0.65 * diameter_m) * inside**flatness
        patch = np.ix_(row % texels, column % texels)
        heights[patch] = np.maximum(heights[patch], dome)
    return heights


def _gravel(diameter_m: float, depth_m: float, flatness: float, grit_m: float) -> Recipe:
    """Recipe: stones of a mean diameter, ``depth_m`` high, with grit of RMS ``grit_m``."""

    def heights(rng: np.random.Generator, texels: int, size_m: float) -> F64:
        stones = depth_m * _stones(rng, texels, size_m, diameter_m, flatness)
        grit = grit_m * noise(rng, texels, size_m, 1.5e-3, 0.25e-3, fall=0.5)
        return np.asarray(stones + grit)

    return heights


def _grain(
    depth_m: float, longest_m: float, shortest_m: float, stretch: float, fall: float
) -> Recipe:
    """Recipe: :func:`noise` of RMS ``depth_m``."""

    def heights(rng: np.random.Generator, texels: int, size_m: float) -> F64:
        return depth_m * noise(rng, texels, size_m, longest_m, shortest_m, stretch, fall)

    return heights


def _hammered(diameter_m: float, depth_m: float) -> Recipe:
    """Recipe: dents, ``depth_m`` deep, and a fine grain of RMS 1 micrometre."""

    def heights(rng: np.random.Generator, texels: int, size_m: float) -> F64:
        dents = -depth_m * _stones(rng, texels, size_m, diameter_m, 1.0)
        return np.asarray(dents + 1e-6 * noise(rng, texels, size_m, 1e-3, 0.2e-3))

    return heights


def _cloth(weave: Weave) -> Recipe:
    """Recipe: :func:`woven` cloth with slack threads and fibres of RMS 6 and 4 % of the depth."""

    def heights(rng: np.random.Generator, texels: int, size_m: float) -> F64:
        cloth = woven(weave, size_m, texels).heights_m
        slack = 0.06 * weave.depth_m * noise(rng, texels, size_m, 8e-3, 1.5e-3)
        fibres = 0.04 * weave.depth_m * noise(rng, texels, size_m, 0.5e-3, 0.15e-3, fall=0.0)
        return np.asarray(cloth + slack + fibres)

    return heights


def _corduroy(period_m: float, depth_m: float) -> Recipe:
    """Recipe: round ribs along x, ``period_m`` apart, with a pile of fibres."""

    def heights(rng: np.random.Generator, texels: int, size_m: float) -> F64:
        ribs = max(round(size_m / period_m), 1)
        y = (np.arange(texels) + 0.5) / texels
        rib = np.abs(np.sin(np.pi * ribs * y)) ** 0.6
        pile = 0.05 * noise(rng, texels, size_m, 0.6e-3, 0.15e-3, fall=0.0)
        return np.asarray(depth_m * (rib[:, None] + pile))

    return heights


def _timber(rings_m: float, depth_m: float, pores_m: float, cracks_m: float) -> Recipe:
    """Recipe: growth rings along x, bent by slow noise, with pores and cracks along the grain."""

    def heights(rng: np.random.Generator, texels: int, size_m: float) -> F64:
        y = (np.arange(texels) + 0.5) / texels
        bend = 0.9 * noise(rng, texels, size_m, size_m, 0.15 * size_m, stretch=3.0)
        rings = max(round(size_m / rings_m), 1)
        phase = rings * y[:, None] + bend
        late = (phase - np.floor(phase)) ** 3  # slow rise in early wood, sharp end of late wood
        grain = noise(rng, texels, size_m, 1.2e-3, 0.2e-3, stretch=20.0, fall=0.4)
        pore = noise(rng, texels, size_m, 0.8e-3, 0.25e-3, stretch=8.0, fall=0.3)
        crack = noise(rng, texels, size_m, 6e-3, 0.8e-3, stretch=25.0, fall=0.8)
        wood = depth_m * (late + 0.12 * grain)
        wood = wood - pores_m * np.clip(pore - 1.3, 0.0, 1.0)
        return np.asarray(wood - cracks_m * np.clip(crack - 1.5, 0.0, 1.0))

    return heights


def woven(weave: Weave, size_m: float, texels: int, seed: int = 0) -> HeightField:
    """Make a square of cloth (texels, texels) that tiles. Period and direction are changed to the
    nearest values with a whole number of repeats both ways. Raises InputError for a square smaller
    than a repeat of the weave."""
    draft = np.array([[int(c) for c in row] for row in DRAFTS[weave.draft]], np.float64)
    wefts, warps = draft.shape
    repeat = int(np.lcm(wefts, warps))
    threads = size_m / weave.period_m
    a = repeat * round(threads * np.cos(weave.direction_rad) / repeat)
    b = repeat * round(threads * np.sin(weave.direction_rad) / repeat)
    if a == 0 and b == 0:
        raise InputError(
            f"Weave '{weave.draft}': {1e3 * size_m:g} mm are less than one repeat of {repeat} "
            f"threads, {1e3 * weave.period_m:g} mm each."
        )
    # Whole numbers of threads along both sides make the square tile.
    x = (np.arange(texels) + 0.5) / texels
    warp = a * x[None, :] + b * x[:, None]  # counts warp threads, along the weft
    weft = -b * x[None, :] + a * x[:, None]
    # The thread on top at each crossing rises, the thread below dives.
    above = _thread(draft, warp, weft)
    below = _thread(1.0 - draft.T, weft, warp)
    dive = weave.float_share
    top = _bulge(warp) * (1.0 - dive + dive * above)
    bottom = _bulge(weft) * (1.0 - dive + dive * below)
    heights = np.maximum(top, bottom)
    heights = weave.depth_m * (heights - heights.min()) / np.ptp(heights)
    texel = size_m / texels
    if weave.fibre_m > 0.0:
        fibres = np.random.default_rng(seed).standard_normal(heights.shape)
        heights = heights + weave.fibre_m * fibres
    return HeightField(heights, (texel, texel))


def _bulge(count: F64) -> F64:
    """Height of a round thread over its width, 0.3 to 1; ``count`` counts threads across."""
    across = 2.0 * (count - np.floor(count)) - 1.0
    return np.sqrt(np.maximum(1.0 - 0.9 * across**2, 0.0))


def _thread(draft: F64, own: F64, crossing: F64) -> F64:
    """Height of a thread along itself: 1 on top, 0 below, smooth between crossings. ``own`` and
    ``crossing`` count threads of its own kind and of the crossing kind."""
    crossed, threads = draft.shape
    thread = np.floor(own).astype(np.int64) % threads
    position = crossing - 0.5
    before = np.floor(position).astype(np.int64)
    share = position - before
    # Smoothstep: level at both crossings.
    smooth = share * share * (3.0 - 2.0 * share)
    first = draft[before % crossed, thread]
    second = draft[(before + 1) % crossed, thread]
    return np.asarray(first + smooth * (second - first))


def reference_fabrics() -> dict[str, Weave]:
    """Three cloths by name, from smooth to rough, for calibration (textiles on the phone, section
    5)."""
    weaves = (
        Weave("plain", 0.25e-3, 25e-6, fibre_m=1e-6),
        Weave("denim", 0.5e-3, 120e-6, np.pi / 4.0, fibre_m=3e-6),
        Weave("basket", 1.0e-3, 350e-6, fibre_m=8e-6),
    )
    return dict(zip(FABRICS, weaves, strict=True))


def _named(
    name: str, size_m: float, roughness: float, heights: Recipe, period_m: float
) -> ProceduralMaterial:
    return ProceduralMaterial(name, *MATERIAL_TITLES[name], size_m, roughness, heights, period_m)


MATERIALS: Final[dict[str, ProceduralMaterial]] = {
    recipe.name: recipe
    for recipe in (
        _named("gravel-fine", 0.06, 0.85, _gravel(3e-3, 0.8e-3, 0.6, 40e-6), 3e-3),
        _named("gravel-coarse", 0.1, 0.95, _gravel(8e-3, 2.5e-3, 0.6, 90e-6), 8e-3),
        _named("gravel-pebbles", 0.1, 0.8, _gravel(6e-3, 2e-3, 0.9, 10e-6), 6e-3),
        _named("gravel-sharp", 0.08, 0.95, _gravel(5e-3, 2e-3, 0.4, 110e-6), 5e-3),
        _named("metal-brushed", 0.04, 0.15, _grain(3e-6, 0.6e-3, 0.12e-3, 60.0, 0.0), 0.3e-3),
        _named("metal-satin", 0.04, 0.1, _grain(1.5e-6, 0.6e-3, 0.12e-3, 15.0, 0.0), 0.3e-3),
        _named("metal-cast", 0.04, 0.3, _grain(8e-6, 2e-3, 0.2e-3, 1.0, 0.6), 1e-3),
        _named("metal-hammered", 0.06, 0.1, _hammered(7e-3, 0.12e-3), 7e-3),
        _named("fabric-shirting", 0.02, 0.45, _cloth(Weave("plain", 0.3e-3, 40e-6)), 0.3e-3),
        _named(
            "fabric-denim", 0.03, 0.55, _cloth(Weave("denim", 0.5e-3, 120e-6, np.pi / 4.0)), 0.5e-3
        ),
        _named(
            "fabric-twill", 0.03, 0.5, _cloth(Weave("twill", 0.6e-3, 160e-6, np.pi / 6.0)), 0.6e-3
        ),
        _named("fabric-basket", 0.04, 0.6, _cloth(Weave("basket", 1.0e-3, 350e-6)), 1e-3),
        _named("fabric-satin", 0.02, 0.35, _cloth(Weave("satin", 0.25e-3, 30e-6)), 0.25e-3),
        _named("fabric-corduroy", 0.04, 0.6, _corduroy(1.6e-3, 0.4e-3), 1.6e-3),
        _named("wood-oak", 0.08, 0.65, _timber(4e-3, 60e-6, 90e-6, 0.0), 4e-3),
        _named("wood-pine", 0.08, 0.55, _timber(5e-3, 120e-6, 10e-6, 0.0), 5e-3),
        _named("wood-weathered", 0.1, 0.8, _timber(5e-3, 260e-6, 60e-6, 0.5e-3), 5e-3),
        _named("wood-veneer", 0.06, 0.5, _timber(2.5e-3, 25e-6, 30e-6, 0.0), 2.5e-3),
    )
}
