# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx bench relief``: estimated against true relief, on families outside the training set.

Compared are intensities (slopes, 1 is full strength), texel by texel. Two simple estimates serve
as rivals: Sobel of the brightness and local contrast, each scaled by one factor for all pictures
to the true mean level.
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
from hfx_blender.processes import blender_session

from ...command_process.temporary_folder import temporary_folder
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
"""From random generator, heights and RMS slope: picture (N, N, 3), sRGB, and heights in texels."""


@dataclass(frozen=True, eq=False)
class Case:
    """Picture (N, N, 3), sRGB 0..1, with its true intensity (N, N); family "": a flat print."""

    family: str
    srgb: F64
    truth: F32
    tiles: bool


def cases(each: int, prints: int, names: Sequence[str] = _FAMILIES) -> Iterator[Case]:
    """Pictures of held-out families, ``each`` per family, then flat prints of the same patterns."""
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
    photo = pictures.photograph(rng, Relief(heights), slope)
    return photo.picture.astype(np.float64) / 255.0, photo.heights.astype(np.float64)


def measure(
    *, short: bool = False, progress: Callable[[float], None], weights: Weights | None = None
) -> dict[str, Any]:
    """Measure this package's pictures and, if not ``short``, pictures by Cycles; plain data."""
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
    """Figures of the network and of both simple estimates, over all cases."""
    names, rows, truth_rows = [], [], []
    for case in drawn:
        names.append(case.family)
        truth_rows.append(case.truth)
        rows.append([intensity_of(case, weights), *simple(case)])
    families, truths = np.array(names), np.stack(truth_rows)
    estimates = np.stack([np.stack(row) for row in rows], 1)  # (3, K, N, N)
    has_relief = families != ""
    for method in (1, 2):
        estimates[method] *= truths[has_relief].mean() / estimates[method, has_relief].mean()
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
            [correlation(e, t) for e, t in zip(method[has_relief], truths[has_relief], strict=True)]
            for method in estimates
        ]
    )
    for method, name in enumerate(("relief", "sobel", "contrast")):
        estimate_ = estimates[method]
        near = np.abs(estimate_ - truths) <= step
        result[name] = {
            "median_r": float(np.median(r[method])),
            "tenth_percentile_r": float(np.quantile(r[method], 0.1)),
            "spearman_of_levels": spearman(estimate_[has_relief].mean((1, 2)), true_levels),
            "within_one_step": float(near.mean()),
            "level_of_prints": float(estimate_[~has_relief].mean()),
        }
    levels = [result[name]["level_of_prints"] for name in ("relief", "sobel")]
    result["prints_against_sobel"] = levels[0] / levels[1]
    result["better_than_both"] = float(np.mean(r[0] > np.maximum(r[1], r[2])))
    result["median_r_of_families"] = {
        name: float(np.median(r[0, families[has_relief] == name])) for name in _FAMILIES
    }
    return result


def intensity_of(case: Case, weights: Weights | None = None) -> F32:
    """Intensity (N, N) estimated from a picture, with a blur of one texel.

    ``weights`` None: the shipped network.
    """
    settings = MapSettings()
    size = TEXELS * settings.blur_m
    relief = estimate(case.srgb, (size, size), tiles=case.tiles, weights=weights)
    return make_map(relief.field, relief.roughness, settings, relief.slope).intensity


def simple(case: Case) -> tuple[F32, F32]:
    """Simple estimates of intensity, up to an unknown factor: Sobel and local contrast."""
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
    """Pearson's r of two arrays; 0 if either is constant."""
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale > 0.0 else 0.0


def spearman(a: F32, b: F32) -> float:
    """Spearman's rank correlation."""
    ranks = [np.argsort(np.argsort(values)).astype(np.float32) for values in (a, b)]
    return correlation(*ranks)


_ROWS: Final = (
    ("median_r", "r, median"),
    ("tenth_percentile_r", "r, tenth percentile"),
    ("spearman_of_levels", "levels, Spearman"),
    ("within_one_step", "texels within one step"),
    ("level_of_prints", "level of flat prints"),
)


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` as tables for a terminal."""
    lines = [f"families that were not learnt, {result['texels']} x {result['texels']} texels"]
    for key, title in (("ours", "light of ours"), ("cycles", "rendered by Cycles")):
        if key not in result:
            continue
        figures_ = result[key]
        lines.append(
            f"\n{title}: {figures_['pictures']} pictures, {figures_['prints']} flat prints"
        )
        lines.append(f"{'':<24}{'relief':>9}{'Sobel':>9}{'contrast':>10}")
        for field, label in _ROWS:
            values = [figures_[name][field] for name in ("relief", "sobel", "contrast")]
            lines.append(f"{label:<24}{values[0]:>9.3f}{values[1]:>9.3f}{values[2]:>10.3f}")
        lines.append(f"better than both: {figures_['better_than_both']:.0%}")
        lines.append(f"flat prints against Sobel's: {figures_['prints_against_sobel']:.2f}")
        pairs = figures_["median_r_of_families"].items()
        lines.append("median r: " + ", ".join(f"{name} {r:.2f}" for name, r in pairs))
    return "\n".join(lines)
