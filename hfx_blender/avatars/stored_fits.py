# SPDX-License-Identifier: GPL-3.0-or-later
"""Storage of an avatar's fit in the .blend.

The fit is stored on the armature object as typed ID-property arrays: copying, appending and linking
the object keep the fit, and arrays are read without a loop. The three shipped models take about 3
MB before Blender compresses the file. Blender saves no ID properties of a library override, so the
fit of an overridden armature is stored on a local mesh without users in the scene, referenced by
``hfx.fit_kept``.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import Any

import bpy
import numpy as np

from ..blender import mesh_arrays
from ..engine.arrays import F64
from ..engine.body.model import PerceptualModel, SkinWeights, load_avatar, load_model
from ..engine.modality import MODALITIES
from ..engine.retargeting.quality import AREA_RATIOS, FARTHEST_MM, IN_PLACE, FitQuality, PartQuality
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
    """Fit of all perceptual models to an avatar."""

    meshes: tuple[bpy.types.Object, ...]  # in the order in which their vertices are numbered
    models: tuple[FittedModel, ...]
    quality: tuple[FitQuality, ...] = ()  # of each model
    warnings: tuple[str, ...] = ()  # parts that fit badly, by name
    notes: tuple[str, ...] = ()  # bones that are missing or doubtful
    by_bones: bool = False  # the surface could not be followed


def model_ids(armature: bpy.types.Object) -> list[str]:
    """Ids of the models that a fit has: the shipped ones, and those of the armature's set."""
    shipped = {f"hfx-{modality.model}-1" for modality in MODALITIES.values()}
    return sorted(shipped.union(armature.hfx.body_models.split()))


def store(armature: bpy.types.Object, fit: Fit) -> None:
    """Store a fit on an armature, or on the storage mesh for a library override. An earlier fit is
    replaced. The bones' names and rest pose, the layer and the shape keys of the meshes are stored
    too, for :func:`fitted_model` to detect edits."""
    owner = armature
    if armature.override_library is not None:  # ID properties of an override are not saved
        owner = armature.hfx.fit_kept or bpy.data.meshes.new(f".HFX Fit of {armature.name}")
        armature.hfx.fit_kept = owner
    # Names are joined, as ID properties have no lists of strings.
    owner[FIT] = {
        "rest": _rest_of(armature),
        "all_bones": "\n".join(armature.data.bones.keys()),
        "layer": armature.hfx.felt_layer,
        "mesh_names": "\n".join(mesh.name for mesh in fit.meshes),
        "mesh_vertices": np.array([len(mesh.data.vertices) for mesh in fit.meshes], np.int32),
        "shapes": json.dumps([mesh_copies.steady_shape(mesh.data) for mesh in fit.meshes]),
        **document_of(fit),
    }


def document_of(fit: Fit) -> dict[str, Any]:
    """Fit as nested dictionaries of values and arrays, without the meshes."""
    return {
        "bones": "\n".join(fit.models[0].bone_names),
        "models": {m.model_id: {"hash": m.model_hash, **arrays_of(m)} for m in fit.models},
        "quality": {
            quality.model_id: {
                "parts": "\n".join(part.part for part in quality.parts),
                **{
                    name: np.array([getattr(part, name) for part in quality.parts], np.float64)
                    for name in _MEASURES
                },
                "sides": quality.sides,
                "feet_forward": quality.feet_forward,
            }
            for quality in fit.quality
        },
        "warnings": "\n".join(fit.warnings),
        "notes": "\n".join(fit.notes),
        "by_bones": fit.by_bones,
    }


def fit_of(document: Mapping[str, Any]) -> Fit:
    """Fit of a document of :func:`document_of`; no meshes."""
    bones = tuple(document["bones"].split("\n"))
    models = (
        model_of_arrays(model_id, stored["hash"], bones, stored)
        for model_id, stored in document["models"].items()
    )
    # An empty text has no lines.
    warnings, notes = (
        tuple(filter(None, document[kind].split("\n"))) for kind in ("warnings", "notes")
    )
    return Fit((), tuple(models), _qualities(document), warnings, notes, document["by_bones"])


