# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of skin with volumes; ``contact.c``."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..arrays import F64, I64, Weights
from ..native.library import (
    ANY,
    DOUBLES,
    INTEGER,
    LONGS,
    POINTER,
    f64,
    loaded,
    pointer_to,
    structure,
)
from ..native.skin import Clusters, PosedBones
from ..native.skin_table import Table, table_of
from .compiled_broad_phase import Given, Pairs
from .compiled_target import PlacedTarget
from .contact_details import DetailArrays

if TYPE_CHECKING:
    from ..native.threads import Threads


_STEP_KINDS: Final = 7  # 1, 2, ... 64 steps


_Drift = structure(
    "hfx_drift", before=POINTER * _STEP_KINDS, after=POINTER * _STEP_KINDS, intervals=INTEGER
)
_Found = structure(
    "hfx_found",
    weights=ANY,
    column_of=LONGS,
    columns=INTEGER,
    is_single=INTEGER,
    posed=INTEGER,
)


_Details = structure(
    "hfx_details",
    **dict.fromkeys(("places", "since", "entries", "ways", "samples"), DOUBLES),
    contacts=LONGS,
    **{"count": INTEGER, "room": INTEGER},
)


@cache
def _library() -> ctypes.CDLL:
    found = loaded()
    found.hfx_look_at_skin.argtypes = [POINTER] * 10 + [DOUBLES] * 2
    found.hfx_look_at_skin.restype = None
    return found


@dataclass(frozen=True, eq=False)
class Posing:
    """Source of the positions of cluster-row pairs: matrices of bones, or known places."""

    clusters: Clusters | None = None
    own: Clusters | None = None  # of vertices of cells, where these are not units of the surface
    bones: PosedBones | None = None  # rest to shape space, at the rows of the target
    given: Given | None = None


def look_at_skin(
    pairs: Pairs,
    table: Table,
    posing: Posing,
    target: PlacedTarget,
    drifts: Mapping[int, tuple[F64, F64]],
    weights: Weights,
    column_of: I64,
    details: DetailArrays | None = None,
    threads: Threads | None = None,
) -> Callable[[], int]:
    """Compute contact weights of cells inside and of passages.

    Parameters
    ----------
    pairs : Pairs
    table : Table
        Filled for the clusters that are covered or followed.
    posing : Posing
    target : PlacedTarget
    drifts : mapping
        How points drift, (steps + 1, n - 1, 4, 4) from before and after, by number of steps; see
        :func:`.continuous_collision.drift_of`. Straight ways need none.
    weights : (n, C) float32 or float64
        Changed in place: a pair's cells get theirs, what passed only raises them.
    column_of : (cells,) int64
        The column of each of the table's cells.
    details : DetailArrays, optional
        Filled in, for the same columns.
    threads : Threads, optional
        Threads that look while this one goes on, each at clusters of its own.

    Returns
    -------
    callable
        Waits until all is looked at, and tells how many places were posed. Without threads it
        has been by now.
    """
    drift = _drift_of(drifts, target.count - 1) if drifts else _STRAIGHT
    shared = table_of(table), posing, target, drift, weights, column_of
    if details is not None:
        count = _look_for_details(_Look(pairs, table, *shared), weights, details, target)
        return lambda: count
    if threads is None:
        count = _Look(pairs, table, *shared).take()
        return lambda: count
    looks = [_Look(part, table, *shared) for part in _parts(pairs, table)]
    begun = [threads.submit(look.take) for look in looks]
    return lambda: sum(each.result() for each in begun)


_STRAIGHT: Final = _Drift()
_SAMPLES: Final = 1 << 18
"""Samples of contacts that there is room for at first."""


def _look_for_details(
    look: _Look, weights: Weights, details: DetailArrays, target: PlacedTarget
) -> int:
    room = _SAMPLES
    while True:
        samples, contacts = np.empty((room, 3)), np.empty(room, np.int64)
        made: Any = _Details(
            *(details.places, details.since, details.entries, details.ways),
            *(samples, contacts, 0, room),
        )
        count = look.take(made)
        if made.count <= room:
            break
        room = made.count
        weights[:] = 0.0  # what is there already is taken as found
    found, owners = samples[: made.count], contacts[: made.count]
    details.place_deepest(found, owners, target.shapes, target.part("matrices"))
    return count


def _drift_of(drifts: Mapping[int, tuple[F64, F64]], intervals: int) -> ctypes.Structure:
    each_way: list[list[Any]] = [[None] * _STEP_KINDS, [None] * _STEP_KINDS]
    for number, places in drifts.items():
        for way, matrices in zip(each_way, places, strict=True):
            way[number.bit_length() - 1] = f64(matrices)
    addresses = ([None if m is None else DOUBLES.address(m) for m in way] for way in each_way)
    drift: Any = _Drift(*((POINTER * _STEP_KINDS)(*way) for way in addresses), intervals)
    drift.arrays = each_way
    return drift


_WORTH: Final = 1 << 16
"""Places of pairs that pay for a call of their own where threads share the work: some of it takes
much longer than the rest."""


def _parts(pairs: Pairs, table: Table) -> list[Pairs]:
    """Split pairs into parts with similar numbers of points, clusters kept whole."""
    total = np.cumsum(table.place_counts[pairs.clusters])
    count = int(total[-1]) // _WORTH
    if count < 2:
        return [pairs]
    begins = np.concatenate([[True], pairs.clusters[1:] != pairs.clusters[:-1]]).nonzero()[0]
    wanted = total[-1] * np.arange(1, count) / count
    inner = begins[np.minimum(np.searchsorted(total[begins], wanted), len(begins) - 1)]
    cuts = np.unique(np.concatenate([[0], inner, [len(total)]])).tolist()
    parts = (slice(*ends) for ends in pairwise(cuts))
    return [
        Pairs(pairs.clusters[part], pairs.rows[part], pairs.how[part], pairs.steps[part])
        for part in parts
    ]


class _Look:
    """One call of the library for some pairs, with its arguments."""

    def __init__(
        self,
        pairs: Pairs,
        table: Table,
        pointers: Any,
        posing: Posing,
        target: PlacedTarget,
        drift: Any,
        weights: Weights,
        column_of: I64,
    ) -> None:
        most_bones = 0 if posing.clusters is None else posing.clusters.most_bones
        room = np.empty(2 * pointers.most_room + 27 * most_bones + 2)
        events = np.empty((2 * table.largest_cell + 2, 2))
        self._kept = pairs, pointers, posing, target, drift, weights, column_of
        is_single = int(weights.dtype == np.float32)
        self._found = _Found(weights, column_of, weights.shape[1], is_single, 0)
        self._arguments = (
            *(pointer_to(pairs.pointers), pointer_to(pointers)),
            *(each and each.table for each in (posing.clusters, posing.own)),
            None if posing.bones is None else pointer_to(posing.bones.pointers),
            None if posing.given is None else pointer_to(posing.given.pointers),
            *(pointer_to(target.pointers), pointer_to(drift), pointer_to(self._found)),
        )
        self._room = room, events

    def take(self, details: ctypes.Structure | None = None) -> int:
        """Run the call without the interpreter lock; returns the number of positions posed."""
        self._found.posed = 0
        _library().hfx_look_at_skin(*self._arguments, pointer_to(details), *self._room)
        count: int = self._found.posed
        return count
