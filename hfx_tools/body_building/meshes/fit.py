# SPDX-License-Identifier: GPL-3.0-or-later
"""Fit of a relaxed mesh to the skin, without self-intersections.

Even cells ignore the chords between their centres. Here the vertices of finely spaced parts are
raised by the depth of the chords, diagonals through a coarse limb are flipped, and crossing
triangles are drawn apart.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64, Bool

from . import mesh_edges, mesh_edit
from .crossings import crossings
from .nearest_places import locate
from .remesher import Remesher
from .uncross import COARSE_M, uncross

_FLIP_GAIN: Final = 0.02  # smallest gain of a flipped diagonal, as a share of the spacing
_SMALLEST_ANGLE: Final = np.radians(12.0)
_RAISED_UP_TO_M: Final = 0.0315  # spacing
_RAISED_FROM_M: Final = 0.012
_RAISE_LIMIT_M: Final = 0.0015
_RAISE_SAMPLES: Final = 30_000
_RAISE_DAMPING: Final = 0.005
_UNTANGLE_ROUNDS: Final = 30
_UNTANGLE_LIMIT: Final = 0.25  # of the spacing
_CONNECT_ROUNDS: Final = 10


def fit(mesh: Remesher) -> None:
    """Fit a relaxed mesh to its skin, in place."""
    _connect(mesh)
    _exchange_diagonals(mesh)
    mesh.points = raised(mesh)
    _untangle(mesh)
    uncross(mesh)


def _connect(mesh: Remesher) -> None:
    """Reconnect vertices cut off from their part.

    Cells of one part may touch in a corner only; the diagonal is then flipped. A vertex that no
    flip can connect joins the most frequent part around it.
    """
    for turn in range(_CONNECT_ROUNDS):
        edges = mesh_edges.edges_of(mesh.triangles, len(mesh.points))
        stray = _stray(mesh, edges)
        if not stray.any():
            return
        c, d = edges.opposite.T
        across = np.flatnonzero(
            ~edges.is_border & (stray[c] != stray[d]) & (mesh.part[c] == mesh.part[d])
        )
        mesh.triangles, done = mesh_edit.flip(
            mesh.points, mesh.triangles, edges, across, mesh.is_midline, turn, mesh.normals
        )
        if not done:
            offsets, around = mesh_edit.neighbours(edges)
            for vertex in np.flatnonzero(stray):
                parts = mesh.part[around[offsets[vertex] : offsets[vertex + 1]]]
                others = parts[parts != mesh.part[vertex]]
                if len(others):
                    mesh.part[vertex] = np.bincount(others).argmax()


def _stray(mesh: Remesher, edges: mesh_edges.Edges) -> Bool:
    """Mask (V,) of vertices outside the largest connected piece of their part."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    start, end = edges.ends[(mesh.part[edges.ends[:, 0]] == mesh.part[edges.ends[:, 1]])].T
    size = (len(mesh.points),) * 2
    piece = connected_components(
        coo_array((np.ones(len(start)), (start, end)), shape=size), directed=False
    )[1]
    stray = np.zeros(len(mesh.points), bool)
    for part in np.unique(mesh.part):
        own = mesh.part == part
        stray |= own & (piece != np.bincount(piece[own]).argmax())
    return stray


def _exchange_diagonals(mesh: Remesher) -> None:
    """Flip edges of coarse parts if the opposite diagonal's middle is nearer to the skin."""
    from scipy.spatial import cKDTree

    if (mesh.spacing_m < COARSE_M).all():
        return
    skin = cKDTree(mesh.samples.points)

    def depth(start: I64, end: I64) -> F64:
        return skin.query(0.5 * (mesh.points[start] + mesh.points[end]))[0]

    for turn in range(8):
        edges = mesh_edges.edges_of(mesh.triangles, len(mesh.points))
        index = np.flatnonzero(~edges.is_border)
        a, b = edges.ends[index].T
        c, d = edges.opposite[index].T
        spacing = mesh.spacing_m[mesh.part]
        coarsest = np.max((spacing[a], spacing[b], spacing[c], spacing[d]), axis=0)
        is_better = depth(a, b) - depth(c, d) > _FLIP_GAIN * coarsest
        is_better &= coarsest >= COARSE_M
        is_better &= _smallest_angle(mesh.points, a, b, c, d) > _SMALLEST_ANGLE
        mesh.triangles, done = mesh_edit.flip(
            mesh.points,
            mesh.triangles,
            edges,
            index[is_better],
            mesh.is_midline,
            turn,
            mesh.normals,
        )
        if not done:
            break


