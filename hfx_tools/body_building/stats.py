# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body stats``: evenness of a model's vertices against their target spacing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.body.parts import PARTS

from . import joint_gradient
from .left_skin import Half
from .meshes.mesh_edges import edges_of
from .thresholds import NOTE_ON_TABLE_1, TABLE_1_MM, TABLE_1_SD_MM

TIMES_FILE: Final = "build-times.json"
"""File of a build's processor times, apart from the reproducible models."""


@dataclass(frozen=True)
class Row:
    """Statistics of a part of a model, mm; mean and SD are None without an edge in the part."""

    modality: str
    part: str
    vertices: int
    target_mm: float
    mean_mm: float | None
    sd_mm: float | None
    gap_mm: float
    table_1_mm: float
    table_1_sd_mm: float


def spacing_m(model: PerceptualModel) -> tuple[F64, F64]:
    """Mean and standard deviation of the distance between neighbours, by part.

    Neighbours are the ends of an edge with both ends in the part. In a model with a joint gradient
    each distance is divided by the relative spacing at the middle of its edge, so that mean and
    standard deviation compare with the part's target.

    Returns
    -------
    mean, sd : (parts,) float64
        Metres, NaN for a part without such an edge.
    """
    ends = edges_of(model.triangles.astype(np.int64), len(model)).ends
    vertices = model.vertices.astype(np.float64)
    lengths = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    middles = 0.5 * (vertices[ends[:, 0]] + vertices[ends[:, 1]])
    gradient = joint_gradient.of(model.provenance)
    lengths /= gradient.relative(middles, model.part[ends[:, 0]])
    mean, sd = np.full(len(PARTS), np.nan), np.full(len(PARTS), np.nan)
    for number in range(len(PARTS)):
        own = lengths[(model.part[ends] == number).all(axis=1)]
        if len(own):
            mean[number], sd[number] = own.mean(), own.std()
    return mean, sd


def statistics(model: PerceptualModel, gaps_m: F64, errors_m: F64) -> dict[str, Any]:
    """Compute statistics of a model for manifest and provenance, by part.

    Parameters
    ----------
    gaps_m : (parts,) float64
        Largest distance from a point of the part's skin to the nearest vertex, divided by the
        relative spacing at the point.
    errors_m : (parts,) float64
        Mean distance of the part's skin from the mesh.
    """
    mean, sd = spacing_m(model)
    gradient = joint_gradient.of(model.provenance)
    result: dict[str, Any] = {}
    for number, part in enumerate(PARTS):
        result[part] = {
            "vertices": int((model.part == number).sum()),
            "area_cm2": round(1e4 * float(model.areas_m2[model.part == number].sum()), 1),
            "target_mm": model.provenance["targets_mm"][part],
            "mean_mm": _to_mm(mean[number]),
            "sd_mm": _to_mm(sd[number]),
            "gap_mm": _to_mm(gaps_m[number]),
            "error_mm": _to_mm(errors_m[number]),
        }
        if part in gradient.joints_m:
            target_mm = result[part]["target_mm"]
            result[part]["target_at_joints_mm"] = round(gradient.factor * target_mm, 3)
    return result


def decimated(half: Half, gaps_m: F64, errors_m: F64) -> dict[str, Any]:
    """Compute statistics of the paper's decimation for the manifest, by part of the left half."""
    ends = edges_of(half.triangles, len(half.points)).ends
    lengths = np.linalg.norm(half.points[ends[:, 0]] - half.points[ends[:, 1]], axis=1)
    result: dict[str, Any] = {}
    for number, part in enumerate(PARTS):
        own = lengths[half.part[ends[:, 0]] == number]  # parts share no edge
        if len(own):
            result[part] = {
                "vertices": int((half.part == number).sum()),
                "mean_mm": _to_mm(own.mean()),
                "sd_mm": _to_mm(own.std()),
                "gap_mm": _to_mm(gaps_m[number]),
                "error_mm": _to_mm(errors_m[number]),
            }
    return result


def _to_mm(metres: float) -> float | None:
    return None if np.isnan(metres) else round(1000.0 * float(metres), 3)


def table(models: Iterable[PerceptualModel]) -> list[Row]:
    """Rows of Table 1 of Danieau et al. 2018 for models, with newly measured spacings."""
    rows: list[Row] = []
    for model in models:
        mean, sd = spacing_m(model)
        stored = model.provenance["statistics"]
        for number, part in enumerate(PARTS):
            rows.append(
                Row(
                    modality=model.modality,
                    part=part,
                    vertices=int((model.part == number).sum()),
                    target_mm=stored[part]["target_mm"],
                    mean_mm=_to_mm(mean[number]),
                    sd_mm=_to_mm(sd[number]),
                    gap_mm=stored[part]["gap_mm"],
                    table_1_mm=TABLE_1_MM[model.modality][number],
                    table_1_sd_mm=TABLE_1_SD_MM[model.modality][number],
                )
            )
    return rows


