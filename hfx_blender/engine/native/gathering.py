# SPDX-License-Identifier: GPL-3.0-or-later
"""Compaction of cluster-row weights into contacts; ``gather.c``.

A *column* is a vertex of the model that the examined clusters contain.
"""

from __future__ import annotations

from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..arrays import I32, I64, Bool, Weights
from .library import loaded
from .skin_arrays import SkinTableArrays

_MOST_COLUMNS: Final = 32
_COLUMNS: WeakKeyDictionary[SkinTableArrays, dict[bytes, tuple[I32, I64]]] = WeakKeyDictionary()

_MOST_CLEARED: Final = 8
_CLEARED: WeakKeyDictionary[SkinTableArrays, list[npt.NDArray[Any]]] = WeakKeyDictionary()


def columns_of(clusters: I64, table: SkinTableArrays) -> tuple[I32, I64]:
    """Columns of some clusters; the result is cached and must not be changed.

    Returns the vertex of each column, ascending, (C,), and the column of each of the table's cells
    (cells,), valid for cells of the given clusters only.
    """
    known, key = _COLUMNS.setdefault(table, {}), clusters.tobytes()
    if key not in known:
        if len(known) >= _MOST_COLUMNS:
            known.clear()
        known[key] = _compute_columns(clusters, table)
    return known[key]


def _compute_columns(clusters: I64, table: SkinTableArrays) -> tuple[I32, I64]:
    """Result of :func:`columns_of`, uncached."""
    count = len(table.cells)
    is_needed, place_of = np.empty(len(table.unit_counts), np.uint8), np.empty(count, np.int64)
    columns, column_of = np.empty(count, np.int32), np.empty(count, np.int64)
    column_count = loaded().hfx_columns(
        *(len(clusters), clusters, len(table.unit_counts), table.cell_starts, count),
        *(table.cells, is_needed, place_of, columns, column_of),
    )
    return columns[:column_count].copy(), column_of


def no_weights(table: SkinTableArrays, rows: int, columns: int, precision: Any) -> Weights:
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
    table: SkinTableArrays, weights: Weights, columns: I32, reported: Bool, own_sets: bool
) -> tuple[I64, I64, I64, I32, Weights]:
    """Collect contacts row by row; clears ``weights``, which must not be used afterwards.

    ``weights`` (n, C) are of :func:`no_weights`, filled in; ``columns`` (C,) the vertex of each
    column; ``reported`` (n,) the rows whose contacts are returned; ``own_sets``: store a vertex set
    for each row, even if equal to that of the row before. Returns rows (indices into ``weights``),
    sets, offsets, vertices, weights, see :class:`..contact.contact_query.Contacts`.
    """
    count, width = weights.shape
    (at, sets), offsets = np.empty((2, count), np.int64), np.empty(count + 1, np.int64)
    vertices, values = np.empty(weights.size, np.int32), np.empty(weights.size, weights.dtype)
    counts = np.empty(3, np.int64)
    loaded().hfx_gather(
        *(count, width, weights, weights.dtype == np.float32, reported, columns, own_sets),
        *(at, sets, offsets, vertices, values, counts),
    )
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
