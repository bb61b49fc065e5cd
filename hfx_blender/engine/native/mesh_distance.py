# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of points to a mesh's triangles, compiled; see ``volume/mesh_distance.py``."""

from __future__ import annotations

import numpy as np

from ..arrays import F64, I64
from .library import loaded
from .mesh_tree import NativeTree


def nearest(tree: NativeTree, points: F64, reach: float = np.inf) -> tuple[I64, F64]:
    """Leaf and distance of the triangle nearest to each point of (3, N), both (N,): -1 and
    infinity beyond ``reach``, -1 and NaN where not finite."""
    count = points.shape[1]
    leaves, distances = np.empty(count, np.int64), np.empty(count)
    loaded().hfx_mesh_nearest(tree.pointers, points, count, reach, leaves, distances)
    return leaves, distances


def distances_beyond(tree: NativeTree, points: F64, limit: float, slack: float, width: int) -> F64:
    """``TriangleTree.distances_beyond`` for finite points (3, N); ``width`` boxes are followed for
    a first guess."""
    found = np.empty(points.shape[1])
    nodes, away = np.empty(2 * width, np.int64), np.empty(2 * width)
    loaded().hfx_mesh_distances_beyond(
        *(tree.pointers, points, points.shape[1], limit, slack, width, nodes, away, found)
    )
    return found
