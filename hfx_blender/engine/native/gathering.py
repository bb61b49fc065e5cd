# SPDX-License-Identifier: GPL-3.0-or-later
"""Compaction of weights of cluster-row pairs into lists of contacts; ``gather.c``."""

from __future__ import annotations

from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..arrays import I32, I64, Bool, Weights
from .library import loaded
from .skin_table import Table

_MOST_COLUMNS: Final = 32
_COLUMNS: WeakKeyDictionary[Table, dict[bytes, tuple[I32, I64]]] = WeakKeyDictionary()

_MOST_CLEARED: Final = 8
_CLEARED: WeakKeyDictionary[Table, list[npt.NDArray[Any]]] = WeakKeyDictionary()


def columns_of(clusters: I64, table: Table) -> tuple[I32, I64]:
    """Columns of some clusters: their vertices, ascending, and the column of each of the table's
    cells, valid for these clusters only. Not to be changed: they are kept."""
    known, key = _COLUMNS.setdefault(table, {}), clusters.tobytes()
    if key not in known:
        if len(known) >= _MOST_COLUMNS:
            known.clear()
        known[key] = _made_columns(clusters, table)
    return known[key]


def _made_columns(clusters: I64, table: Table) -> tuple[I32, I64]:
    count = len(table.cells)
    is_needed, place_of = np.empty(len(table.unit_counts), np.uint8), np.empty(count, np.int64)
    columns, column_of = np.empty(count, np.int32), np.empty(count, np.int64)
    found = loaded().hfx_columns(
        *(len(clusters), clusters, len(table.unit_counts), table.cell_starts, count),
        *(table.cells, is_needed, place_of, columns, column_of),
    )
    return columns[:found].copy(), column_of


def no_weights(table: Table, rows: int, columns: int, precision: Any) -> Weights:
    """Weights (rows, columns) that are all 0, for clusters of a table.

    Those that :func:`gathered` has cleared are used again: new ones would be fetched page by page.
    """
    kept, size = _CLEARED.setdefault(table, []), rows * columns
    fitting = (k for k, each in enumerate(kept) if each.size >= size and each.dtype == precision)
    which = next(fitting, None)
    room = np.zeros(size, precision) if which is None else kept.pop(which)
    return room[:size].reshape(rows, columns)


def gathered(
    table: Table, weights: Weights, columns: I32, reported: Bool, own_sets: bool
) -> tuple[I64, I64, I64, I32, Weights]:
    """Gather contacts row by row; see :class:`..contact.contact_details.Contacts`.

    ``weights`` are those of :func:`no_weights`, and are not to be used any more.

    Returns
    -------
    rows, sets, offsets, vertices, weights
    """
    count, width = weights.shape
    (at, sets), offsets = np.empty((2, count), np.int64), np.empty(count + 1, np.int64)
    vertices, values = np.empty(weights.size, np.int32), np.empty(weights.size, weights.dtype)
    counts = np.empty(3, np.int64)
    loaded().hfx_gather(
        *(count, width, weights, weights.dtype == np.float32, reported, columns, own_sets),
        *(at, sets, offsets, vertices, values, counts),
    )
    kept = _CLEARED[table]
    assert weights.base is not None
    kept.append(weights.base)
    del kept[:-_MOST_CLEARED]
    felt, set_count, total = counts.tolist()
    # Copies, as a view would keep the memory of all possible contacts.
    return (
        at[:felt],
        sets[:felt],
        offsets[: set_count + 1],
        vertices[:total].copy(),
        values[:total].copy(),
    )
