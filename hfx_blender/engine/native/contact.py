# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of skin with volumes that have a formula; ``reach.c``, ``contact.c``, ``gather.c``."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from threading import Thread
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.shape import Falloff, FalloffKind, Shape
from .library import f64, i64, library, pointer, structure
from .skin import Clusters, PosedBones
from .skin_table import Table, table_of

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]
Bool = npt.NDArray[np.bool_]
Weights = npt.NDArray[np.floating[Any]]

NOT: Final = 0
COVERED: Final = 1
BY_VERTEX: Final = 2
WHOLE: Final = 3
"""How the cells of a pair are looked at."""

_KINDS: Final[dict[type[Shape], int]] = {Cuboid: 0, Sphere: 1, Cylinder: 2, Capsule: 3}
_STEP_KINDS: Final = 7  # 1, 2, ... 64 steps

_POINTER: Final[Any] = ctypes.c_void_p
_INTEGER: Final[Any] = ctypes.c_int64
_DOUBLE: Final[Any] = ctypes.c_double


_Target = structure(
    "hfx_target",
    **dict.fromkeys(("kinds", "halves", "to_shape", "to_world"), _POINTER),
    is_flat=_INTEGER,
    is_smooth=_INTEGER,
    share=_DOUBLE,
    amplitude=_DOUBLE,
)
_Drift = structure(
    "hfx_drift", before=_POINTER * _STEP_KINDS, after=_POINTER * _STEP_KINDS, intervals=_INTEGER
)
_Pairs = structure(
    "hfx_pairs",
    count=_INTEGER,
    **dict.fromkeys(("clusters", "rows", "how", "steps", "points"), _POINTER),
    total=_INTEGER,
)
_Found = structure(
    "hfx_found",
    weights=_POINTER,
    column_of=_POINTER,
    columns=_INTEGER,
    is_single=_INTEGER,
    posed=_INTEGER,
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
    rows=_INTEGER,
    clusters=_INTEGER,
    **dict.fromkeys(_BROAD_ARRAYS, _POINTER),
    edge_m=_DOUBLE,
    is_split=_INTEGER,
)


@cache
def _calls() -> ctypes.CDLL | None:
    found = library()
    if found is not None:
        found.hfx_look_at_skin.argtypes = [_POINTER] * 10
        found.hfx_place.argtypes = [_INTEGER] + [_POINTER] * 3 + [_DOUBLE] + [_POINTER] * 3
        found.hfx_overlaps.argtypes = [_POINTER] * 3
        found.hfx_reach.argtypes = [_POINTER] * 6
        found.hfx_columns.argtypes = [_INTEGER, _POINTER, _INTEGER, _POINTER, _INTEGER] + [
            _POINTER
        ] * 5
        for real in ("single", "double"):
            changes = getattr(found, f"hfx_changes_{real}")
            gather = getattr(found, f"hfx_gather_{real}")
            changes.argtypes = [_INTEGER] * 2 + [_POINTER] * 2 + [_INTEGER, _POINTER]
            changes.restype = _INTEGER
            gather.argtypes = [_INTEGER] * 2 + [_POINTER] * 6
            gather.restype = None
        found.hfx_place.restype = found.hfx_overlaps.restype = _INTEGER
        found.hfx_columns.restype = _INTEGER
        found.hfx_look_at_skin.restype = found.hfx_reach.restype = None
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


@dataclass(frozen=True, eq=False)
class Posing:
    """How the places of pairs come about: by the matrices of bones, or they are known."""

    clusters: Clusters | None = None
    own: Clusters | None = None  # of vertices of cells, where these are not units of the surface
    bones: PosedBones | None = None  # rest to shape space, at the rows of the target
    points: F64 | None = None  # (3, N) the places of all pairs, shape space


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


_MOST_COLUMNS: Final = 32
_COLUMNS: WeakKeyDictionary[Table, dict[bytes, tuple[I32, I64]]] = WeakKeyDictionary()


def columns_of(pairs: Pairs, table: Table) -> tuple[I32, I64]:
    """Vertices of all pairs' clusters, ascending, and where each of the table's cells is among
    them, which is only told of these clusters. Not to be changed: they are kept."""
    clusters = np.unique(pairs.clusters)
    known, key = _COLUMNS.setdefault(table, {}), clusters.tobytes()
    if key not in known:
        if len(known) >= _MOST_COLUMNS:
            known.clear()
        known[key] = _made_columns(clusters, table)
    return known[key]


def _made_columns(clusters: I64, table: Table) -> tuple[I32, I64]:
    count = len(table.cells)
    is_needed, place_of = np.empty(len(table.unit_counts), np.uint8), np.empty(count, np.int64)
    columns, column_of = np.empty(count, np.int32), np.empty(count, np.int64)
    counted = table.cells, is_needed, place_of, columns, column_of
    found = _library().hfx_columns(
        len(clusters),
        pointer(clusters),
        len(table.unit_counts),
        pointer(table.cell_starts),
        count,
        *(pointer(each) for each in counted),
    )
    return columns[:found].copy(), column_of


