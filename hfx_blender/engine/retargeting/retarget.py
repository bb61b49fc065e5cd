# SPDX-License-Identifier: GPL-3.0-or-later
"""Fit of perceptual models to a user's avatar, with canonical vertex ids.

The canonical avatar is posed to the target's rest pose and pulled onto the target's skin once
(:func:`warping`). The vertices of each model follow the canonical avatar and are projected onto
the target's triangles (:func:`fit`).
"""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from ..body import model_library
from ..body.model import AVATAR_ID, Avatar, PerceptualModel, SkinWeights, load_model
from ..body.rigs.mapping import BoneMapping
from ..scene import FittedModel, SurfaceAnchors
from ..stepwise import within
from .canonical_pose import matrices, posed
from .joints import Skeletons, skeletons_of, with_placed_hinges
from .layers import Layer, leaving_out
from .limbs import Limbs
from .quality import FitQuality, judge, uncertain_places_m
from .shape_fields import fields_for, shape
from .surface import NearestSkin, TargetSurface, pull, vertex_normals
from .target import TargetAvatar, areas_of, weight_matrix
from .turns import unit

# Largest distance of projection onto the skin, metres at canonical size (1.8 m)
_LANDING_M: Final = 0.05
# Skin weights below are dropped: an error of at most 2 mm, half a metre from a joint
_LEAST_WEIGHT: Final = 0.004
# Fraction of the canonical avatar's edges shared by a reshaped copy of the mesh
_SAME_TOPOLOGY: Final = 0.95
# Largest scale of a head after removal of hats and hair (chibi characters)
_LARGEST_HEAD: Final = 4.0
# Largest fraction of such a mesh under clothes without a fit to the clothes
_UNDER_CLOTHES: Final = 0.02


@dataclass(frozen=True, eq=False)
class Warp:
    """Canonical avatar deformed to a target's shape; shared by all models."""

    target: TargetAvatar
    mapping: BoneMapping
    bodies: Skeletons
    surface: TargetSurface
    vertices: F64  # (V, 3) of the canonical avatar, normalised space
    normals: F64  # (V, 3)
    limbs: Limbs
    posed: F64  # (V, 3) vertices after posing alone, normalised space
    same: I64 | None  # (V,) target vertex of each avatar vertex if the meshes are the same
    uncertain_m: Mapping[str, float]  # place -> possible error at canonical size


