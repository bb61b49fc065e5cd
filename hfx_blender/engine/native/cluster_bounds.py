# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of vertices: splitting and world boxes.

Bindings of ``clusters.c`` and ``bounds.c``. All functions need the library.
"""

import numpy as np

from ..arrays import F32, F64, I32, I64
from .library import i64, loaded, structure

_DEPTH = 64  # greatest number of successive halvings
_BONE_ROOM = 24  # work space of each bone, float64 elements


def split(pieces: list[I32], vertices: F32, load: I64 | None, leaf_size: int) -> list[I32]:
    """Halve clusters at the median of their longest axis until each fits a leaf.

    ``pieces`` are disjoint arrays of vertex ids; ``load`` (V,) is the part of ``leaf_size``, the
    largest sum of loads in a cluster, taken by each vertex (None: 1). Returns clusters with
    ascending vertex ids, in the order of ``pieces``; empty for no pieces.
    """
    if not pieces:
        return []
    ids = np.concatenate(pieces)
    # Stack of pending pieces, the first on top, with room for the halves of one piece.
    todo = np.zeros(len(pieces) + _DEPTH, np.int64)
    todo[: len(pieces)] = np.cumsum([len(piece) for piece in pieces])[::-1]
    ends, room = np.empty(len(ids), np.int64), np.empty((2, len(ids)), np.uint64)
    count = loaded().hfx_split(len(pieces), todo, ids, vertices, load, leaf_size, ends, room)
    return cut(ids, ends[:count])


def cut(ids: I32, ends: I64) -> list[I32]:
    """Split ``ids`` into consecutive views that end before the indices ``ends``, ascending."""
    last = ends.tolist()
    return [ids[first:end] for first, end in zip([0, *last], last, strict=False)]


class Outline:
    """Boxes at rest of skin by bone, cluster by cluster; ``pointers`` is ``hfx_outline``.

    ``bones`` (B,) are indices in the pose of all bones that move skin; a bone beyond the pose stays
    at rest. A *pair* is a cluster with a bone: ``starts`` (C + 1,) is the first pair of each
    cluster; each pair has an index ``slots`` (P,) into ``bones``, and ``centres`` and ``halves``
    (P, 3), centre and half extents of its box, metres, rest space.
    """

    def __init__(self, bones: I64, starts: I64, slots: I64, centres: F64, halves: F64) -> None:
        bones, slots, boxes = i64(bones), i64(slots), np.stack([centres, halves], axis=2)
        self._size = len(bones), len(starts) - 1
        arrays = bones, starts, slots, bones[slots], centres, halves, boxes
        self.pointers = structure("hfx_outline")(*self._size, *arrays)

    def bounds(
        self, posed: F64, rows: I64, to_target: F64, margins: F64 | None
    ) -> tuple[F64, F64, F64, F64]:
        """World boxes of clusters at rows (n,) of ``posed`` (T, B, 3, 4), rest to posed armature
        space.

        ``to_target`` (n, 4, 4) is armature space to world at each row; ``margins`` (C,) the bulge
        of each cluster's skin beyond its boxes at rest, metres, None for no bulge. Returns lowest
        and highest corner (n, C, 3) of each cluster, the box (n, 2, 3) around all clusters at each
        row, and the box (C, 2, 3) around each cluster over all rows.
        """
        bones, clusters = self._size
        low, high = np.empty((2, len(rows), clusters, 3))
        of_rows, of_clusters = np.empty((len(rows), 2, 3)), np.empty((clusters, 2, 3))
        loaded().hfx_bounds(
            *(self.pointers, len(rows), posed.shape[1], posed, rows, to_target, margins),
            *(np.empty(_BONE_ROOM * bones), low, high, of_rows, of_clusters),
        )
        return low, high, of_rows, of_clusters
