# SPDX-License-Identifier: GPL-3.0-or-later
"""What was read at single times, and how it becomes a block of the engine's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .engine.modality import MODALITIES
from .engine.scene import AnimationBlock, EffectBlock, PoseBlock
from .engine.volume.shape import Shape

F64 = npt.NDArray[np.float64]


@dataclass(eq=False)
class EffectRow:
    """One effect at one time."""

    level: float = 0.0
    parameters: list[float] | None = None
    matrix: F64 | None = None
    shape: Shape | None = None


@dataclass(eq=False)
class PoseRow:
    """One body at one time."""

    to_world: F64
    bones: npt.NDArray[np.float32] | None = None
    surface: npt.NDArray[np.float32] | None = None


@dataclass(eq=False)
class Row:
    """Everything at one time."""

    index: int
    effects: list[EffectRow] = field(default_factory=list)
    poses: list[PoseRow] = field(default_factory=list)

    def agrees(self, other: Row) -> bool:
        """Whether two readings of the same time are the same up to rounding."""
        return all(
            (a is None) == (b is None) and (a is None or np.allclose(a, b, 1e-5, 1e-6, True))
            for a, b in zip(self._numbers(), other._numbers(), strict=False)
        )

    def _numbers(self) -> list[npt.ArrayLike | None]:
        numbers: list[npt.ArrayLike | None] = [len(self.poses)]
        for effect in self.effects:
            numbers += [effect.level, effect.parameters, effect.matrix]
        for pose in self.poses:
            numbers += [pose.to_world, pose.bones, pose.surface]
        return numbers


def block_of(
    rows: Sequence[Row], modalities: Sequence[str], body_count: int, history: int
) -> AnimationBlock:
    """Rows of ascending times as a block; ``modalities`` are those of the effects."""
    return AnimationBlock(
        indices=np.array([row.index for row in rows], np.int64),
        effects=tuple(
            _effect_block([row.effects[k] for row in rows], modality)
            for k, modality in enumerate(modalities)
        ),
        poses=tuple(
            _pose_block([row.poses[k] if row.poses else None for row in rows])
            for k in range(body_count)
        ),
        history=history,
    )


def _effect_block(rows: list[EffectRow], modality: str) -> EffectBlock:
    count = len(MODALITIES[modality].parameters)
    blank = [0.0] * count
    parameters = np.array([row.parameters or blank for row in rows], np.float64)
    levels = np.array([row.level for row in rows], np.float64)
    if not any(row.matrix is not None for row in rows):
        return EffectBlock(levels, parameters)
    identity = np.eye(4)
    shapes: dict[Shape, int] = {}
    which = np.zeros(len(rows), np.int32)
    for k, row in enumerate(rows):
        if row.shape is not None:
            which[k] = shapes.setdefault(row.shape, len(shapes))
    return EffectBlock(
        levels,
        parameters,
        np.stack([identity if row.matrix is None else row.matrix for row in rows]),
        tuple(shapes),
        which,
    )


def _pose_block(rows: list[PoseRow | None]) -> PoseBlock:
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
