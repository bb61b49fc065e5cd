# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin as the library reads it: tables of samples, bones that move skin, and skin weights.

Bindings of ``skin.h``, ``skin_filling.c`` and ``skin_binding.c``.

A *place* is a vertex of a cluster's outline, a *pair* a cluster with a bone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..arrays import F32, F64, I32, I64, missing_ids
from .library import i64, loaded, structure


class SurfaceArrays(Protocol):
    """Arrays that the library reads of a :class:`..skin.skin_table.SkinMesh`."""

    @property
    def vertices(self) -> F32: ...
    @property
    def triangles(self) -> I32: ...


class SkinTableArrays(Protocol):
    """Arrays that the library reads and fills of a :class:`..skin.skin_table.SkinTable`."""

    starts: I64
    place_counts: I64
    unit_counts: I64
    quad_starts: I64
    cell_starts: I64
    cells: I32
    largest_cell: int

    @property
    def samples(self) -> F64: ...


_MESHES: WeakKeyDictionary[SurfaceArrays, Any] = WeakKeyDictionary()
_TABLES: WeakKeyDictionary[SkinTableArrays, tuple[Any, F64]] = WeakKeyDictionary()


def table_structure(table: SkinTableArrays) -> Any:
    """Cached ``hfx_table`` of a table; rebuilt after its samples have moved to a larger array."""
    samples = table.samples
    # The C structure holds addresses: a grown array of samples needs a new structure.
    if table not in _TABLES or _TABLES[table][1] is not samples:
        kind = structure("hfx_table")
        names = (name for name, _ in kind._fields_)
        filled = kind(
            *(samples.shape[1] if name == "room" else getattr(table, name) for name in names)
        )
        # Work space of the largest cluster, float64 elements; see ``hfx_narrow_phase``.
        rooms = 6 * table.place_counts + 3 * table.unit_counts + np.diff(table.cell_starts)
        filled.most_room = int(rooms.max(initial=0))
        _TABLES[table] = filled, samples
    return _TABLES[table][0]


def mesh_structure(mesh: SurfaceArrays) -> Any:
    """Cached ``hfx_skin_mesh`` of a mesh, valid as long as the mesh lives."""
    if mesh not in _MESHES:
        kind = structure("hfx_skin_mesh")
        _MESHES[mesh] = kind(*(getattr(mesh, name) for name, _ in kind._fields_))
    return _MESHES[mesh]


_EXTENT: Final = 7  # float64 elements of the C structure ``extent``


def fill(
    table: SkinTableArrays,
    mesh: SurfaceArrays,
    clusters: I64,
    samples: int,
    spacing: F64,
    most_share: float,
) -> int:
    """Fill in clusters (k,), ascending, of a table in place, except their samples.

    The table has the surface ``mesh`` and a number of ``samples`` already. ``spacing`` (3, V), for
    each vertex of the mesh: largest distance of skin from a sample, and this distance at the
    finest, metres; then the reciprocal spacing of vertices, up to a constant factor. ``most_share``
    is the largest share of a unit's skin that the vertex represents as a sample. Returns the number
    of samples to be held by the table including these clusters.
    """
    first = table.starts[clusters]
    quads = table.quad_starts[first + table.unit_counts[clusters]] - table.quad_starts[first]
    cells = int((table.cell_starts[clusters + 1] - table.cell_starts[clusters]).max())
    # Work space for the largest cluster.
    rooms = (
        *np.zeros((2, len(mesh.vertices)), np.int64),
        np.empty((int(quads.max()), _EXTENT)),
        np.empty(int(table.unit_counts[clusters].max())),
        np.empty(cells),
        np.empty(cells, np.int64),
    )
    shared = (
        table_structure(table),
        mesh_structure(mesh),
        structure("hfx_spacing")(*spacing, most_share),
    )
    count: int = loaded().hfx_fill(*shared, len(clusters), clusters, samples, *rooms)
    return count


