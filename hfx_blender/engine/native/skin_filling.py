# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills in the sampling of the skin of clusters; ``skin_filling.c``."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64
from .declarations import structure
from .library import loaded
from .skin_table import Mesh, Table, mesh_of, table_of

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