def _smallest_angle(points: F64, a: I64, b: I64, c: I64, d: I64) -> F64:
    """Smallest angle of the two triangles at a diagonal from c to d, radians."""
    angles = []
    for apex, left, right in ((c, a, d), (a, c, d), (d, a, c), (c, b, d), (b, c, d), (d, b, c)):
        u, v = points[left] - points[apex], points[right] - points[apex]
        area = np.linalg.norm(np.cross(u, v), axis=1)
        angles.append(np.arctan2(area, np.einsum("ij,ij->i", u, v)))
    return np.min(angles, axis=0)


def raised(mesh: Remesher) -> F64:
    """Vertices (V, 3) moved along their normals, so that triangles lie on the skin on average.

    The heights are a damped least-squares fit to the distances of skin samples from the mesh.
    """
    from scipy.sparse import coo_array, csr_array, diags_array
    from scipy.sparse.linalg import spsolve

    if (mesh.spacing_m >= COARSE_M).any():
        return mesh.points  # chords through whole limbs are far deeper than the allowed height
    spacing = mesh.spacing_m[mesh.samples.part]
    chosen = np.flatnonzero((spacing >= _RAISED_FROM_M) & (spacing <= _RAISED_UP_TO_M))
    if not len(chosen):
        return mesh.points
    chosen = chosen[:: max(1, len(chosen) // _RAISE_SAMPLES)]
    triangle, shares, height = locate(
        mesh.samples.points[chosen], mesh.points, mesh.triangles, candidates=3
    )
    rows = np.repeat(np.arange(len(chosen)), 3)
    size = (len(chosen), len(mesh.points))
    columns = mesh.triangles[triangle].ravel()
    mix = csr_array(coo_array((shares.ravel(), (rows, columns)), shape=size))
    normal = mix.T @ mix
    held = _RAISE_DAMPING * normal.diagonal().max() * np.ones(len(mesh.points))
    heights = spsolve((normal + diags_array(held)).tocsc(), mix.T @ height)
    own = mesh.spacing_m[mesh.part]
    heights[(own < _RAISED_FROM_M) | (own > _RAISED_UP_TO_M)] = 0.0
    heights = np.clip(heights, -_RAISE_LIMIT_M, _RAISE_LIMIT_M)
    points: F64 = mesh.points + heights[:, None] * mesh.normals
    points[mesh.is_midline, 0] = 0.0
    return points


def _untangle(mesh: Remesher) -> None:
    """Draw the vertices of crossing triangles toward the middle of their neighbours."""
    from scipy.sparse import coo_array, csr_array

    edges = mesh_edges.edges_of(mesh.triangles, len(mesh.points))
    starts, ends = edges.ends.T
    size = (len(mesh.points),) * 2
    graph = csr_array(coo_array((np.ones(len(starts)), (starts, ends)), shape=size))
    graph = graph + graph.T
    mean = csr_array(graph / np.asarray(graph.sum(axis=1))[:, None])
    start = mesh.points.copy()
    movable: Bool = mesh.spacing_m[mesh.part] < COARSE_M
    for _ in range(_UNTANGLE_ROUNDS):
        crossing = np.unique(crossings(mesh.points, mesh.triangles))
        crossing = crossing[movable[crossing]]
        if not len(crossing):
            return
        middle = mean[crossing] @ mesh.points
        moved = mesh.points[crossing] + 0.3 * (middle - mesh.points[crossing]) - start[crossing]
        limit = _UNTANGLE_LIMIT * mesh.local_spacing_m()[crossing]
        length = np.maximum(np.linalg.norm(moved, axis=1), 1e-30)
        moved *= np.minimum(1.0, limit / length)[:, None]
        mesh.points[crossing] = start[crossing] + moved
        mesh.points[mesh.is_midline, 0] = 0.0
