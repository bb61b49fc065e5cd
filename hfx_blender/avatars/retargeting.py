# SPDX-License-Identifier: GPL-3.0-or-later
"""Fits body models to a user's own avatar, and stores the fit in the .blend.

The fit is stored on the armature object as typed ID-property arrays, which go wherever the
object goes (copy, append, link) and are read without a loop: about 3 MB for the three shipped
models, before Blender compresses the file. Blender saves no ID properties of an override: its fit
is kept on a mesh of this file, which nobody sees, that ``hfx.fit_kept`` points to.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

import bpy
import numpy as np

from ..engine.arrays import F64
from ..engine.body.model import PerceptualModel, SkinWeights, load_avatar, load_model
from ..engine.body.rigs.mapping import BoneMapping
from ..engine.modality import MODALITIES
from ..engine.retargeting import skin_parts
from ..engine.retargeting import target as retarget_target
from ..engine.retargeting.quality import (
    AREA_RATIOS,
    FARTHEST_MM,
    IN_PLACE,
    PartQuality,
    Quality,
    joint_faults,
)
from ..engine.retargeting.target import TargetAvatar
from ..engine.scene import FittedModel, SurfaceAnchors
from ..errors import InputError
from . import avatar_meshes

FIT = "hfx_fit"
"""ID property of an armature: its bones and meshes as they were, and the arrays of each model."""


_ARRAYS = {
    "vertices": np.float32,
    "offsets": np.int32,
    "bones": np.int32,
    "values": np.float32,
    "corners": np.int32,
    "places": np.float32,
    "heights": np.float32,
}
_ONLY_BONES = (
    "felt by its bones only, because {reason}: the haptic body has the standard shape, stretched "
    "to this rig's joints, and not the shape of the mesh, so touches are approximate, and hair, "
    "clothes or a large head beyond it are not felt; join the pieces to one closed skin, or select "
    "other meshes, for a fit to the surface"
)
_MEASURES = ("distance_mean_mm", "distance_p95_mm", "in_place", "area_ratio")


@dataclass(frozen=True, eq=False)
class Fit:
    """All perceptual models on one avatar."""

    meshes: tuple[bpy.types.Object, ...]  # in the order in which their vertices are numbered
    models: tuple[FittedModel, ...]
    quality: tuple[Quality, ...] = ()  # of each model
    warnings: tuple[str, ...] = ()  # parts that fit badly, by name
    notes: tuple[str, ...] = ()  # bones that are missing or doubtful
    by_bones: bool = False  # the surface could not be followed


def model_ids() -> list[str]:
    """Ids of the perceptual models that the modalities are felt on."""
    return sorted({f"hfx-{modality.model}-1" for modality in MODALITIES.values()})


def fit_body(
    armature: bpy.types.Object, meshes: Sequence[bpy.types.Object], mapping: BoneMapping
) -> Fit:
    """Fit all perceptual models to an avatar; nothing in the scene is changed.

    Parameters
    ----------
    meshes : sequence of Object
        The avatar's skin, in any order.

    Raises
    ------
    InputError
        The avatar cannot be fitted to.
    """
    # Fitting is half of this module's imports, and Blender's start must not wait for it.
    from ..engine.retargeting import by_bones, retarget

    avatar = load_avatar()
    targets, notes = _facing_out(meshes, avatar_meshes.read_meshes(armature, meshes))
    name = meshes[0].name
    layer = avatar_meshes.layer_of(armature)
    if len(meshes) > 1:
        order = skin_parts.ranked(avatar, targets, mapping, layer)
        meshes, targets = [meshes[k] for k in order], [targets[k] for k in order]
        name = f"{meshes[0].name} and {len(meshes) - 1} more"
    target = skin_parts.joined(targets)
    no_surface = retarget_target.check(target, name) or _why_rigid(armature, meshes, targets)
    models = [load_model(model_id) for model_id in model_ids()]
    try:
        if no_surface is None:
            warped = retarget.warp(avatar, target, mapping, layer)
            fits = [retarget.fit(model, warped) for model in models]
            qualities = [quality for _, quality in fits]
            if (lost := by_bones.lost_part(qualities)) is not None:
                no_surface = (
                    f"only {100 * lost.in_place:.0f} % of its {lost.part.replace('_', ' ')} is "
                    f"found on that part of '{name}'"
                )
        if no_surface is None:
            fitted, warnings = [model for model, _ in fits], _folded(qualities)
        else:
            fitted, qualities = by_bones.fit_by_bones(models, avatar, target, mapping), []
            warnings = [_ONLY_BONES.format(reason=no_surface)]
    except InputError as error:
        raise InputError(f"Armature '{armature.name}': {error}") from None
    return Fit(
        tuple(meshes),
        tuple(fitted),
        tuple(qualities),
        (*notes, *warnings),
        mapping.report,
        no_surface is not None,
    )


def _facing_out(
    meshes: Sequence[bpy.types.Object], targets: Sequence[TargetAvatar]
) -> tuple[list[TargetAvatar], list[str]]:
    """Turn meshes whose faces look inwards, for the fit; with a sentence about each."""
    turned, notes = [], []
    for mesh, target in zip(meshes, targets, strict=True):
        if retarget_target.is_inside_out(target):
            target = replace(target, triangles=target.triangles[:, ::-1])
            notes.append(
                f"the normals of '{mesh.name}' point inwards: it was read turned inside out; "
                "correct it with Mesh > Normals > Recalculate Outside"
            )
        turned.append(target)
    return turned, notes


def _why_rigid(
    armature: bpy.types.Object,
    meshes: Sequence[bpy.types.Object],
    targets: Sequence[TargetAvatar],
) -> str | None:
    """Why rigid pieces are no skin, where they are most of an avatar's surface."""
    areas = [retarget_target.areas_of(t.vertices, t.triangles).sum() for t in targets]
    rigid = [avatar_meshes.bone_of(armature, mesh) is not None for mesh in meshes]
    if float(np.dot(areas, rigid)) < 0.5 * float(np.sum(areas)):
        return None
    return f"{sum(rigid)} of its {len(meshes)} meshes are rigid pieces that hang on bones"


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


