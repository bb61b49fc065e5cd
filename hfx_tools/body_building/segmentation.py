# SPDX-License-Identifier: GPL-3.0-or-later
"""Body parts on the dense skin, from skin weights and normals.

Skin weights separate the parts of a limb; in hand and foot the normals separate back and palm,
top and sole. Smoothing gives clean borders, and pieces cut off from their part join the part
around them.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F64, U8
from hfx_blender.engine.body.model import Skeleton
from hfx_blender.engine.body.parts import CENTRE, LEFT, PARTS, RIGHT

from .outer_skin import Skin

_HAND, _FOOT = -1, -2  # placeholders, split by normals later
_PART_OF_BONE: Final = {
    "head": "head",
    "upperarm01": "upper_arm",
    "upperarm02": "upper_arm",
    "lowerarm01": "forearm",
    "lowerarm02": "forearm",
    "upperleg01": "upper_leg",
    "upperleg02": "upper_leg",
    "lowerleg01": "lower_leg",
    "lowerleg02": "lower_leg",
}
_RIBBON_M: Final = 0.012
_SOLE_LIMIT: Final = 0.35  # smallest downward component of a sole's normal
_SMOOTHING_STEPS: Final = 60
"""Averaging steps on the dense skin, for clean borders within about 4 mm."""


def _stem(bone: str) -> str:
    return bone.removesuffix(".L").removesuffix(".R")


def bone_parts(skeleton: Skeleton) -> list[str]:
    """Name of the body part of each bone; ``hand`` and ``foot`` are split by normals later.

    A bone without a table entry belongs to the part of its parent, the root to the torso. The
    neck is torso: the part ``head`` is the bone ``head`` with the face bones.
    """
    parts: list[str] = []
    for name, parent in zip(skeleton.bone_names, skeleton.parents.tolist(), strict=True):
        stem = _stem(name)
        if stem in _PART_OF_BONE:
            parts.append(_PART_OF_BONE[stem])
        elif stem.startswith("finger") and stem != "finger1-1":
            parts.append("fingers")
        elif stem == "wrist":
            parts.append("hand")
        elif stem == "foot":
            parts.append("foot")
        else:
            parts.append(parts[parent] if parent >= 0 else "torso")
    return parts


def label(skin: Skin, skeleton: Skeleton) -> tuple[U8, U8]:
    """Label part and side of each vertex; each part of a side is one piece, left mirrors right.

    Returns
    -------
    part : (V,) uint8
        Index into :data:`~.parts.PARTS`.
    side : (V,) uint8
        Index into :data:`~.parts.SIDES`.
    """
    groups = np.array(bone_parts(skeleton))
    average = _averaging(skin)
    names = [name for name in PARTS if (groups == name).any()] + ["hand", "foot"]
    shares = np.column_stack(
        [np.asarray(skin.weights[:, np.flatnonzero(groups == name)].sum(axis=1)) for name in names]
    )
    facing = _vertex_normals(skin)
    palm_axis = _palm_axis(skeleton)
    toward_palm = np.einsum("ij,ij->i", facing, palm_axis * _mirror_sign(skin))
    down = -facing[:, 2]
    fields = np.column_stack((shares, toward_palm, down - _SOLE_LIMIT))
    for _ in range(_SMOOTHING_STEPS):
        fields = average @ fields
    fields = 0.5 * (fields + fields[skin.mirror])
    chosen = np.array(names)[np.argmax(fields[:, :-2], axis=1)]
    chosen = np.where(
        chosen == "hand", np.where(fields[:, -2] > 0.0, "hand_palm", "hand_dorsum"), chosen
    )
    chosen = np.where(
        chosen == "foot", np.where(fields[:, -1] > 0.0, "foot_sole", "foot_dorsum"), chosen
    )
    index = {name: number for number, name in enumerate(PARTS)}
    part = np.array([index[name] for name in chosen], np.uint8)
    side = _sides(skin)
    return _in_one_piece(skin, part, side), side


def _sides(skin: Skin) -> U8:
    x = skin.vertices[:, 0]
    side = np.where(x > 0.0, LEFT, RIGHT)
    side[skin.mirror == np.arange(len(x))] = CENTRE
    return side.astype(np.uint8)


def _mirror_sign(skin: Skin) -> F64:
    return np.where(skin.vertices[:, :1] >= 0.0, 1.0, np.array([-1.0, 1.0, 1.0]))


def _palm_axis(skeleton: Skeleton) -> F64:
    """Unit direction out of the left palm: normal to the hand and the row of knuckles."""
    heads = dict(zip(skeleton.bone_names, skeleton.rest[:, :3, 3].astype(float), strict=True))
    along = heads["finger3-1.L"] - heads["wrist.L"]
    across = heads["finger2-1.L"] - heads["finger5-1.L"]  # toward the thumb
    axis = np.cross(along, across)
    return axis / np.linalg.norm(axis)


def _vertex_normals(skin: Skin) -> F64:
    corners = skin.vertices[skin.faces]
    face = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal = np.zeros_like(skin.vertices)
    for corner in range(4):
        np.add.at(normal, skin.faces[:, corner], face)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _adjacency(skin: Skin) -> Any:
    from scipy.sparse import coo_array, csr_array

    starts = skin.faces.ravel()
    ends = np.roll(skin.faces, -1, axis=1).ravel()
    count = len(skin.vertices)
    return csr_array(coo_array((np.ones(len(starts)), (starts, ends)), shape=(count, count)))


def _averaging(skin: Skin) -> Any:
    """Sparse smoothing operator (V, V): half a vertex, half the mean of its neighbours."""
    from scipy.sparse import diags_array, eye_array

    adjacency = _adjacency(skin)
    inverse = diags_array(1.0 / np.asarray(adjacency.sum(axis=1)).ravel())
    return 0.5 * (inverse @ adjacency + eye_array(adjacency.shape[0]))


class _HalfGraph:
    """Edges of the left half with the midline, as a graph of pieces of equal label."""

    def __init__(self, skin: Skin, side: U8) -> None:
        adjacency = _adjacency(skin).tocoo()
        self.members = side != RIGHT
        inner = self.members[adjacency.row] & self.members[adjacency.col]
        self.rows, self.columns = adjacency.row[inner], adjacency.col[inner]
        self.lengths = np.linalg.norm(
            skin.vertices[self.rows] - skin.vertices[self.columns], axis=1
        )
        self.shape = adjacency.shape

    def pieces(self, part: U8) -> npt.NDArray[np.int32]:
        """Id of each vertex's connected piece of equal part, (V,)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        same = part[self.rows] == part[self.columns]
        edges = (self.rows[same], self.columns[same])
        graph = coo_array((np.ones(len(edges[0])), edges), self.shape)
        return connected_components(graph, directed=False)[1]

    def distances_m(self, sources: npt.NDArray[Any]) -> tuple[F64, npt.NDArray[np.int32]]:
        """Distance along edges to the nearest source, and the predecessor on the path, negative at
        sources; infinite without a path.
        """
        from scipy.sparse import coo_array, csr_array
        from scipy.sparse.csgraph import dijkstra

        graph = csr_array(coo_array((self.lengths, (self.rows, self.columns)), self.shape))
        distance, before, _ = dijkstra(
            graph, indices=sources, min_only=True, return_predecessors=True
        )
        return distance, before


