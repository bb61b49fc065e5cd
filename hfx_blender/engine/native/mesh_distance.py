# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of points to a mesh's triangles, compiled; see ``volume/mesh_distance.py``."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from ..arrays import F64, I64
from .library import DOUBLE, DOUBLES, INTEGER, LONGS, POINTER, f64, loaded
from .mesh_tree import NativeTree


@cache
def _calls() -> ctypes.CDLL:
    """The library, with the arguments of these functions."""
    found = loaded()
    found.hfx_mesh_nearest.argtypes = [POINTER, DOUBLES, INTEGER, DOUBLE, LONGS, DOUBLES]
    found.hfx_mesh_distances_beyond.argtypes = [
        *(POINTER, DOUBLES, INTEGER, DOUBLE, DOUBLE, INTEGER),
        *(LONGS, DOUBLES, DOUBLES),
    ]
    found.hfx_mesh_nearest.restype = found.hfx_mesh_distances_beyond.restype = None
    return found


def nearest(tree: NativeTree, points: F64, reach: float = np.inf) -> tuple[I64, F64]:
    """Leaf and distance of the triangle nearest to each point of (3, N), both (N,): -1 and
    infinity beyond ``reach``, -1 and NaN where not finite."""
    points = f64(points)
    count = points.shape[1]
    leaves, distances = np.empty(count, np.int64), np.empty(count)
    _calls().hfx_mesh_nearest(tree.address, points, count, reach, leaves, distances)
    return leaves, distances


def distances_beyond(tree: NativeTree, points: F64, limit: float, slack: float, width: int) -> F64:
    """``TriangleTree.distances_beyond`` for finite points (3, N); ``width`` boxes are followed for
    a first guess."""
    points = f64(points)
    found = np.empty(points.shape[1])
    nodes, away = np.empty(2 * width, np.int64), np.empty(2 * width)
    _calls().hfx_mesh_distances_beyond(
        *(tree.address, points, points.shape[1], limit, slack, width),
        *(nodes, away, found),
    )
    return found
