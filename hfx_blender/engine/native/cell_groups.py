# SPDX-License-Identifier: GPL-3.0-or-later
"""Upper bounds of the sizes of cells in a pose, from what is known at rest; ``cell_groups.c``."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import I64
from ..indexing import lacking
from .declarations import structure
from .library import loaded
from .skin_binding import Clusters
from .skin_table import Mesh, Table, mesh_of, table_of


class CellGroups:
    """Groups of cells of the clusters of a skin; see :class:`..skin.cell_sizes.CellSizes`.

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
        """Clusters that are not filled in yet, ascending."""
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
