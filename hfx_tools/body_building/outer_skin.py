# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin: the outer surface of the base mesh, capped, smoothed and scaled.

The base mesh is one closed surface with eye sockets, mouth and throat as pockets. Pockets are
separate islands of the texture layout; they are cut off, and the three openings are closed by
strips of quads from lid to lid and from lip to lip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F64, I32

from .source import Source

if TYPE_CHECKING:
    from scipy.sparse import csr_array


HEIGHT_M: Final = 1.8
POCKETS: Final = (1, 3, 6)
"""Texture islands inside the body: mouth with throat, eye sockets."""

LEVELS: Final = 3
"""Catmull-Clark steps from the base mesh to the dense skin."""


@dataclass(frozen=True, eq=False)
class Skin:
    """Closed quad surface in metres, soles at Z = 0; the first vertices are the avatar's."""

    vertices: F64  # (V, 3)
    faces: I32  # (F, 4)
    weights: csr_array  # (V, B) skin weights, rows sum to 1
    mirror: I32  # (V,)


@dataclass(frozen=True, eq=False)
class Skins:
    """Coarse skin of the avatar, and the dense skin by subdivision."""

    avatar: Skin
    dense: Skin
    medium_faces: I32  # (F / 4, 4) one step before the dense skin, in its vertex ids
    uv: F64  # (F, 4, 2) of the avatar's faces
    source_vertices: I32  # (V,) avatar vertex -> vertex of the base mesh
    scale: float  # base mesh to rest space
    ground_m: float  # height of the soles in the base mesh, after scaling
    steps: tuple[csr_array, ...] = ()  # subdivision operators, avatar to dense skin


def outer_faces(source: Source) -> tuple[I32, F64]:
    """Faces of the skin, pockets cut off and capped, in vertex ids of the base mesh.

    Returns
    -------
    faces : (F, 4) int32
        Closed, consistently oriented.
    uv : (F, 4, 2) float64
    """
    pocket = np.isin(source.island, POCKETS)
    faces, uv = source.faces[~pocket], source.uv[~pocket]
    uv_of = np.zeros((len(source.vertices), 2))
    uv_of[faces.ravel()] = uv.reshape(-1, 2)
    caps: list[I32] = []
    for island in POCKETS:
        loop = _boundary(source.faces[source.island == island])
        centred = source.vertices[loop, 0]
        if centred.max() > 0.0:  # the right eye is the mirror image of the left eye
            cap = _strip(loop, source.vertices)
            caps.append(cap)
            if centred.min() > 0.0:
                caps.append(source.mirror[cap][:, ::-1])
    strips = np.concatenate(caps)
    # Cap corners take the layout of the skin around them: lids and lips, stretched across.
    uv_of[strips.ravel()] = _skin_uv(faces, uv, strips.ravel())
    return np.concatenate((faces, strips)), np.concatenate((uv, uv_of[strips]))


def _skin_uv(faces: I32, uv: F64, vertices: I32) -> F64:
    flat, corners = faces.ravel(), uv.reshape(-1, 2)
    order = np.argsort(flat, kind="stable")
    first = order[np.searchsorted(flat[order], vertices)]
    return corners[first]


def _boundary(faces: I32) -> I32:
    """Boundary loop of a patch with a single boundary, in the direction of the patch's faces."""
    edges = np.concatenate([faces[:, [k, (k + 1) % 4]] for k in range(4)]).tolist()
    known = {(start, end) for start, end in edges}
    following = {start: end for start, end in edges if (end, start) not in known}
    loop = [min(following)]
    while (vertex := following[loop[-1]]) != loop[0]:
        loop.append(vertex)
    return np.array(loop, np.int32)


def _strip(loop: I32, vertices: F64) -> I32:
    """Close an even loop by one strip of quads between its two halves.

    Of all foldings of the loop into two halves, the strip with the shortest rungs is returned.
    """
    half = len(loop) // 2

    def rungs(turn: int) -> tuple[I32, I32]:
        turned = np.roll(loop, -turn)
        return turned[:half], turned[half:][::-1]

    def length(turn: int) -> float:
        left, right = rungs(turn)
        return float(np.linalg.norm(vertices[left] - vertices[right], axis=1).sum())

    left, right = rungs(min(range(half), key=length))
    return np.column_stack((left[:-1], left[1:], right[1:], right[:-1])).astype(np.int32)


def make(source: Source, bone_names: tuple[str, ...]) -> Skins:
    """Build avatar and dense skin, scaled to an avatar of exactly :data:`HEIGHT_M`."""
    from scipy.sparse import csr_array

    cage_faces, uv = outer_faces(source)
    used, inverse = np.unique(cage_faces, return_inverse=True)
    faces = inverse.reshape(cage_faces.shape).astype(np.int32)
    renumber = np.full(len(source.vertices), -1, np.int32)
    renumber[used] = np.arange(len(used), dtype=np.int32)

    rows, columns, values = _weight_triples(source.weights, bone_names)
    weights = csr_array((values, (rows, columns)), shape=(len(source.vertices), len(bone_names)))[
        used
    ]
    vertices, mirror = source.vertices[used], renumber[source.mirror[used]]

    count = len(used)
    dense_faces = faces
    steps: list[csr_array] = []
    for _ in range(LEVELS):
        medium_faces = dense_faces
        operator, finer, new_mirror = subdivide(dense_faces, mirror)
        steps.append(operator)
        weights = operator @ weights
        dense_faces, mirror = finer, new_mirror
    vertices, scale, ground_m = _scaled_vertices(vertices, steps, mirror, HEIGHT_M)
    dense = Skin(vertices, dense_faces, csr_array(weights), mirror)
    avatar = Skin(vertices[:count], faces, dense.weights[:count], mirror[:count])
    return Skins(
        avatar, dense, medium_faces, uv, used.astype(np.int32), scale, ground_m, tuple(steps)
    )


