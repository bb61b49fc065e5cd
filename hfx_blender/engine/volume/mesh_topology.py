# SPDX-License-Identifier: GPL-3.0-or-later
"""Making a triangle mesh a closed surface that faces one way: merging, turning, closing holes."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
I32 = npt.NDArray[np.int32]
Bool = npt.NDArray[np.bool_]

LARGEST_HOLES: Final = 0.25
"""Area of all caps over that of the mesh: a box without its lid has 0.2, a bowl far more. Beyond
it a mesh is rather a sheet, of which nobody can say what is inside."""


def merged(vertices: F64, triangles: npt.NDArray[np.integer[Any]]) -> tuple[F64, I32]:
    """Make coincident vertices one; drop unused vertices and triangles without three corners."""
    used, corners = _used(triangles, len(vertices))
    vertices = vertices[used]
    order = np.lexsort(vertices.T)
    new = np.ones(len(vertices), np.bool_)
    new[1:] = np.any(vertices[order[1:]] != vertices[order[:-1]], axis=1)
    group = np.zeros(len(vertices), np.int64)
    group[order] = np.cumsum(new) - 1
    corners = group[corners]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    used, corners = _used(corners, int(np.count_nonzero(new)))
    return vertices[order][new][used], corners.astype(np.int32)


def _used(numbers: npt.NDArray[np.integer[Any]], count: int) -> tuple[I64, I64]:
    """Which of 0 .. ``count`` - 1 occur, ascending, and the place of each number among them."""
    occurs = np.zeros(count, np.bool_)
    occurs[numbers] = True
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[numbers]


def closed_surface(vertices: F64, triangles: I32, name: str) -> tuple[F64, I32, str]:
    """Turn the few triangles that face the other way, and put caps on small holes.

    A cap is the cone from a hole's rim to the middle of its corners; over any rim, however bent,
    it makes every edge used as often in one direction as in the other.

    Returns
    -------
    vertices : (V', 3) float64
        With the middles of holes at the end.
    triangles : (F', 3) int32
        With the caps at the end.
    note : str
        What was closed, for the user; empty if nothing was.

    Raises
    ------
    InputError
        Holes are too large to guess at, or the faces cannot all face one way.
    """
    edge, uses, up = _edges(triangles)
    is_open = uses % 2 == 1
    if _balance(edge, up)[~is_open].any():
        turned = _turns(len(triangles), edge, uses, up)
        triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
        edge, uses, up = _edges(triangles)
    note = ""
    if is_open.any():
        vertices, triangles, note = _with_caps(vertices, triangles, edge, uses, name)
        edge, uses, up = _edges(triangles)
    if _balance(edge, up).any():
        raise InputError(
            f"'{name}' has faces whose normals cannot be made to agree, so its inside is not "
            f"defined; recalculate its normals or remove its inner faces."
        )
    return vertices, triangles, note


def _edges(triangles: I32) -> tuple[I64, I64, Bool]:
    """The edge of each of the 3 F corners, the triangles' uses of it, and whether it is upwards.

    Corner ``k`` belongs to triangle ``k // 3``.
    """
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    up = starts < ends
    keys = np.minimum(starts, ends).astype(np.int64) * (triangles.max() + 1) + np.maximum(
        starts, ends
    )
    _, edge, uses = np.unique(keys, return_inverse=True, return_counts=True)
    return edge.ravel(), uses, up


def _balance(edge: I64, up: Bool) -> F64:
    """How much more often each edge is used upwards than downwards."""
    return np.bincount(edge, np.where(up, 1.0, -1.0)).astype(np.float64)


def _with_caps(
    vertices: F64, triangles: I32, edge: I64, uses: I64, name: str
) -> tuple[F64, I32, str]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # Of the uses of an open edge those in both directions cancel: one is left over.
    rim = _left_over(edge, triangles, uses)
    count = len(vertices)
    joined = coo_array((np.ones(len(rim)), (rim[:, 0], rim[:, 1])), shape=(count, count))
    _, hole_of = connected_components(joined, directed=False)
    holes, hole = np.unique(hole_of[rim[:, 0]], return_inverse=True)
    sizes = np.bincount(hole)
    middles = np.stack(
        [np.bincount(hole, vertices[rim[:, 0], k]) / sizes for k in range(3)], axis=1
    )
    caps = np.stack([rim[:, 1], rim[:, 0], count + hole], axis=1).astype(np.int32)
    with_middles = np.concatenate([vertices, middles])
    open_edges = int(np.count_nonzero(uses % 2))
    if _area(with_middles, caps) > LARGEST_HOLES * _area(vertices, triangles):
        raise InputError(
            f"'{name}' is not closed: {open_edges} of its {len(uses)} edges lack a face on one "
            f"side; fill the holes or merge the vertices there."
        )
    closed = "a hole was" if len(holes) == 1 else f"{len(holes)} holes were"
    note = f"'{name}' is open at {open_edges} edges: {closed} closed for it"
    return with_middles, np.concatenate([triangles, caps]), note


def _left_over(edge: I64, triangles: I32, uses: I64) -> I64:
    """Directed edges (n, 2) that caps have to be put on: what open edges lack to be balanced."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    balance = _balance(edge, starts < ends)
    firsts = np.zeros(len(uses), np.int64)
    firsts[edge] = np.arange(len(edge))
    is_lacking = (uses % 2 == 1) & (balance != 0)
    lacking = np.repeat(np.arange(len(uses)), np.where(is_lacking, np.abs(balance), 0).astype(int))
    one, other = starts[firsts[lacking]], ends[firsts[lacking]]
    low, high = np.minimum(one, other), np.maximum(one, other)
    upwards = balance[lacking] > 0
    return np.stack([np.where(upwards, low, high), np.where(upwards, high, low)], axis=1).astype(
        np.int64
    )


def _area(vertices: F64, triangles: I32) -> float:
    corners = vertices[triangles]
    corners = corners / (np.abs(vertices - vertices[0]).max() or 1.0)  # no scale underflows
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.sqrt(np.einsum("ij,ij->i", across, across)).sum())


def _turns(count: int, edge: I64, uses: I64, up: Bool) -> Bool:
    """Which triangles to turn so that neighbours agree, the fewest of each connected piece."""
    corners = np.argsort(edge, kind="stable")
    corners = corners[uses[edge[corners]] == 2].reshape(-1, 2)
    disagree = up[corners[:, 0]] == up[corners[:, 1]]
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in range(count)]
    for (one, other), differs in zip((corners // 3).tolist(), disagree.tolist(), strict=True):
        neighbours[one].append((other, differs))
        neighbours[other].append((one, differs))
    turned = np.zeros(count, np.bool_)
    seen = np.zeros(count, np.bool_)
    for seed in range(count):
        if seen[seed]:
            continue
        seen[seed] = True
        piece, queue = [seed], deque([seed])
        while queue:
            current = queue.popleft()
            for other, differs in neighbours[current]:
                if not seen[other]:
                    seen[other] = True
                    turned[other] = turned[current] ^ differs
                    piece.append(other)
                    queue.append(other)
        if 2 * np.count_nonzero(turned[piece]) > len(piece):
            turned[piece] = ~turned[piece]
    return turned
