# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of skin with volumes that have a formula; ``contact.c``."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.shape import Falloff, FalloffKind, Shape
from .library import f64, i64, library, pointer
from .skin import Clusters, PosedBones

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
Weights = npt.NDArray[np.floating[Any]]

_KINDS: Final[dict[type[Shape], int]] = {Cuboid: 0, Sphere: 1, Cylinder: 2, Capsule: 3}
_STEP_KINDS: Final = 7  # 1, 2, ... 64 steps

_POINTER: Final[Any] = ctypes.c_void_p
_INTEGER: Final[Any] = ctypes.c_int64
_DOUBLE: Final[Any] = ctypes.c_double


def _structure(name: str, **types: Any) -> type[ctypes.Structure]:
    return type(name, (ctypes.Structure,), {"_fields_": list(types.items())})


_TABLE_ARRAYS: Final = (
    "starts",
    "place_counts",
    "unit_counts",
    "cell_starts",
    "cell_of",
    "steps",
    "quad_starts",
    "unit_shares",
    "vertex_shares",
    "reaches",
    "means",
    "around",
    "is_ringed",
    "sample_starts",
    "heights_m",
    "wholes",
    "bulge_m",
    "samples",
)
_Table = _structure(
    "hfx_table", **dict.fromkeys(_TABLE_ARRAYS, _POINTER), room=_INTEGER, is_simple=_INTEGER
)
_Target = _structure(
    "hfx_target",
    kinds=_POINTER,
    halves=_POINTER,
    to_shape=_POINTER,
    to_world=_POINTER,
    is_flat=_INTEGER,
    is_smooth=_INTEGER,
    share=_DOUBLE,
    amplitude=_DOUBLE,
)
_Drift = _structure(
    "hfx_drift", before=_POINTER * _STEP_KINDS, after=_POINTER * _STEP_KINDS, intervals=_INTEGER
)
_Pairs = _structure(
    "hfx_pairs",
    count=_INTEGER,
    clusters=_POINTER,
    rows=_POINTER,
    wide=_POINTER,
    steps=_POINTER,
    points=_POINTER,
    total=_INTEGER,
)
_Found = _structure(
    "hfx_found", weights=_POINTER, column_of=_POINTER, columns=_INTEGER, is_single=_INTEGER
)


class Table(Protocol):
    """The skin of a model; see :class:`..skin_table.SkinTable`."""

    starts: I64
    place_counts: I64
    unit_counts: I64
    cell_starts: I64
    is_simple: bool
    most_samples: I64

    @property
    def samples(self) -> F64: ...


@cache
def _calls() -> ctypes.CDLL | None:
    found = library()
    if found is not None:
        found.hfx_look_at_skin.argtypes = [_POINTER] * 9
        found.hfx_look_at_skin.restype = None
    return found


def is_possible(shapes: Sequence[Shape]) -> bool:
    """Whether the library is there and knows all of some volumes."""
    return all(type(shape) in _KINDS for shape in shapes) and _calls() is not None


@dataclass(frozen=True, eq=False)
class Pairs:
    """Clusters, ascending, each at some rows, ascending, and what is wanted of them.

    Where a pair is followed, the one before it is the same cluster at the row before.
    """

    clusters: I64  # (p,)
    rows: I64  # (p,)
    wide: Bool  # (p,) whether it is covered
    steps: I64  # (p,) in how many straight steps it is followed from the row before; 0: not


@dataclass(frozen=True, eq=False)
class Target:
    """A volume and a body's place at some rows."""

    shapes: Sequence[Shape]
    which: I64  # (n,) the shape of each row
    falloff: Falloff
    amplitude: float
    to_shape: F64  # (n, 4, 4) from the world
    to_world: F64  # (n, 4, 4) from the body's own space


@dataclass(frozen=True, eq=False)
class Posing:
    """How the places of pairs come about: by the matrices of bones, or they are known."""

    clusters: Clusters | None = None
    bones: PosedBones | None = None  # rest to shape space, at the rows of the target
    points: F64 | None = None  # (3, N) the places of all pairs, shape space


