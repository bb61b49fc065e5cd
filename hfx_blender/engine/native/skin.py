# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrices of bones, bounds of clusters, and what the library needs to pose them; ``skin.c``."""

from __future__ import annotations

import ctypes
from functools import cache, cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from .library import INTEGER, POINTER, f64, i64, library, pointer
from .skin_table import Table, table_of

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


@cache
def _calls() -> ctypes.CDLL | None:
    """The library, with the arguments of these functions."""
    found = library()
    if found is not None:
        found.hfx_bone_matrices.argtypes = [INTEGER] * 3 + [POINTER] * 6
        found.hfx_cluster_bounds.argtypes = [INTEGER] * 2 + [POINTER] + [INTEGER] + [POINTER] * 6
        found.hfx_cluster_moves.argtypes = (
            [POINTER, INTEGER] + [POINTER] * 3 + [INTEGER] + [POINTER] * 6
        )
        found.hfx_cell_means.argtypes = [POINTER] * 2 + [INTEGER, POINTER, INTEGER] + [POINTER] * 2
        found.hfx_links.argtypes = [POINTER, INTEGER] + [POINTER] * 4
        for name in ("bone_matrices", "cluster_bounds", "cluster_moves", "cell_means", "links"):
            getattr(found, f"hfx_{name}").restype = None
    return found


def is_there() -> bool:
    """Whether these functions can be called."""
    return _calls() is not None


def bone_matrices(posed: F64, rows: I64, to_target: F64, bones: I64) -> tuple[F64, F64]:
    """Rest to target space for some bones, and what that stretches.

    Parameters
    ----------
    posed : (T, B, 3, 4) float64
        Rest space to posed armature space.
    rows : (n,) int64
        Of these.
    to_target : (n, 4, 4) float64
        From armature space.
    bones : (k,) int64
        Of the pose; B is one that rests.

    Returns
    -------
    matrices : (n, k, 3, 4) float64
    stretches : (n, k) float64
        No less than what each matrix stretches any direction by.
    """
    calls = _calls()
    assert calls is not None
    posed, rows, to_target = f64(posed), i64(rows), f64(to_target)
    bones = i64(np.where(bones < posed.shape[1], bones, -1))
    matrices = np.empty((len(rows), len(bones), 3, 4))
    stretches = np.empty((len(rows), len(bones)))
    calls.hfx_bone_matrices(
        len(rows),
        len(bones),
        posed.shape[1],
        *(pointer(each) for each in (posed, rows, bones, to_target, matrices, stretches)),
    )
    return matrices, stretches


def cluster_bounds(
    matrices: F64, starts: I64, slots: I64, centres: F64, halves: F64
) -> tuple[F64, F64]:
    """Boxes around clusters.

    Parameters
    ----------
    matrices : (n, B, 3, 4) float64
    starts : (C + 1,) int64
        Each cluster's first pair: a bone, and the box of what it moves.
    slots : (P,) int64
        The bone of each pair.
    centres, halves : (P, 3) float64
        Of these boxes.

    Returns
    -------
    low, high : (n, C, 3) float64
    """
    calls = _calls()
    assert calls is not None
    rows, count = matrices.shape[:2]
    low, high = np.empty((2, rows, len(starts) - 1, 3))
    calls.hfx_cluster_bounds(
        rows,
        count,
        pointer(matrices),
        len(starts) - 1,
        *(pointer(each) for each in (starts, slots, centres, halves, low, high)),
    )
    return low, high


class ClusterPointers(ctypes.Structure):
    """``hfx_cluster``."""

    _fields_ = [
        *(
            (name, POINTER)
            for name in (
                "entry_bones",
                "factors",
                "firsts",
                "bones",
                "moved",
                "distances",
                "differences",
            )
        ),
        ("bone_count", INTEGER),
    ]


class BonePointers(ctypes.Structure):
    """``hfx_bones``."""

    _fields_ = [
        ("matrices", POINTER),
        ("stretches", POINTER),
        ("slots", POINTER),
        ("count", INTEGER),
    ]


class GroupPointers(ctypes.Structure):
    """``hfx_groups``."""

    _fields_ = [
        *(
            (name, POINTER)
            for name in ("starts", "distances", "boxes", "bones", "shares", "changes")
        ),
        ("count", INTEGER),
    ]


