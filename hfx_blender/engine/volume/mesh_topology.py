# SPDX-License-Identifier: GPL-3.0-or-later
"""Repairs a triangle mesh into a closed surface that faces one way.

trimesh tells what is connected where a mesh has to be mended; its own ``repair`` turns faces and
fills holes with networkx, which is not bundled. A sound mesh is judged without importing it.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64, I32, I64, Bool

LARGEST_HOLES: Final = 0.25
"""Largest area of all caps over that of the mesh: a box without its lid has 0.2, a bowl far more.
Beyond it a mesh is rather a sheet, whose inside is undefined."""


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
    """Numbers below ``count`` that occur, ascending, and the place of each number among them."""
    occurs = np.zeros(count, np.bool_)
    occurs[numbers] = True
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[numbers]


def closed_surface(vertices: F64, triangles: I32, name: str) -> tuple[F64, I32, str]:
    """Turn the few triangles with the wrong orientation, and close small holes.

    A cap is the cone from a hole's rim to the middle of its corners; over any rim, however bent,
    it makes every edge used as often in one direction as in the other.

    Returns
    -------
    vertices : (V', 3) float64
        With the middles of holes at the end.
    triangles : (F', 3) int32
        With the caps at the end.
    note : str
        The repairs, counted, for the user; empty without any.

    Raises
    ------
    InputError
        Holes are too large to guess at, the faces cannot all face one way, or trimesh, which mends
        both, is not installed.
    """
    try:
        return _mended(vertices, triangles, name)
    except ImportError as error:
        raise InputError(
            f"'{name}' has holes, or faces that face the other way, and {error.name}, with which "
            f"they are mended, is not installed; fill the holes and recalculate the normals."
        ) from error


def _mended(vertices: F64, triangles: I32, name: str) -> tuple[F64, I32, str]:
    edge, uses, up = _edges(triangles)
    is_open = uses % 2 == 1
    notes: list[str] = []
    if _balance(edge, up)[~is_open].any():
        turned = _turns(triangles)
        triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
        edge, uses, up = _edges(triangles)
        number = int(np.count_nonzero(turned))
        faces = "1 face that faces" if number == 1 else f"{number} faces that face"
        notes += [f"'{name}' has {faces} the other way: turned for it"] * (number > 0)
    if is_open.any():
        vertices, triangles, note = _with_caps(vertices, triangles, edge, uses, name)
        notes.append(note)
        edge, uses, up = _edges(triangles)
    if _balance(edge, up).any():
        raise InputError(
            f"'{name}' has faces whose normals cannot be made to agree, so its inside is not "
            f"defined; recalculate its normals or remove its inner faces."
        )
    return vertices, triangles, "; ".join(notes)


def is_closed(triangles: I32) -> bool:
    """Test that each edge is used as often in one direction as in the other."""
    edge, _, up = _edges(triangles)
    return not _balance(edge, up).any()


def _edges(triangles: I32) -> tuple[I64, I64, Bool]:
    """Edge of each of the 3 F corners, the number of uses of each edge, and each corner's
    direction.

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
    """Uses of each edge upwards minus its uses downwards, (edges,)."""
    return np.bincount(edge, np.where(up, 1.0, -1.0)).astype(np.float64)


def _with_caps(
    vertices: F64, triangles: I32, edge: I64, uses: I64, name: str
) -> tuple[F64, I32, str]:
    from trimesh.graph import connected_component_labels

    # Of the uses of an open edge those in both directions cancel: one is left over.
    rim = _left_over(edge, triangles, uses)
    count = len(vertices)
    labels = connected_component_labels(rim, count)[rim[:, 0]]
    holes, hole = np.unique(labels, return_inverse=True)
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
    """Directed edges (n, 2) that caps must add, so that every edge is balanced."""
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
    from trimesh.triangles import area

    size = np.abs(vertices - vertices[0]).max() or 1.0  # no scale underflows
    return float(area(vertices[triangles] / size).sum())


def _turns(triangles: I32) -> Bool:
    """Triangles to turn so that neighbours agree, as a mask; the fewest of each connected piece.

    Each triangle is there twice, as it is and turned; those that agree are connected. A piece
    that can face one way is then there twice, too, and the one with fewer turned is taken.
    """
    from trimesh.graph import connected_component_labels, face_adjacency

    count = len(triangles)
    pairs, shared = face_adjacency(triangles, return_edges=True)
    corners = triangles[pairs]  # (n, 2, 3)
    ahead = (corners == shared[:, None, :1]) & (np.roll(corners, -1, axis=2) == shared[:, None, 1:])
    differ = count * (ahead[:, 0].any(axis=1) == ahead[:, 1].any(axis=1))
    one, other = pairs.T
    links = np.stack([one, other + differ, one + count, other + count - differ]).reshape(2, 2, -1)
    labels = connected_component_labels(links.swapaxes(1, 2).reshape(-1, 2), 2 * count)
    as_is, turned = labels[:count], labels[count:]
    votes = np.bincount(as_is, minlength=2 * count)
    more = votes[turned] - votes[as_is]
    # Of as many each way the first triangle of a piece stays.
    first = np.full(2 * count, count)
    np.minimum.at(first, as_is, np.arange(count))
    return (more > 0) | ((more == 0) & (first[turned] < first[as_is]))
