# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores the fit of body models to a user's own avatar in the .blend, and reads it.

The fit is stored on the armature object as typed ID-property arrays, which go wherever the
object goes (copy, append, link) and are read without a loop: about 3 MB for the three shipped
models, before Blender compresses the file. Blender saves no ID properties of an override: its fit
is kept on a mesh of this file, which nobody sees, that ``hfx.fit_kept`` points to.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ..engine.arrays import F64
from ..engine.body.model import PerceptualModel, SkinWeights, load_model
from ..engine.modality import MODALITIES
from ..engine.retargeting.quality import (
    AREA_RATIOS,
    FARTHEST_MM,
    IN_PLACE,
    PartQuality,
    Quality,
)
from ..engine.scene import FittedModel, SurfaceAnchors
from ..errors import InputError
from . import avatar_meshes, mesh_copies

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
        "shapes": json.dumps([mesh_copies.steady_shape(mesh.data) for mesh in fit.meshes]),
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


def shape_of(armature: bpy.types.Object, mesh: bpy.types.Object) -> dict[str, float]:
    """Values of a mesh's shape keys when the body was fitted to it; the others were 0."""
    fit = _stored_fit(armature)
    meshes = avatar_meshes.meshes_of(armature)
    if fit is None or "shapes" not in fit or mesh not in meshes:
        return {}
    shapes: list[dict[str, float]] = json.loads(fit["shapes"])
    number = meshes.index(mesh)
    return shapes[number] if number < len(shapes) else {}


def _stored(fitted: FittedModel) -> dict[str, object]:
    return {"hash": fitted.model_hash, **arrays_of(fitted)}


def arrays_of(fitted: FittedModel) -> dict[str, np.ndarray]:
    """Flat arrays that a fitted model is stored as."""
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
    return {name: np.ascontiguousarray(arrays[name], _ARRAYS[name]).ravel() for name in _ARRAYS}


def fitted_of(
    model_id: str, model_hash: str, bone_names: tuple[str, ...], stored: Mapping[str, Any]
) -> FittedModel:
    """Fitted model of the arrays of :func:`arrays_of`."""
    arrays = {name: np.array(stored[name], kind) for name, kind in _ARRAYS.items()}
    return FittedModel(
        model_id=model_id,
        model_hash=model_hash,
        vertices=arrays["vertices"].reshape(-1, 3),
        bone_names=bone_names,
        weights=SkinWeights(arrays["offsets"], arrays["bones"], arrays["values"]),
        anchors=SurfaceAnchors(
            arrays["corners"].reshape(-1, 3),
            arrays["places"].reshape(-1, 3).astype(np.float64),
            arrays["heights"].astype(np.float64),
        ),
    )


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
    return fitted_of(model_id, stored["hash"], tuple(fit["bones"].split("\n")), stored)


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
