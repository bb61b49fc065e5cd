# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin of a model as the library reads it, and its filling in; ``skin.h``, ``skin_filling.c``."""

from __future__ import annotations

from typing import Any, Final, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I32, I64
from .declarations import structure
from .library import loaded


class Mesh(Protocol):
    """See :class:`..skin.skin_table.SkinMesh`."""

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


_EXTENT: Final = 7  # numbers in extent


def fill(
    table: Table, mesh: Mesh, clusters: I64, samples: int, spacing: F64, most_share: float
) -> int:
    """Fill in clusters of a table, all but the samples.

    Parameters
    ----------
    table : Table
        Its arrays are written to.
    mesh : Mesh
        Its surface.
    clusters : (k,) int64
        Ascending.
    samples : int
        How many the table has.
    spacing : (3, V) float64
        Of vertices of the mesh: how far skin may be from its samples, metres, and how far at the
        finest; one over the spacing of vertices, but for a factor.
    most_share : float
        Of a unit, that its vertex stands for.

    Returns
    -------
    int
        How many samples it is to have.
    """
    first = table.starts[clusters]
    quads = table.quad_starts[first + table.unit_counts[clusters]] - table.quad_starts[first]
    cells = int((table.cell_starts[clusters + 1] - table.cell_starts[clusters]).max())
    rooms = (
        *np.zeros((2, len(mesh.vertices)), np.int64),
        np.empty((int(quads.max()), _EXTENT)),
        np.empty(int(table.unit_counts[clusters].max())),
        np.empty(cells),
        np.empty(cells, np.int64),
    )
    shared = table_of(table), mesh_of(mesh), structure("hfx_spacing")(*spacing, most_share)
    count: int = loaded().hfx_fill(*shared, len(clusters), clusters, samples, *rooms)
    return count


def place_samples(table: Table, clusters: I64) -> None:
    """Write the samples of clusters that were filled in; the table has room for them."""
    loaded().hfx_place_samples(table_of(table), len(clusters), clusters)
