# SPDX-License-Identifier: GPL-3.0-or-later
"""Somebody's own avatar as a haptic body: reading it, and keeping the fit in the .blend.

The fit is stored on the armature object as typed ID-property arrays, which go wherever the
object goes (copy, append, link, override) and are read without a loop: about 3 MB for the three
shipped models, before Blender compresses the file.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from .engine.body.model import PerceptualModel, SkinWeights, load_avatar, load_model
from .engine.body.retargeting import retarget
from .engine.body.retargeting import target as retarget_target
from .engine.body.retargeting.target import TargetAvatar
from .engine.body.rigs.mapping import BoneMapping, RigBone, map_bones
from .engine.modality import MODALITIES
from .engine.scene import FittedModel, SurfaceAnchors
from .errors import InputError

FIT = "hfx_fit"
"""ID property of an armature: its bones and mesh as they were, and the arrays of each model."""

F64 = npt.NDArray[np.float64]

_ARRAYS = {
    "vertices": np.float32,
    "offsets": np.int32,
    "bones": np.int32,
    "values": np.float32,
    "corners": np.int32,
    "places": np.float32,
    "heights": np.float32,
}


def fit_body(
    armature: bpy.types.Object,
    avatar: bpy.types.Object | None,
    mapping: BoneMapping | None = None,
) -> tuple[list[FittedModel], list[str]]:
    """Fit all perceptual models to an avatar; nothing in the scene is changed.

    Parameters
    ----------
    mapping : BoneMapping, optional
        A corrected one; found from the bones by default.

    Returns
    -------
    fitted : list of FittedModel
    warnings : list of str
        What a user should check: doubtful bones, parts that fit badly.

    Raises
    ------
    InputError
        The avatar has no mesh, no human bones, or cannot be fitted to.
    """
    if avatar is None:
        raise InputError(
            f"'{armature.name}' has no mesh that a body could be fitted to: select the avatar's "
            "mesh and then its armature."
        )
    if find_spec("scipy") is None:
        raise InputError(
            "Fitting the body to an avatar needs the Python package scipy, which this Blender "
            f"lacks: install it with '{sys.executable} -m pip install scipy', or use the built-in "
            "avatar."
        )
    target = read_avatar(armature, avatar)
    retarget_target.check(target, avatar.name)
    try:
        mapping = mapping or map_bones(target.bones)
        warped = retarget.warp(load_avatar(), target, mapping)
    except InputError as error:
        raise InputError(f"Armature '{armature.name}': {error}") from None
    fitted, faults = [], {}
    for model_id in sorted({f"hfx-{modality.model}-1" for modality in MODALITIES.values()}):
        found, quality = retarget.fit(load_model(model_id), warped)
        fitted.append(found)
        for fault in quality.warnings:
            faults.setdefault(fault, model_id)
    warnings = [f"{fault} ({model_id})" for fault, model_id in faults.items()]
    return fitted, [*mapping.report, *warnings]


def read_avatar(armature: bpy.types.Object, avatar: bpy.types.Object) -> TargetAvatar:
    """An avatar in the rest space of its armature.

    Raises
    ------
    InputError
        Armature or mesh are being edited, or scaled by zero or a negative number.
    """
    if avatar.type != "MESH":
        raise InputError(f"Avatar '{avatar.name}' is a {avatar.type.lower()}, not a mesh.")
    for obj in (armature, avatar):
        if obj.mode == "EDIT":
            raise InputError(f"'{obj.name}' is being edited; leave Edit Mode first.")
        _check_scale(obj)
    world = np.array(armature.matrix_world, np.float64)
    to_rest = np.linalg.inv(world) @ np.array(avatar.matrix_world, np.float64)
    mesh = avatar.data
    points = np.zeros(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    mesh.calc_loop_triangles()
    triangles = np.zeros(len(mesh.loop_triangles) * 3, np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    bones = armature.data.bones
    names = tuple(
        group.name
        for group in avatar.vertex_groups
        if group.name in bones and bones[group.name].use_deform
    )
    scene = bpy.context.scene.unit_settings
    unit = 1.0 if scene.system == "NONE" else scene.scale_length
    return TargetAvatar(
        vertices=points.reshape(-1, 3) @ to_rest[:3, :3].T + to_rest[:3, 3],
        triangles=triangles.reshape(-1, 3).astype(np.int64),
        weights=_weights(avatar, names),
        bone_names=names,
        bones=tuple(
            RigBone(
                bone.name,
                bone.parent.name if bone.parent else None,
                tuple(bone.head_local),
                tuple(bone.tail_local),
            )
            for bone in bones
        ),
        metres=unit * float(np.cbrt(np.linalg.det(world[:3, :3]))),
    )


def _check_scale(obj: bpy.types.Object) -> None:
    matrix = np.array(obj.matrix_world, np.float64)[:3, :3]
    lengths = np.linalg.norm(matrix, axis=0)
    if not np.isfinite(matrix).all() or lengths.min() < 1e-9:
        raise InputError(f"'{obj.name}' is scaled by zero, so it has no size to fit a body to.")
    if np.linalg.det(matrix) < 0.0:
        raise InputError(
            f"'{obj.name}' has a negative scale, which swaps its left and right; apply the scale "
            "(Object > Apply > Scale) and recalculate the normals first."
        )


def _weights(avatar: bpy.types.Object, names: tuple[str, ...]) -> SkinWeights:
    column = {avatar.vertex_groups[name].index: number for number, name in enumerate(names)}
    counts, bones, values = [0], [], []
    for vertex in avatar.data.vertices:
        row = sorted(
            (column[element.group], element.weight)
            for element in vertex.groups
            if element.group in column and element.weight > 0.0
        )
        total = sum(weight for _, weight in row)
        bones += [bone for bone, _ in row]
        values += [weight / total for _, weight in row]
        counts.append(len(bones))
    return SkinWeights(
        np.array(counts, np.int32), np.array(bones, np.int32), np.array(values, np.float32)
    )


def store(armature: bpy.types.Object, avatar: bpy.types.Object, fitted: list[FittedModel]) -> None:
    """Keep a fit in the .blend."""
    armature[FIT] = {
        "rest": _rest_of(armature),
        "all_bones": _names_of(armature),
        "avatar_vertices": len(avatar.data.vertices),
        "bones": "\n".join(fitted[0].bone_names),
        "models": {model.model_id: _stored(model) for model in fitted},
    }


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
    if FIT in armature:
        del armature[FIT]


def is_fitted(armature: bpy.types.Object) -> bool:
    return FIT in armature


def fitted_model(armature: bpy.types.Object, model_id: str) -> FittedModel | None:
    """The stored fit of a model; None where the body's armature is the canonical one.

    Raises
    ------
    InputError
        The armature's rest pose or the avatar's mesh was edited since, or the fit is of another
        edition of the model.
    """
    if FIT not in armature:
        return None
    fit, avatar = armature[FIT], armature.hfx.avatar
    again = "; mark it as a haptic body again."
    if _is_edited(armature, fit):
        raise InputError(
            f"Body '{armature.name}': the armature's rest pose was edited since the body was "
            f"fitted to it{again}"
        )
    if avatar is not None and fit["avatar_vertices"] != len(avatar.data.vertices):
        raise InputError(
            f"Body '{armature.name}': the body was fitted to {fit['avatar_vertices']} vertices, "
            f"its avatar '{avatar.name}' has {len(avatar.data.vertices)} now{again}"
        )
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


def model_of(armature: bpy.types.Object, model_id: str) -> PerceptualModel:
    """A perceptual model as it stands on a body: its places, bones and weights."""
    model, fitted = load_model(model_id), fitted_model(armature, model_id)
    return model if fitted is None else fitted.of(model)


def _rest_of(armature: bpy.types.Object) -> F64:
    """Heads and tails of all bones at rest, flat."""
    ends = [end for bone in armature.data.bones for end in (bone.head_local, bone.tail_local)]
    return np.array(ends, np.float64).ravel()


def _is_edited(armature: bpy.types.Object, fit: Mapping[str, Any]) -> bool:
    """Whether bones were added, renamed or moved since a fit was stored."""
    if fit["all_bones"] != _names_of(armature):
        return True
    before, now = np.array(fit["rest"], np.float64), _rest_of(armature)
    return not np.allclose(before, now, rtol=0.0, atol=1e-4 * np.ptp(before))


def _names_of(armature: bpy.types.Object) -> str:
    return "\n".join(bone.name for bone in armature.data.bones)