def warping(
    avatar: Avatar, target: TargetAvatar, mapping: BoneMapping, layer: Layer
) -> Generator[float, None, Warp]:
    """Generator: deform the canonical avatar to a target's shape; yields progress, returns a Warp.

    Meshes with the canonical topology (MakeHuman's base mesh, the shipped avatar) and uncovered
    skin are matched vertex by vertex, without a fit. Progress is 0..1. ``layer`` ("visible" or
    "skin") has the haptic vertices where clothes cover skin. Raises InputError: the target's joints
    are missing or not human.
    """
    bodies = skeletons_of(avatar, target, mapping)
    triangles = avatar.triangles
    points = avatar.vertices.astype(np.float64)
    # Rigs place knees and elbows differently: their joints move to the most likely place.
    bodies, estimates = with_placed_hinges(bodies, points, triangles, target.triangles)
    if bodies.absent:
        target = with_mapped_bones(target, mapping)
    surface = TargetSurface(bodies.points, target.triangles, bodies.target_shares)
    yield 0.05
    # First pose, with a conservative scale of the head, only to find the layers of the surface.
    limbs, shares, fields = Limbs(avatar, bodies), bodies.avatar_shares, fields_for(avatar)
    start = posed(avatar, matrices(avatar, bodies))
    layers = leaving_out(surface, layer, start, bodies)
    left_out = yield from within(layers, 0.1, 0.3)
    # The head is measured again without hats and hair (vertices of left-out triangles only), so
    # larger scales are plausible.
    is_used = np.zeros(len(surface.points), bool)
    is_used[surface.triangles[surface.parent[~left_out]]] = True
    bare = replace(bodies, target_shares=bodies.target_shares * is_used[:, None])
    moved = matrices(avatar, bare, _LARGEST_HEAD)
    start = posed(avatar, moved)
    same, uncertain_m = _same_mesh(avatar, target), {}
    # A matched mesh with over 2 % of its area in left-out layers is under clothes: no match.
    is_covered = False
    if same is not None:
        areas = areas_of(surface.points, surface.triangles)
        is_body = np.isin(surface.triangles, same).all(axis=1)
        out = np.unique(surface.parent[left_out])
        is_covered = areas[out][is_body[out]].sum() > _UNDER_CLOTHES * areas[is_body].sum()
    if same is not None and not is_covered:
        vertices = start = bodies.points[same]
    else:
        same = None
        surface.leave_out(left_out)
        vertices = start
        if fields is not None:
            shaping = shape(fields, moved, start, triangles, bodies, surface, limbs)
            vertices = yield from within(shaping, 0.3, 0.65)
        shaped = vertices
        # The pull moves vertices across limbs only; slides along limbs are limited afterwards.
        pulling = pull(shaped, triangles, shares, limbs.axes, surface)
        vertices = yield from within(pulling, 0.65, 1.0)
        vertices = limbs.with_joints_joined(vertices, start)
        uncertain_m = uncertain_places_m(avatar, bodies, estimates, start, shaped, vertices)
    normals = vertex_normals(vertices, triangles)
    return Warp(
        target, mapping, bodies, surface, vertices, normals, limbs, start, same, uncertain_m
    )


def fit(model: PerceptualModel, warped: Warp) -> tuple[FittedModel, FitQuality]:
    """Fit a perceptual model to a target, in the target's own space and unit. Vertices lie on the
    skin of their region within 5 cm, else on the nearest skin of any; on a mesh of the canonical
    topology at their canonical offsets. The quality is measured at canonical size."""
    places, unprojected, is_there = _project(model, warped)
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
    # Distances at canonical size do not depend on the avatar's unit and height.
    distance = np.linalg.norm(places.points - unprojected, axis=1)
    nearest = model.avatar_vertices[np.arange(len(model)), model.avatar_weights.argmax(axis=1)]
    rest, _ = carried(model, warped.posed, warped.normals)
    joints = warped.limbs.offsets_m(nearest, rest, places.points, warped.surface)
    feet_forward, absent = warped.bodies.feet_forward, warped.bodies.absent
    quality = judge(
        *(model, places, shares, distance, feet_forward, joints, is_there, absent),
        warped.uncertain_m,
    )
    return fitted, quality


def fit_by_bones(
    models: Sequence[PerceptualModel], avatar: Avatar, target: TargetAvatar, mapping: BoneMapping
) -> list[FittedModel]:
    """Fit perceptual models to a target's joints alone, in the target's own space and unit.

    For avatars of rigid pieces or voxels, and meshes without a body part. The canonical skin is
    kept. Weights are mapped canonical weights; anchors are the nearest triangles, only for
    pictures. Raises InputError: the target's joints are missing or not human.
    """
    from scipy.spatial import cKDTree

    bodies = skeletons_of(avatar, target, mapping)
    vertices = posed(avatar, matrices(avatar, bodies))
    normals = vertex_normals(vertices, avatar.triangles)
    nearest = cKDTree(bodies.points[target.triangles].mean(axis=1))
    boned = with_mapped_bones(target, mapping)
    fitted = []
    for model in models:
        points, _ = carried(model, vertices, normals)
        triangle = nearest.query(points)[1]
        fitted.append(
            FittedModel(
                model_id=model.id,
                model_hash=model.content_hash,
                vertices=(points @ bodies.to_target[:3, :3].T + bodies.to_target[:3, 3]).astype(
                    np.float32
                ),
                bone_names=boned.bone_names,
                weights=_skin_weights_of(_mapped(model, boned, mapping).tocsr()),
                anchors=SurfaceAnchors(
                    target.triangles[triangle].astype(np.int32),
                    # Centres of the triangles: exact enough for pictures.
                    np.full((len(points), 3), 1.0 / 3.0),
                    np.zeros(len(points)),
                ),
            )
        )
    return fitted


