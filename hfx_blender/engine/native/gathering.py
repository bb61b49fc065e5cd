# SPDX-License-Identifier: GPL-3.0-or-later
"""From pairs of clusters and rows to lists of contacts; ``gather.c``."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from .library import INTEGER, POINTER, library, pointer
from .reach import Pairs
from .skin_table import Table

I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
Weights = npt.NDArray[np.floating[Any]]


@cache
def _library() -> ctypes.CDLL:
    found = library()
    assert found is not None
    found.hfx_columns.argtypes = [INTEGER, POINTER, INTEGER, POINTER, INTEGER] + [POINTER] * 5
    found.hfx_columns.restype = INTEGER
    for real in ("single", "double"):
        changes = getattr(found, f"hfx_changes_{real}")
        gather = getattr(found, f"hfx_gather_{real}")
        changes.argtypes = [INTEGER] * 2 + [POINTER] * 2 + [INTEGER, POINTER]
        changes.restype = INTEGER
        gather.argtypes = [INTEGER] * 2 + [POINTER] * 6
        gather.restype = None
    return found


_MOST_COLUMNS: Final = 32
_COLUMNS: WeakKeyDictionary[Table, dict[bytes, tuple[I32, I64]]] = WeakKeyDictionary()


def columns_of(pairs: Pairs, table: Table) -> tuple[I32, I64]:
    """Vertices of all pairs' clusters, ascending, and where each of the table's cells is among
    them, which is only told of these clusters. Not to be changed: they are kept."""
    known, key = _COLUMNS.setdefault(table, {}), pairs.distinct.tobytes()
    if key not in known:
        if len(known) >= _MOST_COLUMNS:
            known.clear()
        known[key] = _made_columns(pairs.distinct, table)
    return known[key]


def _made_columns(clusters: I64, table: Table) -> tuple[I32, I64]:
    count = len(table.cells)
    is_needed, place_of = np.empty(len(table.unit_counts), np.uint8), np.empty(count, np.int64)
    columns, column_of = np.empty(count, np.int32), np.empty(count, np.int64)
    counted = table.cells, is_needed, place_of, columns, column_of
    found = _library().hfx_columns(
        len(clusters),
        pointer(clusters),
        len(table.unit_counts),
        pointer(table.cell_starts),
        count,
        *(pointer(each) for each in counted),
    )
    return columns[:found].copy(), column_of


def gathered(
    weights: Weights, columns: I32, heard: Bool, own_sets: bool
) -> tuple[I64, I64, I64, I32, Weights]:
    """What is felt, row by row; see :class:`..contact.Contacts`.

    Returns
    -------
    rows, sets, offsets, vertices, weights
    """
    real = "single" if weights.dtype == np.float32 else "double"
    kinds, heard_at = np.empty(len(weights), np.uint8), np.ascontiguousarray(heard, np.uint8)
    calls = _library()
    total = getattr(calls, f"hfx_changes_{real}")(
        *weights.shape, pointer(weights), pointer(heard_at), int(own_sets), pointer(kinds)
    )
    rows = kinds.nonzero()[0]
    sets = np.cumsum(kinds[rows] == 2) - 1
    offsets = np.empty(int(sets[-1]) + 2 if len(rows) else 1, np.int64)
    vertices, values = np.empty(total, np.int32), np.empty(total, weights.dtype)
    getattr(calls, f"hfx_gather_{real}")(
        *weights.shape,
        *map(pointer, (weights, kinds, columns, offsets, vertices, values)),
    )
    return rows, sets, offsets, vertices, values
