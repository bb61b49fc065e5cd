# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptual models on a user's own avatar: same vertex ids, the avatar's places and bones.

The canonical avatar is posed onto the target's rest pose and pulled onto its skin once
(:func:`warping`); the vertices of any model ride along and land on the target's triangles
(:func:`fit`).
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from ..body.model import Avatar, PerceptualModel, SkinWeights
from ..scene import FittedModel, SurfaceAnchors
from ..stepwise import within
from . import hinges, uncertainty
from .canonical_pose import matrices, posed
from .joints import Skeletons, skeletons_of
from .layers import Layer, leaving_out
from .limbs import Limbs
from .quality import Quality, judge
from .shape_fields import fields_for, shape
from .surface import Places, TargetSurface, pull, vertex_normals
from .target import RigMapping, TargetAvatar, areas_of

_LANDING_M: Final = 0.05
"""Farthest that a vertex may be from the skin on which it lands (of a body 1.8 m tall)."""

_LEAST_WEIGHT: Final = 0.004
"""Skin weights below this are dropped: at most 2 mm at half a metre from a joint."""

_SAME_TOPOLOGY: Final = 0.95
"""Share of the canonical avatar's edges that a mesh must have to be the same mesh, reshaped."""

_LARGEST_HEAD: Final = 4.0
"""Largest scale of a head without hats and hair: a chibi character's."""

_UNDER_CLOTHES: Final = 0.02
"""Share of that mesh's skin that may lie under other layers and still be felt."""


@dataclass(frozen=True, eq=False)
class Warp:
    """Deformation of the canonical avatar into a target's shape, shared by all models."""

    target: TargetAvatar
    mapping: RigMapping
    bodies: Skeletons
    surface: TargetSurface
    vertices: F64  # (V, 3) of the canonical avatar, normalised space
    normals: F64  # (V, 3)
    limbs: Limbs
    posed: F64  # (V, 3) where the rig's joints alone put the vertices
    same: I64 | None  # (V,) the target's own vertices, where it is the same mesh
    uncertain_m: Mapping[str, float]  # place -> how far it may be off, of a body 1.8 m tall


def warping(
    avatar: Avatar, target: TargetAvatar, mapping: RigMapping, layer: Layer
) -> Generator[float, None, Warp]:
    """Bring the canonical avatar into the shape of a target, in steps (:mod:`...stepwise`).

    Where the target is the same mesh (MakeHuman's base mesh, the shipped avatar) and its skin is
    felt, each vertex goes exactly to its own place.

    Parameters
    ----------
    layer : {"visible", "skin"}
        What is felt where clothes lie over skin.

    Raises
    ------
    InputError
        The target's joints are missing or are not a person's.
    """
    bodies = skeletons_of(avatar, target, mapping)
    faces = avatar.faces.astype(np.int64)
    triangles = np.concatenate((faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]))
    points = avatar.vertices.astype(np.float64)
    bodies, estimates = hinges.placed(bodies, points, triangles, target.triangles)
    if bodies.absent:
        target = with_mapped_bones(target, mapping)
    surface = TargetSurface(bodies.points, target.triangles, bodies.target_shares)
    yield 0.05
    limbs, shares, fields = Limbs(avatar, bodies), bodies.avatar_shares, fields_for(avatar)
    start = posed(avatar, matrices(avatar, bodies))
    layers = leaving_out(surface, layer, start, bodies)
    out = yield from within(layers, 0.1, 0.3)
    moved = matrices(avatar, _without(bodies, surface, out), _LARGEST_HEAD)
    start = posed(avatar, moved)
    same, uncertain_m = _same_mesh(avatar, target), {}
    if same is not None and not _is_left_out(same, surface, np.unique(surface.parent[out])):
        vertices = start = bodies.points[same]
    else:
        same = None
        surface.leave_out(out)
        vertices = start
        if fields is not None:
            shaping = shape(fields, moved, start, triangles, bodies, surface, limbs)
            vertices = yield from within(shaping, 0.3, 0.65)
        shaped = vertices
        pulling = pull(shaped, triangles, shares, limbs.axes, surface)
        vertices = yield from within(pulling, 0.65, 1.0)
        vertices = limbs.with_joints_joined(vertices, start)
        uncertain_m = uncertainty.uncertain_m(avatar, bodies, estimates, start, shaped, vertices)
    normals = vertex_normals(vertices, triangles)
    return Warp(
        target, mapping, bodies, surface, vertices, normals, limbs, start, same, uncertain_m
    )


