# SPDX-License-Identifier: GPL-3.0-or-later
"""Outlines of clusters: bounds of the skin between their vertices; ``skin_outline.c``."""

from __future__ import annotations

import numpy as np

from ..arrays import F64, I32, I64
from .clusters import cut
from .library import loaded
from .skin_mesh import Mesh, mesh_of


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
