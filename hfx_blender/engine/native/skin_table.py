# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin of a model as the library reads it; ``skin.h``."""

from __future__ import annotations

from typing import Any, Final, Protocol
from weakref import WeakKeyDictionary

import numpy as np

from ..arrays import F64, I32, I64
from .library import BYTES, DOUBLE, DOUBLES, INTEGER, LONGS, structure

_TABLE_ARRAYS: Final = (
    "starts",
    "place_counts",
    "unit_counts",
    "cell_starts",
    "cell_of",
    "quad_starts",
    "unit_shares",
    "vertex_shares",
    "reaches",
    "means",
    "around",
    "is_ringed",
    "steps",
    "finest",
    "sample_starts",
    "heights_m",
    "wholes",
    "bulge_m",
    "quads",
    "samples",
)
_COUNTS: Final = {
    **dict.fromkeys(("starts", "place_counts", "unit_counts", "cell_starts", "cell_of"), LONGS),
    **dict.fromkeys(("quad_starts", "around", "steps", "finest", "sample_starts"), LONGS),
    "is_ringed": BYTES,
}
_Table = structure(
    "hfx_table",
    **(
        dict.fromkeys(_TABLE_ARRAYS, DOUBLES) | dict.fromkeys(_COUNTS, LONGS) | {"is_ringed": BYTES}
    ),
    room=INTEGER,
    is_simple=INTEGER,
    is_split=INTEGER,
    spacing_share=DOUBLE,
    distance_m=DOUBLE,
)


class Table(Protocol):
    """The skin of a model; see :class:`..skin.skin_table.SkinTable`."""

    place_counts: I64
    unit_counts: I64
    cell_starts: I64
    cells: I32
    vertices: I32
    is_simple: bool
    is_split: bool
    largest_cell: int
    spacing_share: float
    distance_m: float

    @property
    def samples(self) -> F64: ...


_TABLES: WeakKeyDictionary[Table, tuple[Any, F64]] = WeakKeyDictionary()


def table_of(table: Table) -> Any:
    """``hfx_table``, which keeps its arrays alive; rebuilt when the table has got more samples."""
    samples = table.samples
    if table not in _TABLES or _TABLES[table][1] is not samples:
        arrays = [getattr(table, name) for name in _TABLE_ARRAYS[:-1]]
        arrays.append(samples)
        made = _Table(
            *arrays,
            samples.shape[1],
            int(table.is_simple),
            int(table.is_split),
            table.spacing_share,
            table.distance_m,
        )
        made.most_room = int(_rooms(table).max(initial=0))
        _TABLES[table] = made, samples
    return _TABLES[table][0]


def _rooms(table: Table) -> I64:
    """Numbers that the library notes of each cluster at a row; see ``hfx_look_at_skin``."""
    return 6 * table.place_counts + 3 * table.unit_counts + np.diff(table.cell_starts)