def look_at_skin(
    pairs: Pairs,
    table: Table,
    posing: Posing,
    target: Target,
    drifts: Mapping[int, tuple[F64, F64]],
    weights: Weights,
    column_of: I64,
    threads: int = 1,
) -> int:
    """Contact weights of cells, of what is inside and of what passed; see ``finding.Found``.

    Parameters
    ----------
    pairs : Pairs
    table : Table
        Filled for the clusters that are covered or followed.
    posing : Posing
    target : Target
    drifts : mapping
        How points drift, (steps + 1, n - 1, 4, 4) from before and after, by number of steps; see
        :class:`..swept.Drift`. Straight ways need none.
    weights : (n, C) float32 or float64
        Changed in place: a pair's cells get theirs, what passed only raises them.
    column_of : (cells,) int64
        The column of each of the table's cells.
    threads : int
        How many look at clusters at once, at most; each has cells of its own.

    Returns
    -------
    int
        How many places were posed.
    """
    each_way: list[list[Any]] = [[None] * _STEP_KINDS, [None] * _STEP_KINDS]
    for number, places in drifts.items():
        for way, matrices in zip(each_way, places, strict=True):
            way[number.bit_length() - 1] = f64(matrices)
    drift = _Drift(intervals=max(target.count - 1, 0))
    if drifts:
        drift.before, drift.after = (
            (_POINTER * _STEP_KINDS)(*(pointer(m) for m in way)) for way in each_way
        )
    shared = table_of(table), posing, target, drift, weights, column_of
    if threads < 2 or posing.points is not None:
        return _Look(pairs, table, *shared).take()
    looks = [_Look(part, table, *shared) for part in _parts(pairs, table)]
    posed: list[int] = []

    def work() -> None:
        with suppress(IndexError):  # until there are none left
            while True:
                posed.append(looks.pop().take())

    others = [Thread(target=work, daemon=True) for _ in looks[1:threads]]
    for other in others:
        other.start()
    work()
    for other in others:
        other.join()
    return sum(posed)


_WORTH: Final = 1 << 13
"""Places of pairs that a call of their own pays for where threads share the work: some of it
takes much longer than the rest."""


def _parts(pairs: Pairs, table: Table) -> list[Pairs]:
    """The pairs in parts of about as many places each, clusters kept whole."""
    total = np.cumsum(table.place_counts[pairs.clusters])
    count = int(total[-1]) // _WORTH
    if count < 2:
        return [pairs]
    begins = np.concatenate([[True], pairs.clusters[1:] != pairs.clusters[:-1]]).nonzero()[0]
    wanted = total[-1] * np.arange(1, count) / count
    inner = begins[np.minimum(np.searchsorted(total[begins], wanted), len(begins) - 1)]
    cuts = np.unique(np.concatenate([[0], inner, [len(total)]])).tolist()
    parts = (slice(*ends) for ends in pairwise(cuts))
    return [
        Pairs(pairs.clusters[part], pairs.rows[part], pairs.how[part], pairs.steps[part])
        for part in parts
    ]


class _Look:
    """One call for some pairs, with all that it needs."""

    def __init__(
        self,
        pairs: Pairs,
        table: Table,
        pointers: Any,
        posing: Posing,
        target: Target,
        drift: Any,
        weights: Weights,
        column_of: I64,
    ) -> None:
        some = np.unique(pairs.clusters)
        known = [each for each in (posing.clusters, posing.own) if each is not None]
        most_bones = max((each.most_bones for each in known), default=0)
        cells = table.cell_starts[some + 1] - table.cell_starts[some]
        sizes = 6 * table.place_counts[some] + table.unit_counts[some] + cells
        points = None if posing.points is None else f64(posing.points)
        room = np.empty(2 * int(sizes.max()) + 48 * most_bones + 2)
        events = np.empty((2 * int(table.most_samples[some].max()) + 2, 2))
        self._kept = pairs, posing, target, points, room, events
        is_single = int(weights.dtype == np.float32)
        self._found = _Found(pointer(weights), pointer(column_of), weights.shape[1], is_single, 0)
        self._arguments = (
            ctypes.byref(pairs.pointers(points)),
            ctypes.byref(pointers),
            None if posing.clusters is None else posing.clusters.table,
            None if posing.own is None else posing.own.table,
            None if posing.bones is None else ctypes.byref(posing.bones.pointers),
            ctypes.byref(target.pointers),
            ctypes.byref(drift),
            ctypes.byref(self._found),
            pointer(room),
            pointer(events),
        )

    def take(self) -> int:
        """Do it, while other threads of Python may run; how many places were posed."""
        _library().hfx_look_at_skin(*self._arguments)
        count: int = self._found.posed
        return count


def gathered(
    weights: Weights, columns: I32, heard: Bool, own_sets: bool
) -> tuple[I64, I64, I64, I32, Weights]:
    """What is felt, row by row; see :class:`..contact.Contacts`.

    Returns
    -------
    rows, sets, offsets, vertices, weights
    """
    real = "single" if weights.dtype == np.float32 else "double"
    kinds, heard_at = np.empty(len(weights), np.uint8), np.ascontiguousarray(heard, np.uint8)
    calls = _library()
    total = getattr(calls, f"hfx_changes_{real}")(
        *weights.shape, pointer(weights), pointer(heard_at), int(own_sets), pointer(kinds)
    )
    rows = kinds.nonzero()[0]
    sets = np.cumsum(kinds[rows] == 2) - 1
    offsets = np.empty(int(sets[-1]) + 2 if len(rows) else 1, np.int64)
    vertices, values = np.empty(total, np.int32), np.empty(total, weights.dtype)
    getattr(calls, f"hfx_gather_{real}")(
        *weights.shape,
        *map(pointer, (weights, kinds, columns, offsets, vertices, values)),
    )
    return rows, sets, offsets, vertices, values
