# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies that bones move against volumes with a formula, by the compiled library.

The same as :func:`.contacts.begin` does in numpy, step by step; what it cannot do is left to that.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..active_rows import FARTHEST
from ..arrays import I32, I64, Weights
from ..native import gathering
from ..skin.cell_coverage import BodySkin
from ..skin.skinned_model import SkinnedModel
from . import compiled_broad_phase
from . import compiled_narrow_phase as native
from .compiled_target import PlacedTarget, is_known
from .contact_query import ContactQuery
from .continuous_collision import Drift

FoundContacts = tuple[I64, I64, I64, I32, Weights]
"""Rows, sets, offsets, vertices and weights; see :class:`.contacts.Contacts`."""


def is_possible(query: ContactQuery) -> bool:
    """Test that the library is there and supports this volume and this body's binding."""
    return isinstance(query.skin.surface, SkinnedModel) and is_known(query.effect.shapes)


def begin(query: ContactQuery) -> Callable[[], FoundContacts] | None:
    """Begin the contacts of a body with a volume; None where the volume is unusable at some row.

    As :func:`.contacts.begin`; rows are places among those of the query.
    """
    effect, falloff, pose, skin = query.effect, query.falloff, query.pose, query.skin
    counters, bounds, rows = query.counters, query.bounds, query.rows
    assert isinstance(skin.surface, SkinnedModel)
    assert effect.matrices is not None and pose.bones is not None
    tolerance, table = skin.skin.tolerance, skin.skin.table
    target = PlacedTarget(
        effect.shapes,
        effect.shape_index,
        effect.matrices,
        pose.to_world,
        rows,
        falloff,
        tolerance.amplitude,
        FARTHEST,
    )
    if not target.is_usable:
        return None
    broad = compiled_broad_phase.CompiledBroadPhase(
        *(target, skin.surface.outline, bounds.rows, bounds.boxes, query.follows, query.reported),
        *(skin.skin.edge_m, skin.skin.is_split),
    )
    tests = int(np.count_nonzero(query.reported))
    counters.volume_tests += tests
    counters.clusters_tested += tests * bounds.low.shape[1]
    met = broad.overlaps()
    if not len(met) and not query.follows.any():
        return _nothing
    groups = None
    if not falloff.is_flat and skin.skin.is_split and tolerance.amplitude > 0.0:
        assert skin.cell_sizes is not None
        groups = skin.cell_sizes.pointers(met)
    reached = broad.reach(pose.bones, skin.used_bones, skin.own_outline, groups)
    if not len(reached.clusters):
        return _nothing
    pairs, posing = reached.pairs, _posing(skin, reached)
    columns, column_of = gathering.columns_of(reached.clusters, table)
    weights: Weights = np.zeros((len(rows), len(columns)), falloff.precision)
    drifts = {}
    if reached.most_steps > 1:
        volume, body = target.part("matrices"), target.part("to_world")
        ways = (volume[:-1], volume[1:]), (body[:-1], body[1:])
        for number in np.unique(pairs.steps[pairs.steps > 1]).tolist():
            drift = Drift.of(*ways, number)
            drifts[number] = drift.from_before, drift.from_after
    looked = native.look_at_skin(
        pairs, table, posing, target, drifts, weights, column_of, query.threads
    )

    def found() -> FoundContacts:
        counters.vertices_posed += looked()
        return gathering.gathered(weights, columns, query.reported, query.own_sets)

    return found


def _posing(skin: BodySkin, reached: compiled_broad_phase.Reached) -> native.Posing:
    """Source of positions for the library; fills in skin that is covered or followed."""
    assert isinstance(skin.surface, SkinnedModel)
    if len(reached.wide):
        skin.skin.table.need(reached.wide)
        skin.surface.native_clusters(reached.wide, skin.skin.table)
    clusters = skin.surface.native_clusters(reached.clusters)
    own = None
    if skin.is_grouped:
        assert isinstance(skin.vertices, SkinnedModel)
        own = skin.vertices.native_clusters(reached.by_vertex)
    return native.Posing(clusters, own, reached.bones)


def _nothing() -> FoundContacts:
    none = np.zeros(0, np.int64)
    return none, none, np.zeros(1, np.int64), np.zeros(0, np.int32), np.zeros(0)
