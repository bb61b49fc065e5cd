# SPDX-License-Identifier: GPL-3.0-or-later
"""Fits body models to a user's avatar, or reads the fit from the cache."""

from collections.abc import Generator, Sequence
from dataclasses import replace

import bpy
import numpy as np

from ..engine.body.model import PerceptualModel, load_avatar, load_model
from ..engine.body.rigs.mapping import BoneMapping
from ..engine.retargeting import layers, props, retarget
from ..engine.retargeting import target as retarget_target
from ..engine.retargeting.layers import Layer
from ..engine.retargeting.quality import FitQuality, joint_faults, lost_part
from ..engine.retargeting.target import TargetAvatar
from ..engine.stepwise import within
from ..errors import InputError
from . import avatar_meshes, fit_cache
from .stored_fits import Fit, document_of, fit_of, model_ids, worst_first

_ONLY_BONES = (
    "felt by its bones only, because {reason}: the haptic body has the standard shape, stretched "
    "to this rig's joints, and not the shape of the mesh, so touches are approximate, and hair, "
    "clothes or a large head beyond it are not felt; join the pieces to one closed skin, or select "
    "other meshes, for a fit to the surface"
)


def fitting(
    armature: bpy.types.Object, meshes: Sequence[bpy.types.Object], mapping: BoneMapping
) -> Generator[float, None, Fit]:
    """Fit all perceptual models to an avatar; yields the progress from 0 to 1, returns the fit.
    ``meshes`` is the avatar's skin, in the order of vertex numbering; props are left out, with
    notes. The scene is not changed. Raises InputError: the avatar cannot be fitted to."""
    targets = yield from within(avatar_meshes.reading_meshes(armature, meshes), 0.0, 0.1)
    targets, normal_notes = _face_outwards(meshes, targets)
    targets, left_out = props.without_props(load_avatar(), targets, mapping)
    prop_notes = [
        f"left out of '{meshes[prop.mesh].name}': loose pieces that bone '{prop.bone}' moves and "
        f"that stick out of the body, {max(100 * prop.share, 1):.0f} % of its surface, as they "
        "are held or carried and no skin"
        for prop in left_out
        if len(targets[prop.mesh].triangles)
    ]
    skin_numbers = [number for number, target in enumerate(targets) if len(target.triangles)]
    # Meshes that are props as a whole are no part of the avatar's skin.
    if skin_numbers and left_out:
        meshes, targets = [meshes[k] for k in skin_numbers], [targets[k] for k in skin_numbers]
    rigid = [avatar_meshes.bone_of(armature, mesh) is not None for mesh in meshes]
    names, layer = [mesh.name for mesh in meshes], avatar_meshes.layer_of(armature)
    models = [load_model(model_id) for model_id in model_ids(armature)]
    hashes = [model.content_hash for model in models]
    # The key covers everything that the fit depends on, so that a cached fit is exact.
    key = fit_cache.key_of("fit", targets, mapping, names, rigid, layer, hashes)
    cached = fit_cache.read(key)
    if cached is not None:
        fit = fit_of(cached)
    else:
        try:
            steps = _fitting_models(models, targets, names, rigid, mapping, layer)
            fit = yield from within(steps, 0.1, 1.0)
        except InputError as error:
            raise InputError(f"Armature '{armature.name}': {error}") from None
        fit_cache.write(key, document_of(fit))
    # A fit by bones uses no normals.
    warnings = (*(() if fit.by_bones else normal_notes), *prop_notes, *fit.warnings)
    return replace(fit, meshes=tuple(meshes), warnings=warnings, notes=mapping.report)


def _fitting_models(
    models: Sequence[PerceptualModel],
    targets: Sequence[TargetAvatar],
    names: Sequence[str],
    rigid: Sequence[bool],
    mapping: BoneMapping,
    layer: Layer,
) -> Generator[float, None, Fit]:
    """Fit models to the surface, or to the bones alone if the surface is unusable, in steps.
    Unusable are surfaces that fail the target's check, are mostly rigid pieces, or miss a body
    part; the warning says why. Meshes and notes of the result are empty."""
    avatar, target = load_avatar(), layers.joined(targets)
    name = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    no_surface = retarget_target.check(target, name)
    areas = [retarget_target.areas_of(t.vertices, t.triangles).sum() for t in targets]
    if no_surface is None and float(np.dot(areas, rigid)) >= 0.5 * float(np.sum(areas)):
        no_surface = f"{sum(rigid)} of its {len(rigid)} meshes are rigid pieces that hang on bones"
    if no_surface is None:
        warping = retarget.warping(avatar, target, mapping, layer)
        warped_avatar = yield from within(warping, 0.0, 0.8)
        fits = {}
        # The warp is shared, so each model takes a small part of the time. A fit can converge on
        # the wrong limb (a mesh without arms, a cloak). A part that lies mostly elsewhere makes the
        # whole surface unusable; a coarse model reveals it soonest.
        for number, model in enumerate(sorted(models, key=len)):
            yield 0.8 + 0.2 * number / len(models)
            fits[model.id] = retarget.fit(model, warped_avatar)
            if (lost := lost_part([fits[model.id][1]])) is not None:
                break
        if lost is not None:
            no_surface = (
                f"only {100 * lost.in_place:.0f} % of its "
                f"{lost.part.replace('_', ' ')} is found on that part of '{name}'"
            )
    if no_surface is None:
        fitted, qualities = zip(*(fits[model.id] for model in models), strict=True)
        return Fit((), fitted, tuple(qualities), tuple(_fault_lines(qualities)))
    placed = retarget.fit_by_bones(models, avatar, target, mapping)
    return Fit((), tuple(placed), (), (_ONLY_BONES.format(reason=no_surface),), by_bones=True)


def _face_outwards(
    meshes: Sequence[bpy.types.Object], targets: Sequence[TargetAvatar]
) -> tuple[list[TargetAvatar], list[str]]:
    """Targets with outward normals, and a note for each mesh with flipped triangles."""
    outward_targets, notes = [], []
    for mesh, target in zip(meshes, targets, strict=True):
        outwards, share = retarget_target.faced_out(target)
        outward_targets.append(outwards)
        if share:
            notes.append(
                f"the normals of '{mesh.name}' point inwards on {max(100 * share, 1):.0f} % of its "
                "surface: it was read turned outwards; correct it with Mesh > Normals > "
                "Recalculate Outside"
            )
    return outward_targets, notes


def _fault_lines(qualities: Sequence[FitQuality]) -> list[str]:
    """Faults of a fit: of the whole body, of body parts (worst first), of joints, then advice."""
    lines = [
        f"{part.part.replace('_', ' ')} {', '.join(part.faults)}"
        for part in worst_first(qualities)
        if part.faults
    ]
    lines += joint_faults(qualities)
    whole_faults = dict.fromkeys(fault for quality in qualities for fault in quality.whole_faults)
    if lines:
        lines.append(
            "look at these parts with Show Perceptual Model; other meshes (select them first) or "
            "corrected bones may fit better"
        )
    return [*whole_faults, *lines]
