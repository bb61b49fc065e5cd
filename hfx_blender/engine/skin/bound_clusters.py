# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones that move skin, skin weights and groups of cells, as the library reads them.

Bindings of ``skin_binding.c`` and ``cell_groups.c``.

A *place* is a vertex of a cluster's outline, a *pair* a cluster with a bone.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I32, I64, missing_ids
from ..native.library import i64, loaded, structure
from .skin_table import SkinTable


@dataclass(frozen=True, eq=False)
class UsedBones:
    """Ascending ids of the bones with skin weights; a bone that a pose lacks stays at rest."""

    ids: I64  # (k,)

    def slots(self, given: int) -> I64:
        """Index into ``ids`` of each bone of a pose, (given + 1,); 0 for bones without weights.
        ``given`` is the number of bones of the pose; entry ``given`` stands for a bone beyond it.
        Cached. Raises IndexError for a used bone with an id above ``given``."""
        if given not in self._slots:
            if len(self.ids) and self.ids[-1] > given:
                raise IndexError(f"bone {self.ids[-1]} of a pose of {given}")
            self._slots[given] = slots = np.zeros(given + 1, np.int64)
            slots[self.ids] = np.arange(len(self.ids))
        return self._slots[given]

    @cached_property
    def _slots(self) -> dict[int, I64]:
        return {}


class PosedBones:
    """Output arrays for bone matrices and stretches at ``count`` rows; ``pointers``: ``hfx_bones``.

    ``matrices`` (n, k, 3, 4) are rest to shape space, only filled for bones of clusters within
    reach; ``stretches`` (n, k) upper bounds of the stretch of each matrix in any direction. A pose
    has ``given`` bones; the bone of this index is at rest.
    """

    def __init__(self, count: int, bones: UsedBones, given: int) -> None:
        self.matrices = np.empty((count, len(bones.ids), 3, 4))
        self.stretches = np.empty((count, len(bones.ids)))
        arrays = self.matrices, self.stretches
        self.pointers = structure("hfx_bones")(*arrays, bones.slots(given), len(bones.ids))


class BoundClusters:
    """Skin weights of a model's vertices, and the model's C clusters of vertices.

    ``offsets`` (V + 1,) is the first weight of each vertex; ``bones`` and ``values`` (E,) are of
    each weight; ``rest`` (V, 4) homogeneous positions; each cluster has a vertex at least;
    ``bone_count`` is the highest bone plus 1. ``pointers`` is ``hfx_bound``, ``place_counts`` (C,)
    the clusters' sizes.
    """

    def __init__(
        self, offsets: I64, bones: I64, values: F64, rest: F64, clusters: list[I32], bone_count: int
    ) -> None:
        self.place_counts = np.array([len(ids) for ids in clusters], np.int64)
        self.bone_count = bone_count
        starts = np.zeros(len(clusters) + 1, np.int64)
        np.cumsum(self.place_counts, out=starts[1:])
        self._members = np.concatenate([np.zeros(0, np.int32), *clusters])
        self._offsets, self._starts = i64(offsets), starts
        arrays = self._offsets, bones, values, rest, starts, self._members
        self.pointers = structure("hfx_bound")(*arrays, len(clusters), bone_count)

    @cached_property
    def weight_counts(self) -> I64:
        """Number of skin weights of each cluster, (C,)."""
        # Running sums, read at the last vertex of each cluster.
        ends = np.cumsum(np.diff(self._offsets)[self._members])
        return np.asarray(np.diff(ends[self._starts[1:] - 1], prepend=0))

    @cached_property
    def bone_boxes(self) -> tuple[I64, I64, F64, F64]:
        """Each cluster's bones, and boxes at rest of the vertices that each bone moves. The first
        pair of each cluster (C + 1,), the bone of each pair (P,), ascending within a cluster, and
        the lowest and highest corner of each pair's box, (P, 3) each, m."""
        most = int(np.minimum(self.weight_counts, self.bone_count).sum())
        starts, bones = np.empty(len(self._starts), np.int64), np.empty(most, np.int64)
        low, high = np.empty((2, most, 3))
        is_there, room = np.empty(self.bone_count, np.uint8), np.empty((self.bone_count, 6))
        arrays = is_there, room, starts, bones, low, high
        pair_count = loaded().hfx_bone_boxes(self.pointers, *arrays)
        # Copies, so that the space for the most possible pairs is freed.
        return starts, bones[:pair_count].copy(), low[:pair_count].copy(), high[:pair_count].copy()


