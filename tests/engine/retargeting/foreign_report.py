# SPDX-License-Identifier: GPL-3.0-or-later
"""Fit of models to the avatars of :mod:`foreign_avatars`, as tables."""

from __future__ import annotations

from dataclasses import dataclass

import foreign_avatars
import numpy as np
import retarget_variants as variants
from foreign_avatars import Foreign
from retarget_report import landmarks, table, warnings_of

from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.rigs.mapping import BoneMapping, map_bones
from hfx_blender.engine.retargeting import retarget
from hfx_blender.engine.retargeting.bone_regions import REGIONS
from hfx_blender.engine.retargeting.joints import Skeletons, dominant
from hfx_blender.engine.retargeting.quality import FitQuality
from hfx_blender.engine.retargeting.target import check
from hfx_blender.errors import InputError

MODEL_ID = "hfx-pressure-1"


@dataclass(frozen=True)
class ForeignFit:
    """Fit of a third-party avatar; with the truth where known (millimetres, at avatar size)."""

    avatar: Foreign
    mapping: BoneMapping
    quality: FitQuality
    refused: str  # reason of a refusal, or empty
    parts: dict[str, float]  # median error of each part
    p95: dict[str, float]
    landmarks: dict[str, float]
    agreement: float  # share of vertices with the same part as the nearest true vertex
    plausible: dict[str, float]  # mm on a body of 1.8 m: see _plausible


def follow(avatar: Foreign) -> ForeignFit:
    """Fit the pressure model by bone names alone."""
    target, model = avatar.target, load_model(MODEL_ID)
    mapping = map_bones(target.bones)  # type: ignore[arg-type]
    refused = ""
    try:
        check(target, "Avatar")
    except InputError as error:
        refused = str(error)
    warped = variants.warp(load_avatar(), target, mapping)
    fitted, quality = retarget.fit(model, warped)
    normalised = np.linalg.inv(warped.bodies.to_target)
    points = fitted.vertices @ normalised[:3, :3].T + normalised[:3, 3]
    parts: dict[str, float] = {}
    p95: dict[str, float] = {}
    marks: dict[str, float] = {}
    agreement = float("nan")
    if avatar.places is not None:
        from scipy.spatial import cKDTree

        truth, known = avatar.truth(model)
        error = np.linalg.norm(fitted.vertices - truth, axis=1) * 1000.0 * target.metres
        for number, part in enumerate(PARTS):
            mine = known & (model.part == number)
            parts[part] = float(np.median(error[mine]))
            p95[part] = float(np.percentile(error[mine], 95))
        for name, ids in landmarks(model).items():
            marks[name] = float(max([error[k] for k in ids if known[k]], default=np.nan))
        nearest = np.flatnonzero(known)[cKDTree(truth[known]).query(fitted.vertices)[1]]
        agreement = float(np.mean(model.part[nearest] == model.part))
    return ForeignFit(
        avatar, mapping, quality, refused, parts, p95, marks, agreement,
        _plausible(warped.bodies, points),
    )  # fmt: skip


def _plausible(bodies: Skeletons, points: np.ndarray) -> dict[str, float]:
    """Return landmark errors measurable on any body, in millimetres of a body 1.8 m tall.

    Heels above the lowest skin, the nose behind the foremost skin of the head, fingertips short of
    the outermost skin on the same side.
    """
    actual = landmarks(load_model(MODEL_ID))
    skin = bodies.points
    low = skin[:, 2].min()
    face = skin[dominant(bodies.target_shares) == REGIONS.index("head")]
    nose = points[actual["nose"][0]]
    tips = points[actual["fingertips"]]
    reach = [skin[:, 0].max() - tips[:5, 0].max(), tips[5:, 0].min() - skin[:, 0].min()]
    return {
        "heels": 1000.0 * float(max(points[k, 2] - low for k in actual["heels"])),
        "nose": 1000.0 * float(nose[1] - face[:, 1].min()),
        "fingertips": 1000.0 * float(max(reach)),
    }


def with_truth() -> dict[str, ForeignFit]:
    """Third-party avatars with derivable correspondence."""
    fits = {"SOMA": follow(foreign_avatars.soma())}
    rigs = ("mixamo", "game_engine", "cmu", "mixamo")
    for name, rig in zip(foreign_avatars.TOPOLOGIES, rigs, strict=True):
        fits[f"{name}, {rig}"] = follow(foreign_avatars.topology(name, rig))
    return fits


def without_truth() -> dict[str, ForeignFit]:
    """Return game characters, where folders are configured."""
    actual = {name: follow(make()) for name, make in foreign_avatars.assetcoop().items()}
    fixit = foreign_avatars.mrfixit()
    return actual if fixit is None else actual | {"mrfixit": follow(fixit)}


def lines() -> list[str]:
    """Return the tables as Markdown, without tables for missing data."""
    known, others = with_truth(), without_truth()
    text = ["### Avatars that nobody here made, median error of each part (mm)", ""]
    text += [*table(known, "parts"), ""]
    text += ["### Avatars that nobody here made, 95th percentile (mm)", "", *table(known, "p95")]
    text += ["", "### Avatars that nobody here made, landmarks (mm, the worst of each kind)", ""]
    text += [*table(known, "landmarks"), ""]
    text += ["| avatar | package | vertices | bones mapped | same part | warnings |"]
    text += ["|---|---|---|---|---|---|"]
    text += [
        f"| {name} | {row.avatar.package} | {len(row.avatar.target.vertices):,} | "
        f"{len(row.mapping.bones)} | {100 * row.agreement:.1f} % | "
        f"{'; '.join(warnings_of(row.quality)) or 'none'} |"
        for name, row in known.items()
    ]
    if others:
        text += ["", "### Game characters, without a truth (mm on a body of 1.8 m)", ""]
        text += [
            "| avatar | package | vertices | bones mapped | distance p95, median part "
            "| worst part | in place, worst part | sides | head's area | heels up | nose back "
            "| fingertips short | parts warned of | refused |",
            "|---" * 14 + "|",
        ]
        text += [_row(name, row) for name, row in others.items()]
    return text


def _row(name: str, row: ForeignFit) -> str:
    parts = row.quality.parts
    far = max(parts, key=lambda part: part.distance_p95_mm)
    out = min(parts, key=lambda part: part.in_place)
    warned = sum(bool(part.faults) for part in parts)
    cells = (
        name,
        row.avatar.package,
        f"{len(row.avatar.target.vertices):,}",
        str(len(row.mapping.bones)),
        f"{np.median([part.distance_p95_mm for part in parts]):.0f}",
        f"{far.part.replace('_', ' ')} {far.distance_p95_mm:.0f}",
        f"{out.part.replace('_', ' ')} {100 * out.in_place:.0f} %",
        f"{100 * row.quality.sides:.0f} %",
        f"{parts[0].area_ratio:.1f}",
        *(f"{row.plausible[key]:.0f}" for key in ("heels", "nose", "fingertips")),
        f"{warned} of {len(parts)}",
        "yes" if row.refused else "no",
    )
    return "| " + " | ".join(cells) + " |"
