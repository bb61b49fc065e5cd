# SPDX-License-Identifier: GPL-3.0-or-later
"""Woven cloth as heights: any weave, period and direction; tiles without a seam."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64
from .height_field import HeightField
from .surface_names import FABRICS

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
    """Woven cloth.

    Parameters
    ----------
    draft : str
        Key of ``DRAFTS``.
    period_m : float
        Distance of adjacent threads.
    depth_m : float
        Height of the highest thread over the deepest gap.
    direction_rad : float
        Direction of the weft.
    float_share : float
        Share of the depth that a thread loses where it dives.
    fibre_m : float
        RMS roughness of the fibres.

    Raises
    ------
    InputError
        The draft is unknown, or period or depth is not positive.
    """

    draft: str
    period_m: float
    depth_m: float
    direction_rad: float = 0.0
    float_share: float = 0.6
    fibre_m: float = 0.0

    def __post_init__(self) -> None:
        if self.draft not in DRAFTS:
            raise InputError(f"Weave '{self.draft}': expected one of {', '.join(DRAFTS)}.")
        for name in ("period_m", "depth_m"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"Weave: {name} is {value:g}; expected more than 0.")


def woven(weave: Weave, size_m: float, texels: int, seed: int = 0) -> HeightField:
    """Make a square of cloth that tiles.

    Period and direction are changed to the nearest values with a whole number of repeats both ways.

    Raises
    ------
    InputError
        The square is smaller than a repeat of the weave.
    """
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
        noise = np.random.default_rng(seed).standard_normal(heights.shape)
        heights = heights + weave.fibre_m * noise
    return HeightField(heights, (texel, texel))


def _bulge(count: F64) -> F64:
    """Height of a round thread over its width, 0..1."""
    across = 2.0 * (count - np.floor(count)) - 1.0
    return np.sqrt(np.maximum(1.0 - 0.9 * across**2, 0.0))


def _thread(draft: F64, own: F64, crossing: F64) -> F64:
    """Height of a thread, 0..1, smooth between crossings."""
    crossed, threads = draft.shape
    thread = np.floor(own).astype(np.int64) % threads
    position = crossing - 0.5
    before = np.floor(position).astype(np.int64)
    share = position - before
    smooth = share * share * (3.0 - 2.0 * share)
    first = draft[before % crossed, thread]
    second = draft[(before + 1) % crossed, thread]
    height: F64 = first + smooth * (second - first)
    return height


def reference_fabrics() -> dict[str, Weave]:
    """Three cloths from smooth to rough, for calibration (textiles on the phone, section 5)."""
    weaves = (
        Weave("plain", 0.25e-3, 25e-6, fibre_m=1e-6),
        Weave("denim", 0.5e-3, 120e-6, np.pi / 4.0, fibre_m=3e-6),
        Weave("basket", 1.0e-3, 350e-6, fibre_m=8e-6),
    )
    return dict(zip(FABRICS, weaves, strict=True))
