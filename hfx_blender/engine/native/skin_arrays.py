# SPDX-License-Identifier: GPL-3.0-or-later
"""A model's skin as the library reads it; ``skin.h``, ``skin_filling.c``."""

from __future__ import annotations

from typing import Any, Final, Protocol
from weakref import WeakKeyDictionary

import numpy as np

from ..arrays import F32, F64, I32, I64
from .declarations import structure
from .library import loaded


class SurfaceArrays(Protocol):
    """Arrays that the library reads of a :class:`..skin.skin_table.SkinMesh`."""

    @property
    def vertices(self) -> F32: ...
    @property
    def triangles(self) -> I32: ...


class SkinTableArrays(Protocol):
    """Arrays that the library reads and fills of a :class:`..skin.skin_table.SkinTable`."""

    starts: I64
    place_counts: I64
    unit_counts: I64
    quad_starts: I64
    cell_starts: I64
    cells: I32
    largest_cell: int

    @property
    def samples(self) -> F64: ...


_MESHES: WeakKeyDictionary[SurfaceArrays, Any] = WeakKeyDictionary()
_TABLES: WeakKeyDictionary[SkinTableArrays, tuple[Any, F64]] = WeakKeyDictionary()


def table_structure(table: SkinTableArrays) -> Any:
    """Cached ``hfx_table`` of a table; rebuilt after its samples have moved to a larger array."""
    samples = table.samples
    if table not in _TABLES or _TABLES[table][1] is not samples:
        kind = structure("hfx_table")
        names = (name for name, _ in kind._fields_)
        filled = kind(
            *(samples.shape[1] if name == "room" else getattr(table, name) for name in names)
        )
        filled.most_room = int(_rooms(table).max(initial=0))
        _TABLES[table] = filled, samples
    return _TABLES[table][0]


def _rooms(table: SkinTableArrays) -> I64:
    """Work space of each cluster, float64 elements; see ``hfx_narrow_phase``."""
    return 6 * table.place_counts + 3 * table.unit_counts + np.diff(table.cell_starts)


def mesh_structure(mesh: SurfaceArrays) -> Any:
    """Cached ``hfx_skin_mesh`` of a mesh, valid as long as the mesh lives."""
    if mesh not in _MESHES:
        kind = structure("hfx_skin_mesh")
        _MESHES[mesh] = kind(*(getattr(mesh, name) for name, _ in kind._fields_))
    return _MESHES[mesh]


_EXTENT: Final = 7  # float64 elements of the C structure ``extent``


def fill(
    table: SkinTableArrays,
    mesh: SurfaceArrays,
    clusters: I64,
    samples: int,
    spacing: F64,
    most_share: float,
) -> int:
    """Fill in clusters (k,), ascending, of a table in place, except their samples.

    Returns the number of samples to be held by the table including these clusters.

    Parameters
    ----------
    mesh : SurfaceArrays
        Surface of the table.
    samples : int
        Number of samples already in the table.
    spacing : (3, V) float64
        For each vertex of the mesh: largest distance of skin from a sample, and this distance at
        the finest, metres; then the reciprocal spacing of vertices, up to a constant factor.
    most_share : float
        Largest share of a unit's skin that the vertex represents as a sample.
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
    shared = (
        table_structure(table),
        mesh_structure(mesh),
        structure("hfx_spacing")(*spacing, most_share),
    )
    count: int = loaded().hfx_fill(*shared, len(clusters), clusters, samples, *rooms)
    return count


def place_samples(table: SkinTableArrays, clusters: I64) -> None:
    """Write the samples of filled-in clusters; the table must have room."""
    loaded().hfx_place_samples(table_structure(table), len(clusters), clusters)
