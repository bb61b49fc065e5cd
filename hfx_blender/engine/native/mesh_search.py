# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside tests, distances and crossings of closed meshes; ``mesh.h``."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from .declarations import structure
from .library import f64, i64, loaded

SPAN: Final = 16
"""Elements of a prepared triangle: y of its corners in ascending order (3); x of the lowest and of
the middle corner (2), slopes in x of the edges low-high, low-middle and middle-high (3); z and its
slopes (5); orientation +1 or -1 (1); padding (2)."""


def bounds_in_columns(corners: F64, listed: I64, columns: I64, cells: I64, margin: float) -> I64:
    """Bounds of listed triangles within their columns, eight bounds packed into each int64.

    Parameters
    ----------
    corners : (F, 3, 3) float64
        Triangle, corner, axis; in cells.
    listed, columns : (n,) int64
        Triangle, and column in which it is listed.
    cells : (3,) int64
        Number of cells along each axis.
    margin : float
        Growth of the bounds, in cells.

    Returns
    -------
    (n,) int64
        Opaque; read by the compiled inside test.
    """
    bounds = np.empty(len(listed), np.int64)
    loaded().hfx_mesh_bounds(
        *(corners, listed, columns, len(listed), int(cells[1]), int(cells[2]), margin, bounds)
    )
    return bounds


class NativeGrid:
    """Voxel grid for inside tests, with the triangles of each run of mixed voxels; ``hfx_grid``.

    Parameters
    ----------
    box : (2, 3) float64
        Lowest and highest corner; points beyond are outside.
    axes : (3,) int64
        Coordinate of a point that becomes x, y and z of the grid.
    scale : (3,) float64
        Cells per length.
    cells : (3,) int64
        Number of cells along each axis.
    codes : (X * Y * Z,) int64
        Run of each voxel; -1 for outside, -2 for inside.
    offsets : (runs + 1,) int64
        First listed triangle of each run.
    beyond : (runs,) int64
        Winding number above the upper end of each run.
    listed : (n,) int64
        Triangles, run by run.
    bounds : (n,) int64
        See :func:`bounds_in_columns`.
    spans : (F, 16) float64
        Prepared triangles, see :data:`SPAN`.

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
        """Test points (3, N) for being inside, (N,) bool; NaN is outside."""
        inside = np.empty(points.shape[1], np.bool_)
        loaded().hfx_mesh_inside(self.pointers, points, points.shape[1], inside)
        return inside


BOX: Final = 6
FRAME: Final = 16


def leaf_order(corners: F64) -> I64:
    """Triangles (F, 3, 3) sorted into the leaves of a balanced tree, (2^k,) int64.

    Groups are halved at the median centroid along their longest axis. Some triangles occur twice,
    to fill the leaves.
    """
    count = len(corners)
    size = 1 << (count - 1).bit_length()
    order, spare = np.empty(size, np.int64), np.empty(size, np.int64)
    middles, keys, spare_keys = np.empty((count, 3)), np.empty(size), np.empty(size)
    loaded().hfx_mesh_leaf_order(corners, count, size, order, middles, keys, spare_keys, spare)
    return order


class NativeTree:
    """Bounding-box tree over triangles; ``hfx_tree``.

    Parameters
    ----------
    corners : (F, 3, 3) float64
        Triangle, corner, axis.
    order : (2^k,) int64
        Triangle of each leaf, see :func:`leaf_order`.

    Attributes
    ----------
    boxes : (2^(k + 1), 6) float64
        Lowest and highest corner of each node: 1 is the root, 2 n and 2 n + 1 are the children of
        n; the leaves are last.
    frames : (2^k, 16) float64
        Frame of each leaf's triangle in its own plane.
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
        """Leaf and distance of the triangle nearest to each point of (3, N), both (N,).

        -1 and infinity beyond ``reach``; -1 and NaN for points that are not finite.
        """
        count = points.shape[1]
        leaves, distances = np.empty(count, np.int64), np.empty(count)
        loaded().hfx_mesh_nearest(self.pointers, points, count, reach, leaves, distances)
        return leaves, distances

    def distances_beyond(self, points: F64, limit: float, slack: float, width: int) -> F64:
        """Approximate distances (N,) of finite points (3, N), too large by at most share ``slack``.

        A result within ``limit`` only says that the distance is within it. ``width`` is the number
        of boxes followed down the tree for the first upper bound.
        """
        distances = np.empty(points.shape[1])
        nodes, away = np.empty(2 * width, np.int64), np.empty(2 * width)
        loaded().hfx_mesh_distances_beyond(
            *(self.pointers, points, points.shape[1], limit, slack, width, nodes, away, distances)
        )
        return distances


_SLACK: Final = 1e-12  # rounding error of a tree's boxes, share of the largest coordinate


class NativeMesh:
    """Closed mesh for the compiled contact; ``hfx_mesh``.

    Parameters
    ----------
    grid : NativeGrid
        In shape space.
    tree : NativeTree
        In shape space moved by ``-middle``.
    middle : (3,) float64
        Centre of the mesh's box, shape space.
    depth : float
        Radius of the largest inscribed ball; 0 without falloff, which alone needs it.

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
        """Signed lower bounds of the distance to the boundary of points (3, N), shape space, (N,).

        Positive outside, negative inside; all points nearer than the absolute value are on the same
        side. 0 where no bound is known without a search, NaN for NaN.
        """
        clearances = np.empty(points.shape[1])
        loaded().hfx_mesh_clearances(self.pointers, points, points.shape[1], clearances)
        return clearances

    def passages(self, starts: F64, ends: F64) -> tuple[F64, F64]:
        """First and last time at which points in straight, even motion are inside, (N,) each.

        Time is 0 at ``starts`` (3, N) and 1 at ``ends``; infinity and -infinity for a point that is
        never inside. A point may leave the mesh in between.
        """
        first, last = np.empty((2, starts.shape[1]))
        loaded().hfx_mesh_passages(self.pointers, starts, ends, len(first), first, last)
        return first, last
