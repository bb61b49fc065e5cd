# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx bench relief``: estimated relief against the true one, on families that were not learnt.

Compared are intensities, slopes with 1 as full strength, texel by texel; beside them stand the
simple ways: Sobel of the brightness and local contrast, each with the one factor for all pictures
that gives it the true mean level.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.engine.arrays import F32, F64
from hfx_blender.engine.texture.haptic_map import DeviceRange, NoticeableSteps
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.mcha import MapSettings, blurred_slope, make_map
from hfx_blender.engine.texture.relief.linear_light import height_from_colour
from hfx_blender.engine.texture.relief.relief_estimate import estimate
from hfx_blender.files.staging import temporary_folder
from hfx_blender.processes import blender_session

from ...relief import pictures
from ...relief.families import Relief
from . import relief_families

TEXELS: Final = 256
_EACH: Final = 4  # pictures of a family
_PRINTS: Final = 16
_RENDERED_EACH: Final = 1
_RENDERED_PRINTS: Final = 8
_FAMILIES: Final = tuple(relief_families.FAMILIES)

Weights = dict[str, F32]
Photograph = Callable[[np.random.Generator, F64, float], tuple[F64, F64]]
"""Random numbers, heights and RMS slope to a picture (N, N, 3), sRGB, and heights in texels."""


@dataclass(frozen=True, eq=False)
class Case:
    """A picture (N, N, 3) with its true intensity (N, N); of a print, ``family`` is empty."""

    family: str
    srgb: F64
    truth: F32
    tiles: bool


def cases(each: int, prints: int, names: Sequence[str] = _FAMILIES) -> Iterator[Case]:
    """Pictures of held-out families, then flat prints of them."""
    return _cases(_photograph, True, each, prints, names)


def rendered_cases(folder: Path) -> Iterator[Case]:
    """Pictures of held-out families and prints, rendered by Cycles."""
    blender_session.start()
    from . import relief_cycles

    def photograph(rng: np.random.Generator, heights: F64, slope: float) -> tuple[F64, F64]:
        return relief_cycles.photograph(rng, Relief(heights), slope, folder)

    return _cases(photograph, False, _RENDERED_EACH, _RENDERED_PRINTS, _FAMILIES)


def _cases(
    photograph: Photograph, tiles: bool, each: int, prints: int, names: Sequence[str]
) -> Iterator[Case]:
    for name in names:
        for k in range(each):
            rng = np.random.default_rng([2, k, *name.encode()])
            heights = np.rot90(relief_families.FAMILIES[name](rng, TEXELS), rng.integers(4))
            slope = float(np.exp(rng.uniform(np.log(0.05), np.log(1.2))))
            srgb, heights = photograph(rng, heights.copy(), slope)
            yield Case(name, srgb, np.minimum(_slopes(heights, tiles), np.float32(1.0)), tiles)
    for k in range(prints):
        rng = np.random.default_rng([3, k])
        pattern = relief_families.FAMILIES[names[k % len(names)]](rng, TEXELS)
        srgb, heights = photograph(rng, pattern, 0.0)
        yield Case("", srgb, np.zeros(heights.shape, np.float32), tiles)


def _photograph(rng: np.random.Generator, heights: F64, slope: float) -> tuple[F64, F64]:
    made = pictures.photograph(rng, Relief(heights), slope)
    return made.picture.astype(np.float64) / 255.0, made.heights.astype(np.float64)


def measure(
    *, short: bool = False, progress: Callable[[float], None], weights: Weights | None = None
) -> dict[str, Any]:
    """Figures of pictures of ours and, if not ``short``, of those by Cycles; plain data."""
    each, prints = (2, 8) if short else (_EACH, _PRINTS)
    count = each * len(_FAMILIES) + prints
    rendered = 0 if short else _RENDERED_EACH * len(_FAMILIES) + _RENDERED_PRINTS
    done = 0

    def counted(drawn: Iterator[Case]) -> Iterator[Case]:
        nonlocal done
        for case in drawn:
            yield case
            done += 1
            progress(done / (count + rendered))

    result = {"texels": TEXELS, "ours": figures(counted(cases(each, prints)), weights)}
    if rendered:
        with temporary_folder() as folder:
            result["cycles"] = figures(counted(rendered_cases(Path(folder))), weights)
    return result


