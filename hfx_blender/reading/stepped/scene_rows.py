# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows read at single times, and their assembly into parts of a block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.modality import MODALITIES
from ...engine.scene import EffectBlock, PoseBlock
from ...engine.volume.shape import Shape
from ..description.surface_reading import joined

_RELATIVE = 1e-5
_ABSOLUTE = 5e-6
"""Tolerance between two ways of reading the same time: Blender computes in 32 bits."""


@dataclass(eq=False)
class EffectRow:
    """State of one effect at one time."""

    level: float = 0.0
    parameters: list[float] | None = None
    matrix: F64 | None = None
    shape: Shape | None = None
    response: F64 | None = None  # (F, WIDTH) controls of its filters
    vertices: F64 | None = None  # (V, 3) of a surface, object space
    place: F64 | None = None  # (2,) of a point on the skin; see EffectBlock
    drive: F64 | None = None  # (A,) of a vector sensation


@dataclass(eq=False)
class PoseRow:
    """State of one body at one time."""

    to_world: F64
    bones: npt.NDArray[np.float32] | None = None
    surface: npt.NDArray[np.float32] | None = None

    def nearly_equals(self, other: PoseRow) -> bool:
        """Test that two readings of the same time are equal up to rounding."""
        return _agree(self, other, ("to_world", "bones", "surface"))


@dataclass(frozen=True, eq=False)
class Places:
    """Placements of N volumes at a time, or over several, see :mod:`.stepped_volumes`."""

    there: npt.NDArray[np.bool_]  # (N,) False: disabled; the rest may be anything then
    matrices: F64  # (N, 4, 4) object space to world, Blender's units
    boxes: F64  # (N, 2, 3) corners of what holds the volume, object space; NaN: not known


@dataclass(eq=False)
class Row:
    """Reading at one time; effects and bodies by their place in the scene's lists."""

    index: int
    effects: dict[int, EffectRow] = field(default_factory=dict)
    places: Places | None = None  # of volumes of which nothing else was read
    poses: dict[int, PoseRow | None] = field(default_factory=dict)  # None: disabled


def effects_agree(one: EffectRow, two: EffectRow) -> bool:
    """Test that two readings of the same time are equal up to rounding; while an effect is off,
    only its level counts."""
    if not _close(one.level, two.level):
        return False
    if not one.level > 0.0:
        return True
    return _agree(one, two, ("parameters", "matrix", "response", "vertices", "place", "drive"))


def _agree(one: object, two: object, names: Sequence[str]) -> bool:
    """Test that the attributes of these names are equal up to rounding, or missing in both."""
    return all(_close(getattr(one, name), getattr(two, name)) for name in names)


def _close(one: npt.ArrayLike | None, two: npt.ArrayLike | None) -> bool:
    if one is None or two is None:
        return one is two
    one, two = np.asarray(one), np.asarray(two)
    if one.shape == two.shape and (one == two).all():
        return True  # as nearly always: told ten times faster
    return one.shape == two.shape and np.allclose(one, two, _RELATIVE, _ABSOLUTE, equal_nan=True)


def effect_block(rows: Sequence[EffectRow], modality: str) -> EffectBlock:
    """An effect's rows of ascending times as a part of a block."""
    count = len(MODALITIES[modality].parameters)
    blank = [0.0] * count
    parameters = np.array([row.parameters or blank for row in rows], np.float64)
    levels = np.array([row.level for row in rows], np.float64)
    if not any(row.matrix is not None for row in rows):
        return EffectBlock(
            levels,
            parameters,
            place=_stacked([row.place for row in rows]),
            drive=_stacked([row.drive for row in rows]),
        )
    identity = np.eye(4)
    shapes: dict[Shape, int] = {}
    which = np.zeros(len(rows), np.int32)
    for k, row in enumerate(rows):
        if row.shape is not None:
            which[k] = shapes.setdefault(row.shape, len(shapes))
    return EffectBlock(
        levels,
        parameters,
        matrices=np.stack([identity if row.matrix is None else row.matrix for row in rows]),
        shapes=tuple(shapes),
        shape_index=which,
        response=_stacked([row.response for row in rows]),
        vertices=joined([row.vertices for row in rows]),
    )


def silence(count: int, modality: str) -> EffectBlock:
    """An effect that is not felt at some times."""
    width = len(MODALITIES[modality].parameters)
    return EffectBlock(np.zeros(count), np.zeros((count, width)))


def _stacked(values: Sequence[F64 | None]) -> F64 | None:
    """Rows (T, ...); where one was not read, it may hold anything."""
    known = next((each for each in values if each is not None), None)
    if known is None:
        return None
    return np.stack([known if each is None else each for each in values])


def pose_block(rows: Sequence[PoseRow | None]) -> PoseBlock:
    """A body's rows of ascending times as a part of a block; None was not read."""
    valid = np.array([row is not None for row in rows])
    known = next((row for row in rows if row is not None), None)
    if known is None:
        return PoseBlock(valid, np.zeros((len(rows), 4, 4)))
    filled = [known if row is None else row for row in rows]
    return PoseBlock(
        valid,
        np.stack([row.to_world for row in filled]),
        None if known.bones is None else np.stack([row.bones for row in filled]).astype(np.float64),
        None if known.surface is None else np.stack([row.surface for row in filled]),
    )