_TABLES: WeakKeyDictionary[Table, tuple[Any, list[npt.NDArray[Any]]]] = WeakKeyDictionary()


def _table(table: Table) -> Any:
    """``hfx_table``; made anew where the table has more samples than before."""
    if table not in _TABLES or _TABLES[table][1][-1] is not table.samples:
        arrays = [getattr(table, name) for name in _TABLE_ARRAYS]
        made = _Table(*map(pointer, arrays), table.samples.shape[1], int(table.is_simple))
        _TABLES[table] = made, arrays
    return _TABLES[table][0]


def look_at_skin(
    pairs: Pairs,
    table: Table,
    posing: Posing,
    target: Target,
    drifts: Mapping[int, tuple[F64, F64]],
    weights: Weights,
    column_of: I64,
) -> None:
    """Contact weights of cells, of what is inside and of what passed; see ``finding.Found``.

    Parameters
    ----------
    pairs : Pairs
    table : Table
        Filled for their clusters.
    posing : Posing
    target : Target
        Of shapes that :func:`is_possible` knows.
    drifts : mapping
        How points drift, (steps + 1, n - 1, 4, 4) from before and after, by number of steps; see
        :class:`..swept.Drift`. Straight ways need none.
    weights : (n, C) float32 or float64
        Changed in place: a pair's cells get theirs, what passed only raises them.
    column_of : (cells,) int64
        The column of each of the table's cells.
    """
    calls = _calls()
    assert calls is not None
    kept = []
    clusters, rows = i64(pairs.clusters), i64(pairs.rows)
    wide, steps = np.ascontiguousarray(pairs.wide, np.uint8), i64(pairs.steps)
    points = None if posing.points is None else f64(posing.points)
    kinds = i64([_KINDS[type(shape)] for shape in target.shapes])[target.which]
    halves = f64([getattr(shape, "half_segment", 0.0) for shape in target.shapes])[target.which]
    to_shape, to_world = f64(target.to_shape), f64(target.to_world)
    falloff = target.falloff
    each_way: list[list[Any]] = [[None] * _STEP_KINDS, [None] * _STEP_KINDS]
    for number, places in drifts.items():
        for way, matrices in zip(each_way, places, strict=True):
            way[number.bit_length() - 1] = f64(matrices)
            kept.append(way[number.bit_length() - 1])
    some = np.unique(clusters)
    most_bones = 0 if posing.clusters is None else posing.clusters.most_bones
    cells = table.cell_starts[some + 1] - table.cell_starts[some]
    sizes = 6 * table.place_counts[some] + table.unit_counts[some] + cells
    room = np.empty(2 * (int(sizes.max()) + 16 * most_bones + 1))
    events = np.empty((2 * int(table.most_samples[some].max()) + 2, 2))
    assert weights.flags.c_contiguous
    calls.hfx_look_at_skin(
        ctypes.byref(
            _Pairs(
                len(clusters),
                *(pointer(each) for each in (clusters, rows, wide, steps, points)),
                0 if points is None else points.shape[1],
            )
        ),
        ctypes.byref(_table(table)),
        None if posing.clusters is None else ctypes.byref(posing.clusters.table),
        None if posing.bones is None else ctypes.byref(posing.bones.pointers),
        ctypes.byref(
            _Target(
                *(pointer(each) for each in (kinds, halves, to_shape, to_world)),
                int(falloff.is_flat),
                int(falloff.kind is FalloffKind.SMOOTH),
                falloff.share,
                target.amplitude,
            )
        ),
        ctypes.byref(
            _Drift(
                *(
                    (_POINTER * _STEP_KINDS)(*(0 if m is None else m.ctypes.data for m in way))
                    for way in each_way
                ),
                max(len(target.which) - 1, 0),
            )
        ),
        ctypes.byref(
            _Found(
                pointer(weights),
                pointer(column_of),
                weights.shape[1],
                int(weights.dtype == np.float32),
            )
        ),
        pointer(room),
        pointer(events),
    )
