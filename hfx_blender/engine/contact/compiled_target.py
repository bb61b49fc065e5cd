# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes placed relative to a body; ``placement.c``, ``broad.h``."""

import ctypes
from functools import lru_cache
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64
from ..kinematics.placement_motion import Motion
from ..native.library import f64, i64, loaded, structure
from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.mesh import MeshVolume
from ..volume.shape import Falloff, FalloffKind, Shape, world_bounds

_MESH: Final = 4
_KINDS: Final[dict[type[Shape], int]] = {
    **{Cuboid: 0, Sphere: 1, Cylinder: 2, Capsule: 3},
    MeshVolume: _MESH,
}
_SWEPT_PARTS: Final = 8
"""Parts of a turning mesh's path between two rows; see ``broad_phase.c``."""


@lru_cache(maxsize=256)
def _formulas(shapes: tuple[Shape, ...]) -> tuple[I64, F64, F64]:
    """Kinds (n,), half segments (n,) and boxes (n, 2, 3) of shapes, shape space; cached for
    analytic shapes, which compare by value."""
    halves = [getattr(shape, "half_segment", 0.0) for shape in shapes]
    boxes = np.array([shape.bounds for shape in shapes], np.float64).reshape(-1, 2, 3)
    return i64([_KINDS[type(shape)] for shape in shapes]), f64(halves), boxes


_ROW: Final[dict[str, tuple[int, ...]]] = {
    "kinds": (),
    "halves": (),
    "to_shape": (4, 4),
    "to_world": (4, 4),
    "matrices": (4, 4),
    "body_to_shape": (4, 4),
    "boxes": (2, 3),
    "turns": (2,),
    "meshes": (),
}
"""Shapes of the arrays of ``hfx_target`` for one row, in the order of its fields."""

_ENDS: Final = np.cumsum([0, *(np.prod(shape, dtype=int) for shape in _ROW.values())]).tolist()


class PlacedTarget:
    """Volume and body, placed at ``rows`` (n,) of a block, ascending; ``hfx_target``.

    ``shape_index`` (T,) is the shape at each row of the block, None for the first at all rows;
    ``matrices`` and ``to_world`` (T, 4, 4) are shape space, and body space, to world. ``amplitude``
    is the largest change of weight that may remain unsampled, ``farthest`` the largest usable entry
    of a matrix. ``is_usable`` (n,): finite and not flattened; all other results require usable rows
    throughout. Raises IndexError: a row is not in the block.
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
        self.room, self.is_usable = np.empty(count * _ENDS[-1]), np.zeros(count, np.bool_)
        first = self.room.ctypes.data
        # All fields share one allocation, each at a fixed multiple of the row count.
        places = [first + count * end * self.room.itemsize for end in _ENDS[:-1]]
        rises = falloff.is_flat, falloff.kind is FalloffKind.SMOOTH, falloff.share
        self.pointers = structure("hfx_target")(
            *(count, *places[:4], *rises, amplitude, *places[4:], None, self.is_usable)
        )
        self.pointers.kept += [self.room, shapes]  # the structure holds addresses only
        shortest = min(len(a) for a in (matrices, to_world, shape_index) if a is not None)
        if count and not 0 <= rows[0] <= rows[-1] < shortest:
            raise IndexError(f"rows {rows[0]} to {rows[-1]} of a block of {shortest}")
        self._shapes, self._falloff = shapes, falloff
        self._which = np.zeros(count, np.int64) if shape_index is None else shape_index[rows]
        # A cache of meshes would keep them alive.
        self._has_mesh = any(isinstance(shape, MeshVolume) for shape in shapes)
        formulas = (_formulas.__wrapped__ if self._has_mesh else _formulas)(shapes)
        inputs = rows, matrices, to_world, shape_index, *formulas
        loaded().hfx_place(self.pointers, *inputs, len(shapes), farthest)

    @property
    def shapes(self) -> list[Shape]:
        """Shape at each of the n rows."""
        return [self._shapes[k] for k in self._which.tolist()]

    def find_meshes(self, with_ways: bool) -> None:
        """Prepare meshes for the library, once skin is near; nothing without meshes. With
        ``with_ways`` also store the boxes swept by turning meshes between rows."""
        if not self._has_mesh:
            return
        is_mesh = self.part("kinds").view(np.int64) == _MESH
        meshes, matrices = self.part("meshes").view(np.int64), self.part("matrices")
        boxes = self.part("boxes")
        turning = is_mesh & (self.part("turns")[0] > 0.0) & with_ways
        if turning.any():
            # The boxes at both ends of half a turn miss what a blade sweeps, so boxes in between
            # count.
            low, high = boxes[:, 0].copy(), boxes[:, 1].copy()
            # Between rows a volume is at least in the boxes of both ends.
            low[1:], high[1:] = np.minimum(low[1:], low[:-1]), np.maximum(high[1:], high[:-1])
        for k in np.unique(self._which[is_mesh]).tolist():
            shape, mine = self._shapes[k], self._which == k
            assert isinstance(shape, MeshVolume)
            mesh = shape.compiled(not self._falloff.is_flat)  # cached by the shape
            meshes[mine] = ctypes.addressof(mesh)
            rows = np.flatnonzero(turning & mine)
            # Row k has the path from row k - 1, by interpolated placements.
            motion = Motion.between(matrices[rows - 1], matrices[rows])
            for part in range(1, _SWEPT_PARTS if len(rows) else 0):
                ends = world_bounds(shape, motion.at(part / _SWEPT_PARTS))
                low[rows] = np.minimum(low[rows], ends[:, 0])
                high[rows] = np.maximum(high[rows], ends[:, 1])
        if turning.any():
            self.pointers.kept.append(swept := np.stack([low, high], axis=1))
            self.pointers.swept = swept.ctypes.data

    def part(self, name: str) -> F64:
        """Values of a field by row: ``turns`` (2, n), else (n, ...) as in ``_ROW``; a view."""
        number, shape = list(_ROW).index(name), _ROW[name]
        flat = self.room[self.count * _ENDS[number] : self.count * _ENDS[number + 1]]
        return flat.reshape((*shape, -1) if name == "turns" else (-1, *shape))
