# SPDX-License-Identifier: GPL-3.0-or-later
"""Assembly of a whole perceptual model, with all fields, from the left half of its mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hfx_blender.engine.arrays import F64, I32, I64, U8
from hfx_blender.engine.body.model import Avatar, PerceptualModel, Skeleton, SkinWeights
from hfx_blender.engine.body.parts import CENTRE, LEFT, RIGHT

from .left_skin import Half
from .meshes.mesh_edges import edges_of, triangle_normals
from .meshes.nearest_places import locate

if TYPE_CHECKING:
    from scipy.sparse import csr_array


SMALLEST_WEIGHT: Final = 1e-3
"""Smallest stored skin weight. Dropping smaller weights moves no vertex by more than a millimetre;
a limit of four weights a vertex would cost 13-19 mm in deep bends."""


@dataclass(frozen=True, eq=False)
class Whole:
    """Whole mesh, both halves, vertices in canonical order."""

    points: F64  # (V, 3)
    triangles: I64  # (F, 3)
    part: U8  # (V,)
    side: U8  # (V,)
    mirror: I64  # (V,)
    origin: I64  # (V,) vertex of the left half, equal or mirrored


def whole(half: Half) -> Whole:
    """Mirror a half and put its vertices into canonical order.

    The order is by part, then side (centre, left, right), then along a walk through the
    neighbours (reverse Cuthill-McKee), so that near vertices have near ids. The right side is in
    the order of the left.
    """
    count = len(half.points)
    off_midline = np.flatnonzero(~half.is_midline)
    twin = np.arange(count)
    twin[off_midline] = count + np.arange(len(off_midline))
    origin = np.concatenate((np.arange(count), off_midline))
    points = half.points[origin]
    points[count:, 0] *= -1.0
    side = np.where(half.is_midline, CENTRE, LEFT)[origin].astype(np.uint8)
    side[count:] = RIGHT
    triangles = np.concatenate((half.triangles, twin[half.triangles][:, ::-1]))
    mirror = np.concatenate((twin, off_midline))

    order = np.lexsort((_walk(half)[origin], side, half.part[origin]))
    new_id = np.zeros(len(points), np.int64)
    new_id[order] = np.arange(len(points))
    triangles = new_id[triangles]
    # Each triangle starts at its lowest id, and the triangles are in ascending order.
    first = np.argmin(triangles, axis=1)
    triangles = np.take_along_axis(triangles, (first[:, None] + np.arange(3)) % 3, axis=1)
    triangles = triangles[np.lexsort(triangles.T[::-1])]
    return Whole(
        points[order],
        triangles,
        half.part[origin[order]],
        side[order],
        new_id[mirror[order]],
        origin[order],
    )


def _walk(half: Half) -> I64:
    """Rank of each vertex on a breadth-first walk through its part."""
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    ends = edges_of(half.triangles, len(half.points)).ends
    same = half.part[ends[:, 0]] == half.part[ends[:, 1]]
    start, end = ends[same].T
    size = (len(half.points),) * 2
    ones = np.ones(2 * len(start), np.int8)
    rows, columns = np.concatenate((start, end)), np.concatenate((end, start))
    graph = csr_array(coo_array((ones, (rows, columns)), shape=size))
    graph.indices, graph.indptr = graph.indices.astype(np.int32), graph.indptr.astype(np.int32)
    rank = np.zeros(len(half.points), np.int64)
    rank[reverse_cuthill_mckee(graph, symmetric_mode=True)] = np.arange(len(half.points))
    return rank


def triangles_of(faces: I32) -> I64:
    """Split quads along the diagonal from their first corner; ``-1`` marks a triangle."""
    quads = faces.astype(np.int64)
    true_quads = quads[quads[:, 3] >= 0]
    return np.concatenate((quads[:, [0, 1, 2]], true_quads[:, [0, 2, 3]]))


def sparse_weights(weights: csr_array) -> SkinWeights:
    """Convert skin weights (V, B) to stored form: small weights dropped, each row of sum 1."""
    from scipy.sparse import csr_array, diags_array

    table = csr_array(weights).copy()
    table.data[table.data < SMALLEST_WEIGHT] = 0.0
    table.eliminate_zeros()
    table.sort_indices()
    table = csr_array(diags_array(1.0 / np.asarray(table.sum(axis=1)).ravel()) @ table)
    table.sort_indices()
    return SkinWeights(
        offsets=table.indptr.astype(np.int32),
        bones=table.indices.astype(np.int32),
        values=table.data.astype(np.float32),
    )


def vertex_normals(points: F64, triangles: I64) -> F64:
    """Unit normals (V, 3): area-weighted mean of the adjacent triangles.

    A zero mean is replaced by the largest adjacent triangle's normal, or (0, 0, 1) without area.
    """
    facing = triangle_normals(points, triangles)
    total = np.zeros_like(points)
    for corner in range(3):
        np.add.at(total, triangles[:, corner], facing)
    flat = np.flatnonzero(np.linalg.norm(total, axis=1) == 0.0)
    for vertex in flat:  # triangles back to back, left by decimation
        around = facing[(triangles == vertex).any(axis=1)]
        sizes = np.linalg.norm(around, axis=1)
        total[vertex] = around[sizes.argmax()] if sizes.any() else (0.0, 0.0, 1.0)
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def model(
    identity: str,
    modality: str,
    half: Half,
    half_areas_m2: F64,
    avatar: Avatar,
    dense_weights: tuple[F64, I64, csr_array],
    provenance: dict[str, Any],
) -> PerceptualModel:
    """Assemble a perceptual model from the left half of its mesh.

    Parameters
    ----------
    half_areas_m2 : (V,) float64
        Skin of each vertex of the half; a midline vertex has the same area on the right.
    dense_weights : points (D, 3), triangles (T, 3), weights (D, B)
        Left half of the dense skin, source of the vertices' weights.
    """
    from scipy.sparse import csr_array, diags_array

    body = whole(half)
    areas = (half_areas_m2 * np.where(half.is_midline, 2.0, 1.0))[body.origin]
    weights = _weights_at(half.points, dense_weights)
    mirrored = weights[:, mirrored_bones(avatar.skeleton)]
    on_left, on_right = ((body.side == label).astype(float) for label in (LEFT, RIGHT))
    middle = 0.5 * (body.side == CENTRE)  # mean of both sides
    weights = (
        diags_array(on_left + middle) @ weights[body.origin]
        + diags_array(on_right + middle) @ mirrored[body.origin]
    )
    avatar_triangles = triangles_of(avatar.faces)
    over, over_weights, offset = locate(
        body.points, avatar.vertices.astype(np.float64), avatar_triangles
    )
    return PerceptualModel(
        id=identity,
        modality=modality,
        vertices=body.points.astype(np.float32),
        triangles=body.triangles.astype(np.int32),
        normals=vertex_normals(body.points, body.triangles).astype(np.float32),
        areas_m2=areas.astype(np.float32),
        part=body.part.astype(np.uint8),
        side=body.side.astype(np.uint8),
        mirror=body.mirror.astype(np.int32),
        bone_names=avatar.skeleton.bone_names,
        weights=sparse_weights(csr_array(weights)),
        avatar_vertices=avatar_triangles[over].astype(np.int32),
        avatar_weights=over_weights.astype(np.float32),
        avatar_offset_m=offset.astype(np.float32),
        provenance=provenance,
    )


def _weights_at(points: F64, dense: tuple[F64, I64, csr_array]) -> csr_array:
    """Skin weights (P, B) at points (P, 3), interpolated on the dense skin's triangles."""
    from scipy.sparse import coo_array, csr_array

    surface, triangles, weights = dense
    triangle, shares, _ = locate(points, surface, triangles)
    rows = np.repeat(np.arange(len(points)), 3)
    columns = triangles[triangle].ravel()
    mix = coo_array((shares.ravel(), (rows, columns)), shape=(len(points), len(surface)))
    return csr_array(csr_array(mix) @ weights)


def mirrored_bones(skeleton: Skeleton) -> I64:
    """Index of each bone's mirror twin; a bone without a twin gets its own index."""
    index = {name: number for number, name in enumerate(skeleton.bone_names)}
    opposite = {"L": "R", "R": "L"}
    return np.array(
        [
            index[f"{name[:-1]}{opposite[name[-1]]}"] if name[-2:] in (".L", ".R") else number
            for number, name in enumerate(skeleton.bone_names)
        ],
        np.int64,
    )
