# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside test of a closed mesh, compiled; see ``volume/mesh_inside.py``."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from .declarations import structure
from .library import loaded

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