def fitted_to_variant(avatar: Avatar) -> list[FittedModel]:
    """Every shipped model on the skin of an installed variant of the avatar: exact, with canonical
    ids, in the order of the manifest. Raises InputError: a model of the variant is missing or of
    another edition."""
    suffix = avatar.id.removeprefix(AVATAR_ID)
    fitted = []
    for entry in model_library.shipped():
        if entry.kind != "model":
            continue
        model = load_model(entry.id + suffix)
        owner = model_library.owner_of_ids(model.id, model.provenance)
        fitted.append(
            FittedModel(
                model_id=owner.id,
                model_hash=owner.content_hash,
                vertices=model.vertices,
                bone_names=model.bone_names,
                weights=model.weights,
                anchors=SurfaceAnchors(
                    model.avatar_vertices,
                    model.avatar_weights.astype(np.float64),
                    model.avatar_offset_m.astype(np.float64),
                ),
            )
        )
    return fitted


def carried(model: PerceptualModel, vertices: F64, normals: F64) -> tuple[F64, F64]:
    """Points and unit normals (V, 3 each) of a model on moved vertices of the canonical avatar.
    ``vertices`` and ``normals`` are of the canonical avatar, (A, 3)."""
    corners = vertices[model.avatar_vertices]
    weights = model.avatar_weights.astype(np.float64)
    across = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    points = np.einsum("vc,vci->vi", weights, corners) + model.avatar_offset_m[:, None] * across
    outward = np.einsum("vc,vci->vi", weights, normals[model.avatar_vertices])
    return points, unit(outward)


def _project(
    model: PerceptualModel, warped: Warp
) -> tuple[NearestSkin, F64, npt.NDArray[np.bool_]]:
    """Project a model's vertices onto the target: places, points (V, 3) before, skin flags (V,).
    ``found`` of a place is False for vertices without skin of their region in reach; the flag is
    True if the target has skin of the vertex's region at all."""
    points, normals = carried(model, warped.vertices, warped.normals)
    weights = model.avatar_weights.astype(np.float64)
    shares = np.einsum("vc,vcr->vr", weights, warped.bodies.avatar_shares[model.avatar_vertices])
    places = warped.surface.nearest(points, normals, shares, _LANDING_M)
    far = np.flatnonzero(~places.found)
    landed = places.points.copy()
    if len(far):
        # Bound to the nearest skin of any region and direction, so that the vertices still move
        # with the body; ``found`` stays False for the judgement of the fit.
        all_regions = np.ones((len(far), shares.shape[1]))
        nearest = warped.surface.nearest(points[far], normals[far], all_regions, np.inf, -1.0)
        places.triangle[far], places.weights[far] = nearest.triangle, nearest.weights
        places.normals[far], landed[far] = nearest.normals, nearest.points
    if warped.same is not None:
        landed = points
    has_skin: npt.NDArray[np.bool_] = shares.sum(axis=1) > 0.0
    return replace(places, points=landed), points, has_skin