def figures(drawn: Iterator[Case], weights: Weights | None = None) -> dict[str, Any]:
    """Figures of the network and of the simple ways."""
    names, rows, truth_rows = [], [], []
    for case in drawn:
        names.append(case.family)
        truth_rows.append(case.truth)
        rows.append([intensity_of(case, weights), *simple(case)])
    families, truths = np.array(names), np.stack(truth_rows)
    estimates = np.stack([np.stack(row) for row in rows], 1)  # (3, K, N, N)
    has_relief = families != ""
    for way in (1, 2):
        estimates[way] *= truths[has_relief].mean() / estimates[way, has_relief].mean()
    estimates = np.minimum(estimates, 1.0)
    true_levels = truths[has_relief].mean((1, 2))
    low, high = DeviceRange().amplitude_g
    step = NoticeableSteps().amplitude_g / (high - low)
    result: dict[str, Any] = {
        "pictures": int(has_relief.sum()),
        "prints": int((~has_relief).sum()),
    }
    r = np.array(
        [
            [correlation(e, t) for e, t in zip(way[has_relief], truths[has_relief], strict=True)]
            for way in estimates
        ]
    )
    for way, name in enumerate(("relief", "sobel", "contrast")):
        found = estimates[way]
        near = np.abs(found - truths) <= step
        result[name] = {
            "median_r": float(np.median(r[way])),
            "tenth_percentile_r": float(np.quantile(r[way], 0.1)),
            "spearman_of_levels": spearman(found[has_relief].mean((1, 2)), true_levels),
            "within_one_step": float(near.mean()),
            "level_of_prints": float(found[~has_relief].mean()),
        }
    levels = [result[name]["level_of_prints"] for name in ("relief", "sobel")]
    result["prints_against_sobel"] = levels[0] / levels[1]
    result["better_than_both"] = float(np.mean(r[0] > np.maximum(r[1], r[2])))
    result["median_r_of_families"] = {
        name: float(np.median(r[0, families[has_relief] == name])) for name in _FAMILIES
    }
    return result


def intensity_of(case: Case, weights: Weights | None = None) -> F32:
    """Estimated intensity of a picture, the blur of the map's settings being one texel."""
    settings = MapSettings()
    size = TEXELS * settings.blur_m
    found = estimate(case.srgb, (size, size), tiles=case.tiles, weights=weights)
    return make_map(found.field, found.roughness, settings, found.slope).intensity


def simple(case: Case) -> tuple[F32, F32]:
    """Simple estimates of intensity, with a factor that is unknown: Sobel and local contrast."""
    grey = height_from_colour(case.srgb)
    return _slopes(grey, case.tiles), _contrast(grey)


def _slopes(heights: F64, tiles: bool) -> F32:
    return blurred_slope(HeightField(heights, (1.0, 1.0), tiles), pictures.SLOPE_BLUR)


def _contrast(grey: F64) -> F32:
    """Standard deviation of the brightness around each texel."""
    from scipy.ndimage import gaussian_filter

    mean = gaussian_filter(grey, 3.0, mode="wrap")
    square = gaussian_filter(grey * grey, 3.0, mode="wrap")
    return np.sqrt(np.maximum(square - mean * mean, 0.0)).astype(np.float32)


def correlation(a: F32, b: F32) -> float:
    """Pearson's r of two arrays, 0 where one is even."""
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale > 0.0 else 0.0


def spearman(a: F32, b: F32) -> float:
    """Spearman's rank correlation."""
    ranks = [np.argsort(np.argsort(each)).astype(np.float32) for each in (a, b)]
    return correlation(*ranks)


_ROWS: Final = (
    ("median_r", "r, median"),
    ("tenth_percentile_r", "r, tenth percentile"),
    ("spearman_of_levels", "levels, Spearman"),
    ("within_one_step", "texels within one step"),
    ("level_of_prints", "level of flat prints"),
)


def as_text(result: dict[str, Any]) -> str:
    """The figures as tables."""
    lines = [f"families that were not learnt, {result['texels']} x {result['texels']} texels"]
    for key, title in (("ours", "light of ours"), ("cycles", "rendered by Cycles")):
        if key not in result:
            continue
        found = result[key]
        lines.append(f"\n{title}: {found['pictures']} pictures, {found['prints']} flat prints")
        lines.append(f"{'':<24}{'relief':>9}{'Sobel':>9}{'contrast':>10}")
        for field, label in _ROWS:
            values = [found[name][field] for name in ("relief", "sobel", "contrast")]
            lines.append(f"{label:<24}{values[0]:>9.3f}{values[1]:>9.3f}{values[2]:>10.3f}")
        lines.append(f"better than both: {found['better_than_both']:.0%}")
        lines.append(f"flat prints against Sobel's: {found['prints_against_sobel']:.2f}")
        pairs = found["median_r_of_families"].items()
        lines.append("median r: " + ", ".join(f"{name} {r:.2f}" for name, r in pairs))
    return "\n".join(lines)
