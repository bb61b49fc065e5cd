# SPDX-License-Identifier: GPL-3.0-or-later
"""Narrow phase: contact of skin with volumes at samples and between them; ``narrow_phase.c``.

Continuous collision detection finds contacts between two samples. Samples of skin move straight in
shape space, in as many steps as the volume's rotation requires, and each step is tested exactly
(``continuous_collision.h``), so thin walls are not missed. Slow motion is untracked: contacts
hidden between two samples are then nearer to the boundary than the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..arrays import F64, I64, Weights
from ..kinematics.placement_motion import Motion
from ..native.library import loaded, structure
from ..skin.bound_clusters import Clusters, PosedBones
from ..skin.skin_table import SkinTable
from ..volume.shape import inverse_placement
from .broad_phase import Pairs
from .compiled_target import PlacedTarget
from .contact_query import DetailArrays

if TYPE_CHECKING:
    from concurrent.futures import Executor


_STEP_KINDS: Final = 7  # 1, 2, ... 64 steps


@dataclass(frozen=True, eq=False)
class Posing:
    """Source of positions for cluster-row pairs: bone matrices, or known positions."""

    clusters: Clusters | None = None
    own: Clusters | None = None  # of the cells' vertices; None: units of the surface
    bones: PosedBones | None = None  # rest to shape space, at the rows of the target
    surface: Any = None  # ``hfx_surface_places``


def narrow_phase(
    pairs: Pairs,
    table: SkinTable,
    posing: Posing,
    target: PlacedTarget,
    drifts: Mapping[int, tuple[F64, F64]],
    weights: Weights,
    column_of: I64,
    details: DetailArrays | None = None,
    threads: Executor | None = None,
) -> Callable[[], int]:
    """Begin the computation of contact weights of covered cells and of passages.

    Returns a function that waits for the end and returns the number of positions posed. ``table``
    is filled in for sampled and tracked clusters. ``drifts`` maps a number of steps to the matrices
    (steps + 1, n - 1, 4, 4 each) of :func:`drift_of`; straight paths need none. ``weights`` (n, C),
    float32 or float64, are set in place for the pairs' cells, passages only raise a weight;
    ``column_of`` (cells,) is the column of each of the table's cells. ``details``, of the same
    columns, are filled in place at once, without threads. ``threads`` compute parts of the pairs,
    with whole clusters each; without ``threads`` the computation is finished on return.
    """
    drift = None
    if drifts:
        # By way (from before, from after), then by log2 of the number of steps.
        ways = [drifts.get(1 << k, (None, None)) for k in range(_STEP_KINDS)]
        before, after = zip(*ways, strict=True)
        drift = structure("hfx_drift")(*before, *after, target.count - 1)
    shared = posing, target, drift, weights, column_of
    if details is not None:
        count = _with_details(NarrowPhaseCall(pairs, table, *shared), weights, details, target)
        return lambda: count
    if threads is None:
        count = NarrowPhaseCall(pairs, table, *shared).run()
        return lambda: count
    calls = [NarrowPhaseCall(part, table, *shared) for part in _parts(pairs, table)]
    futures = [threads.submit(call.run) for call in calls]
    return lambda: sum(future.result() for future in futures)


_SAMPLES: Final = 1 << 18
"""Initial room for samples of contacts."""


def _with_details(
    call: NarrowPhaseCall, weights: Weights, details: DetailArrays, target: PlacedTarget
) -> int:
    """Fill ``details`` and ``weights`` by a call, repeated if its samples do not fit. Returns the
    number of positions posed."""
    # The number of samples of contacts is unknown before the call, and reported by it.
    room = _SAMPLES
    while True:
        samples, contacts = np.empty((room, 3)), np.empty(room, np.int64)
        arrays = structure("hfx_details")(
            *(details.places, details.since, details.entries, details.ways),
            *(samples, contacts, 0, room),
        )
        count = call.run(arrays)
        if arrays.count <= room:
            break
        room = arrays.count
        weights[:] = 0.0  # the call raises existing weights
    inside, owners = samples[: arrays.count], contacts[: arrays.count]
    details.place_deepest(inside, owners, target.shapes, target.part("matrices"))
    return count


_WORTH: Final = 1 << 17
"""Positions in the part of a thread; parts differ much in time, so several for each thread."""


def _parts(pairs: Pairs, table: SkinTable) -> list[Pairs]:
    """Split pairs into parts of about 2**17 positions, clusters kept whole; one part for few."""
    total = np.cumsum(table.place_counts[pairs.clusters])
    count = int(total[-1]) // _WORTH
    if count < 2:
        return [pairs]
    # Cuts at the first pair of a cluster, nearest to equal shares of the work.
    begins = np.concatenate([[True], pairs.clusters[1:] != pairs.clusters[:-1]]).nonzero()[0]
    targets = total[-1] * np.arange(1, count) / count
    inner = begins[np.minimum(np.searchsorted(total[begins], targets), len(begins) - 1)]
    cuts = np.unique(np.concatenate([[0], inner, [len(total)]])).tolist()
    parts = (slice(*ends) for ends in pairwise(cuts))
    return [
        Pairs(pairs.clusters[part], pairs.rows[part], pairs.how[part], pairs.steps[part])
        for part in parts
    ]


class NarrowPhaseCall:
    """One call of ``hfx_narrow_phase``, with its arguments kept alive."""

    def __init__(
        self,
        pairs: Pairs,
        table: SkinTable,
        posing: Posing,
        target: PlacedTarget,
        drift: Any,
        weights: Weights,
        column_of: I64,
    ) -> None:
        # Work space per call: threads must not share it.
        skin = table.structure
        most_bones = 0 if posing.clusters is None else posing.clusters.most_bones
        room = np.empty(skin.most_room + 26 * most_bones + 2)
        events = np.empty((2 * table.largest_cell + 2, 2))
        is_single = weights.dtype == np.float32
        self._results = structure("hfx_found")(
            *(weights, column_of, weights.shape[1], is_single, 0, room, events)
        )
        source = structure("hfx_posing")(
            *(skin, posing.clusters and posing.clusters.table, posing.own and posing.own.table),
            *(posing.bones and posing.bones.pointers, posing.surface),
        )
        self._arguments = pairs.pointers, source, target.pointers, drift, self._results
        self._posing = posing  # its tables of clusters hold addresses only

    def run(self, details: Any = None) -> int:
        """Run the call without the interpreter lock; ``details`` is an ``hfx_details`` to fill,
        None for weights alone. Returns the number of positions posed."""
        self._results.posed = 0
        loaded().hfx_narrow_phase(*self._arguments, details)
        return int(self._results.posed)


def drift_of(volume: tuple[F64, F64], body: tuple[F64, F64], steps: int) -> tuple[F64, F64]:
    """Maps of points at rest in a body's frame, in shape space over intervals of n rows.

    ``volume`` and ``body`` are placing matrices (n, 4, 4) before and after each interval, of
    ``steps`` straight steps of equal length. Returns from_before, from_after: (steps + 1, n, 4, 4),
    maps from shape space before, or after, the interval to shape space at each step.
    """
    volumes, bodies = Motion.between(*volume), Motion.between(*body)
    places = []
    for k in range(steps + 1):
        inverses, _ = inverse_placement(volumes.at(k / steps))
        places.append(inverses @ bodies.at(k / steps))
    path = np.stack(places)
    # From shape to body space at the start or end, then back to shape space at each step.
    before, after = (inverse_placement(at)[0] @ volume[k] for k, at in enumerate(body))
    return path @ before, path @ after
