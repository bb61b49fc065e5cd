# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed meshes as volumes: inside test, tree of boxes, and distances; ``mesh.h``."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from .declarations import structure
from .library import f64, i64, loaded

SPAN: Final = 16
"""Numbers of a triangle: y of its corners, low to high (3); x of the lowest and the middle one (2),
slopes in x of the edges low to high, low to middle, middle to high (3); the same in z (5); +1 or
-1, which way it faces; two unused."""


def bounds_in_columns(corners: F64, listed: I64, columns: I64, cells: I64, margin: float) -> I64:
    """Bounds of listed triangles within their columns: eight bounds packed into one number each.

    Parameters
    ----------
    corners : (F, 3, 3) float64
        Triangle, corner, coordinate; in cells.
    listed, columns : (n,) int64
        Triangles, and the column that each is listed for.
    cells : (3,) int64
        How many there are.
    margin : float
        In cells: far above rounding.

    Returns
    -------
    (n,) int64
        As the compiled test reads them.
    """
    bounds = np.empty(len(listed), np.int64)
    loaded().hfx_mesh_bounds(
        *(corners, listed, columns, len(listed), int(cells[1]), int(cells[2]), margin, bounds)
    )
    return bounds


class NativeGrid:
    """Voxels and runs of triangles, as the compiled test reads them.

    Parameters
    ----------
    box : (2, 3) float64
        Lowest and highest corner; what is beyond is outside.
    axes : (3,) int64
        Which of a point's coordinates is x, y, z of the cells.
    scale : (3,) float64
        Cells per length.
    cells : (3,) int64
        How many there are.
    codes : (X * Y * Z,) int64
        Of each cell: its run, -1 outside, -2 inside.
    offsets : (runs + 1,) int64
        Where the triangles of each run begin.
    beyond : (runs,) int64
        Winding number beyond its upper end.
    listed : (n,) int64
        Triangles, run after run.
    bounds : (n,) int64
        Where the listed triangles are in their columns, see :func:`bounds_in_columns`.
    spans : (F, 16) float64
        Of the triangles, see :data:`SPAN`.

    Attributes
    ----------
    pointers : Structure
        ``hfx_grid``.
    """

    def __init__(
        self,
        box: F64,
        axes: I64,
        scale: F64,
        cells: I64,
        codes: I64,
        offsets: I64,
        beyond: I64,
        listed: I64,
        bounds: I64,
        spans: F64,
    ) -> None:
        assert bounds.shape == listed.shape and spans.shape[1:] == (SPAN,)
        self.pointers = structure("hfx_grid")(
            *(box, axes, scale, cells, codes, offsets, beyond, listed, bounds, spans)
        )

    def contains(self, points: F64) -> Bool:
        """Inside test of points (3, N), (N,) bool; NaN is outside."""
        inside = np.empty(points.shape[1], np.bool_)
        loaded().hfx_mesh_inside(self.pointers, points, points.shape[1], inside)
        return inside


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


_SLACK: Final = 1e-12  # of the largest coordinate: boxes of a tree are that much too small


class NativeMesh:
    """Cells and triangles of a mesh, as the library reads them.

    Parameters
    ----------
    grid : NativeGrid
    tree : NativeTree
        About the middle.
    middle : (3,) float64
        Of the mesh, shape space.
    depth : float
        Radius of the largest ball inside; 0 where nobody asks for it.

    Attributes
    ----------
    pointers : Structure
        ``hfx_mesh``.
    """

    def __init__(self, grid: NativeGrid, tree: NativeTree, middle: F64, depth: float) -> None:
        slack = _SLACK * float(np.abs(np.stack(tree.extent)).max())
        parts = grid.pointers, tree.pointers, middle
        self.pointers = structure("hfx_mesh")(*parts, slack, depth)

    def clearances(self, points: F64) -> F64:
        """Bound of the distance to the boundary of points (3, N), shape space, (N,).

        Within less than its absolute value all points are on the same side of the boundary: it is
        positive outside, negative inside, 0 where no such bound is known without looking, and NaN
        for NaN.
        """
        found = np.empty(points.shape[1])
        loaded().hfx_mesh_clearances(self.pointers, points, points.shape[1], found)
        return found

    def passages(self, starts: F64, ends: F64) -> tuple[F64, F64]:
        """First and last time at which points in straight, even motion are inside, (N,) each.

        From 0 at the ``starts`` (3, N) to 1 at the ``ends``; infinite, and minus infinity, where a
        point is never inside. In between a point may leave the mesh for a while.
        """
        first, last = np.empty((2, starts.shape[1]))
        loaded().hfx_mesh_passages(self.pointers, starts, ends, len(first), first, last)
        return first, last
