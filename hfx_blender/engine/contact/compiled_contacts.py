# SPDX-License-Identifier: GPL-3.0-or-later
"""Contacts by the compiled library, for all kinds of volumes and bodies.

The broad phase compares boxes of clusters with boxes of volumes in the world (``broad_phase.c``).
The narrow phase poses only clusters within reach, directly into shape space, and tests their cells
(``narrow_phase.c``).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..active_rows import FARTHEST
from ..arrays import F64, I64
from ..native import gathering
from ..skin.skinned_model import SkinnedModel
from . import narrow_phase as native
from .broad_phase import CompiledBroadPhase, Reached, SurfacePlaces
from .compiled_target import PlacedTarget
from .contact_query import ContactQuery, Contacts, DetailArrays
from .narrow_phase import drift_of


def placed(query: ContactQuery) -> PlacedTarget:
    """Place the query's volume relative to its body at its rows; IndexError for unknown rows."""
    effect, tolerance = query.effect, query.skin.skin.tolerance
    assert effect.matrices is not None
    return PlacedTarget(
        *(effect.shapes, effect.shape_index, effect.matrices, query.pose.to_world, query.rows),
        *(query.falloff, tolerance.amplitude, FARTHEST),
    )


def begin(query: ContactQuery, target: PlacedTarget) -> Callable[[], Contacts]:
    """Begin the contacts of a body with a volume that is usable at all rows; counts tests.

    Returns a function that waits for and returns the contacts, as :func:`.contacts.begin`.
    """
    falloff, pose, skin = query.falloff, query.pose, query.skin
    counters, bounds, rows = query.counters, query.bounds, query.rows
    tolerance, table = skin.skin.tolerance, skin.skin.table
    bound = skin.surface if isinstance(skin.surface, SkinnedModel) else None
    broad = CompiledBroadPhase(
        *(target, bound.outline if bound else None, bounds.rows, bounds.boxes, query.follows),
        *(query.reported, skin.skin.edge_m, skin.skin.is_split, query.with_impact),
    )
    tests = int(np.count_nonzero(query.reported))
    counters.volume_tests += tests
    counters.clusters_tested += tests * bounds.low.shape[1]
    met = broad.overlaps()
    if not broad.near_count:
        return _nothing
    # Meshes are prepared only now, after the boxes have met.
    target.find_meshes(bool(query.follows.any()))
    # Bounds of cell sizes allow testing vertices alone; without falloff the share of skin counts.
    groups = None
    if not falloff.is_flat and skin.skin.is_split and tolerance.amplitude > 0.0 and bound:
        groups = skin.cell_groups(met)
    if bound is not None:
        assert pose.bones is not None
        reached = broad.reach(pose.bones, skin.used_bones, skin.own_outline, groups)
    else:
        assert bounds.places is not None
        places = bounds.places, bounds.own, broad.at, table.starts
        reached = broad.reach_surface(SurfacePlaces(*places))
    if not len(reached.clusters):
        return _nothing
    pairs, posing = reached.pairs, _posing(query, reached)
    # Dense weights, for the cells of reached clusters only.
    columns, column_of = gathering.columns_of(reached.clusters, table)
    weights = gathering.no_weights(table, len(rows), len(columns), falloff.precision)
    arrays = DetailArrays.empty(*weights.shape) if query.asks_details else None
    drifts = _drifts(target, pairs.steps[pairs.steps > 1]) if reached.most_steps > 1 else {}
    narrow = native.narrow_phase(
        *(pairs, table, posing, target, drifts, weights, column_of, arrays, query.threads)
    )

    def collect() -> Contacts:
        counters.vertices_posed += narrow()
        own_sets = query.own_sets or arrays is not None
        gathered = gathering.gathered(table, weights, columns, query.reported, own_sets)
        at, sets, offsets, vertices, values = gathered
        details = None
        if arrays is not None:
            row, column = np.repeat(at, np.diff(offsets)), np.searchsorted(columns, vertices)
            details = arrays.of(row, column)
        return Contacts(rows[at], sets, offsets, vertices, values, details)

    return collect


def _drifts(target: PlacedTarget, steps: I64) -> dict[int, tuple[F64, F64]]:
    """Drift matrices of :func:`.narrow_phase.drift_of` for all intervals, by number of steps."""
    volume, body = target.part("matrices"), target.part("to_world")
    ways = (volume[:-1], volume[1:]), (body[:-1], body[1:])
    return {number: drift_of(*ways, number) for number in np.unique(steps).tolist()}


def _posing(query: ContactQuery, reached: Reached) -> native.Posing:
    """Source of positions for the library; also fills in skin of sampled and tracked clusters."""
    skin, table = query.skin, query.skin.skin.table
    if len(reached.wide):
        table.need(reached.wide)
    if not isinstance(skin.surface, SkinnedModel):
        return native.Posing(surface=reached.surface)
    if len(reached.wide):
        skin.surface.native_clusters(reached.wide, table)
    own = None
    if skin.is_grouped:
        assert isinstance(skin.vertices, SkinnedModel)
        clusters = reached.clusters if query.asks_details else reached.by_vertex
        own = skin.vertices.native_clusters(clusters)
    return native.Posing(skin.surface.native_clusters(reached.clusters), own, reached.bones)


def _nothing() -> Contacts:
    """Contacts without any row, with empty details."""
    empty = np.zeros(0, np.int64)
    details = DetailArrays.empty(0, 0).of(empty, empty)
    return Contacts(
        empty, empty, np.zeros(1, np.int64), np.zeros(0, np.int32), np.zeros(0), details
    )
