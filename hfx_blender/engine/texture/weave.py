# SPDX-License-Identifier: GPL-3.0-or-later
"""Woven cloth as heights: any weave, period and direction, without a seam where it tiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import F64
from .height_field import HeightField
from .surface_names import FABRICS

# Where the warp lies over the weft: one row a weft thread, one column a warp thread.
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
    """A woven cloth.

    Parameters
    ----------
    draft : str
        A key of ``DRAFTS``.
    period_m : float
        From one thread to the next.
    depth_m : float
        From the deepest gap to the highest thread.
    direction_rad : float
        Of the weft.
    float_share : float
        How much of the depth a thread loses where it dives; 1 is all.
    fibre_m : float
        RMS of the fibres' own unevenness.
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

    A whole number of repeats must fit both ways, so the period and the direction become the
    nearest ones that do.

    Raises
    ------
    InputError
        Not one repeat of the weave fits into the square.
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
    x = (np.arange(texels) + 0.5) / texels
    warp = a * x[None, :] + b * x[:, None]  # counts warp threads, along the weft
    weft = -b * x[None, :] + a * x[:, None]
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
    """Height of a thread's round back over its width, 0..1."""
    across = 2.0 * (count - np.floor(count)) - 1.0
    return np.sqrt(np.maximum(1.0 - 0.9 * across**2, 0.0))


def _thread(draft: F64, mine: F64, other: F64) -> F64:
    """Height of a thread, 0..1, smooth from one crossing to the next."""
    crossed, threads = draft.shape
    thread = np.floor(mine).astype(np.int64) % threads
    place = other - 0.5
    before = np.floor(place).astype(np.int64)
    share = place - before
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
