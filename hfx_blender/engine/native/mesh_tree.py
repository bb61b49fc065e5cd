# SPDX-License-Identifier: GPL-3.0-or-later
"""The tree of boxes over a mesh's triangles, compiled; see ``volume/mesh_distance.py``."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Final

import numpy as np

from ..arrays import F64, I64
from .library import DOUBLES, INTEGER, LONGS, f64, i64, loaded, structure

BOX: Final = 6
FRAME: Final = 16

_Tree = structure(
    "hfx_tree", boxes=DOUBLES, order=LONGS, corners=DOUBLES, frames=DOUBLES, size=INTEGER
)


@cache
def _calls() -> ctypes.CDLL:
    """The library, with the arguments of these functions."""
    found = loaded()
    found.hfx_mesh_leaf_order.argtypes = [
        *(DOUBLES, INTEGER, INTEGER, LONGS),
        *(DOUBLES, DOUBLES, DOUBLES, LONGS),
    ]
    for each in (found.hfx_mesh_boxes, found.hfx_mesh_frames):
        each.argtypes = [DOUBLES, LONGS, INTEGER, DOUBLES]
    for name in ("leaf_order", "boxes", "frames"):
        getattr(found, f"hfx_mesh_{name}").restype = None
    return found


def leaf_order(corners: F64) -> I64:
    """Triangles as leaves (2^k,), of corners (F, 3, 3); as ``mesh_distance.leaf_order``."""
    corners = f64(corners)
    count = len(corners)
    size = 1 << (count - 1).bit_length()
    order, spare = np.empty(size, np.int64), np.empty(size, np.int64)
    middles, keys, spare_keys = np.empty((count, 3)), np.empty(size), np.empty(size)
    scratch = order, middles, keys, spare_keys, spare
    _calls().hfx_mesh_leaf_order(corners, count, size, *scratch)
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
    address : int
        Of ``hfx_tree``, as long as this lives.
    """

    def __init__(self, corners: F64, order: I64) -> None:
        self.corners, self.order = f64(corners), i64(order)
        self.size = len(self.order)
        self.boxes = np.zeros((2 * self.size, BOX))
        self.frames = np.empty((self.size, FRAME))
        _calls().hfx_mesh_boxes(self.corners, self.order, self.size, self.boxes)
        _calls().hfx_mesh_frames(self.corners, self.order, self.size, self.frames)
        self._structure = _Tree(self.boxes, self.order, self.corners, self.frames, self.size)
        self.address = ctypes.addressof(self._structure)

    @property
    def extent(self) -> tuple[F64, F64]:
        """Lowest and highest corner of all triangles, (3,) each."""
        return self.boxes[1, :3], self.boxes[1, 3:]