def quality_of(armature: bpy.types.Object) -> list[FitQuality]:
    """Quality of each model's fit, as measured at fitting; empty without a fit."""
    fit = _stored_fit(armature)
    return list(_qualities(fit)) if fit else []


def _qualities(document: Mapping[str, Any]) -> tuple[FitQuality, ...]:
    """Quality of each model, in order, from a stored fit."""
    qualities = []
    for model_id, stored in document["quality"].items():
        columns = [list(stored[name]) for name in _MEASURES]
        parts = starmap(PartQuality, zip(stored["parts"].split("\n"), *columns, strict=True))
        sides, feet_forward = stored["sides"], stored["feet_forward"]
        qualities.append(FitQuality(model_id, tuple(parts), sides, feet_forward))
    return tuple(qualities)


def worst_first(qualities: Sequence[FitQuality]) -> list[PartQuality]:
    """Body parts by falling badness, each with the quality on the worst fitting model."""
    worst: dict[str, PartQuality] = {}
    for part in (part for quality in qualities for part in quality.parts):
        if part.part not in worst or _badness(part) > _badness(worst[part.part]):
            worst[part.part] = part
    return sorted(worst.values(), key=_badness, reverse=True)


def _badness(part: PartQuality) -> float:
    """Largest measure of a part over its limit: 0 perfect, above 1 a fault is reported."""
    # Half and double the area are equally bad.
    spread = abs(np.log(max(part.area_ratio, 1e-9)))
    return max(
        part.distance_p95_mm / FARTHEST_MM,
        (1.0 - part.in_place) / (1.0 - IN_PLACE),
        float(spread / np.log(AREA_RATIOS[1])),
    )


def messages_of(armature: bpy.types.Object, field: str) -> list[str]:
    """Lines "warnings" or "notes" of a stored fit, by ``field``; empty without a fit."""
    return [line for line in _stored_fit(armature).get(field, "").split("\n") if line]


def shape_of(armature: bpy.types.Object, mesh: bpy.types.Object) -> dict[str, float]:
    """Values of a mesh's non-zero shape keys at fitting, by name; empty for an unfitted mesh."""
    shapes: list[dict[str, float]] = json.loads(_stored_fit(armature).get("shapes", "[]"))
    return dict(zip(avatar_meshes.meshes_of(armature), shapes, strict=False)).get(mesh, {})


def rest_gap(armature: bpy.types.Object, mesh: bpy.types.Object) -> float:
    """Largest distance of vertices of the fit, or of the built-in skin, from their places on a mesh
    in rest pose, armature units; 0 for a mirrored mesh or another number of vertices."""
    points, keys = mesh_arrays.points(mesh.data), mesh.data.shape_keys
    shape = shape_of(armature, mesh)
    for key in keys.key_blocks if keys is not None and shape else ():
        key_points = (mesh_arrays.values(k.data, "co", 3) for k in (key, key.relative_key))
        points += shape.get(key.name, 0.0) * np.subtract(*key_points)
    points = avatar_meshes.in_rest_space(armature, mesh, points)
    fit, meshes = _stored_fit(armature), avatar_meshes.meshes_of(armature)
    if not fit:
        skin = load_avatar().vertices
        return float(np.abs(points - skin).max()) if points.shape == skin.shape else 0.0
    counts = [len(part.data.vertices) for part in meshes]
    is_same = counts == list(fit["mesh_vertices"]) and not any(map(mesh_copies.mirrors_of, meshes))
    if is_by_bones(armature) or not is_same:
        return 0.0
    coarsest = min(fit["models"].values(), key=lambda stored: len(stored["heights"]))  # quick
    fitted = model_of_arrays("", "", (), coarsest)
    corners = fitted.anchors.corners - sum(counts[: meshes.index(mesh)])
    own = ((corners >= 0) & (corners < len(points))).all(axis=1)
    feet = np.einsum("nc,nci->ni", fitted.anchors.weights[own], points[corners[own]])
    # A vertex in its place is as far from the triangle as its anchor is high.
    distances = np.linalg.norm(feet - fitted.vertices[own], axis=1)
    return float((distances - np.abs(fitted.anchors.offset_m[own])).max(initial=0.0))


