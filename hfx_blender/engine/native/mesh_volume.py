# SPDX-License-Identifier: GPL-3.0-or-later
"""A closed mesh as a volume, compiled; see ``volume/mesh.py``."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Final

import numpy as np

from ..arrays import F64
from .library import DOUBLE, DOUBLES, INTEGER, POINTER, f64, loaded, structure
from .mesh_inside import NativeGrid
from .mesh_tree import NativeTree

_SLACK: Final = 1e-12  # of the largest coordinate: boxes of a tree are that much too small

_Mesh = structure(
    "hfx_mesh", grid=POINTER, tree=POINTER, middle=DOUBLES, slack=DOUBLE, depth=DOUBLE
)


@cache
def _calls() -> ctypes.CDLL:
    """The library, with the arguments of these functions."""
    found = loaded()
    found.hfx_mesh_clearances.argtypes = [POINTER, DOUBLES, INTEGER, DOUBLES]
    found.hfx_mesh_passages.argtypes = [POINTER, DOUBLES, DOUBLES, INTEGER, DOUBLES, DOUBLES]
    found.hfx_mesh_clearances.restype = found.hfx_mesh_passages.restype = None
    return found


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
    address : int
        Of ``hfx_mesh``, as long as this lives.
    """

    def __init__(self, grid: NativeGrid, tree: NativeTree, middle: F64, depth: float) -> None:
        slack = _SLACK * float(np.abs(np.stack(tree.extent)).max())
        self._made_of = grid, tree
        self._structure = _Mesh(grid.address, tree.address, f64(middle), slack, depth)
        self.address = ctypes.addressof(self._structure)

    def clearances(self, points: F64) -> F64:
        """See :meth:`..volume.mesh.MeshVolume.clearance`."""
        points = f64(points)
        found = np.empty(points.shape[1])
        _calls().hfx_mesh_clearances(self.address, points, points.shape[1], found)
        return found

    def passages(self, starts: F64, ends: F64) -> tuple[F64, F64]:
        """See :meth:`..volume.mesh.MeshVolume.passage`."""
        starts, ends = f64(starts), f64(ends)
        first, last = np.empty((2, starts.shape[1]))
        _calls().hfx_mesh_passages(self.address, starts, ends, len(first), first, last)
        return first, last