def _join(graph: _HalfGraph, part: U8, number: int) -> U8:
    """Join the large pieces of a part by ribbons along shortest paths; returns new labels.

    For the thumb, a separate piece of the fingers: the ribbon through the first web counts as
    fingers, like the skin between fingers.
    """
    result = part.copy()
    while True:
        piece = graph.pieces(result)
        is_member = graph.members & (result == number)
        sizes = np.bincount(piece[is_member], minlength=piece.max() + 1)
        large = np.flatnonzero(sizes > 0.05 * is_member.sum())
        if len(large) == 1:
            return result
        main = large[np.argmax(sizes[large])]
        distance, before = graph.distances_m(np.flatnonzero(is_member & (piece == main)))
        candidates = np.flatnonzero(is_member & np.isin(piece, large) & (piece != main))
        vertex = int(candidates[np.argmin(distance[candidates])])
        path = [vertex]
        while (vertex := int(before[path[-1]])) >= 0:
            path.append(vertex)
        result[graph.distances_m(np.array(path))[0] < _RIBBON_M / 2.0] = number


def _in_one_piece(skin: Skin, part: U8, side: U8) -> U8:
    """Give every stray piece to the part with the longest common border; returns new labels."""
    graph = _HalfGraph(skin, side)
    result = _join(graph, part, PARTS.index("fingers"))
    for _ in PARTS:
        piece = graph.pieces(result)
        stray = graph.members.copy()
        for number in np.unique(result):
            is_member = graph.members & (result == number)
            stray &= ~(is_member & (piece == np.bincount(piece[is_member]).argmax()))
        if not stray.any():
            break
        for number in np.unique(piece[stray]):
            border = (piece[graph.rows] == number) & (result[graph.rows] != result[graph.columns])
            around = np.bincount(result[graph.columns[border]], minlength=len(PARTS))
            result[graph.members & (piece == number)] = around.argmax()
    right = side == RIGHT
    result[right] = result[skin.mirror[right]]
    return result
