# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways of points across a mesh's surface, compiled; see ``volume/mesh_crossing.py``."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..arrays import F64, Bool
from .library import BYTES, DOUBLE, DOUBLES, INTEGER, LONGS, POINTER, f64, i64, loaded, structure
from .mesh_tree import NativeTree

if TYPE_CHECKING:
    from ..ways import Ways


MOST_STEPS: Final = 64  # of a way

_Surface = structure(
    "hfx_surface",
    boxes=DOUBLES,
    order=LONGS,
    size=INTEGER,
    corners=DOUBLES,
    slack=DOUBLE,
    middle=DOUBLES,
)
_Ways = structure(
    "hfx_ways",
    **dict.fromkeys(("count", "steps", "all"), INTEGER),
    **{"from_before": DOUBLES, "from_after": DOUBLES, "interval": LONGS},
    **{"before": DOUBLES, "after": DOUBLES},
)


@cache
def _calls() -> ctypes.CDLL:
    """The library, with the arguments of these functions."""
    found = loaded()
    found.hfx_mesh_crossings.argtypes = [POINTER, POINTER, DOUBLES, DOUBLES]
    found.hfx_mesh_nears.argtypes = [POINTER, POINTER, DOUBLES, BYTES]
    found.hfx_mesh_crossings.restype = found.hfx_mesh_nears.restype = None
    return found


class _Call:
    """The structures that both functions take; they hold what these point to."""

    def __init__(self, tree: NativeTree, slack: float, middle: F64, ways: Ways) -> None:
        if ways.steps > MOST_STEPS:
            raise ValueError(f"ways: expected at most {MOST_STEPS} steps, got {ways.steps}")
        self._surface = _Surface(
            tree.boxes, tree.order, tree.size, tree.corners, slack, f64(middle)
        )
        self._ways = _Ways(
            *(ways.before.shape[1], ways.steps, ways.from_before.shape[1]),
            *(f64(ways.from_before), f64(ways.from_after), i64(ways.intervals)),
            *(f64(ways.before), f64(ways.after)),
        )
        self.addresses: tuple[Any, Any] = (
            ctypes.addressof(self._surface),
            ctypes.addressof(self._ways),
        )


def crossings(tree: NativeTree, slack: float, middle: F64, ways: Ways) -> tuple[F64, F64]:
    """First and last time at which points on their paths cross the surface, (N,) each.

    Parameters
    ----------
    slack : float
        How much its boxes are too small.
    middle : (3,) float64
        What the tree is about, in the points' space.

    Returns
    -------
    first, last : (N,) float64
        From 0 at the start to 1 at the end; infinite, and minus infinity, where nothing is
        crossed and where a place is not finite.
    """
    first, last = np.empty(len(ways.intervals)), np.empty(len(ways.intervals))
    call = _Call(tree, slack, middle, ways)
    _calls().hfx_mesh_crossings(*call.addresses, first, last)
    return first, last


def comes_near(tree: NativeTree, slack: float, middle: F64, ways: Ways, reaches: F64) -> Bool:
    """Paths that may come within ``reaches`` (N,) of the surface; see :func:`crossings`."""
    reaches, near = f64(reaches), np.empty(len(ways.intervals), np.uint8)
    call = _Call(tree, slack, middle, ways)
    _calls().hfx_mesh_nears(*call.addresses, reaches, near)
    return near.astype(np.bool_)
