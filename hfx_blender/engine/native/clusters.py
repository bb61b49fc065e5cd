# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of the vertices of a model, their outlines, and bounds of the sizes of their cells;
``clusters.c``, ``skin_outline.c``, ``cell_groups.c``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import F32, F64, I32, I64, lacking
from .declarations import structure
from .library import loaded
from .skin import Clusters
from .skin_table import Mesh, Table, mesh_of, table_of

_DEPTH = 64  # no more halvings follow each other


def split(pieces: list[I32], vertices: F32, load: I64 | None, leaf_size: int) -> list[I32]:
    """Halve pieces at the median of their longest axis until every one is small enough.

    Parameters
    ----------
    pieces : list of (n,) int32
        Vertex ids, none in two places.
    vertices : (V, 3) float32
    load : (V,) int64 or None
        How much of ``leaf_size`` each vertex takes; 1 by default.

    Returns
    -------
    list of (n,) int32
        Ascending vertex ids, in the order of the pieces.
    """
    if not pieces:
        return []
    ids = np.concatenate(pieces)
    todo = np.zeros(len(pieces) + _DEPTH, np.int64)
    todo[: len(pieces)] = np.cumsum([len(some) for some in pieces])[::-1]
    ends, room = np.empty(len(ids), np.int64), np.empty((2, len(ids)), np.uint64)
    found = loaded().hfx_split(len(pieces), todo, ids, vertices, load, leaf_size, ends, room)
    return cut(ids, ends[:found])


def cut(ids: I32, ends: I64) -> list[I32]:
    """Split an array into pieces that end at the given places."""
    last = ends.tolist()
    return [ids[first:end] for first, end in zip([0, *last], last, strict=False)]


def outlined(mesh: Mesh, starts: I64, units: I32, cluster_of: I64) -> tuple[list[I32], F64]:
    """Outline of each cluster: its units, the corners around them, and the margin of its skin.

    Parameters
    ----------
    starts : (C + 1,) int64
        Each cluster's first unit.
    units : (V,) int32
        Vertices of the mesh, cluster by cluster.
    cluster_of : (V,) int64
        The cluster of each.

    Returns
    -------
    outlines : list of (n,) int32
        A cluster's units as they are given, then corners, ascending.
    margins : (C,) float64
        Metres.
    """
    clusters, surface = len(starts) - 1, mesh_of(mesh)
    margins = np.zeros(clusters)
    loaded().hfx_margins(surface, len(mesh.triangles), cluster_of, margins)
    outlines = np.empty(len(units) + 2 * mesh.triangles.size, np.int32)
    seen, ends = np.empty(len(units), np.int64), np.zeros(clusters, np.int64)
    loaded().hfx_outlines(
        *(surface, clusters, starts, units, cluster_of, len(units), seen, outlines, ends)
    )
    return cut(outlines[: ends[-1]].copy(), ends), margins


class CellGroups:
    """Groups of cells of a skin on a body that bones move: bounds of their sizes in any pose.

    The size of a cell is the mean distance from its vertex. Bones stretch skin and pull it apart
    where they bend. Sizes are known for whole clusters from the bones alone, so that no skin is
    posed to find out that its vertices tell enough of it.

    With weights u of a place x of skin and v of its cell's vertex at y, and any matrix R,
    sum u M x - sum v M y = sum u L (x - y) + sum (u - v) (M - R) y: the first part is at most
    what bones stretch times the way at rest, the second how differently bones move the vertex
    times how far the weights differ.

    Parameters
    ----------
    count : int
        Of clusters.

    Attributes
    ----------
    table : array of ``hfx_groups``
        Of all clusters; only those are filled in that :meth:`add` was given.
    """

    def __init__(self, count: int) -> None:
        self.table: Any = (structure("hfx_groups") * count)()
        self._rows = np.frombuffer(memoryview(self.table), np.int64).reshape(count, -1)
        self._is_known = np.zeros(count, np.bool_)
        self._kept: list[npt.NDArray[Any]] = []

    def lacking(self, clusters: I64) -> I64:
        """Sorted unique ids of clusters without an entry."""
        return lacking(self._is_known, clusters)

    def add(
        self, clusters: I64, table: Table, mesh: Mesh, surface: Clusters, own: Clusters | None
    ) -> None:
        """Fill in some clusters.

        Parameters
        ----------
        clusters : (k,) int64
        table : Table
            None of it needs to be filled.
        mesh : Mesh
            Its surface.
        surface, own : Clusters
            Those of the surface and of the model's own vertices, with these filled in; None
            where they are the same.
        """
        places = table.place_counts[clusters]
        cells = table.cell_starts[clusters + 1] - table.cell_starts[clusters]
        bones = surface.most_bones + (0 if own is None else own.most_bones)
        most = int(max(places.max(), cells.max()))
        groups, pairs = int(cells.sum()), int(cells.sum()) * bones
        place = np.zeros(len(mesh.vertices), np.int64)
        counts = np.empty(2 * most + bones * (bones + 3), np.int64)
        room = np.empty(most * (10 + 8 * bones) + bones)
        firsts = np.empty((2, len(clusters) + 1), np.int64)
        arrays: list[npt.NDArray[Any]] = [
            np.empty(groups + len(clusters), np.int64),
            np.empty(groups),
            np.empty((groups, 2, 3)),
            np.empty(pairs, np.int64),
            np.empty(pairs),
            np.empty(pairs),
        ]
        loaded().hfx_cell_groups(
            *(table_of(table), mesh_of(mesh), surface.table, own and own.table),
            *(len(clusters), clusters, place, counts, room),
            structure("hfx_found_groups")(*firsts, *arrays),
        )
        of_groups, of_pairs = firsts
        before = np.arange(len(clusters) + 1)
        ends = (of_groups + before, of_groups, of_groups, of_pairs, of_pairs, of_pairs)
        for field, (array, at) in enumerate(zip(arrays, ends, strict=True)):
            kept = array[: at[-1]].copy()
            self._rows[clusters, field] = kept.ctypes.data + at[:-1] * array.strides[0]
            self._kept.append(kept)
        self._rows[clusters, len(arrays)] = np.diff(of_groups)
        self._is_known[clusters] = True
