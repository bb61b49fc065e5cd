# SPDX-License-Identifier: GPL-3.0-or-later
"""A closed mesh as a volume, compiled; see ``volume/mesh.py``."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64
from .declarations import structure
from .library import loaded
from .mesh_inside import NativeGrid
from .mesh_tree import NativeTree

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
        """See :meth:`..volume.mesh.MeshVolume.clearance`."""
        found = np.empty(points.shape[1])
        loaded().hfx_mesh_clearances(self.pointers, points, points.shape[1], found)
        return found

    def passages(self, starts: F64, ends: F64) -> tuple[F64, F64]:
        """See :meth:`..volume.mesh.MeshVolume.passage`."""
        first, last = np.empty((2, starts.shape[1]))
        loaded().hfx_mesh_passages(self.pointers, starts, ends, len(first), first, last)
        return first, last
