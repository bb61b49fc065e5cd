# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets of edge collapses, splits and flips on a triangle mesh, without change of topology.

The mesh is half a body: an open manifold disc with the midline as its only border. Only
operations without a common triangle are done together.
"""

from __future__ import annotations

import numpy as np

from hfx_blender.engine.arrays import F64, I64, Bool, expand

from .mesh_edges import Edges, edges_of, key, triangle_normals


def neighbours(edges: Edges) -> tuple[I64, I64]:
    """Neighbours of each vertex: row ``v`` is ``slice(offsets[v], offsets[v + 1])``."""
    starts = np.concatenate((edges.ends[:, 0], edges.ends[:, 1]))
    ends = np.concatenate((edges.ends[:, 1], edges.ends[:, 0]))
    order = np.lexsort((ends, starts))
    offsets = np.searchsorted(starts[order], np.arange(edges.count + 1))
    return offsets.astype(np.int64), ends[order]


def scatter_ranks(count: int, seed: int) -> I64:
    """Permutation of ``count`` numbers, equal for equal seeds."""
    return np.random.default_rng(seed).permutation(count)


def independent(edges: Edges, start: I64, end: I64, rank: I64) -> Bool:
    """Mask of candidate edges with the lowest rank within one edge around them."""
    worst = np.iinfo(np.int64).max
    own = np.full(edges.count, worst)
    np.minimum.at(own, start, rank)
    np.minimum.at(own, end, rank)
    # Ranks spread by one edge, so no two winners are adjacent.
    around = own.copy()
    np.minimum.at(around, edges.ends[:, 0], own[edges.ends[:, 1]])
    np.minimum.at(around, edges.ends[:, 1], own[edges.ends[:, 0]])
    return (around[start] == rank) & (around[end] == rank)


def collapsible(
    points: F64, normals: F64, triangles: I64, edges: Edges, gone: I64, stays: I64, fold: float
) -> Bool:
    """Test edges for a collapse of ``gone[i]`` into ``stays[i]`` without a fold or a pinch.

    The only common neighbours may be the vertices opposite of the edge (link condition, Dey et al.
    1999), and no triangle may turn from the skin by more than ``arccos(fold)``.
    """
    offsets, around = neighbours(edges)
    places, owner = expand(offsets, gone)
    # Link condition: count the neighbours common to both ends.
    shared = edges.exists(around[places], stays[owner]) & (around[places] != stays[owner])
    common = np.bincount(owner[shared], minlength=len(gone))
    index = np.searchsorted(edges.keys, key(gone, stays, edges.count))
    allowed = common == np.where(edges.is_border[index], 1, 2)

    # Triangles around the removed vertex, without the vanishing ones, must not turn over.
    corner_order = np.argsort(triangles.ravel(), kind="stable")
    corner_offsets = np.searchsorted(triangles.ravel()[corner_order], np.arange(edges.count + 1))
    places, owner = expand(corner_offsets.astype(np.int64), gone)
    moved = triangles[corner_order[places] // 3]
    is_moved = ~(moved == stays[owner][:, None]).any(axis=1)
    moved, owner = moved[is_moved], owner[is_moved]
    after = np.where(moved == gone[owner][:, None], stays[owner][:, None], moved)
    facing = triangle_normals(points, after)
    skin = normals[after].sum(axis=1)
    cosine = np.einsum("ij,ij->i", facing, skin) / np.maximum(
        np.linalg.norm(facing, axis=1) * np.linalg.norm(skin, axis=1), 1e-30
    )
    allowed[owner[cosine < fold]] = False
    return allowed


def collapse(triangles: I64, gone: I64, stays: I64, count: int) -> I64:
    """Merge each ``gone[i]`` into ``stays[i]`` and drop vanished triangles; returns a new array."""
    target = np.arange(count)
    target[gone] = stays
    merged = target[triangles]
    alive = (
        (merged[:, 0] != merged[:, 1])
        & (merged[:, 1] != merged[:, 2])
        & (merged[:, 2] != merged[:, 0])
    )
    return merged[alive]


def split(triangles: I64, edges: Edges, chosen: I64) -> tuple[I64, I64]:
    """Put a new vertex on edges; an edge is skipped if its triangle is split by an earlier one.

    ``chosen`` (N,) int64: edges, in order of priority.

    Returns
    -------
    triangles : (F', 3) int64
        The new vertices are numbered from ``edges.count`` on.
    done : (M,) int64
        Split edges, in the order of their new vertices.
    """
    # Each triangle keeps its first edge; an edge wins if both its triangles keep it.
    rank = np.arange(len(chosen))
    best = np.full(len(triangles) + 1, len(chosen))  # the last entry is for "no triangle"
    first, second = edges.triangle[chosen].T
    np.minimum.at(best, first, rank)
    np.minimum.at(best, second, rank)
    wins = (best[first] == rank) & ((best[second] == rank) | (second < 0))
    done = chosen[wins]
    new = edges.count + np.arange(len(done))
    # The first half replaces a triangle in place, the second half is appended.
    pieces = [triangles.copy()]
    for column in range(2):
        has = edges.triangle[done, column] >= 0
        triangle, vertex = edges.triangle[done[has], column], new[has]
        apex = edges.opposite[done[has], column]
        rows = triangles[triangle]
        turn = np.argmax(rows == apex[:, None], axis=1)
        start = rows[np.arange(len(rows)), (turn + 1) % 3]
        end = rows[np.arange(len(rows)), (turn + 2) % 3]
        pieces[0][triangle] = np.column_stack((apex, start, vertex))
        pieces.append(np.column_stack((apex, vertex, end)))
    return np.concatenate(pieces), done


def flip_to_delaunay(points: F64, triangles: I64, is_midline: Bool, rounds: int = 12) -> I64:
    """Flip edges with opposite angles of more than pi together; returns new triangles."""
    for turn in range(rounds):
        edges = edges_of(triangles, len(points))
        index = np.flatnonzero(~edges.is_border)
        a, b = edges.ends[index].T
        c, d = edges.opposite[index].T
        bad = _cotangent(points, c, a, b) + _cotangent(points, d, a, b) < -1e-9
        triangles, done = flip(points, triangles, edges, index[bad], is_midline, turn)
        if not done:
            break
    return triangles


def flip(
    points: F64,
    triangles: I64,
    edges: Edges,
    chosen: I64,
    is_midline: Bool,
    seed: int,
    normals: F64 | None = None,
) -> tuple[I64, int]:
    """Replace inner edges by the opposite diagonal of their two triangles, if safe.

    A flip must not duplicate an edge, join two midline vertices by a chord or turn a triangle
    over: away from the two old triangles, or from the vertices' ``normals`` if given.

    Returns
    -------
    triangles : (F, 3) int64
    done : int
        Number of flipped edges; of several flips at one triangle only one is done.
    """
    (a, b), (c, d) = edges.ends[chosen].T, edges.opposite[chosen].T
    allowed = ~(is_midline[c] & is_midline[d]) & (c != d) & ~edges.exists(c, d)
    chosen, a, b, c, d = chosen[allowed], a[allowed], b[allowed], c[allowed], d[allowed]
    # In the first triangle the edge runs from `start` to `end`, and c is opposite.
    first, second = edges.triangle[chosen].T
    rows = triangles[first]
    forward = ((rows == a[:, None]) & (np.roll(rows, -1, axis=1) == b[:, None])).any(axis=1)
    start, end = np.where(forward, a, b), np.where(forward, b, a)
    left_triangle, right_triangle = np.column_stack((start, d, c)), np.column_stack((d, end, c))
    if normals is None:
        facing = triangle_normals(points, rows) + triangle_normals(points, triangles[second])
    else:
        facing = normals[a] + normals[b] + normals[c] + normals[d]
    safe = np.einsum("ij,ij->i", triangle_normals(points, left_triangle), facing) > 0.0
    safe &= np.einsum("ij,ij->i", triangle_normals(points, right_triangle), facing) > 0.0
    rank = np.where(safe, scatter_ranks(len(chosen), seed), len(chosen))
    best = np.full(len(triangles), len(chosen))
    np.minimum.at(best, first, rank)
    np.minimum.at(best, second, rank)
    winners = np.flatnonzero(safe & (best[first] == rank) & (best[second] == rank))
    # Two flips far apart may create one and the same edge: only the first is done.
    _, unique = np.unique(key(c[winners], d[winners], len(points)), return_index=True)
    winners = winners[unique]
    triangles = triangles.copy()
    triangles[first[winners]] = left_triangle[winners]
    triangles[second[winners]] = right_triangle[winners]
    return triangles, len(winners)


def _cotangent(points: F64, apex: I64, left: I64, right: I64) -> F64:
    u, v = points[left] - points[apex], points[right] - points[apex]
    area = np.linalg.norm(np.cross(u, v), axis=1)
    return np.einsum("ij,ij->i", u, v) / np.maximum(area, 1e-30)
