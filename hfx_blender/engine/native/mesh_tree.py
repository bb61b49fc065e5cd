# SPDX-License-Identifier: GPL-3.0-or-later
"""Tree of boxes over a mesh's triangles, and distances to these; see
``volume/mesh_distance.py``."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64
from .declarations import structure
from .library import f64, i64, loaded

BOX: Final = 6
FRAME: Final = 16


def leaf_order(corners: F64) -> I64:
    """Triangles as leaves (2^k,), of corners (F, 3, 3); as ``mesh_distance.leaf_order``."""
    count = len(corners)
    size = 1 << (count - 1).bit_length()
    order, spare = np.empty(size, np.int64), np.empty(size, np.int64)
    middles, keys, spare_keys = np.empty((count, 3)), np.empty(size), np.empty(size)
    loaded().hfx_mesh_leaf_order(corners, count, size, order, middles, keys, spare_keys, spare)
    return order


class NativeTree:
    """Triangles and the boxes over them, as the compiled searches read them.

    Parameters
    ----------
    corners : (F, 3, 3) float64
        Triangle, corner, coordinate.
    order : (2^k,) int64
        Triangles as leaves.

    Attributes
    ----------
    boxes : (2^(k + 1), 6) float64
        Lowest and highest corner of each node: 1 is the root, 2 n and 2 n + 1 are the halves
        of n, the leaves come last.
    frames : (2^k, 16) float64
        The triangle of each leaf, in a plane of its own.
    pointers : Structure
        ``hfx_tree``.
    """

    def __init__(self, corners: F64, order: I64) -> None:
        self.corners, self.order = f64(corners), i64(order)
        self.size = len(self.order)
        self.boxes = np.zeros((2 * self.size, BOX))
        self.frames = np.empty((self.size, FRAME))
        loaded().hfx_mesh_boxes(self.corners, self.order, self.size, self.boxes)
        loaded().hfx_mesh_frames(self.corners, self.order, self.size, self.frames)
        arrays = self.boxes, self.order, self.corners, self.frames
        self.pointers = structure("hfx_tree")(*arrays, self.size)

    @property
    def extent(self) -> tuple[F64, F64]:
        """Lowest and highest corner of all triangles, (3,) each."""
        return self.boxes[1, :3], self.boxes[1, 3:]

    def nearest(self, points: F64, reach: float = np.inf) -> tuple[I64, F64]:
        """Leaf and distance of the triangle nearest to each point of (3, N), both (N,): -1 and
        infinity beyond ``reach``, -1 and NaN where not finite."""
        count = points.shape[1]
        leaves, distances = np.empty(count, np.int64), np.empty(count)
        loaded().hfx_mesh_nearest(self.pointers, points, count, reach, leaves, distances)
        return leaves, distances

    def distances_beyond(self, points: F64, limit: float, slack: float, width: int) -> F64:
        """``TriangleTree.distances_beyond`` for finite points (3, N); ``width`` boxes are followed
        for a first guess."""
        found = np.empty(points.shape[1])
        nodes, away = np.empty(2 * width, np.int64), np.empty(2 * width)
        loaded().hfx_mesh_distances_beyond(
            *(self.pointers, points, points.shape[1], limit, slack, width, nodes, away, found)
        )
        return found
