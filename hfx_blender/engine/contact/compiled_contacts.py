# SPDX-License-Identifier: GPL-3.0-or-later
"""Contacts by the compiled library, for all kinds of volumes and bodies.

The broad phase compares boxes of clusters with boxes of volumes in the world (``broad_phase.c``).
The narrow phase poses only clusters within reach, directly into shape space, and tests their cells
(``narrow_phase.c``). Their weights, by row and *column*, a vertex of the model that the examined
clusters contain, are compacted into contacts (``gather.c``).
"""

from collections.abc import Callable
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..active_rows import FARTHEST
from ..arrays import I32, I64, Bool, Weights
from ..native.library import loaded
from ..skin.skin_table import SkinTable
from ..skin.skinned_model import SkinnedModel
from . import narrow_phase as native
from .broad_phase import CompiledBroadPhase, Reached
from .compiled_target import PlacedTarget
from .contact_query import ContactQuery, Contacts, DetailArrays
from .narrow_phase import drift_of

_MOST_COLUMNS: Final = 32
_COLUMNS: WeakKeyDictionary[SkinTable, dict[bytes, tuple[I32, I64]]] = WeakKeyDictionary()

_MOST_CLEARED: Final = 8
_CLEARED: WeakKeyDictionary[SkinTable, list[npt.NDArray[Any]]] = WeakKeyDictionary()


def placed(query: ContactQuery) -> PlacedTarget:
    """Place the query's volume relative to its body at its rows; IndexError for unknown rows."""
    effect, tolerance = query.effect, query.skin.skin.tolerance
    assert effect.matrices is not None
    return PlacedTarget(
        *(effect.shapes, effect.shape_index, effect.matrices, query.pose.to_world, query.rows),
        *(query.falloff, tolerance.amplitude, FARTHEST),
    )


def begin(query: ContactQuery, target: PlacedTarget) -> Callable[[], Contacts]:
    """Begin the contacts of a body with a volume that is usable at all rows. Returns a
    function that waits for and returns the contacts, as :func:`.contacts.begin`."""
    falloff, pose, skin = query.falloff, query.pose, query.skin
    counters, bounds, rows = query.counters, query.bounds, query.rows
    tolerance, table = skin.skin.tolerance, skin.skin.table
    bound = skin.surface if isinstance(skin.surface, SkinnedModel) else None
    broad = CompiledBroadPhase(
        *(target, bound.outline if bound else None, bounds.rows, bounds.boxes, query.follows),
        *(query.reported, skin.skin.edge_m, skin.skin.is_split, query.with_impact),
    )
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
        reached = broad.reach_surface(bounds.places, bounds.own, table.starts)
    if not len(reached.clusters):
        return _nothing
    pairs, posing = reached.pairs, _posing(query, reached)
    # Dense weights, for the cells of reached clusters only.
    columns, column_of = columns_of(reached.clusters, table)
    weights = no_weights(table, len(rows), len(columns), falloff.precision)
    arrays = DetailArrays.empty(*weights.shape) if query.asks_details else None
    drifts = {}
    if reached.most_steps > 1:
        # Drift matrices for all intervals, by number of steps of tracking.
        parts = map(target.part, ("matrices", "to_world"))
        volume, frame = ((part[:-1], part[1:]) for part in parts)
        steps = np.unique(pairs.steps[pairs.steps > 1]).tolist()
        drifts = {number: drift_of(volume, frame, number) for number in steps}
    narrow = native.narrow_phase(
        *(pairs, table, posing, target, drifts, weights, column_of, arrays, query.threads)
    )

    def collect() -> Contacts:
        counters.vertices_posed += narrow()
        own_sets = query.own_sets or arrays is not None
        contacts = gathered(table, weights, columns, query.reported, own_sets)
        at, sets, offsets, vertices, values = contacts
        details = None
        if arrays is not None:
            row, column = np.repeat(at, np.diff(offsets)), np.searchsorted(columns, vertices)
            details = arrays.of(row, column)
        return Contacts(rows[at], sets, offsets, vertices, values, details)

    return collect


def _posing(query: ContactQuery, reached: Reached) -> native.Posing:
    """Source of posed vertices for the library: bones, or the evaluated surface. Also fills in the
    skin of sampled and tracked clusters."""
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


def columns_of(clusters: I64, table: SkinTable) -> tuple[I32, I64]:
    """Columns of some clusters; the result is cached and must not be changed.

    Returns the vertex of each column, ascending, (C,), and the column of each of the table's cells
    (cells,), valid for cells of the given clusters only.
    """
    known, key = _COLUMNS.setdefault(table, {}), clusters.tobytes()
    if key in known:
        return known[key]
    # A simple bound on memory: neighbouring blocks reach the same clusters again.
    if len(known) >= _MOST_COLUMNS:
        known.clear()
    count = len(table.cells)
    is_needed, place_of = np.empty(len(table.unit_counts), np.uint8), np.empty(count, np.int64)
    columns, column_of = np.empty(count, np.int32), np.empty(count, np.int64)
    column_count = loaded().hfx_columns(
        *(len(clusters), clusters, len(table.unit_counts), table.cell_starts, count),
        *(table.cells, is_needed, place_of, columns, column_of),
    )
    known[key] = columns[:column_count].copy(), column_of
    return known[key]


def no_weights(table: SkinTable, rows: int, columns: int, precision: Any) -> Weights:
    """Weights of 0, (rows, columns), of the float type ``precision``.

    Memory cleared by :func:`gathered` for this table is reused, because the operating system would
    map new memory page by page.
    """
    cleared, size = _CLEARED.setdefault(table, []), rows * columns
    fitting = (k for k, room in enumerate(cleared) if room.size >= size and room.dtype == precision)
    # The first large enough array of the right type.
    which = next(fitting, None)
    room = np.zeros(size, precision) if which is None else cleared.pop(which)
    return room[:size].reshape(rows, columns)


def gathered(
    table: SkinTable, weights: Weights, columns: I32, reported: Bool, own_sets: bool
) -> tuple[I64, I64, I64, I32, Weights]:
    """Collect contacts row by row; clears ``weights``, which must not be used afterwards.

    ``weights`` (n, C) are of :func:`no_weights`, filled in; ``columns`` (C,) the vertex of each
    column; ``reported`` (n,) the rows whose contacts are returned; ``own_sets``: store a vertex set
    for each row, even if equal to that of the row before. Returns rows (indices into ``weights``),
    sets, offsets, vertices, weights, see :class:`.contact_query.Contacts`.
    """
    count, width = weights.shape
    (at, sets), offsets = np.empty((2, count), np.int64), np.empty(count + 1, np.int64)
    vertices, values = np.empty(weights.size, np.int32), np.empty(weights.size, weights.dtype)
    counts = np.empty(3, np.int64)
    loaded().hfx_gather(
        *(count, width, weights, weights.dtype == np.float32, reported, columns, own_sets),
        *(at, sets, offsets, vertices, values, counts),
    )
    # The library has set all weights back to 0, so the next block can use this memory.
    cleared = _CLEARED[table]
    assert weights.base is not None
    cleared.append(weights.base)
    del cleared[:-_MOST_CLEARED]
    row_count, set_count, total = counts.tolist()
    # A view would keep the memory of all possible contacts alive.
    return (
        at[:row_count],
        sets[:row_count],
        offsets[: set_count + 1],
        vertices[:total].copy(),
        values[:total].copy(),
    )