def check_scipy() -> None:
    """Raise an error with instructions if scipy is missing."""
    if find_spec("scipy") is None:
        raise InputError(
            "Fitting the body to an avatar needs the Python package scipy, which this Blender "
            f"lacks: install it with '{sys.executable} -m pip install scipy', or use the built-in "
            "avatar."
        )


def store(armature: bpy.types.Object, fit: Fit) -> None:
    """Keep a fit in the .blend."""
    keeper = armature
    if armature.override_library is not None:  # ID properties of an override are not saved
        keeper = armature.hfx.fit_kept or bpy.data.meshes.new(f".HFX Fit of {armature.name}")
        armature.hfx.fit_kept = keeper
    keeper[FIT] = {
        "rest": _rest_of(armature),
        "all_bones": _names_of(armature),
        "layer": armature.hfx.felt_layer,
        "mesh_names": "\n".join(mesh.name for mesh in fit.meshes),
        "mesh_vertices": np.array([len(mesh.data.vertices) for mesh in fit.meshes], np.int32),
        "bones": "\n".join(fit.models[0].bone_names),
        "models": {model.model_id: _stored(model) for model in fit.models},
        "quality": {quality.model_id: _stored_quality(quality) for quality in fit.quality},
        "warnings": "\n".join(fit.warnings),
        "notes": "\n".join(fit.notes),
        "by_bones": fit.by_bones,
    }


def _stored_quality(quality: Quality) -> dict[str, object]:
    table = {
        name: np.array([getattr(part, name) for part in quality.parts], np.float64)
        for name in _MEASURES
    }
    return {
        "parts": "\n".join(part.part for part in quality.parts),
        **table,
        "sides": quality.sides,
        "feet_forward": quality.feet_forward,
    }


def quality_of(armature: bpy.types.Object) -> list[Quality]:
    """Quality of each model's fit, as judged when it was fitted; empty without a fit."""
    fit = _stored_fit(armature)
    if fit is None:
        return []
    found = []
    for model_id, stored in fit["quality"].items():
        columns = [list(stored[name]) for name in _MEASURES]
        parts = [
            PartQuality(name, *values)
            for name, *values in zip(stored["parts"].split("\n"), *columns, strict=True)
        ]
        found.append(Quality(model_id, tuple(parts), stored["sides"], stored["feet_forward"]))
    return found


def worst_first(qualities: Sequence[Quality]) -> list[PartQuality]:
    """Quality of each body part on the model that fits it worst, the worst part first."""
    worst: dict[str, PartQuality] = {}
    for part in (part for quality in qualities for part in quality.parts):
        if part.part not in worst or _badness(part) > _badness(worst[part.part]):
            worst[part.part] = part
    return sorted(worst.values(), key=_badness, reverse=True)


def _badness(part: PartQuality) -> float:
    """Badness of a body part's fit: 1 is the limit of a fault."""
    spread = abs(np.log(max(part.area_ratio, 1e-9)))
    return max(
        part.distance_p95_mm / FARTHEST_MM,
        (1.0 - part.in_place) / (1.0 - IN_PLACE),
        float(spread / np.log(AREA_RATIOS[1])),
    )


def texts_of(armature: bpy.types.Object, kind: str) -> list[str]:
    """The "warnings" or the "notes" of a stored fit."""
    fit = _stored_fit(armature)
    return [] if fit is None else list(filter(None, fit[kind].split("\n")))


