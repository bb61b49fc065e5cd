# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects and bodies at single times, and the assembly into blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.modality import MODALITIES
from ...engine.scene import EffectBlock, PoseBlock
from ...engine.volume.shape import Shape
from ..description.area_values import joined

_RELATIVE = 1e-5
_ABSOLUTE = 5e-6
"""Relative and absolute tolerance between two readings of a time: Blender computes in float32."""


@dataclass(eq=False)
class EffectRow:
    """State of an effect at one time; the default is an effect that is off."""

    level: float = 0.0  # activation times intensity, 0..1
    parameters: list[float] | None = None  # in the modality's order; None if off
    matrix: F64 | None = None  # (4, 4) to world, metres; None without a place in the scene
    shape: Shape | None = None  # volumes only
    response: F64 | None = None  # (F, WIDTH) controls of the response filters
    vertices: F64 | None = None  # (V, 3) of a surface, object space
    place: F64 | None = None  # (2,) of a spot; see EffectBlock
    drive: F64 | None = None  # (A,) of a vector sensation


@dataclass(eq=False)
class PoseRow:
    """Pose of a body at one time."""

    to_world: F64  # (4, 4) armature or avatar to world, metres
    bones: npt.NDArray[np.float32] | None = None  # (B, 3, 4) rest space to armature space
    surface: npt.NDArray[np.float32] | None = None  # (A, 3) avatar vertices, local space

    def nearly_equals(self, second: PoseRow) -> bool:
        """Test for equality up to float32 rounding of matrix, bones and surface; None equals only
        None."""
        return _agree(self, second, ("to_world", "bones", "surface"))


@dataclass(frozen=True, eq=False)
class VolumePlacements:
    """Placements of N volumes at one time, or with a leading time axis over several."""

    there: npt.NDArray[np.bool_]  # (N,) False: disabled, other fields are undefined
    matrices: F64  # (N, 4, 4) object space to world, Blender units
    boxes: F64  # (N, 2, 3) corners of the volume's box, object space; NaN if unknown


@dataclass(eq=False)
class SceneRow:
    """Effects and bodies at one sample, by the indices in the scene description."""

    index: int
    effects: dict[int, EffectRow] = field(default_factory=dict)
    places: VolumePlacements | None = None  # of far volumes, which have no effect row
    poses: dict[int, PoseRow | None] = field(default_factory=dict)  # None: disabled


def effects_agree(one: EffectRow, two: EffectRow) -> bool:
    """Test for equality up to float32 rounding. Levels always count; the rest, except shapes, only
    while the first level is above 0."""
    if not _close(one.level, two.level):
        return False
    if not one.level > 0.0:
        return True
    return _agree(one, two, ("parameters", "matrix", "response", "vertices", "place", "drive"))


def _agree(one: object, two: object, names: Sequence[str]) -> bool:
    """Test two objects for attributes equal up to float32 rounding; None equals only None."""
    return all(_close(getattr(one, name), getattr(two, name)) for name in names)


def _close(one: npt.ArrayLike | None, two: npt.ArrayLike | None) -> bool:
    """Test arrays of equal shape for equality within 1e-5 relative plus 5e-6; NaN equals NaN, None
    only None."""
    if one is None or two is None:
        return one is two
    one, two = np.asarray(one), np.asarray(two)
    if one.shape == two.shape and (one == two).all():
        return True  # common, and ten times faster than allclose
    return one.shape == two.shape and np.allclose(one, two, _RELATIVE, _ABSOLUTE, equal_nan=True)


def effect_block(rows: Sequence[EffectRow], modality: str) -> EffectBlock:
    """Block of an effect from rows in the order of time (T). Missing parameters are 0, missing
    matrices the identity; without any matrix there are no shapes, response and vertices."""
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
    """Block of an effect at ``count`` times with level and parameters 0, without a placement."""
    width = len(MODALITIES[modality].parameters)
    return EffectBlock(np.zeros(count), np.zeros((count, width)))


def _stacked(values: Sequence[F64 | None]) -> F64 | None:
    """Stack arrays to (T, ...); None entries become copies of the first array. None without any."""
    first = next((value for value in values if value is not None), None)
    if first is None:
        return None
    return np.stack([first if value is None else value for value in values])


def pose_block(rows: Sequence[PoseRow | None]) -> PoseBlock:
    """Block of a body from rows in the order of time (T). None rows are invalid copies of the first
    valid row; without any, matrices are zero and bones and surface None."""
    valid = np.array([row is not None for row in rows])
    first = next((row for row in rows if row is not None), None)
    if first is None:
        return PoseBlock(valid, np.zeros((len(rows), 4, 4)))
    filled = [first if row is None else row for row in rows]
    return PoseBlock(
        valid,
        np.stack([row.to_world for row in filled]),
        None if first.bones is None else np.stack([row.bones for row in filled]).astype(np.float64),
        None if first.surface is None else np.stack([row.surface for row in filled]),
    )
