# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of the vertices of a model, and their outlines, bounds of the skin between them;
``clusters.c``, ``skin_outline.c``."""

from __future__ import annotations

import numpy as np

from ..arrays import F32, F64, I32, I64
from .library import loaded
from .skin_table import Mesh, mesh_of

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
