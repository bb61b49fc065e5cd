# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a volume is, and which clusters of skin it can reach; ``reach.c``."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.shape import Falloff, FalloffKind, Shape
from .library import DOUBLE, INTEGER, POINTER, f64, i64, library, pointer, structure
from .skin import PosedBones

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]
Bool = npt.NDArray[np.bool_]

NOT: Final = 0
COVERED: Final = 1
BY_VERTEX: Final = 2
WHOLE: Final = 3
"""How the cells of a pair are looked at."""

_KINDS: Final[dict[type[Shape], int]] = {Cuboid: 0, Sphere: 1, Cylinder: 2, Capsule: 3}


_Target = structure(
    "hfx_target",
    **dict.fromkeys(("kinds", "halves", "to_shape", "to_world"), POINTER),
    is_flat=INTEGER,
    is_smooth=INTEGER,
    share=DOUBLE,
    amplitude=DOUBLE,
)
_Pairs = structure(
    "hfx_pairs",
    count=INTEGER,
    **dict.fromkeys(("clusters", "rows", "how", "steps", "points"), POINTER),
    total=INTEGER,
)
_BROAD_ARRAYS: Final = (
    "matrices",
    "boxes",
    "low",
    "high",
    "at",
    "follows",
    "heard",
    "turns",
    "pair_starts",
    "pair_bones",
    "centres",
    "halves",
)
_Broad = structure(
    "hfx_broad",
    rows=INTEGER,
    clusters=INTEGER,
    **dict.fromkeys(_BROAD_ARRAYS, POINTER),
    edge_m=DOUBLE,
    is_split=INTEGER,
)


@cache
def _calls() -> ctypes.CDLL | None:
    found = library()
    if found is not None:
        found.hfx_place.argtypes = [INTEGER] + [POINTER] * 3 + [DOUBLE] + [POINTER] * 3
        found.hfx_overlaps.argtypes = [POINTER] * 3
        found.hfx_reach.argtypes = [POINTER] * 6
        found.hfx_place.restype = found.hfx_overlaps.restype = INTEGER
        found.hfx_reach.restype = None
    return found


def is_possible(shapes: Sequence[Shape]) -> bool:
    """Whether the library is there and knows all of some volumes."""
    return all(type(shape) in _KINDS for shape in shapes) and _calls() is not None


def _library() -> ctypes.CDLL:
    calls = _calls()
    assert calls is not None
    return calls


@dataclass(frozen=True, eq=False)
class Pairs:
    """Clusters, ascending, each at some rows, ascending, and what is wanted of them.

    Where a pair is followed, the one before it is the same cluster at the row before.
    """

    clusters: I64  # (p,)
    rows: I64  # (p,)
    how: U8  # (p,) NOT, COVERED, BY_VERTEX or WHOLE
    steps: I64  # (p,) in how many straight steps it is followed from the row before; 0: not

    @cached_property
    def distinct(self) -> I64:
        """Each cluster once."""
        return np.unique(self.clusters)

    def pointers(self, points: F64 | None = None) -> ctypes.Structure:
        """``hfx_pairs``; ``points`` (3, N) where the places of all pairs are known."""
        arrays = self.clusters, self.rows, self.how, self.steps, points
        total = 0 if points is None else points.shape[1]
        return _Pairs(len(self.clusters), *map(pointer, arrays), total)


class Target:
    """A volume and a body's place at some rows.

    Parameters
    ----------
    shapes : sequence of Shape
        That :func:`is_possible` knows.
    which : (n,) int64
        The shape of each row.
    falloff : Falloff
    amplitude : float
        Change of weight that need not be sampled.
    to_shape, to_world : (n, 4, 4) float64
        From the world to shape space; from the body's own space to the world.
    """

    def __init__(
        self,
        shapes: Sequence[Shape],
        which: I64,
        falloff: Falloff,
        amplitude: float,
        to_shape: F64,
        to_world: F64,
    ) -> None:
        self.count = len(which)
        self.falloff = falloff
        halves = [getattr(shape, "half_segment", 0.0) for shape in shapes]
        self._arrays = (
            i64([_KINDS[type(shape)] for shape in shapes])[which],
            f64(halves)[which],
            f64(to_shape),
            f64(to_world),
        )
        self.pointers = _Target(
            *map(pointer, self._arrays),
            int(falloff.is_flat),
            int(falloff.kind is FalloffKind.SMOOTH),
            falloff.share,
            amplitude,
        )


