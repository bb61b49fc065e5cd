# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a volume is, and which clusters of skin it can reach; ``reach.c``."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.shape import Falloff, FalloffKind, Shape
from .bounds import Outline
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
    *("outline", "matrices", "boxes", "low", "high", "of_rows", "of_clusters"),
    *("at", "follows", "heard", "turns"),
)
_Broad = structure(
    "hfx_broad",
    rows=INTEGER,
    **dict.fromkeys(_BROAD_ARRAYS, POINTER),
    edge_m=DOUBLE,
    is_split=INTEGER,
    flags=POINTER,
    near=POINTER,
    near_count=INTEGER,
)


@cache
def _calls() -> ctypes.CDLL | None:
    found = library()
    if found is not None:
        found.hfx_place.argtypes = [INTEGER] + [POINTER] * 3 + [DOUBLE] + [POINTER] * 3
        found.hfx_overlaps.argtypes = [POINTER] * 2
        found.hfx_reach.argtypes = [POINTER] * 4
        found.hfx_pair_up.argtypes = [POINTER] * 6
        found.hfx_place.restype = found.hfx_overlaps.restype = found.hfx_reach.restype = INTEGER
        found.hfx_pair_up.restype = None
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

    def pointers(self, points: F64 | None = None) -> ctypes.Structure:
        """``hfx_pairs``; ``points`` (3, N) where the places of all pairs are known."""
        return self._posed if points is None else self._pointers(points, points.shape[1])

    @cached_property
    def _posed(self) -> ctypes.Structure:
        return self._pointers(None, 0)

    def _pointers(self, points: F64 | None, total: int) -> ctypes.Structure:
        arrays = self.clusters, self.rows, self.how, self.steps, points
        return _Pairs(len(self.clusters), *[pointer(each) for each in arrays], total)


@dataclass(frozen=True, eq=False)
class Reached:
    """What is looked at."""

    pairs: Pairs
    clusters: I64  # each of them once
    wide: I64  # those of them whose skin is covered or followed
    by_vertex: I64  # those of which vertices tell


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
        shapes: tuple[Shape, ...],
        which: I64,
        falloff: Falloff,
        amplitude: float,
        to_shape: F64,
        to_world: F64,
    ) -> None:
        self.count = len(which)
        self.falloff = falloff
        kinds, halves, _ = _formulas(shapes)
        self._arrays = kinds[which], halves[which], f64(to_shape), f64(to_world)
        self.pointers = _Target(
            *[pointer(each) for each in self._arrays],
            int(falloff.is_flat),
            int(falloff.kind is FalloffKind.SMOOTH),
            falloff.share,
            amplitude,
        )


def limits_of(shapes: tuple[Shape, ...]) -> F64:
    """Lowest and highest corner of each shape in its own space, (n, 2, 3); not to be changed."""
    return _formulas(shapes)[2]


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
    outline : Outline
        Of the body's clusters.
    bounds : tuple
        Their world boxes at m rows; see :meth:`.bounds.Outline.bounds`.
    at : (n,) int64
        The row of these that each row is.
    follows, heard : (n,) bool
        See :func:`..contact.begin`.
    turns : (2, n) float64 or None
        By how much volume and body turn since the row before, radians.
    edge_m : float
        How far off the edge of a contact may be.
    is_split : bool
        Whether cells have samples.
    """

    def __init__(
        self,
        matrices: F64,
        boxes: F64,
        outline: Outline,
        bounds: tuple[F64, F64, F64, F64],
        at: I64,
        follows: Bool,
        heard: Bool,
        turns: F64 | None,
        edge_m: float,
        is_split: bool,
    ) -> None:
        size = len(at), bounds[0].shape[1]
        self._flags, self._near = np.empty(size, np.uint8), np.empty(size[1], np.int64)
        self._arrays = (
            f64(matrices),
            f64(boxes),
            *map(f64, bounds),
            i64(at),
            np.ascontiguousarray(follows, np.bool_),
            np.ascontiguousarray(heard, np.bool_),
            None if turns is None else f64(turns),
        )
        self._outline = outline  # is to live
        self._pointers = _Broad(
            size[0],
            outline.address,
            *[pointer(each) for each in self._arrays],
            edge_m,
            int(is_split),
            pointer(self._flags),
            pointer(self._near),
        )

    def overlaps(self) -> I64:
        """Clusters whose boxes the volume's meets anywhere; to be called first."""
        is_met = np.empty(len(self._near), np.uint8)
        _library().hfx_overlaps(ctypes.byref(self._pointers), pointer(is_met))
        return is_met.nonzero()[0]

    def reach(self, target: Target, bones: PosedBones, groups: Any) -> Reached:
        """What is looked at; to be called once.

        ``groups`` are those of :meth:`..cell_sizes.CellSizes.pointers` for the clusters that are
        met, or None where nothing falls off or amplitudes must be exact.
        """
        calls = _library()
        shared = [ctypes.byref(each) for each in (self._pointers, target.pointers, bones.pointers)]
        total = calls.hfx_reach(*shared, groups)
        clusters, rows, steps = np.empty((3, total), np.int64)
        pairs = Pairs(clusters, rows, np.empty(total, np.uint8), steps)
        near = self._pointers.near_count
        lists, counts = np.empty((3, near), np.int64), np.empty(3, np.int64)
        calls.hfx_pair_up(*shared, ctypes.byref(pairs.pointers()), pointer(lists), pointer(counts))
        some = (each[:count] for each, count in zip(lists, counts.tolist(), strict=True))
        return Reached(pairs, *some)
