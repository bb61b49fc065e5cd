# SPDX-License-Identifier: GPL-3.0-or-later
"""Broad phase of contact: clusters of skin that a volume can reach; ``reach.c``."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

from ..arrays import F64, I64, U8, Bool
from ..native.bounds import Outline
from ..native.library import (
    BYTES,
    DOUBLE,
    DOUBLES,
    INTEGER,
    LONGS,
    POINTER,
    f64,
    i64,
    loaded,
    structure,
)
from ..native.skin import PosedBones, UsedBones
from .compiled_target import PlacedTarget

NOT: Final = 0
COVERED: Final = 1
BY_VERTEX: Final = 2
WHOLE: Final = 3
"""Kind of test for the cells of a pair."""

_Pairs = structure(
    "hfx_pairs",
    count=INTEGER,
    **{"clusters": LONGS, "rows": LONGS, "how": BYTES, "steps": LONGS, "points": DOUBLES},
    total=INTEGER,
    allowed_m=DOUBLES,
)
_Broad = structure(
    "hfx_broad",
    **{"outline": POINTER, "row": LONGS, "all": LONGS},
    **dict.fromkeys(("low", "high", "of_rows", "of_clusters"), DOUBLES),
    **dict.fromkeys(("follows", "reported"), BYTES),
    edge_m=DOUBLE,
    is_split=INTEGER,
    **{"at": LONGS, "flags": BYTES, "near": LONGS},
    near_count=INTEGER,
)
_Posed = structure("hfx_posed", posed=DOUBLES, all=INTEGER, bones=LONGS, own=POINTER)


@cache
def _calls() -> ctypes.CDLL:
    found = loaded()
    found.hfx_overlaps.argtypes = [POINTER, POINTER, LONGS]
    found.hfx_reach.argtypes = [
        *(POINTER, POINTER, POINTER, POINTER, BYTES),
        *(POINTER, POINTER, LONGS, LONGS),
    ]
    found.hfx_overlaps.restype, found.hfx_reach.restype = INTEGER, None
    return found


@dataclass(frozen=True, eq=False)
class Pairs:
    """Cluster-row pairs, ascending, with the kind of test for each.

    Where a pair is followed, the one before it is the same cluster at the row before.
    """

    clusters: I64  # (p,)
    rows: I64  # (p,)
    how: U8  # (p,) NOT, COVERED, BY_VERTEX or WHOLE
    steps: I64  # (p,) in how many straight steps it is followed from the row before; 0: not
    found: ctypes.Structure | None = None  # ``hfx_pairs`` where the library has filled them in

    def pointers(self, points: F64 | None = None, allowed_m: F64 | None = None) -> ctypes.Structure:
        """``hfx_pairs``; ``points`` (3, N) where the places of all pairs are known, and then
        ``allowed_m`` (p,): how far their skin may be from its samples."""
        if self.found is not None and points is None:
            return self.found
        arrays = self.clusters, self.rows, self.how, self.steps, points
        total = 0 if points is None else points.shape[1]
        return _Pairs(len(self.clusters), *arrays, total, allowed_m)


@dataclass(frozen=True, eq=False)
class Reached:
    """Result of the broad phase: cluster-row pairs for the narrow phase."""

    pairs: Pairs
    clusters: I64  # each of them once
    wide: I64  # those whose skin is sampled or tracked
    by_vertex: I64  # those whose vertices suffice
    most_steps: int  # of any pair
    bones: PosedBones  # to shape space; only bones that move any of these clusters


class CompiledBroadPhase:
    """Broad phase of one volume and one body: clusters that can be reached, row by row.

    Parameters
    ----------
    target : PlacedTarget
    outline : Outline
        Of the body's clusters.
    rows : (m,) int64
        Of the block, ascending; those of the target are among them.
    boxes : tuple
        The clusters' world boxes at these; see :meth:`..native.bounds.Outline.bounds`.
    follows, reported : (n,) bool
        See :func:`.contacts.begin`.
    edge_m : float
        How far off the edge of a contact may be.
    is_split : bool
        Whether cells have samples.
    """

    def __init__(
        self,
        target: PlacedTarget,
        outline: Outline,
        rows: I64,
        boxes: tuple[F64, F64, F64, F64],
        follows: Bool,
        reported: Bool,
        edge_m: float,
        is_split: bool,
    ) -> None:
        count, clusters = target.count, boxes[0].shape[1]
        if count and not (len(rows) and target.rows[-1] <= rows[-1]):
            raise IndexError(f"row {target.rows[-1]} has no boxes")
        self._flags = np.empty(count * clusters, np.uint8)
        self._at, self._near = np.empty(count, np.int64), np.empty(clusters, np.int64)
        self._target = target
        follows, reported = (np.ascontiguousarray(each, np.bool_) for each in (follows, reported))
        self._pointers: Any = _Broad(
            *(outline.address, target.rows, i64(rows), *map(f64, boxes), follows, reported),
            *(edge_m, int(is_split), self._at, self._flags, self._near),
        )
        self._outline = outline

    def overlaps(self) -> I64:
        """Clusters whose boxes the volume's meets anywhere, ascending; to be called first."""
        met = np.empty(len(self._near), np.int64)
        shared = ctypes.byref(self._pointers), ctypes.byref(self._target.pointers)
        count = _calls().hfx_overlaps(*shared, met)
        return met[:count]

    def reach(self, posed: F64, used: UsedBones, own: Outline | None, groups: Any) -> Reached:
        """Finish the broad phase; to be called once.

        Parameters
        ----------
        posed : (T, B, 3, 4) float64
            Rest space to posed armature space, at each row of the block.
        used : UsedBones
            Of all clusters.
        own : Outline or None
            Of the clusters' own vertices where the skin has others.
        groups : array of ``hfx_groups`` or None
            See :meth:`..skin.cell_sizes.CellSizes.pointers`, for the clusters that are met; None
            where nothing falls off or amplitudes must be exact.
        """
        near, count = self._pointers.near_count, self._target.count
        posed = f64(posed)
        if count and not self._target.rows[-1] < len(posed):
            raise IndexError(f"row {self._target.rows[-1]} of a pose of {len(posed)}")
        bones = PosedBones(posed, self._target.rows, None, used)
        clusters, rows, steps = np.empty((3, near * count), np.int64)
        how, is_used = np.empty(near * count, np.uint8), np.empty(len(used.ids), np.uint8)
        pairs: Any = Pairs(clusters, rows, how, steps).pointers()
        lists, counts, ids = np.empty((3, near), np.int64), np.empty(4, np.int64), used.ids
        where = _Posed(posed, posed.shape[1], ids, own and own.address)
        shared = (self._pointers, self._target.pointers, where, bones.pointers)
        _calls().hfx_reach(
            *map(ctypes.byref, shared),
            *(is_used, groups, ctypes.byref(pairs), lists, counts),
        )
        *numbers, most_steps = counts.tolist()
        every, wide, by_vertex = (each[:some] for each, some in zip(lists, numbers, strict=True))
        total = pairs.count
        known = Pairs(clusters[:total], rows[:total], how[:total], steps[:total], pairs)
        return Reached(known, every, wide, by_vertex, most_steps, bones)
