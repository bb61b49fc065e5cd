# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of skin with volumes, at samples and between them; ``narrow_phase.c``.

Continuous collision detection finds contacts between two samples, too fast for either to see:
samples of skin move straight in the volume's own space, in as many steps as its turning asks for,
and each step is tested exactly (``continuous_collision.h``), so that no wall is too thin. Slow
motion is not looked at: what it hides between two samples is nearer to the boundary than the
tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..arrays import F64, I64, Weights
from ..kinematics.placement_motion import Motion
from ..native.declarations import structure
from ..native.library import loaded
from ..native.skin import Clusters, PosedBones
from ..native.skin_arrays import SkinTableArrays, table_structure
from ..volume.placing_matrix import inverse_placement
from .broad_phase import Pairs, SurfacePlaces
from .compiled_target import PlacedTarget
from .contact_query import DetailArrays

if TYPE_CHECKING:
    from concurrent.futures import Executor


_STEP_KINDS: Final = 7  # 1, 2, ... 64 steps


@dataclass(frozen=True, eq=False)
class Posing:
    """Source of the positions of cluster-row pairs: matrices of bones, or known places."""

    clusters: Clusters | None = None
    own: Clusters | None = None  # of vertices of cells, where these are not units of the surface
    bones: PosedBones | None = None  # rest to shape space, at the rows of the target
    surface: SurfacePlaces | None = None


def narrow_phase(
    pairs: Pairs,
    table: SkinTableArrays,
    posing: Posing,
    target: PlacedTarget,
    drifts: Mapping[int, tuple[F64, F64]],
    weights: Weights,
    column_of: I64,
    details: DetailArrays | None = None,
    threads: Executor | None = None,
) -> Callable[[], int]:
    """Compute contact weights of cells inside and of passages.

    Parameters
    ----------
    pairs : Pairs
    table : SkinTableArrays
        Filled for the clusters that are covered or followed.
    posing : Posing
    target : PlacedTarget
    drifts : mapping
        How points drift, (steps + 1, n - 1, 4, 4) from before and after, by number of steps; see
        :func:`drift_of`. Straight ways need none.
    weights : (n, C) float32 or float64
        Changed in place: a pair's cells get theirs, what passed only raises them.
    column_of : (cells,) int64
        The column of each of the table's cells.
    details : DetailArrays, optional
        Filled in, for the same columns.
    threads : Executor, optional
        Threads that compute while this one goes on, each for clusters of its own.

    Returns
    -------
    callable
        Waits until all is computed, which without threads it is by now; gives the number of
        places posed.
    """
    drift = _drift_of(drifts, target.count - 1) if drifts else structure("hfx_drift")()
    shared = posing, target, drift, weights, column_of
    if details is not None:
        count = _with_details(NarrowPhaseCall(pairs, table, *shared), weights, details, target)
        return lambda: count
    if threads is None:
        count = NarrowPhaseCall(pairs, table, *shared).run()
        return lambda: count
    calls = [NarrowPhaseCall(part, table, *shared) for part in _parts(pairs, table)]
    begun = [threads.submit(call.run) for call in calls]
    return lambda: sum(each.result() for each in begun)


_SAMPLES: Final = 1 << 18
"""Samples of contacts that there is room for at first."""


def _with_details(
    call: NarrowPhaseCall, weights: Weights, details: DetailArrays, target: PlacedTarget
) -> int:
    room = _SAMPLES
    while True:
        samples, contacts = np.empty((room, 3)), np.empty(room, np.int64)
        made = structure("hfx_details")(
            *(details.places, details.since, details.entries, details.ways),
            *(samples, contacts, 0, room),
        )
        count = call.run(made)
        if made.count <= room:
            break
        room = made.count
        weights[:] = 0.0  # what is there already is taken as found
    found, owners = samples[: made.count], contacts[: made.count]
    details.place_deepest(found, owners, target.shapes, target.part("matrices"))
    return count


def _drift_of(drifts: Mapping[int, tuple[F64, F64]], intervals: int) -> Any:
    ways: list[list[F64 | None]] = [[None] * _STEP_KINDS, [None] * _STEP_KINDS]
    for number, matrices in drifts.items():
        for way, each in zip(ways, matrices, strict=True):
            way[number.bit_length() - 1] = each
    return structure("hfx_drift")(*ways, intervals)


_WORTH: Final = 1 << 17
"""Places of pairs that pay for a call of their own where threads share the work: some of it takes
much longer than the rest."""


def _parts(pairs: Pairs, table: SkinTableArrays) -> list[Pairs]:
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


class NarrowPhaseCall:
    """One call of the library for some pairs, with its arguments."""

    def __init__(
        self,
        pairs: Pairs,
        table: SkinTableArrays,
        posing: Posing,
        target: PlacedTarget,
        drift: Any,
        weights: Weights,
        column_of: I64,
    ) -> None:
        skin = table_structure(table)
        most_bones = 0 if posing.clusters is None else posing.clusters.most_bones
        room = np.empty(2 * skin.most_room + 27 * most_bones + 2)
        events = np.empty((2 * table.largest_cell + 2, 2))
        is_single = weights.dtype == np.float32
        self._found = structure("hfx_found")(
            *(weights, column_of, weights.shape[1], is_single, 0, room, events)
        )
        source = structure("hfx_posing")(
            *(skin, posing.clusters and posing.clusters.table, posing.own and posing.own.table),
            *(posing.bones and posing.bones.pointers, posing.surface and posing.surface.pointers),
        )
        self._arguments = pairs.pointers, source, target.pointers, drift, self._found
        self._kept = posing  # whose tables of clusters hold addresses alone

    def run(self, details: Any = None) -> int:
        """Run the call without the interpreter lock; returns the number of positions posed."""
        self._found.posed = 0
        loaded().hfx_narrow_phase(*self._arguments, details)
        count: int = self._found.posed
        return count


def drift_of(volume: tuple[F64, F64], body: tuple[F64, F64], steps: int) -> tuple[F64, F64]:
    """Relative motion, in a volume's space, of points that rest in a body's frame, in intervals.

    Parameters
    ----------
    volume, body : tuple of (n, 4, 4) float64
        Placing matrices before and after.
    steps : int
        Straight ones, of even length.

    Returns
    -------
    from_before, from_after : (steps + 1, n, 4, 4) float64
        Shape space at the start to the frame's later place; the same from the end.
    """
    volumes, bodies = Motion.between(*volume), Motion.between(*body)
    places = []
    for k in range(steps + 1):
        inverses, _ = inverse_placement(volumes.at(k / steps))
        places.append(inverses @ bodies.at(k / steps))
    path = np.stack(places)
    before, after = (inverse_placement(each)[0] @ volume[k] for k, each in enumerate(body))
    return path @ before, path @ after
