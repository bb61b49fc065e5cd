# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of points to a mesh's triangles, compiled; see ``volume/mesh_distance.py``."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, Final

import numpy as np

from ..arrays import F64, I64
from .library import DOUBLE, DOUBLES, INTEGER, LONGS, f64, loaded
from .mesh_tree import NativeTree

_LOOKED: Final = 0.5  # of what a bound may lack is lost in a search, the rest on the way from it


@cache
def _calls() -> ctypes.CDLL:
    """The library, with the arguments of these functions."""
    found = loaded()
    shared = DOUBLES, INTEGER, DOUBLES, DOUBLES, INTEGER
    found.hfx_mesh_nearest.argtypes = [*shared, DOUBLE, LONGS, DOUBLES]
    found.hfx_mesh_distances_at_least.argtypes = [*shared, DOUBLE, DOUBLE, DOUBLES]
    found.hfx_mesh_distances_beyond.argtypes = [
        *(*shared, DOUBLE, DOUBLE, INTEGER),
        *(LONGS, DOUBLES, DOUBLES),
    ]
    for name in ("nearest", "distances_at_least", "distances_beyond"):
        getattr(found, f"hfx_mesh_{name}").restype = None
    return found


def _tree(tree: NativeTree) -> list[Any]:
    return [tree.boxes, tree.size, tree.frames]


def nearest(tree: NativeTree, points: F64, reach: float = np.inf) -> tuple[I64, F64]:
    """Leaf and distance of the triangle nearest to each point of (3, N), both (N,): -1 and
    infinity beyond ``reach``, -1 and NaN where not finite."""
    points = f64(points)
    count = points.shape[1]
    leaves, distances = np.empty(count, np.int64), np.empty(count)
    _calls().hfx_mesh_nearest(*_tree(tree), points, count, reach, leaves, distances)
    return leaves, distances


def distances_at_least(tree: NativeTree, points: F64, share: float) -> F64:
    """Lower bound of the distances, at least ``share`` (below 1) of each; much faster where
    consecutive points are near each other."""
    points = f64(points)
    found = np.empty(points.shape[1])
    _calls().hfx_mesh_distances_at_least(
        *_tree(tree), points, points.shape[1], share, 1.0 - _LOOKED * (1.0 - share), found
    )
    return found


def distances_beyond(tree: NativeTree, points: F64, limit: float, slack: float, width: int) -> F64:
    """``TriangleTree.distances_beyond`` for finite points (3, N); ``width`` boxes are followed for
    a first guess."""
    points = f64(points)
    found = np.empty(points.shape[1])
    nodes, away = np.empty(2 * width, np.int64), np.empty(2 * width)
    _calls().hfx_mesh_distances_beyond(
        *(*_tree(tree), points, points.shape[1], limit, slack, width),
        *(nodes, away, found),
    )
    return found