class PosedBones:
    """What bones do to skin at some rows.

    Parameters
    ----------
    posed : (T, B, 3, 4) float64
        Rest space to posed armature space.
    rows : (n,) int64
        Of these.
    to_target : (n, 4, 4) float64
        From armature space.
    bones : (k,) int64
        Those that matter, ascending; B is one that rests.

    Attributes
    ----------
    matrices : (n, k, 3, 4) float64
        Rest to target space.
    stretches : (n, k) float64
        No less than what each matrix stretches any direction by.
    slots : (B + 1,) int64
        Where each bone is among the k.
    """

    def __init__(self, posed: F64, rows: I64, to_target: F64, bones: I64) -> None:
        self.matrices, self.stretches = bone_matrices(posed, rows, to_target, bones)
        self.slots = np.zeros(posed.shape[1] + 1, np.int64)
        self.slots[bones] = np.arange(len(bones))

    @cached_property
    def pointers(self) -> BonePointers:
        """``hfx_bones``."""
        arrays = self.matrices, self.stretches, self.slots
        return BonePointers(*map(pointer, arrays), self.matrices.shape[1])

    def cluster_moves(
        self,
        before: I64,
        after: I64,
        linear: F64,
        clusters: I64,
        starts: I64,
        bones: I64,
        centres: F64,
        halves: F64,
    ) -> F64:
        """How far anything in some clusters can have moved between rows.

        Parameters
        ----------
        before, after : (m,) int64
            Rows.
        linear : (m, 3, 3) float64
            From target space to that of the moves.
        clusters : (k,) int64
        starts : (C + 1,) int64
            Each cluster's first pair: a bone, and the box of what it moves at rest.
        bones : (P,) int64
            Of pairs.
        centres, halves : (P, 3) float64
            Of these boxes.

        Returns
        -------
        (m, k) float64
        """
        calls = _calls()
        assert calls is not None
        before, after, linear, clusters = i64(before), i64(after), f64(linear), i64(clusters)
        moves = np.empty((len(before), len(clusters)))
        calls.hfx_cluster_moves(
            ctypes.byref(self.pointers),
            len(before),
            *map(pointer, (before, after, linear)),
            len(clusters),
            *map(pointer, (clusters, starts, bones, centres, halves, moves)),
        )
        return moves

    def cell_means(self, groups: Any, rows: I64, clusters: I64) -> F64:
        """See :meth:`..cell_sizes.CellSizes.means`, target space (m, k).

        ``groups`` are GroupPointers of all clusters, filled in for these; ``rows`` (m,) are some
        of these rows.
        """
        calls = _calls()
        assert calls is not None
        rows, clusters = i64(rows), i64(clusters)
        means = np.empty((len(rows), len(clusters)))
        calls.hfx_cell_means(
            ctypes.byref(self.pointers),
            groups,
            len(rows),
            pointer(rows),
            len(clusters),
            pointer(clusters),
            pointer(means),
        )
        return means


class Clusters:
    """What bones do to the clusters of one model, where the library finds it.

    Attributes
    ----------
    table : array of ClusterPointers
        Of all clusters; only those are filled in that :meth:`add` was given.
    most_bones : int
        Of any of them.
    """

    def __init__(self, count: int) -> None:
        self.table: Any = (ClusterPointers * count)()
        self.most_bones = 0
        self._kept: dict[int, list[npt.NDArray[Any]]] = {}
        self._before: list[list[npt.NDArray[Any]]] = []  # somebody may still look at them
        self._is_known, self._is_linked = np.zeros((2, count), np.bool_)

    def arrays_of(self, cluster: int) -> tuple[npt.NDArray[Any], ...]:
        """What is filled in of a cluster, in the order of ClusterPointers."""
        return tuple(self._kept[cluster])

    def lacking(self, clusters: I64, *, with_links: bool) -> list[int]:
        """Those that are not filled in, or without their neighbours."""
        known = self._is_linked if with_links else self._is_known
        missing: list[int] = clusters[~known[clusters]].tolist()
        return missing

    def add(
        self,
        cluster: int,
        entries: tuple[I64, F64, I64],
        bones: I64,
        moved: F64,
        table: Table | None,
    ) -> None:
        """A cluster: weights one by one (see ``SkinnedModel.cluster_entries``), its bones and
        what they move; of its skin, if that is filled, what neighbours are like."""
        entry_bones, factors, firsts = entries
        distances, differences = np.zeros((2, len(firsts)))
        kept: list[npt.NDArray[Any]] = [
            i64(np.searchsorted(bones, entry_bones)),
            f64(factors),
            i64(np.append(firsts, len(entry_bones))),
            i64(bones),
            f64(moved),
            distances,
            differences,
        ]
        if cluster in self._kept:
            self._before.append(self._kept[cluster])
        self._kept[cluster], self._is_known[cluster] = kept, True
        self.table[cluster] = ClusterPointers(*map(pointer, kept), len(bones))
        if table is not None:
            calls = _calls()
            assert calls is not None
            room = np.empty(2 * len(bones))
            calls.hfx_links(
                ctypes.byref(table_of(table)),
                cluster,
                ctypes.byref(self.table[cluster]),
                *map(pointer, (room, distances, differences)),
            )
            self._is_linked[cluster] = True
        self.most_bones = max(self.most_bones, len(bones))