def _stored(fitted: FittedModel) -> dict[str, object]:
    weights, anchors = fitted.weights, fitted.anchors
    arrays = {
        "vertices": fitted.vertices,
        "offsets": weights.offsets,
        "bones": weights.bones,
        "values": weights.values,
        "corners": anchors.corners,
        "places": anchors.weights,
        "heights": anchors.offset_m,
    }
    flat = {name: np.ascontiguousarray(arrays[name], _ARRAYS[name]).ravel() for name in _ARRAYS}
    return {"hash": fitted.model_hash, **flat}


def forget(armature: bpy.types.Object) -> None:
    """Drop a stored fit: the body follows the canonical skeleton."""
    for keeper in (armature, armature.hfx.fit_kept):
        if keeper is not None and FIT in keeper:
            del keeper[FIT]


def is_fitted(armature: bpy.types.Object) -> bool:
    return _stored_fit(armature) is not None


def is_by_bones(armature: bpy.types.Object) -> bool:
    """Test for a fit that leaves the avatar's surface out."""
    fit = _stored_fit(armature)
    return fit is not None and bool(fit.get("by_bones", False))


def is_of_other_layer(armature: bpy.types.Object) -> bool:
    """Test for a layer of the avatar that was chosen after its body was fitted."""
    fit = _stored_fit(armature)
    return fit is not None and fit.get("layer", "VISIBLE") != armature.hfx.felt_layer


def _stored_fit(armature: bpy.types.Object) -> Any:
    kept = armature.hfx.fit_kept
    return (armature if kept is None or FIT not in kept else kept).get(FIT)


def fitted_model(armature: bpy.types.Object, model_id: str) -> FittedModel | None:
    """The stored fit of a model; None where the body's armature is the canonical one.

    Raises
    ------
    InputError
        The armature's rest pose or the avatar's meshes were edited since, or the fit is of
        another edition of the model.
    """
    fit, again = _stored_fit(armature), "; fit the body again."
    if fit is None:
        return None
    if _is_edited(armature, fit):
        raise InputError(
            f"Body '{armature.name}': the armature's rest pose was edited since the body was "
            f"fitted to it{again}"
        )
    _check_meshes(armature, fit, again)
    model = load_model(model_id)
    stored = fit["models"].get(model_id)
    if stored is None or stored["hash"] != model.content_hash:
        raise InputError(
            f"Body '{armature.name}': it was fitted for another edition of '{model_id}'{again}"
        )
    arrays = {name: np.array(stored[name], kind) for name, kind in _ARRAYS.items()}
    return FittedModel(
        model_id=model_id,
        model_hash=stored["hash"],
        vertices=arrays["vertices"].reshape(-1, 3),
        bone_names=tuple(fit["bones"].split("\n")),
        weights=SkinWeights(arrays["offsets"], arrays["bones"], arrays["values"]),
        anchors=SurfaceAnchors(
            arrays["corners"].reshape(-1, 3),
            arrays["places"].reshape(-1, 3).astype(np.float64),
            arrays["heights"].astype(np.float64),
        ),
    )


def _check_meshes(armature: bpy.types.Object, fit: Mapping[str, Any], again: str) -> None:
    meshes = avatar_meshes.meshes_of(armature)
    if armature.hfx.avatar is None:  # the bones alone are followed
        return
    names, counts = fit["mesh_names"].split("\n"), list(fit["mesh_vertices"])
    if len(meshes) != len(counts):
        raise InputError(
            f"Body '{armature.name}': the body was fitted to {len(counts)} meshes "
            f"({', '.join(names)}), its avatar has {len(meshes)} now{again}"
        )
    for mesh, count in zip(meshes, counts, strict=True):
        if len(mesh.data.vertices) != count:
            raise InputError(
                f"Body '{armature.name}': the body was fitted to {count} vertices of its avatar's "
                f"mesh '{mesh.name}', which has {len(mesh.data.vertices)} now{again}"
            )


def model_of(armature: bpy.types.Object, model_id: str) -> PerceptualModel:
    """A perceptual model as it stands on a body: its places, bones and weights."""
    model, fitted = load_model(model_id), fitted_model(armature, model_id)
    return model if fitted is None else fitted.of(model)


def _rest_of(armature: bpy.types.Object) -> F64:
    """Heads and tails of all bones at rest, flat."""
    ends = [end for bone in armature.data.bones for end in (bone.head_local, bone.tail_local)]
    return np.array(ends, np.float64).ravel()


def _is_edited(armature: bpy.types.Object, fit: Mapping[str, Any]) -> bool:
    """Test for bones that were added, renamed or moved since a fit was stored."""
    if fit["all_bones"] != _names_of(armature):
        return True
    before, now = np.array(fit["rest"], np.float64), _rest_of(armature)
    return not np.allclose(before, now, rtol=0.0, atol=1e-4 * np.ptp(before))


def _names_of(armature: bpy.types.Object) -> str:
    return "\n".join(bone.name for bone in armature.data.bones)