def reshape(skins: Skins, base_vertices: F64, height_m: float | None) -> Skins:
    """Apply another shape of the base mesh to the skins; returns new skins.

    Parameters
    ----------
    base_vertices : (V, 3) float64
        Vertices of the base mesh, metres.
    height_m : float or None
        Height of the avatar after scaling; None: no scaling.
    """
    cage = base_vertices[skins.source_vertices]
    vertices, scale, ground_m = _scaled_vertices(cage, skins.steps, skins.dense.mirror, height_m)
    return replace(
        skins,
        avatar=replace(skins.avatar, vertices=vertices[: len(cage)]),
        dense=replace(skins.dense, vertices=vertices),
        scale=scale,
        ground_m=ground_m,
    )


def _scaled_vertices(
    cage: F64, steps: Sequence[csr_array], mirror: I32, height_m: float | None
) -> tuple[F64, float, float]:
    """Subdivided, symmetric and scaled vertices; the scale; the scaled height of the soles."""
    vertices = cage
    for operator in steps:
        vertices = operator @ vertices
    vertices = _symmetric_vertices(vertices, mirror)
    lowest, highest = vertices[: len(cage), 2].min(), vertices[: len(cage), 2].max()
    scale = 1.0 if height_m is None else height_m / (highest - lowest)
    return scale * (vertices - (0.0, 0.0, lowest)), scale, scale * lowest


def _weight_triples(
    weights: dict[str, list[tuple[int, float]]], bone_names: tuple[str, ...]
) -> tuple[I32, I32, F64]:
    rows, columns, values = [], [], []
    for column, name in enumerate(bone_names):
        for vertex, value in weights.get(name, ()):
            rows.append(vertex)
            columns.append(column)
            values.append(value)
    return np.array(rows, np.int32), np.array(columns, np.int32), np.array(values)


def _symmetric_vertices(vertices: F64, mirror: I32) -> F64:
    """Mirror the left half onto the right and set the midline to x = 0; returns a copy."""
    result = vertices.copy()
    right = vertices[:, 0] < vertices[mirror, 0]
    result[right] = vertices[mirror[right]] * (-1.0, 1.0, 1.0)
    result[mirror == np.arange(len(mirror)), 0] = 0.0
    return result


def subdivide(faces: I32, mirror: I32) -> tuple[Any, I32, I32]:
    """Build one step of Catmull-Clark subdivision of a closed quad mesh as a linear operator.

    Source: Catmull and Clark, Computer-Aided Design 10(6), 1978.

    Parameters
    ----------
    faces : (F, 4) int32
    mirror : (V,) int32

    Returns
    -------
    operator : (V + F + E, V) sparse float64
        Old points to new points: moved old vertices, then face points, then edge points.
    faces : (4 F, 4) int32
    mirror : (V + F + E,) int32
    """
    from scipy.sparse import coo_array, csr_array, diags_array, vstack

    face_count, count = len(faces), len(mirror)
    starts, ends = faces, np.roll(faces, -1, axis=1)
    keys = np.minimum(starts, ends).astype(np.int64) * count + np.maximum(starts, ends)
    edge_keys, edge_of = np.unique(keys, return_inverse=True)
    edge_of = edge_of.reshape(faces.shape)
    edges = np.column_stack((edge_keys // count, edge_keys % count))
    edge_count = len(edges)

    def incidence(columns: npt.NDArray[Any], shape: tuple[int, int], value: float) -> Any:
        rows = np.repeat(np.arange(shape[0]), columns.shape[1])
        return csr_array(
            coo_array((np.full(columns.size, value), (rows, columns.ravel())), shape=shape)
        )

    face_points = incidence(faces, (face_count, count), 0.25)
    edge_means = incidence(edges, (edge_count, count), 0.5)
    faces_at_edge = incidence(edge_of, (face_count, edge_count), 0.5).T @ face_points
    edge_points = 0.5 * (edge_means + faces_at_edge)
    degree = np.bincount(faces.ravel(), minlength=count).astype(float)
    face_mean = incidence(faces, (face_count, count), 1.0).T @ face_points
    edge_mean = incidence(edges, (edge_count, count), 1.0).T @ edge_means
    # Catmull-Clark rule for a vertex of degree n: F / n + 2 R / n + (n - 3) P / n.
    moved = diags_array(degree**-2) @ (face_mean + 2.0 * edge_mean) + diags_array(
        (degree - 3.0) / degree
    )
    face_ids = count + np.arange(face_count)[:, None]
    edge_ids = count + face_count + edge_of
    finer = np.stack(
        (starts, edge_ids, np.broadcast_to(face_ids, faces.shape), np.roll(edge_ids, 1, axis=1)),
        axis=2,
    ).reshape(-1, 4)

    face_lookup = {tuple(row): index for index, row in enumerate(np.sort(faces, axis=1).tolist())}
    face_mirror = [face_lookup[tuple(row)] for row in np.sort(mirror[faces], axis=1).tolist()]
    turned = np.sort(mirror[edges], axis=1).astype(np.int64)
    edge_mirror = np.searchsorted(edge_keys, turned[:, 0] * count + turned[:, 1])
    new_mirror = np.concatenate(
        (mirror, count + np.array(face_mirror), count + face_count + edge_mirror)
    )
    operator = vstack((moved, face_points, edge_points), format="csr")
    return operator, finer.astype(np.int32), new_mirror.astype(np.int32)
