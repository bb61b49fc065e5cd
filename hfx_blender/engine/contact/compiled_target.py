# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes that have a formula, and their placement relative to a body; ``placing.c``,
``broad.h``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, Final

import numpy as np

from ..arrays import F64, I32, I64
from ..native import library
from ..native.library import (
    DOUBLE,
    DOUBLES,
    INTEGER,
    INTS,
    LONGS,
    POINTER,
    f64,
    i64,
    loaded,
    structure,
)
from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.shape import Falloff, FalloffKind, Shape

_KINDS: Final[dict[type[Shape], int]] = {Cuboid: 0, Sphere: 1, Cylinder: 2, Capsule: 3}

_Target = structure(
    "hfx_target",
    rows=INTEGER,
    kinds=LONGS,
    **dict.fromkeys(("halves", "to_shape", "to_world"), DOUBLES),
    is_flat=INTEGER,
    is_smooth=INTEGER,
    share=DOUBLE,
    amplitude=DOUBLE,
    **dict.fromkeys(("matrices", "body_to_shape", "boxes", "turns"), DOUBLES),
)


@cache
def _calls() -> ctypes.CDLL:
    found = loaded()
    found.hfx_place.argtypes = [
        *(POINTER, LONGS, DOUBLES, DOUBLES, INTS, LONGS),
        *(DOUBLES, DOUBLES, INTEGER, DOUBLE),
    ]
    found.hfx_place.restype = INTEGER
    return found


def is_known(shapes: Sequence[Shape]) -> bool:
    """Test that the library is there and knows the formulas of all given volumes."""
    return library.is_there() and all(type(shape) in _KINDS for shape in shapes)


@lru_cache(maxsize=256)
def _formulas(shapes: tuple[Shape, ...]) -> tuple[I64, F64, F64]:
    """Kinds, halves of segments, and boxes (n, 2, 3) in shape space."""
    halves = [getattr(shape, "half_segment", 0.0) for shape in shapes]
    boxes = np.array([shape.bounds for shape in shapes], np.float64).reshape(-1, 2, 3)
    return i64([_KINDS[type(shape)] for shape in shapes]), f64(halves), boxes


class Target:
    """A volume and a body's place at some rows.

    Parameters
    ----------
    shapes : tuple of Shape
        That :func:`is_known` tells of.
    which : (n,) int64
        The shape of each row.
    falloff : Falloff
    amplitude : float
        Change of weight that need not be sampled.
    matrices, to_shape, to_world : (n, 4, 4) float64
        From shape space to the world, and back; from the body's own space to the world.
    """

    def __init__(
        self,
        shapes: tuple[Shape, ...],
        which: I64,
        falloff: Falloff,
        amplitude: float,
        matrices: F64,
        to_shape: F64,
        to_world: F64,
    ) -> None:
        self.count = len(which)
        kinds, halves, _ = _formulas(shapes)
        found = kinds[which], halves[which], f64(to_shape), f64(to_world)
        rises = *_rises(falloff), amplitude
        self.pointers = _Target(self.count, *found, *rises, f64(matrices))


def _rises(falloff: Falloff) -> tuple[int, int, float]:
    return int(falloff.is_flat), int(falloff.kind is FalloffKind.SMOOTH), falloff.share


_ROW: Final[dict[str, tuple[int, ...]]] = {
    "kinds": (),
    "halves": (),
    "to_shape": (4, 4),
    "to_world": (4, 4),
    "matrices": (4, 4),
    "body_to_shape": (4, 4),
    "boxes": (2, 3),
    "turns": (2,),
}
"""Fields of ``hfx_target`` for each row, in this order: shapes of arrays."""

_ENDS: Final = np.cumsum([0, *(np.prod(shape, dtype=int) for shape in _ROW.values())]).tolist()


class PlacedTarget(Target):
    """Volume and body, placed at some rows of a block.

    Parameters
    ----------
    shapes : tuple of Shape
        That :func:`is_known` tells of.
    shape_index : (T,) int32 or None
        The shape at each row of the block; None: always the first.
    matrices, to_world : (T, 4, 4) float64
        Shape space to the world; the body's own space to the world.
    rows : (n,) int64
        Of the block, ascending.
    falloff, amplitude
        See :class:`Target`.
    farthest : float
        No entry of a matrix is larger.

    Attributes
    ----------
    is_usable : bool
        Whether all of it is: nothing is flattened, endless or not a number.
    """

    def __init__(
        self,
        shapes: tuple[Shape, ...],
        shape_index: I32 | None,
        matrices: F64,
        to_world: F64,
        rows: I64,
        falloff: Falloff,
        amplitude: float,
        farthest: float,
    ) -> None:
        self.count = count = len(rows)
        self.rows = rows = i64(rows)
        self._room = np.empty(count * _ENDS[-1])
        first = DOUBLES.address(self._room)
        places = [first + count * end * self._room.itemsize for end in _ENDS[:-1]]
        self.pointers = _Target(count, *places[:4], *_rises(falloff), amplitude, *places[4:])
        matrices, to_world = f64(matrices), f64(to_world)
        if shape_index is not None:
            shape_index = np.ascontiguousarray(shape_index, np.int32)
        shortest = min(len(each) for each in (matrices, to_world, shape_index) if each is not None)
        if count and not 0 <= rows[0] <= rows[-1] < shortest:
            raise IndexError(f"rows {rows[0]} to {rows[-1]} of a block of {shortest}")
        known = rows, matrices, to_world, shape_index, *_formulas(shapes)
        calls: Any = _calls()
        own = ctypes.byref(self.pointers)
        self.is_usable = bool(calls.hfx_place(own, *known, len(shapes), farthest))

    def part(self, name: str) -> F64:
        """``to_shape``, ``to_world``, ``matrices`` or ``body_to_shape`` (n, 4, 4), ``boxes``
        (n, 2, 3) or ``turns`` (2, n); see ``hfx_target``."""
        number, shape = list(_ROW).index(name), _ROW[name]
        flat = self._room[self.count * _ENDS[number] : self.count * _ENDS[number + 1]]
        return flat.reshape((*shape, -1) if name == "turns" else (-1, *shape))
