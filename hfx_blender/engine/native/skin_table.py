# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin of a model as the library reads it; ``skin.h``."""

from __future__ import annotations

from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I32, I64
from .declarations import structure


class Mesh(Protocol):
    """See :class:`..skin.skin_mesh.SkinMesh`."""

    @property
    def vertices(self) -> npt.NDArray[np.float32]: ...
    @property
    def triangles(self) -> npt.NDArray[np.int32]: ...


class Table(Protocol):
    """The skin of a model; see :class:`..skin.skin_table.SkinTable`."""

    starts: I64
    place_counts: I64
    unit_counts: I64
    quad_starts: I64
    cell_starts: I64
    cells: I32
    largest_cell: int

    @property
    def samples(self) -> F64: ...


_MESHES: WeakKeyDictionary[Mesh, Any] = WeakKeyDictionary()
_TABLES: WeakKeyDictionary[Table, tuple[Any, F64]] = WeakKeyDictionary()


def table_of(table: Table) -> Any:
    """``hfx_table``; rebuilt when the table has got more samples."""
    samples = table.samples
    if table not in _TABLES or _TABLES[table][1] is not samples:
        kind = structure("hfx_table")
        names = (name for name, _ in kind._fields_)
        made = kind(
            *(samples.shape[1] if each == "room" else getattr(table, each) for each in names)
        )
        made.most_room = int(_rooms(table).max(initial=0))
        _TABLES[table] = made, samples
    return _TABLES[table][0]


def _rooms(table: Table) -> I64:
    """Number of doubles that the library needs for each cluster; see ``hfx_narrow_phase``."""
    return 6 * table.place_counts + 3 * table.unit_counts + np.diff(table.cell_starts)


def mesh_of(mesh: Mesh) -> Any:
    """``hfx_skin_mesh``; the arrays live as long as the mesh."""
    if mesh not in _MESHES:
        kind = structure("hfx_skin_mesh")
        _MESHES[mesh] = kind(*(getattr(mesh, name) for name, _ in kind._fields_))
    return _MESHES[mesh]
