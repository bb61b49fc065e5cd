# SPDX-License-Identifier: GPL-3.0-or-later
"""Upper bounds of the size of cells of skin in a pose: the mean distance from their vertex.

Bones stretch skin and pull it apart where they bend. Known for whole clusters from the bones
alone, so that no skin is posed to find out that its vertices tell enough of it.
"""

from __future__ import annotations

from typing import Any

from ..arrays import I64
from ..native.clusters import CellGroups
from .skin_table import SkinTable
from .skinned_model import SkinnedModel


class CellSizes:
    """Upper bounds of the sizes of a skin's cells on a body that bones move, cluster by cluster.

    With weights u of a place x of skin and v of its cell's vertex at y, and any matrix R,
    sum u M x - sum v M y = sum u L (x - y) + sum (u - v) (M - R) y: the first part is at most
    what bones stretch times the way at rest, the second how differently bones move the vertex
    times how far the weights differ.

    Parameters
    ----------
    table : SkinTable
        The skin, none of which needs to be filled in.
    surface : SkinnedModel
        Binds the surface of the skin, in its outlines.
    vertices : SkinnedModel, optional
        Binds the model's own vertices, in the clusters of the skin, where its surface is that
        of a finer model.
    """

    def __init__(
        self, table: SkinTable, surface: SkinnedModel, vertices: SkinnedModel | None
    ) -> None:
        self._table, self._surface, self._vertices = table, surface, vertices
        self._native = CellGroups(len(surface.clusters))

    def pointers(self, clusters: I64) -> Any:
        """Native table of all clusters, with these filled in."""
        new = self._native.lacking(clusters)
        if len(new):
            surface = self._surface.native_clusters(new)
            own = None if self._vertices is None else self._vertices.native_clusters(new)
            self._native.add(new, self._table, self._table.mesh, surface, own)
        return self._native.table
