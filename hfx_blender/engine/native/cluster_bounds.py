# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of vertices: splitting, outlines, world boxes and bounds of cell sizes.

Bindings of ``clusters.c``, ``skin_outline.c``, ``bounds.c`` and ``cell_groups.c``. All functions
need the library.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import F32, F64, I32, I64, missing_ids
from .library import i64, loaded, structure
from .skin import Clusters, SkinTableArrays, SurfaceArrays, mesh_structure, table_structure

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


def outlined(
    mesh: SurfaceArrays, starts: I64, units: I32, cluster_of: I64
) -> tuple[list[I32], F64]:
    """Compute the outline of each of C clusters and the margin of its skin.

    ``starts`` (C + 1,) is the first unit of each cluster; ``units`` (V,) the mesh's vertices,
    cluster by cluster; ``cluster_of`` (V,) the cluster of each vertex. Returns outlines, the units
    of each cluster in the given order, then the corners of adjacent triangles, ascending; and
    margins (C,), the largest bulge of curved skin above the flat triangles, m.
    """
    clusters, surface = len(starts) - 1, mesh_structure(mesh)
    margins = np.zeros(clusters)
    loaded().hfx_margins(surface, len(mesh.triangles), cluster_of, margins)
    outlines = np.empty(len(units) + 2 * mesh.triangles.size, np.int32)
    seen, ends = np.empty(len(units), np.int64), np.zeros(clusters, np.int64)
    loaded().hfx_outlines(
        *(surface, clusters, starts, units, cluster_of, len(units), seen, outlines, ends)
    )
    return cut(outlines[: ends[-1]].copy(), ends), margins


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


class CellGroups:
    """Bounds of cell sizes in any pose, for groups of cells on a body that bones move.

    The size of a cell is the mean distance of its skin from its vertex. Bones stretch skin and pull
    skin apart at joints, so the bones alone bound the sizes in a whole cluster; no skin is posed to
    decide that testing the vertices suffices.

    Derivation: let the place x of skin have weights u, the cell's vertex at y have weights v, and
    let R be any matrix. Then sum u M x - sum v M y = sum u L (x - y) + sum (u - v) (M - R) y. The
    first term is at most the bones' stretch times the distance at rest; the second is at most the
    difference of the bones' motions times the difference of the weights.

    ``table`` has an ``hfx_groups`` for each of ``count`` clusters, zero until :meth:`add` fills it.
    """

    def __init__(self, count: int) -> None:
        self.table: Any = (structure("hfx_groups") * count)()
        self._rows = np.frombuffer(memoryview(self.table), np.int64).reshape(count, -1)
        self._is_known = np.zeros(count, np.bool_)
        self._kept: list[npt.NDArray[Any]] = []

    def missing(self, clusters: I64) -> I64:
        """Sorted unique ids of clusters without an entry."""
        return missing_ids(self._is_known, clusters)

    def add(
        self,
        clusters: I64,
        table: SkinTableArrays,
        mesh: SurfaceArrays,
        surface: Clusters,
        own: Clusters | None,
    ) -> None:
        """Compute the table entries of one or more clusters, ids (k,), and mark them as present.

        An entry lists the groups of a cluster's cells, at rest: largest distance, box, and the
        bones of each group with bounds of their weights. An existing entry is computed again and
        replaced, not skipped.

        ``table`` needs no skin samples; ``mesh`` is its surface; ``surface`` and ``own`` are bone
        weights of the surface's vertices and of the model's own vertices, with the clusters added
        (``own`` None where both meshes are the same).
        """
        # Work space for the largest cluster, and results for the largest possible number of groups
        # (each cell alone) and pairs (each group with every bone).
        places = table.place_counts[clusters]
        cells = table.cell_starts[clusters + 1] - table.cell_starts[clusters]
        bones = surface.most_bones + (0 if own is None else own.most_bones)
        most = int(max(places.max(), cells.max()))
        groups, pairs = int(cells.sum()), int(cells.sum()) * bones
        place_of_vertex = np.zeros(len(mesh.vertices), np.int64)
        counts = np.empty(2 * most + bones * (bones + 3), np.int64)
        room = np.empty(most * (10 + 8 * bones) + bones)
        firsts = np.empty((2, len(clusters) + 1), np.int64)
        arrays: list[npt.NDArray[Any]] = [
            np.empty(groups + len(clusters), np.int64),
            np.empty(groups),
            np.empty((groups, 2, 3)),
            np.empty(pairs, np.int64),
            np.empty(pairs),
            np.empty(pairs),
        ]
        loaded().hfx_cell_groups(
            *(table_structure(table), mesh_structure(mesh), surface.table, own and own.table),
            *(len(clusters), clusters, place_of_vertex, counts, room),
            structure("hfx_found_groups")(*firsts, *arrays),
        )
        of_groups, of_pairs = firsts
        before = np.arange(len(clusters) + 1)
        ends = (of_groups + before, of_groups, of_groups, of_pairs, of_pairs, of_pairs)
        for field, (array, at) in enumerate(zip(arrays, ends, strict=True)):
            # The C structure stores addresses into the compacted copies, so the copies must outlive
            # it.
            compact = array[: at[-1]].copy()
            self._rows[clusters, field] = compact.ctypes.data + at[:-1] * array.strides[0]
            self._kept.append(compact)
        self._rows[clusters, len(arrays)] = np.diff(of_groups)
        self._is_known[clusters] = True