@dataclass(frozen=True, eq=False)
class UsedBones:
    """Ascending ids of the bones with skin weights; a bone that a pose lacks stays at rest."""

    ids: I64  # (k,)

    def slots(self, given: int) -> I64:
        """Index into ``ids`` of each bone of a pose, (given + 1,); 0 for bones without weights.

        ``given`` is the number of bones of the pose; entry ``given`` stands for a bone beyond it.
        Cached. Raises IndexError for a used bone with an id above ``given``.
        """
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
        counts: I64 = np.diff(ends[self._starts[1:] - 1], prepend=0)
        return counts

    def bone_boxes(self) -> tuple[I64, I64, F64, F64]:
        """Compute each cluster's bones, and boxes at rest of the vertices that each bone moves.

        Returns the first pair of each cluster (C + 1,), the bone of each pair (P,), ascending
        within a cluster, and the lowest and highest corner of each pair's box, (P, 3) each, m.
        """
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
    read on; a new entry gets new arrays. ``pair_starts`` (C + 1,) and ``pair_bones`` (P,) are of
    :meth:`BoundClusters.bone_boxes`. ``table`` has an ``hfx_cluster`` for each cluster, zero until
    :meth:`add` fills it; ``most_bones`` is the largest number of bones of a cluster.
    """

    def __init__(self, bound: BoundClusters, pair_starts: I64, pair_bones: I64) -> None:
        count = len(bound.place_counts)
        self.table: Any = (structure("hfx_cluster") * count)()
        self._rows = np.frombuffer(memoryview(self.table), np.int64).reshape(count, -1)
        self._bound, self._starts, self._bones = bound, i64(pair_starts), i64(pair_bones)
        self._bone_counts = np.diff(self._starts)
        self.most_bones = int(self._bone_counts.max(initial=0))
        # Without links between units all clusters share one array of zeros.
        most = (bound.place_counts * np.diff(self._starts)).max(initial=0)
        self._unlinked = np.zeros(max(int(most), int(bound.place_counts.max(initial=0))))
        self._arrays: list[npt.NDArray[Any]] = []
        self._is_known, self._is_linked = np.zeros((2, count), np.bool_)

    def add(self, clusters: I64, table: SkinTableArrays | None) -> None:
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
        # In the order of the fields of ``hfx_cluster``; the last two wait for ``_link``.
        arrays = entry_bones, weights, firsts, rest, self._bones, moved, *2 * (self._unlinked,)
        at = entry_at, entry_at, first_at, place_at, self._starts[clusters], pair_at, zeros, zeros
        self._point_to(clusters, dict(enumerate(zip(arrays, at, strict=True))))
        self._rows[clusters, len(arrays)] = bones
        self._is_known[clusters] = True

    def _point_to(self, clusters: I64, fields: dict[int, tuple[npt.NDArray[Any], I64]]) -> None:
        """Store addresses in clusters; ``fields``: number to (array, first index by cluster)."""
        for field, (array, at) in fields.items():
            self._rows[clusters, field] = array.ctypes.data + at[: len(clusters)] * array.strides[0]
            self._arrays.append(array)

    def _link(self, clusters: I64, table: SkinTableArrays) -> None:
        """Compute distances and weight differences of neighbouring units; fields 6 and 7."""
        units = table.unit_counts[clusters]
        at = np.stack([_starts(units), _starts(units * self._bone_counts[clusters])])
        distances, differences = (np.empty(last) for last in at[:, -1])
        room = np.empty(2 * self.most_bones)
        loaded().hfx_find_links(
            *(table_structure(table), self.table, len(clusters)),
            *(clusters, at, room, distances, differences),
        )
        self._point_to(clusters, {6: (distances, at[0]), 7: (differences, at[1])})
        self._is_linked[clusters] = True


def _starts(counts: I64) -> I64:
    """Exclusive cumulative sum (n + 1,) of counts (n,), from 0 to the total."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])