class Clusters:
    """Per-cluster arrays of one model bound to bones, as the library reads them.

    Entries are computed on demand. Arrays are never changed afterwards, so that further threads may
    read on; a new entry gets new arrays. ``table`` has an ``hfx_cluster`` for each cluster, zero
    until :meth:`add` fills it; ``most_bones`` is the largest number of bones of a cluster.
    """

    def __init__(self, bound: BoundClusters) -> None:
        count = len(bound.place_counts)
        self.table: Any = (structure("hfx_cluster") * count)()
        self._rows = np.frombuffer(memoryview(self.table), np.int64).reshape(count, -1)
        self._bound, (self._starts, self._bones, *_) = bound, bound.bone_boxes
        self._bone_counts = np.diff(self._starts)
        self.most_bones = int(self._bone_counts.max(initial=0))
        # Without links between units all clusters share one array of zeros.
        most = (bound.place_counts * np.diff(self._starts)).max(initial=0)
        self._unlinked = np.zeros(1 + max(int(most), int(bound.place_counts.max(initial=0))))
        self._arrays: list[npt.NDArray[Any]] = []
        self._is_known, self._is_linked = np.zeros((2, count), np.bool_)

    def add(self, clusters: I64, table: SkinTable | None) -> None:
        """Compute missing entries of some clusters. With a table, whose skin must be filled in
        there, also the distances and weight differences between neighbouring units; 0 otherwise."""
        new = missing_ids(self._is_known, clusters)
        if len(new):
            self._bind(new)
        if table is not None:
            new = missing_ids(self._is_linked, clusters)
            if len(new):
                self._link(new, table)

    def _bind(self, clusters: I64) -> None:
        """Compute bones, weights and rest positions of clusters without entries."""
        # The entries lie one after another in shared arrays; the C structures get addresses.
        places, bones = self._bound.place_counts[clusters], self._bone_counts[clusters]
        entry_at, first_at, place_at, pair_at = map(
            _starts, (self._bound.weight_counts[clusters], places + 1, places, bones)
        )
        entry_bones, weights = np.empty(entry_at[-1], np.int64), np.empty(entry_at[-1])
        rest, moved = np.empty((place_at[-1], 4)), np.empty((pair_at[-1], 6))
        firsts = np.empty(first_at[-1], np.int64)
        column = np.empty(self._bound.bone_count, np.int64)
        loaded().hfx_bind(
            *(self._bound.pointers, self._starts, self._bones, len(clusters)),
            *(clusters, column, entry_bones, weights, firsts, rest, moved),
        )
        zeros = np.zeros_like(places)
        # In the order of the fields of ``hfx_cluster``; the last four wait for ``_link``.
        arrays = entry_bones, weights, firsts, rest, self._bones, moved, *4 * (self._unlinked,)
        at = entry_at, entry_at, first_at, place_at, self._starts[clusters], pair_at, *4 * (zeros,)
        self._point_to(clusters, dict(enumerate(zip(arrays, at, strict=True))))
        self._rows[clusters, len(arrays)] = bones
        self._is_known[clusters] = True

    def _point_to(self, clusters: I64, fields: dict[int, tuple[npt.NDArray[Any], I64]]) -> None:
        """Store addresses in clusters; ``fields``: number to (array, first index by cluster)."""
        for field, (array, at) in fields.items():
            self._rows[clusters, field] = array.ctypes.data + at[: len(clusters)] * array.strides[0]
            self._arrays.append(array)

    def _link(self, clusters: I64, table: SkinTable) -> None:
        """Compute distances, weight differences and extents of units, and the most of any unit;
        fields 6 to 9."""
        units, bones = table.unit_counts[clusters], self._bone_counts[clusters]
        at = np.stack([_starts(units), _starts(units * bones), _starts(1 + bones)])
        arrays = [np.empty(last) for last in at[[0, 1, 0, 2], -1]]
        known = table.structure, self.table, len(clusters), clusters, at
        loaded().hfx_find_links(*known, np.empty(2 * self.most_bones), *arrays)
        fields = zip(arrays, at[[0, 1, 0, 2]], strict=True)
        self._point_to(clusters, dict(enumerate(fields, 6)))
        self._is_linked[clusters] = True


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

    def add(self, clusters: I64, table: SkinTable, surface: Clusters, own: Clusters | None) -> None:
        """Compute the table entries of one or more clusters, ids (k,), and mark them as present.

        An entry lists the groups of a cluster's cells, at rest: largest distance, box, and the
        bones of each group with bounds of their weights. An existing entry is computed again and
        replaced, not skipped.

        ``table`` needs no skin samples; ``surface`` and ``own`` are bone weights of its surface's
        vertices and of the model's own vertices, with the clusters added (``own`` None where both
        meshes are the same).
        """
        # Work space for the largest cluster, and results for the largest possible number of groups
        # (each cell alone) and pairs (each group with every bone).
        places = table.place_counts[clusters]
        cells = table.cell_starts[clusters + 1] - table.cell_starts[clusters]
        bones = surface.most_bones + (0 if own is None else own.most_bones)
        most = int(max(places.max(), cells.max()))
        groups, pairs = int(cells.sum()), int(cells.sum()) * bones
        place_of_vertex = np.zeros(len(table.mesh.vertices), np.int64)
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
            *(table.structure, table.mesh.structure, surface.table, own and own.table),
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


def _starts(counts: I64) -> I64:
    """Exclusive cumulative sum (n + 1,) of counts (n,), from 0 to the total."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])
