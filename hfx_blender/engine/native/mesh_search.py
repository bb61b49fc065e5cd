# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside tests, distances and crossings of closed meshes; ``mesh.h``."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ..arrays import F64, I64
from .declarations import structure
from .library import f64, i64, loaded


def bounds_in_columns(corners: F64, listed: I64, columns: I64, cells: I64, margin: float) -> I64:
    """Bounds of listed triangles within their columns, eight bounds packed into each int64, (n,).

    Opaque; read by the compiled inside test. ``corners`` (F, 3, 3) and ``margin``, the growth of
    the bounds, are in cells; ``listed`` and ``columns`` (n,) are triangle and column of each list
    entry; ``cells`` (3,) counts cells along each axis.
    """
    bounds = np.empty(len(listed), np.int64)
    loaded().hfx_mesh_bounds(
        *(corners, listed, columns, len(listed), int(cells[1]), int(cells[2]), margin, bounds)
    )
    return bounds


_BOX: Final = 6  # lowest and highest corner
_FRAME: Final = 16


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


def tree_structure(corners: F64, order: I64) -> Any:
    """Bounding-box tree over triangles (F, 3, 3), ``hfx_tree``.

    ``order`` (2^k,) is the triangle of each leaf. Boxes belong to nodes: 1 is the root, 2 n and
    2 n + 1 are the children of n, the leaves are last. Frames belong to the leaves' triangles.
    """
    corners, order = f64(corners), i64(order)
    boxes, frames = np.zeros((2 * len(order), _BOX)), np.empty((len(order), _FRAME))
    loaded().hfx_mesh_boxes(corners, order, len(order), boxes)
    loaded().hfx_mesh_frames(corners, order, len(order), frames)
    return structure("hfx_tree")(boxes, order, corners, frames, len(order))


_SLACK: Final = 1e-12  # rounding error of a tree's boxes, share of the largest coordinate


class NativeMesh:
    """Closed mesh for the compiled contact; ``pointers`` is ``hfx_mesh``.

    ``grid`` is ``hfx_grid`` in shape space; ``tree`` is ``hfx_tree``, moved by ``-middle``, the
    centre of the mesh's box; ``largest`` the largest absolute coordinate of the tree; ``depth`` the
    radius of the largest inscribed ball, 0 without falloff.
    """

    def __init__(self, grid: Any, tree: Any, largest: float, middle: F64, depth: float) -> None:
        self.pointers = structure("hfx_mesh")(grid, tree, middle, _SLACK * largest, depth)

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