def _same_mesh(avatar: Avatar, target: TargetAvatar) -> I64 | None:
    """Target vertex (V,) of each avatar vertex if the meshes have the same topology, else None.
    Tests the ids of the shipped avatar and of MakeHuman's base mesh: 95 % of the edges must
    exist."""
    # Numbers in MakeHuman's base mesh are stored as runs.
    runs = avatar.provenance.get("source_vertices", [])
    base = np.concatenate(
        [np.arange(first, last + 1) for first, last in runs] or [np.zeros(0, int)]
    )
    count = len(target.vertices)
    # Edges as single integers (smaller id times count plus larger id): set tests by numpy.
    target_sides = np.concatenate(
        [target.triangles[:, [0, 1]], target.triangles[:, [1, 2]], target.triangles[:, [2, 0]]]
    )
    target_edges = np.unique(np.sort(target_sides, axis=1) @ np.array([count, 1]))
    quads = avatar.faces.astype(np.int64)
    edges = np.sort(
        np.concatenate([np.column_stack((quads[:, k], quads[:, (k + 1) % 4])) for k in range(4)])
    )
    for ids in (np.arange(len(avatar.vertices)), base):
        if len(ids) == len(avatar.vertices) and ids.max() < count:
            own_edges = np.sort(ids[edges], axis=1) @ np.array([count, 1])
            if np.isin(own_edges, target_edges).mean() >= _SAME_TOPOLOGY:
                return ids.astype(np.int64)
    return None


def _skin_weights(
    model: PerceptualModel, warped: Warp, anchors: SurfaceAnchors, has_skin: npt.NDArray[np.bool_]
) -> SkinWeights:
    """Target's skin weights at the anchors, interpolated; mapped canonical weights where
    ``has_skin`` (V,) is False or the target has no weight."""
    from scipy.sparse import coo_array, diags_array

    target, count = warped.target, len(model)
    target_weights = weight_matrix(target.weights, len(target.bone_names))
    rows = np.repeat(np.arange(count), 3)
    interpolation = coo_array(
        (anchors.weights.ravel(), (rows, anchors.corners.ravel())),
        shape=(count, len(target.vertices)),
    ).tocsr()
    # Weights at a vertex: barycentric mean of the corners' weights, as a sparse product.
    blended = interpolation @ target_weights
    is_bare = (np.asarray(blended.sum(axis=1)).ravel() < 1e-6) | ~has_skin
    if is_bare.any():
        canonical = _mapped(model, target, warped.mapping)
        blended = diags_array(1.0 - is_bare) @ blended + diags_array(1.0 * is_bare) @ canonical
    return _skin_weights_of(blended.tocsr())


def with_mapped_bones(target: TargetAvatar, mapping: BoneMapping) -> TargetAvatar:
    """Copy of a target with all mapped and fallback bones appended to ``bone_names``, each once."""
    moving = (*mapping.bones.values(), *mapping.fallbacks.values())
    return replace(target, bone_names=tuple(dict.fromkeys((*target.bone_names, *moving))))


def _mapped(model: PerceptualModel, target: TargetAvatar, mapping: BoneMapping) -> Any:
    """Sparse matrix (V, target bones) of canonical skin weights on mapped or fallback bones;
    weights of bones that the target lacks are dropped."""
    from scipy.sparse import coo_array

    index = {name: number for number, name in enumerate(target.bone_names)}
    follows = {**mapping.fallbacks, **mapping.bones}
    pairs = [
        (number, index[rig_bone])
        for number, name in enumerate(model.bone_names)
        if (rig_bone := follows.get(name)) in index
    ]
    canonical_ids, target_ids = np.array(pairs).reshape(-1, 2).T
    shape = (len(model.bone_names), len(target.bone_names))
    bone_matrix = coo_array(
        (np.ones(len(canonical_ids)), (canonical_ids, target_ids)), shape=shape
    ).tocsr()
    return weight_matrix(model.weights, len(model.bone_names)) @ bone_matrix


def _skin_weights_of(matrix: Any) -> SkinWeights:
    """Skin weights of a sparse matrix (V, bones), changed in place: entries below 0.004 dropped,
    rows scaled to sum 1."""
    matrix.data[matrix.data < _LEAST_WEIGHT] = 0.0
    matrix.eliminate_zeros()
    matrix.sort_indices()
    sums = np.asarray(matrix.sum(axis=1)).ravel()
    values = matrix.data / np.repeat(sums, np.diff(matrix.indptr))
    return SkinWeights(
        matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), values.astype(np.float32)
    )
