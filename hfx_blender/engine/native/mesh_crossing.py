# SPDX-License-Identifier: GPL-3.0-or-later
"""Crossings of straight paths with a mesh's surface, compiled; see ``volume/mesh_crossing.py``."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
import numpy.typing as npt

from .library import INTEGER, POINTER, f64, library, pointer
from .mesh_tree import NativeTree

F64 = npt.NDArray[np.float64]


@cache
def _calls() -> ctypes.CDLL:
    """The library, with the arguments of these functions."""
    found = library()
    assert found is not None
    found.hfx_mesh_crossings.argtypes = (
        [POINTER] * 2 + [INTEGER, POINTER, ctypes.c_double]
        + [POINTER] * 3 + [INTEGER] + [POINTER] * 2
    )  # fmt: skip
    found.hfx_mesh_crossings.restype = None
    return found


def crossings(
    tree: NativeTree, slack: float, middle: F64, starts: F64, ends: F64
) -> tuple[F64, F64]:
    """First and last time at which points in straight motion cross the surface, (N,) each.

    Parameters
    ----------
    tree : NativeTree
    slack : float
        How much its boxes are too small.
    middle : (3,) float64
        What the tree is about, in the points' space.
    starts, ends : (3, N) float64

    Returns
    -------
    first, last : (N,) float64
        From 0 at the start to 1 at the end; infinite, and minus infinity, where nothing is
        crossed and where a place is not finite.
    """
    middle, starts, ends = f64(middle), f64(starts), f64(ends)
    first, last = np.empty(starts.shape[1]), np.empty(starts.shape[1])
    _calls().hfx_mesh_crossings(
        pointer(tree.boxes), pointer(tree.order), tree.size, pointer(tree.corners), slack,
        pointer(middle), pointer(starts), pointer(ends), starts.shape[1], pointer(first),
        pointer(last),
    )  # fmt: skip
    return first, last