def as_text(rows: Iterable[Row]) -> str:
    """Format the table for a terminal."""
    lines: list[str] = []
    modality = ""
    for row in rows:
        if row.modality != modality:
            modality = row.modality
            lines += [
                "",
                f"{modality:<14}{'vertices':>9}{'target':>9}{'mean':>9}{'off':>8}{'SD':>8}"
                f"{'SD/mean':>9}{'gap':>8}{'Table 1 (SD)':>18}",
            ]
        mean = off = sd = spread = "-"
        if row.mean_mm is not None and row.sd_mm is not None:
            mean, sd = f"{row.mean_mm:.2f}", f"{row.sd_mm:.2f}"
            off = f"{100.0 * (row.mean_mm / row.target_mm - 1.0):+.1f}%"
            spread = f"{row.sd_mm / row.mean_mm:.3f}"
        lines.append(
            f"{row.part:<14}{row.vertices:>9}{row.target_mm:>9.1f}{mean:>9}{off:>8}{sd:>8}"
            f"{spread:>9}{row.gap_mm:>8.2f}"
            f"{f'{row.table_1_mm:.2f} ({row.table_1_sd_mm:.2f})':>18}"
        )
    return "\n".join([*lines[1:], "", NOTE_ON_TABLE_1]) + "\n"


def as_markdown(manifest: Mapping[str, Any]) -> str:
    """Format the shipped models and the printed Table 1 as tables of ``docs/body-models.md``."""
    lines = []
    for model in manifest["models"].values():
        modality = model["modality"]
        lines += [
            f"**{modality.capitalize()}**, {model['vertices']:,} vertices",
            "",
            "| part | vertices | target mm | mean mm | SD / mean | gap mm | error mm "
            "| Table 1 mm (SD) |",
            "|---|---|---|---|---|---|---|---|",
        ]
        printed = zip(TABLE_1_MM[modality], TABLE_1_SD_MM[modality], strict=True)
        for (part, row), (mean, sd) in zip(model["statistics"].items(), printed, strict=True):
            spacing = "- | -"
            if row["mean_mm"]:
                spacing = f"{row['mean_mm']:.2f} | {row['sd_mm'] / row['mean_mm']:.3f}"
            title = part.replace("_", " ")
            lines.append(
                f"| {title} | {row['vertices']} | {row['target_mm']:g} | {spacing} "
                f"| {row['gap_mm']:.2f} | {row['error_mm']:.2f} | {mean:g} ({sd:g}) |"
            )
        lines.append("")
    return "\n".join([*lines, NOTE_ON_TABLE_1])


def comparison_as_text(manifest: Mapping[str, Any], times: Mapping[str, Any]) -> str:
    """Format a comparison of the shipped models' even cells with the paper's quadric decimation.

    Both are measured during the build, on the left half of the body (Danieau et al. 2018, section
    3.1). The last lines of a model have its number of vertices, SD / mean of the spacing (mean of
    the parts), the worst gap as a share of its target, the error by area, and processor time.

    ``times``: modality to ``cells_s`` and ``quadric_s``; may be empty.
    """
    lines = [
        "Left half of the body, millimetres. cells: even cells (shipped). quadric: decimation of",
        "each part by itself, the paper's own way ('hfx body build --method quadric').",
    ]
    for model in manifest["models"].values():
        modality, rows = model["modality"], model["statistics"]
        lines += [
            "",
            f"{modality:<14}{'target':>8} |{'cells':>8}{'mean':>8}{'SD/mean':>8}"
            f"{'gap':>8}{'error':>7} |{'quadric':>8}{'mean':>8}{'SD/mean':>8}"
            f"{'gap':>8}{'error':>7}",
        ]
        for part, cells in rows.items():
            quadric = model["quadric"][part]
            lines.append(
                f"{part:<14}{cells['target_mm']:>8.1f} |{_columns(cells, 2)} |"
                f"{_columns(quadric, 1)}"
            )
        taken = times.get(modality, {})
        both = ((rows, 2, "cells_s"), (model["quadric"], 1, "quadric_s"))
        summaries = (_summary(facts, rows, sides) for facts, sides, _ in both)
        lines.append(f"{'all':<14}{'':>8} |{' |'.join(summaries)}")
        if taken:
            spent = " |".join(f"{f'{taken[key]:.0f} s':>39}" for _, _, key in both)
            lines.append(f"{'processor time':<22} |{spent}")
    return "\n".join(lines) + "\n"


def _summary(rows: Mapping[str, Any], cells: Mapping[str, Any], sides: int) -> str:
    """Columns of a whole model: vertices, SD / mean, gap and error."""
    count = sum(row["vertices"] for row in rows.values()) // sides
    spread = np.mean([row["sd_mm"] / row["mean_mm"] for row in rows.values() if row["mean_mm"]])
    gap = max(row["gap_mm"] / cells[part]["target_mm"] for part, row in rows.items())
    areas = [cells[part]["area_cm2"] for part in rows]
    error = np.average([row["error_mm"] for row in rows.values()], weights=areas)
    return f"{count:>8}{'':>8}{spread:>8.3f}{f'x {gap:.2f}':>8}{error:>7.2f}"


def _columns(facts: Mapping[str, Any], sides: int) -> str:
    mean, sd = facts["mean_mm"], facts["sd_mm"]
    text = "".join(f"{value:>8}" for value in ("-", "-"))
    if mean:
        text = f"{mean:>8.2f}{sd / mean:>8.3f}"
    return f"{facts['vertices'] // sides:>8}{text}{facts['gap_mm']:>8.2f}{facts['error_mm']:>7.2f}"