def _without(bodies: Skeletons, surface: TargetSurface, out: npt.NDArray[np.bool_]) -> Skeletons:
    """Bodies of which the target has no vertices of layers that are left out: hats, hair."""
    is_kept = np.zeros(len(surface.points), bool)
    is_kept[surface.triangles[surface.parent[~out]]] = True
    return replace(bodies, target_shares=bodies.target_shares * is_kept[:, None])


def _is_left_out(same: I64, surface: TargetSurface, triangles: I64) -> bool:
    """Test if the mesh that is the canonical one lies under clothes in more than a few places."""
    areas = areas_of(surface.points, surface.triangles)
    mine = np.isin(surface.triangles, same).all(axis=1)
    return float(areas[triangles][mine[triangles]].sum()) > _UNDER_CLOTHES * areas[mine].sum()


def fit(model: PerceptualModel, warped: Warp) -> tuple[FittedModel, Quality]:
    """Put a perceptual model onto a target.

    Returns
    -------
    fitted : FittedModel
        In the target's own space and unit.
    quality : Quality
        How well it fits, part by part.
    """
    places, before, is_there = _project(model, warped)
    to_target = warped.bodies.to_target
    scale = float(np.cbrt(np.linalg.det(to_target[:3, :3])))
    corners, weights = warped.target.triangles[places.triangle], places.weights
    offset = np.zeros(len(model))
    if warped.same is not None:
        corners = warped.same[model.avatar_vertices]
        weights = model.avatar_weights.astype(np.float64)
        offset = model.avatar_offset_m * scale
    anchors = SurfaceAnchors(corners.astype(np.int32), weights, offset)
    vertices = places.points @ to_target[:3, :3].T + to_target[:3, 3]
    fitted = FittedModel(
        model_id=model.id,
        model_hash=model.content_hash,
        vertices=vertices.astype(np.float32),
        bone_names=warped.target.bone_names,
        weights=_skin_weights(model, warped, anchors, is_there),
        anchors=anchors,
    )
    shares = warped.bodies.target_shares[warped.target.triangles[places.triangle]].mean(axis=1)
    # At the canonical size: an avatar in another unit, or of a giant, is judged alike.
    distance = np.linalg.norm(places.points - before, axis=1)
    nearest = model.avatar_vertices[np.arange(len(model)), model.avatar_weights.argmax(axis=1)]
    rest, _ = carried(model, warped.posed, warped.normals)
    joints = warped.limbs.offsets_m(nearest, rest, places.points, warped.surface)
    feet_forward, absent = warped.bodies.feet_forward, warped.bodies.absent
    quality = judge(
        *(model, places, shares, distance, feet_forward, joints, is_there, absent),
        warped.uncertain_m,
    )
    return fitted, quality


def carried(model: PerceptualModel, vertices: F64, normals: F64) -> tuple[F64, F64]:
    """Points and unit normals (V, 3) of a model on the canonical avatar's moved vertices."""
    corners = vertices[model.avatar_vertices]
    weights = model.avatar_weights.astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    points = np.einsum("vc,vci->vi", weights, corners) + model.avatar_offset_m[:, None] * across
    outward = np.einsum("vc,vci->vi", weights, normals[model.avatar_vertices])
    return points, outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)


def _project(model: PerceptualModel, warped: Warp) -> tuple[Places, F64, npt.NDArray[np.bool_]]:
    """Project the vertices onto the target; returns their places, those before, and which of them
    the target has skin for.
    """
    points, normals = carried(model, warped.vertices, warped.normals)
    weights = model.avatar_weights.astype(np.float64)
    shares = np.einsum("vc,vcr->vr", weights, warped.bodies.avatar_shares[model.avatar_vertices])
    places = warped.surface.nearest(points, normals, shares, _LANDING_M)
    lost = np.flatnonzero(~places.found)
    landed = places.points.copy()
    if len(lost):  # they stay where they are, hung on the nearest skin of any region
        anywhere = warped.surface.nearest(
            points[lost], normals[lost], np.ones((len(lost), shares.shape[1])), np.inf, facing=-1.0
        )
        places.triangle[lost], places.weights[lost] = anywhere.triangle, anywhere.weights
        places.normals[lost] = anywhere.normals
        landed[lost] = anywhere.points
    if warped.same is not None:
        landed = points
    is_there: npt.NDArray[np.bool_] = shares.sum(axis=1) > 0.0
    landed_at = Places(places.found, places.triangle, places.weights, landed, places.normals)
    return landed_at, points, is_there


