# SPDX-License-Identifier: GPL-3.0-or-later
"""Correlation of the textile renderer's output with measured roughness, by families of cloths.

The figure of the textile paper's section 6, over sets of 36 synthetic cloths instead of scans.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.texture import stroke
from hfx_blender.engine.texture.textile import drive_levels
from hfx_tools.roughness import roughness_of_surface

from .cloths import RECIPES, TEXELS, Cloth

SPEEDS_M_S: Final = (stroke.SLOW_M_S, stroke.FAST_M_S)
PARAMETERS: Final = ("Ra", "Rz", "Rmax")
PAPER_R: Final = (0.92, 0.93, 0.95)
"""Correlations in the textile paper, by parameter."""

CUTOFFS_MM: Final = (2.5, 8.0)
"""ISO 4288: 2.5 mm for widths of profile elements up to 1.3 mm, 8 mm from there to 4 mm."""


def correlation(
    rounds: int, texels: int = TEXELS, progress: Callable[[float], None] = lambda _: None
) -> dict[str, Any]:
    """Measure correlation r for ``rounds`` sets of each recipe; plain data.

    The first set of the first recipe is also listed, surface by surface.
    """
    sets: dict[str, list[F64]] = {name: [] for name in RECIPES}
    listed: list[Cloth] = []
    rows = np.zeros((0, 0))
    for seed in range(rounds):
        for name, cloths in RECIPES.items():
            cloths_ = cloths(seed, texels)
            measured = np.array([_measure_cloth(cloth) for cloth in cloths_])
            if not listed:
                listed, rows = cloths_, measured
            sets[name].append(_correlations(measured))
        progress((seed + 1) / rounds)
    return {
        "cutoffs_mm": list(CUTOFFS_MM),
        "speeds_m_s": list(SPEEDS_M_S),
        "rounds": rounds,
        "surfaces": [_as_row(c, row) for c, row in zip(listed, rows.tolist(), strict=True)],
        # By recipe: set, cut-off, speed, parameter.
        "sets": {name: np.array(correlations).tolist() for name, correlations in sets.items()},
        "median_r": {
            name: np.median(correlations, axis=0).tolist() for name, correlations in sets.items()
        },
        "lowest_r": {
            name: np.min(correlations, axis=0).tolist() for name, correlations in sets.items()
        },
    }


def _measure_cloth(cloth: Cloth) -> list[float]:
    """Ra, Rz and Rmax at each cut-off, then the mean drive at each speed; micrometres."""
    values_m = []
    for cutoff in CUTOFFS_MM:
        rough = roughness_of_surface(cloth.field, 1e-3 * cutoff, profiles=6)
        values_m += [rough.ra_m, rough.rz_m, rough.rmax_m]
    starts = [(1e-3 * k, 2.3e-3 * k) for k in range(4)]
    for speed in SPEEDS_M_S:
        ways = [stroke.line(start, 0.0, speed, speed) for start in starts]
        values_m.append(
            float(np.mean([drive_levels(cloth.field, stroke_, 1.0) for stroke_ in ways]))
        )
    return [1e6 * value for value in values_m]


def _correlations(rows: F64) -> F64:
    """Correlation r of a set's rows of :func:`_measure_cloth`, (cut-off, speed, parameter)."""
    r = np.corrcoef(rows.T)[: -len(SPEEDS_M_S), -len(SPEEDS_M_S) :]
    return r.reshape(len(CUTOFFS_MM), len(PARAMETERS), len(SPEEDS_M_S)).transpose(0, 2, 1)


def _as_row(cloth: Cloth, values: list[float]) -> dict[str, Any]:
    """Row of a listed surface, with its roughness at the first cut-off."""
    return {
        "kind": cloth.kind,
        "period_mm": 1e3 * cloth.period_m,
        "depth_um": 1e6 * cloth.depth_m,
        **dict(zip(PARAMETERS, values, strict=False)),
        "drive": values[-len(SPEEDS_M_S) :],  # with c_v of 1
    }


def _cells(result: dict[str, Any], recipe: str, cutoff: int, speed: int) -> list[str]:
    middle, low = (result[key][recipe][cutoff][speed] for key in ("median_r", "lowest_r"))
    return [f"{a:.3f} ({b:.3f})" for a, b in zip(middle, low, strict=True)]


def as_lines(result: dict[str, Any]) -> list[str]:
    """Format a result of :func:`correlation` for a terminal, in lines."""
    lines = [
        "Textile renderer against measured roughness: correlation r over 36 cloths, median "
        f"(lowest) of {result['rounds']} sets of each family:"
    ]
    for cutoff, mm in enumerate(result["cutoffs_mm"]):
        lines.append(f"  cut-off {mm:3g} mm".ljust(28) + "".join(f"{n:>16}" for n in PARAMETERS))
        for recipe in result["sets"]:
            for speed, m_s in enumerate(result["speeds_m_s"]):
                cells = "".join(f"{cell:>16}" for cell in _cells(result, recipe, cutoff, speed))
                lines.append(f"  {recipe:14}{100 * m_s:3g} cm/s    {cells}")
    return lines


def as_markdown(result: dict[str, Any]) -> str:
    """Format a result of :func:`correlation` as the table of ``docs/surfaces.md``."""
    heads = [f"{name}, {mm:g} mm" for mm in result["cutoffs_mm"] for name in PARAMETERS]
    paper = " | ".join(f"{r:g}" for r in (*PAPER_R, *PAPER_R))
    lines = [
        f"| {result['rounds']} sets of 36: median (worst) | {' | '.join(heads)} |",
        "|---|" + "---|" * len(heads),
        f"| the textile paper | {paper} |",
    ]
    for recipe in result["sets"]:
        for speed, m_s in enumerate(result["speeds_m_s"]):
            cells = [
                cell
                for cutoff in range(len(result["cutoffs_mm"]))
                for cell in _cells(result, recipe, cutoff, speed)
            ]
            lines.append(f"| {recipe}, {100 * m_s:g} cm/s | {' | '.join(cells)} |")
    return "\n".join(lines)