def arrays_of(fitted: FittedModel) -> dict[str, np.ndarray]:
    """Flat arrays by name of a fitted model: vertices, skin weights (offsets, bones, values),
    anchors (corners, places, heights)."""
    weights, anchors = fitted.weights, fitted.anchors
    arrays = (
        *(fitted.vertices, weights.offsets, weights.bones, weights.values),
        *(anchors.corners, anchors.weights, anchors.offset_m),
    )
    return {
        name: np.ascontiguousarray(array, kind).ravel()
        for (name, kind), array in zip(_ARRAYS.items(), arrays, strict=True)
    }


def model_of_arrays(
    model_id: str, model_hash: str, bone_names: tuple[str, ...], stored: Mapping[str, Any]
) -> FittedModel:
    """Fitted model from the arrays of :func:`arrays_of`."""
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


def clear(armature: bpy.types.Object) -> None:
    """Delete the stored fit, if any; the body follows the canonical skeleton."""
    for owner in (armature, armature.hfx.fit_kept):
        if owner is not None and FIT in owner:
            del owner[FIT]


def is_fitted(armature: bpy.types.Object) -> bool:
    """Test for a stored fit."""
    return bool(_stored_fit(armature))


def lacks_models(armature: bpy.types.Object) -> bool:
    """Test for a stored fit without a model of the armature's set."""
    fit = _stored_fit(armature)
    return bool(fit) and any(name not in fit["models"] for name in model_ids(armature))


def is_by_bones(armature: bpy.types.Object) -> bool:
    """Test for a stored fit to the bones alone, without the avatar's surface."""
    return bool(_stored_fit(armature).get("by_bones", False))


def is_of_other_layer(armature: bpy.types.Object) -> bool:
    """Test for a fit whose layer (skin or visible surface) differs from the armature's setting."""
    fit = _stored_fit(armature)
    return bool(fit) and fit.get("layer", "VISIBLE") != armature.hfx.felt_layer


def _stored_fit(armature: bpy.types.Object) -> Any:
    """ID property group of a fit, of the storage mesh, else of the armature; empty without one."""
    kept = armature.hfx.fit_kept
    return (armature if kept is None or FIT not in kept else kept).get(FIT, {})


def fitted_model(armature: bpy.types.Object, model_id: str) -> FittedModel | None:
    """Stored fit of a model; None for a body of the canonical armature. Raises InputError: the
    armature's rest pose, or the number of meshes or their vertices, changed after the fit, or the
    fit is of another edition of the model."""
    fit, again = _stored_fit(armature), "; fit the body again."
    if not fit:
        return None
    # Bones added, renamed, or moved by more than rounding: leaving Edit Mode may change positions.
    before, now = np.array(fit["rest"], np.float64), _rest_of(armature)
    if fit["all_bones"] != "\n".join(armature.data.bones.keys()) or not np.allclose(
        before, now, rtol=0.0, atol=1e-4 * np.ptp(before)
    ):
        raise InputError(
            f"Body '{armature.name}': the armature's rest pose was edited since the body was "
            f"fitted to it{again}"
        )
    _check_meshes(armature, fit, again)
    model = load_model(model_id)
    stored = fit["models"].get(model_id)
    # Vertex numbers of another edition mean different skin.
    if stored is None or stored["hash"] != model.content_hash:
        raise InputError(
            f"Body '{armature.name}': it was fitted for another edition of '{model_id}'{again}"
        )
    return model_of_arrays(model_id, stored["hash"], tuple(fit["bones"].split("\n")), stored)


def _check_meshes(armature: bpy.types.Object, fit: Mapping[str, Any], again: str) -> None:
    """Raise InputError if an avatar has another number of meshes or vertices than at fitting;
    ``again`` ends the message. An avatar without a main mesh passes."""
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
    """Perceptual model in a body's rest pose: the stored fit, else the canonical model."""
    model, fitted = load_model(model_id), fitted_model(armature, model_id)
    return model if fitted is None else fitted.of(model)


def _rest_of(armature: bpy.types.Object) -> F64:
    """Heads and tails of all bones at rest, flat: 6 values per bone, armature space."""
    ends = [end for bone in armature.data.bones for end in (bone.head_local, bone.tail_local)]
    return np.array(ends, np.float64).ravel()