def _same_mesh(avatar: Avatar, target: TargetAvatar) -> I64 | None:
    """The target's vertex of each avatar vertex, if the target is the same mesh."""
    runs = avatar.provenance.get("source_vertices", [])
    base = np.concatenate(
        [np.arange(first, last + 1) for first, last in runs] or [np.zeros(0, int)]
    )
    count = len(target.vertices)
    sides = np.concatenate(
        [target.triangles[:, [0, 1]], target.triangles[:, [1, 2]], target.triangles[:, [2, 0]]]
    )
    have = np.unique(np.sort(sides, axis=1) @ np.array([count, 1]))
    quads = avatar.faces.astype(np.int64)
    edges = np.sort(
        np.concatenate([np.column_stack((quads[:, k], quads[:, (k + 1) % 4])) for k in range(4)])
    )
    for ids in (np.arange(len(avatar.vertices)), base):
        if len(ids) == len(avatar.vertices) and ids.max() < count:
            wanted = np.sort(ids[edges], axis=1) @ np.array([count, 1])
            if np.isin(wanted, have).mean() >= _SAME_TOPOLOGY:
                return ids.astype(np.int64)
    return None


def _skin_weights(
    model: PerceptualModel,
    warped: Warp,
    anchors: SurfaceAnchors,
    is_there: npt.NDArray[np.bool_],
) -> SkinWeights:
    """Skin weights of the target at each vertex; the canonical ones, mapped, where it has none."""
    from scipy.sparse import coo_array, diags_array

    target, count = warped.target, len(model)
    own = _matrix(target.weights, len(target.bone_names))
    rows = np.repeat(np.arange(count), 3)
    at = coo_array(
        (anchors.weights.ravel(), (rows, anchors.corners.ravel())),
        shape=(count, len(target.vertices)),
    ).tocsr()
    found = at @ own
    bare = (np.asarray(found.sum(axis=1)).ravel() < 1e-6) | ~is_there
    if bare.any():
        canonical = _mapped(model, target, warped.mapping)
        found = diags_array(1.0 - bare) @ found + diags_array(1.0 * bare) @ canonical
    return _skin_weights_of(found.tocsr())


def with_mapped_bones(target: TargetAvatar, mapping: RigMapping) -> TargetAvatar:
    """Target of which any bone that the canonical ones follow may move skin."""
    moving = (*mapping.bones.values(), *mapping.fallbacks.values())
    return replace(target, bone_names=tuple(dict.fromkeys((*target.bone_names, *moving))))


def mapped_weights(
    model: PerceptualModel, target: TargetAvatar, mapping: RigMapping
) -> SkinWeights:
    """The canonical skin weights of a model, on the target's bones that stand for the canonical."""
    return _skin_weights_of(_mapped(model, target, mapping).tocsr())


def _mapped(model: PerceptualModel, target: TargetAvatar, mapping: RigMapping) -> Any:
    from scipy.sparse import coo_array

    index = {name: number for number, name in enumerate(target.bone_names)}
    follows = {**mapping.fallbacks, **mapping.bones}
    pairs = [
        (number, index[rig_bone])
        for number, name in enumerate(model.bone_names)
        if (rig_bone := follows.get(name)) in index
    ]
    of, onto = np.array(pairs).reshape(-1, 2).T
    shape = (len(model.bone_names), len(target.bone_names))
    chosen = coo_array((np.ones(len(of)), (of, onto)), shape=shape).tocsr()
    return _matrix(model.weights, len(model.bone_names)) @ chosen


def _skin_weights_of(found: Any) -> SkinWeights:
    found.data[found.data < _LEAST_WEIGHT] = 0.0
    found.eliminate_zeros()
    found.sort_indices()
    sums = np.asarray(found.sum(axis=1)).ravel()
    values = found.data / np.repeat(sums, np.diff(found.indptr))
    return SkinWeights(
        found.indptr.astype(np.int32), found.indices.astype(np.int32), values.astype(np.float32)
    )


def _matrix(weights: SkinWeights, bones: int) -> Any:
    from scipy.sparse import csr_array

    shape = (len(weights.offsets) - 1, bones)
    return csr_array(
        (weights.values.astype(np.float64), weights.bones, weights.offsets), shape=shape
    )
