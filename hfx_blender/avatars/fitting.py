# SPDX-License-Identifier: GPL-3.0-or-later
"""Fits body models to a user's own avatar, in steps; an avatar that was fitted before is read."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import bpy
import numpy as np

from ..engine.body.model import load_avatar, load_model
from ..engine.body.rigs.mapping import BoneMapping
from ..engine.retargeting import by_bones, props, retarget, skin_parts
from ..engine.retargeting import target as retarget_target
from ..engine.retargeting.layers import Layer
from ..engine.retargeting.quality import PartQuality, Quality, joint_faults
from ..engine.retargeting.target import TargetAvatar
from ..engine.stepwise import within
from ..errors import InputError
from . import avatar_meshes, kept_fits
from .retargeting import Fit, arrays_of, fitted_of, model_ids, worst_first

_ONLY_BONES = (
    "felt by its bones only, because {reason}: the haptic body has the standard shape, stretched "
    "to this rig's joints, and not the shape of the mesh, so touches are approximate, and hair, "
    "clothes or a large head beyond it are not felt; join the pieces to one closed skin, or select "
    "other meshes, for a fit to the surface"
)


def fitting(
    armature: bpy.types.Object, meshes: Sequence[bpy.types.Object], mapping: BoneMapping
) -> Generator[float, None, Fit]:
    """Fit all perceptual models to an avatar, in steps; nothing in the scene is changed.

    Parameters
    ----------
    meshes : sequence of Object
        The avatar's skin, in the order in which their vertices are numbered.

    Raises
    ------
    InputError
        The avatar cannot be fitted to.
    """
    targets = yield from within(avatar_meshes.reading(armature, meshes), 0.0, 0.1)
    targets, notes = _facing_out(meshes, targets)
    targets, left_out = props.without_props(load_avatar(), targets, mapping)
    carried = _named(meshes, targets, left_out)
    shown = [number for number, target in enumerate(targets) if len(target.triangles)]
    if shown and left_out:  # meshes that are props as a whole are no part of the avatar's skin
        meshes, targets = [meshes[k] for k in shown], [targets[k] for k in shown]
    rigid = [avatar_meshes.bone_of(armature, mesh) is not None for mesh in meshes]
    names, layer = [mesh.name for mesh in meshes], avatar_meshes.layer_of(armature)
    hashes = [load_model(model_id).content_hash for model_id in model_ids()]
    key = kept_fits.key_of("fit", targets, mapping, names, rigid, layer, hashes)
    found = _read(key)
    if found is None:
        try:
            steps = _fitted(targets, names, rigid, mapping, layer)
            found = yield from within(steps, 0.1, 1.0)
        except InputError as error:
            raise InputError(f"Armature '{armature.name}': {error}") from None
        _keep(key, found)
    warnings = (*(() if found.by_bones else notes), *carried, *found.warnings)  # bones: no normals
    return replace(found, meshes=tuple(meshes), warnings=warnings, notes=mapping.report)


def _fitted(
    targets: Sequence[TargetAvatar],
    names: Sequence[str],
    rigid: Sequence[bool],
    mapping: BoneMapping,
    layer: Layer,
) -> Generator[float, None, Fit]:
    """Fit all models, in steps; the result has neither the meshes nor notes."""
    avatar, target = load_avatar(), skin_parts.joined(targets)
    name = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    no_surface = retarget_target.check(target, name) or _why_rigid(targets, rigid)
    models = [load_model(model_id) for model_id in model_ids()]
    qualities: list[Quality] = []
    if no_surface is None:
        warping = retarget.warping(avatar, target, mapping, layer)
        warped = yield from within(warping, 0.0, 0.8)
        fits = []
        for number, model in enumerate(models):
            yield 0.8 + 0.2 * number / len(models)
            fits.append(retarget.fit(model, warped))
        qualities = [quality for _, quality in fits]
        if (lost := by_bones.lost_part(qualities)) is not None:
            no_surface = (
                f"only {100 * lost.in_place:.0f} % of its {lost.part.replace('_', ' ')} is "
                f"found on that part of '{name}'"
            )
    if no_surface is None:
        fitted = tuple(model for model, _ in fits)
        return Fit((), fitted, tuple(qualities), tuple(_folded(qualities)))
    placed = by_bones.fit_by_bones(models, avatar, target, mapping)
    return Fit((), tuple(placed), (), (_ONLY_BONES.format(reason=no_surface),), by_bones=True)


def _read(key: str) -> Fit | None:
    """A fit that was kept; None if there is none."""
    kept = kept_fits.read(key)
    if kept is None:
        return None
    values, arrays = kept
    bones = tuple(values["bones"])
    models = tuple(
        fitted_of(model_id, model_hash, bones, {n: arrays[f"{model_id} {n}"] for n in values["of"]})
        for model_id, model_hash in values["models"]
    )
    qualities = tuple(_quality_of(each) for each in values["quality"])
    return Fit((), models, qualities, tuple(values["warnings"]), by_bones=values["by_bones"])


def _quality_of(values: Mapping[str, Any]) -> Quality:
    parts = tuple(PartQuality(**part) for part in values["parts"])
    return Quality(**{**values, "parts": parts})


def _keep(key: str, found: Fit) -> None:
    arrays = {model.model_id: arrays_of(model) for model in found.models}
    values = {
        "models": [(model.model_id, model.model_hash) for model in found.models],
        "bones": found.models[0].bone_names,
        "of": list(arrays[found.models[0].model_id]),
        "quality": [asdict(quality) for quality in found.quality],
        "warnings": found.warnings,
        "by_bones": found.by_bones,
    }
    flat = {f"{each} {name}": array for each, own in arrays.items() for name, array in own.items()}
    kept_fits.write(key, values, flat)


def _facing_out(
    meshes: Sequence[bpy.types.Object], targets: Sequence[TargetAvatar]
) -> tuple[list[TargetAvatar], list[str]]:
    """Turn meshes whose faces look inwards, for the fit; with a sentence about each."""
    turned, notes = [], []
    for mesh, target in zip(meshes, targets, strict=True):
        outwards, share = retarget_target.faced_out(target)
        turned.append(outwards)
        if share:
            notes.append(
                f"the normals of '{mesh.name}' point inwards on {max(100 * share, 1):.0f} % of its "
                "surface: it was read turned outwards; correct it with Mesh > Normals > "
                "Recalculate Outside"
            )
    return turned, notes


def _named(
    meshes: Sequence[bpy.types.Object], targets: Sequence[TargetAvatar], held: Sequence[props.Prop]
) -> list[str]:
    """Sentences about props that are loose pieces of a mesh, one for each bone."""
    return [
        f"left out of '{meshes[prop.mesh].name}': loose pieces that bone '{prop.bone}' moves and "
        f"that stick out of the body, {max(100 * prop.share, 1):.0f} % of its surface, as they "
        "are held or carried and no skin"
        for prop in held
        if len(targets[prop.mesh].triangles)
    ]


def _why_rigid(targets: Sequence[TargetAvatar], rigid: Sequence[bool]) -> str | None:
    """Reason that rigid pieces are no skin, where they are most of an avatar's surface."""
    areas = [retarget_target.areas_of(t.vertices, t.triangles).sum() for t in targets]
    if float(np.dot(areas, rigid)) < 0.5 * float(np.sum(areas)):
        return None
    return f"{sum(rigid)} of its {len(rigid)} meshes are rigid pieces that hang on bones"


def _folded(qualities: Sequence[Quality]) -> list[str]:
    """Faults of a fit, one line for each body part, the worst part first."""
    lines = [
        f"{part.part.replace('_', ' ')} {', '.join(part.faults)}"
        for part in worst_first(qualities)
        if part.faults
    ]
    lines += joint_faults(qualities)
    whole = dict.fromkeys(fault for quality in qualities for fault in quality.whole_faults)
    if lines:
        lines.append(
            "look at these parts with Show Perceptual Model; other meshes (select them first) or "
            "corrected bones may fit better"
        )
    return [*whole, *lines]
