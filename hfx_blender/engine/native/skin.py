# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones that move skin, and weights of models bound to them; ``skin.h``, ``skin_binding.c``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I32, I64, lacking
from .declarations import structure
from .library import i64, loaded
from .skin_table import Table, table_of


@dataclass(frozen=True, eq=False)
class UsedBones:
    """Bones that move anything, ascending; a bone missing in a pose is at rest."""

    ids: I64  # (k,)

    def slots(self, given: int) -> I64:
        """Index of each bone of a pose among these, (given + 1,); the last entry is the bone that
        rests.
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
    """Room for matrices of bones at some rows, from rest to target space, and for their stretch.

    Parameters
    ----------
    count : int
        Number of rows.
    bones : UsedBones
        Those that matter.
    given : int
        Number of bones of the pose; that bone is one that rests.

    Attributes
    ----------
    matrices : (n, k, 3, 4) float64
        Rest to target space; only of bones that move anything that is near.
    stretches : (n, k) float64
        No less than what each matrix stretches any direction by.
    pointers : Structure
        ``hfx_bones``.
    """

    def __init__(self, count: int, bones: UsedBones, given: int) -> None:
        self.matrices = np.empty((count, len(bones.ids), 3, 4))
        self.stretches = np.empty((count, len(bones.ids)))
        found = self.matrices, self.stretches
        self.pointers = structure("hfx_bones")(*found, bones.slots(given), len(bones.ids))


class BoundClusters:
    """A model's weights and its clusters, none of which is empty.

    Parameters
    ----------
    offsets : (V + 1,) int64
        Each vertex's first weight.
    bones, values : (E,) int64 and float64
        Of weights.
    rest : (V, 4) float64
        Homogeneous.
    clusters : list of (n,) int32
        Vertices.
    bone_count : int
        One more than the highest bone.
    """

    def __init__(
        self,
        offsets: I64,
        bones: I64,
        values: F64,
        rest: F64,
        clusters: list[I32],
        bone_count: int,
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
        ends = np.cumsum(np.diff(self._offsets)[self._members])
        counts: I64 = np.diff(ends[self._starts[1:] - 1], prepend=0)
        return counts

    def bone_boxes(self) -> tuple[I64, I64, F64, F64]:
        """Bones of clusters, and boxes of what each moves at rest.

        Returns
        -------
        starts : (C + 1,) int64
            Each cluster's first pair: itself and a bone.
        bones : (P,) int64
            Ascending in each cluster.
        low, high : (P, 3) float64
            Corners of the boxes.
        """
        most = int(np.minimum(self.weight_counts, self.bone_count).sum())
        starts, bones = np.empty(len(self._starts), np.int64), np.empty(most, np.int64)
        low, high = np.empty((2, most, 3))
        is_there, room = np.empty(self.bone_count, np.uint8), np.empty((self.bone_count, 6))
        arrays = is_there, room, starts, bones, low, high
        found = loaded().hfx_bone_boxes(self.pointers, *arrays)
        return starts, bones[:found].copy(), low[:found].copy(), high[:found].copy()


class Clusters:
    """Per-cluster arrays of one model bound to bones, as the library reads them.

    Arrays that it has are never changed: what is learnt of a cluster later has new ones.

    Parameters
    ----------
    pair_starts, pair_bones : (C + 1,), (P,) int64
        See :meth:`BoundClusters.bone_boxes`.

    Attributes
    ----------
    table : array of ``hfx_cluster``
        Of all clusters; only those are filled in that :meth:`add` was given.
    most_bones : int
        Of any cluster.
    """

    def __init__(self, bound: BoundClusters, pair_starts: I64, pair_bones: I64) -> None:
        count = len(bound.place_counts)
        self.table: Any = (structure("hfx_cluster") * count)()
        self._rows = np.frombuffer(memoryview(self.table), np.int64).reshape(count, -1)
        self._bound, self._starts, self._bones = bound, i64(pair_starts), i64(pair_bones)
        self._bone_counts = np.diff(self._starts)
        self.most_bones = int(self._bone_counts.max(initial=0))
        most = (bound.place_counts * np.diff(self._starts)).max(initial=0)
        self._unlinked = np.zeros(max(int(most), int(bound.place_counts.max(initial=0))))
        self._kept: list[npt.NDArray[Any]] = []
        self._is_known, self._is_linked = np.zeros((2, count), np.bool_)

    def add(self, clusters: I64, table: Table | None) -> None:
        """Fill in some clusters, and the neighbours of those whose skin is filled."""
        new = lacking(self._is_known, clusters)
        if len(new):
            self._bind(new)
        if table is not None:
            new = lacking(self._is_linked, clusters)
            if len(new):
                self._link(new, table)

    def _bind(self, clusters: I64) -> None:
        places, bones = self._bound.place_counts[clusters], self._bone_counts[clusters]
        entry_at, first_at, place_at, pair_at = map(
            _starts, (self._bound.weight_counts[clusters], places + 1, places, bones)
        )
        entry_bones, weights = np.empty(entry_at[-1], np.int64), np.empty(entry_at[-1])
        rest, moved = np.empty((place_at[-1], 4)), np.empty((pair_at[-1], 6))
        firsts, column = (
            np.empty(first_at[-1], np.int64),
            np.empty(self._bound.bone_count, np.int64),
        )
        loaded().hfx_bind(
            *(self._bound.pointers, self._starts, self._bones, len(clusters)),
            *(clusters, column, entry_bones, weights, firsts, rest, moved),
        )
        none = np.zeros_like(places)
        arrays = entry_bones, weights, firsts, rest, self._bones, moved, *2 * (self._unlinked,)
        at = entry_at, entry_at, first_at, place_at, self._starts[clusters], pair_at, none, none
        self._point_to(clusters, dict(enumerate(zip(arrays, at, strict=True))))
        self._rows[clusters, len(arrays)] = bones
        self._is_known[clusters] = True

    def _point_to(self, clusters: I64, fields: dict[int, tuple[npt.NDArray[Any], I64]]) -> None:
        """Point fields of clusters, by number, to arrays, from the given places on."""
        for field, (array, at) in fields.items():
            self._rows[clusters, field] = array.ctypes.data + at[: len(clusters)] * array.strides[0]
            self._kept.append(array)

    def _link(self, clusters: I64, table: Table) -> None:
        units = table.unit_counts[clusters]
        at = np.stack([_starts(units), _starts(units * self._bone_counts[clusters])])
        distances, differences = (np.empty(last) for last in at[:, -1])
        room = np.empty(2 * self.most_bones)
        loaded().hfx_find_links(
            *(table_of(table), self.table, len(clusters)),
            *(clusters, at, room, distances, differences),
        )
        self._point_to(clusters, {6: (distances, at[0]), 7: (differences, at[1])})
        self._is_linked[clusters] = True


def _starts(counts: I64) -> I64:
    """Start of each run of the given lengths, and the end of the last, (n + 1,)."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])