def place(
    matrices: F64, to_world: F64, limits: F64, farthest: float
) -> tuple[F64, F64, F64] | None:
    """Where a volume is at some rows; None where not all of it can be used.

    Parameters
    ----------
    matrices, to_world : (n, 4, 4) float64
        Shape space to the world; the body's own space to the world.
    limits : (n, 2, 3) float64
        Lowest and highest corner in shape space.
    farthest : float
        No entry of a matrix is larger.

    Returns
    -------
    inverses, to_shape : (n, 4, 4) float64
        From the world, and from the body's own space, to shape space.
    boxes : (n, 2, 3) float64
        In the world.
    """
    inverses, to_shape = np.empty((2, *matrices.shape))
    boxes = np.empty((len(matrices), 2, 3))
    arrays = [f64(each) for each in (matrices, to_world, limits)]
    found = inverses, to_shape, boxes
    usable = _library().hfx_place(
        len(matrices), *map(pointer, arrays), farthest, *map(pointer, found)
    )
    return found if usable else None


class Broad:
    """Which clusters a volume can reach, at which rows, and between.

    Parameters
    ----------
    matrices : (n, 4, 4) float64
        Shape space to the world.
    boxes : (n, 2, 3) float64
        World boxes of the volume.
    low, high : (m, C, 3) float64
        World boxes of the body's clusters.
    at : (n,) int64
        The row of these that each row is.
    follows, heard : (n,) bool
        See :func:`..contact.find`.
    turns : (2, n) float64 or None
        By how much volume and body turn since the row before, radians.
    boxes_of_bones : tuple
        See :attr:`..body.posing.SkinnedModel.pairs`.
    edge_m : float
        How far off the edge of a contact may be.
    is_split : bool
        Whether cells have samples.
    """

    def __init__(
        self,
        matrices: F64,
        boxes: F64,
        low: F64,
        high: F64,
        at: I64,
        follows: Bool,
        heard: Bool,
        turns: F64 | None,
        boxes_of_bones: tuple[I64, I64, F64, F64],
        edge_m: float,
        is_split: bool,
    ) -> None:
        self._arrays = (
            f64(matrices),
            f64(boxes),
            f64(low),
            f64(high),
            i64(at),
            np.ascontiguousarray(follows, np.uint8),
            np.ascontiguousarray(heard, np.uint8),
            None if turns is None else f64(turns),
            *boxes_of_bones,
        )
        self._size = len(at), low.shape[1]
        self._pointers = _Broad(
            *self._size, *(pointer(each) for each in self._arrays), edge_m, int(is_split)
        )
        self._flags = np.empty(self._size, np.uint8)

    def overlaps(self) -> I64:
        """Clusters whose boxes the volume's meets anywhere; to be called first."""
        is_met = np.empty(self._size[1], np.uint8)
        _library().hfx_overlaps(ctypes.byref(self._pointers), pointer(self._flags), pointer(is_met))
        return is_met.nonzero()[0]

    def reach(self, target: Target, bones: PosedBones, groups: Any) -> Pairs:
        """What is looked at.

        ``groups`` are those of :meth:`..cell_sizes.CellSizes.pointers` for the clusters that are
        met, or None where nothing falls off or amplitudes must be exact.
        """
        total = self._size[0] * self._size[1]
        clusters, rows, steps = np.empty((3, total), np.int64)
        how = np.empty(total, np.uint8)
        pairs = Pairs(clusters, rows, how, steps)
        found = pairs.pointers()
        _library().hfx_reach(
            ctypes.byref(self._pointers),
            ctypes.byref(target.pointers),
            ctypes.byref(bones.pointers),
            groups,
            pointer(self._flags),
            ctypes.byref(found),
        )
        count: int = found.count
        return Pairs(clusters[:count], rows[:count], how[:count], steps[:count])
