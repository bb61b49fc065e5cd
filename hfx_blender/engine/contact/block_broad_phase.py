# SPDX-License-Identifier: GPL-3.0-or-later
"""Broad phase of a block: boxes of whole bodies against boxes of whole volumes.

A volume that keeps clear of a body over all times of a block costs a few comparisons; clusters are
bounded only near volumes.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..active_rows import posed_rows
from ..arrays import F64, I64, Bool
from ..kinematics.placement_motion import turned_by
from ..native import library
from ..native.library import loaded
from ..scene import AnimationBlock, BodyDescription, EffectBlock
from ..skin.bound_skins import BoundSkins
from ..skin.posing import PointwiseModel
from .reachable_bounds import ReachableBounds, bounds_of, box_of

FEWEST_PAIRS: Final = 32
"""Least number of volumes times rows for which tests of whole boxes pay."""

_ROUNDING: Final = 1e-12

_BEND_M: Final = 0.05
"""Largest distance of skin from the box of all rows on a curved path between two rows, metres."""


class BlockBroadPhase:
    """Boxes of a block's volumes and ``bodies``, in the order of the block's poses; each computed
    on first use."""

    def __init__(
        self, block: AnimationBlock, bodies: tuple[BodyDescription, ...], skins: BoundSkins
    ) -> None:
        self._block = block
        self._skins = skins
        self._number = {body.id: k for k, body in enumerate(bodies)}
        self._posed: dict[str, I64] = {}
        self._turns: dict[str, float] = {}
        self._bounds: dict[tuple[str, str], ReachableBounds] = {}
        self._near: dict[tuple[str, str, bool], list[bool]] = {}
        self._boxes: _VolumeBoxes | None = None

    def posed(self, body: BodyDescription) -> I64:
        """Rows (n,) with a known pose of a body, ascending."""
        if body.id not in self._posed:
            self._posed[body.id] = posed_rows(self._block.poses[self._number[body.id]])
        return self._posed[body.id]

    def bounds(self, body: BodyDescription, model_id: str) -> ReachableBounds:
        """Cluster boxes of a model on a body at all rows with a known pose; cached."""
        key = (body.id, model_id)
        if key not in self._bounds:
            pose = self._block.poses[self._number[body.id]]
            self._bounds[key] = bounds_of(self._skins.of(body, model_id), pose, self.posed(body))
        return self._bounds[key]

    def is_clear(
        self, animated: EffectBlock, body: BodyDescription, model_id: str, *, is_bent: bool = False
    ) -> bool:
        """Test that a volume certainly touches no skin of a model on a body in the block.

        False without the library, for fewer than 32 volumes times rows, and for unusable
        placements, which need a warning. With ``is_bent`` the volume must also stay clear on a
        curved path between two rows that leaves the box of all rows by at most this box's size and
        5 cm.
        """
        if not library.is_there():
            return False
        # Volumes without shapes have no number; unsure boxes count as near in ``meet``.
        boxes = self._boxes
        if boxes is None:
            boxes = self._boxes = _VolumeBoxes(self._block)
        number = boxes.number.get(animated)
        if number is None or boxes.size < FEWEST_PAIRS:
            return False
        # One test for all volumes at once.
        key = (body.id, model_id, is_bent)
        if key not in self._near:
            self._near[key] = boxes.meet(*self._body_box(body, model_id), is_bent=is_bent)
        return not self._near[key][number]

    def _body_box(self, body: BodyDescription, model_id: str) -> tuple[F64, F64]:
        """Lowest and highest corner (3,) of all skin of a model during the block, world, m.

        Enlarged by the arc of a turning body between rows, and by rounding.
        """
        pose, rows = self._block.poses[self._number[body.id]], self.posed(body)
        skin = self._skins.of(body, model_id)
        if isinstance(skin.surface, PointwiseModel):
            low, high = box_of(skin, pose, rows)
        else:  # for skin on bones, boxes of clusters cost no more
            low, high = self.bounds(body, model_id).of_rows.transpose(1, 0, 2)
        origins = pose.to_world[rows, :3, 3]
        swing = 0.0
        if len(rows) > 1:
            # Between two rows a turning body leaves the box of both by the sagitta of its arc.
            if body.id not in self._turns:
                angles = turned_by(pose.to_world[rows[:-1]], pose.to_world[rows[1:]])
                self._turns[body.id] = float(angles.max())
            angle = self._turns[body.id]  # the largest rotation between successive rows
            arms = np.maximum(np.abs(low - origins), np.abs(high - origins))
            arm = float(np.sqrt(np.square(arms).sum(axis=1).max()))
            swing = arm * (1.0 - np.cos(0.5 * angle))
        swing += _ROUNDING * float(np.maximum(np.abs(low), np.abs(high)).max())
        return low.min(axis=0) - swing, high.max(axis=0) + swing


class _VolumeBoxes:
    """World boxes of a block's volumes, each over all rows."""

    def __init__(self, block: AnimationBlock) -> None:
        volumes = [e for e in block.effects if e.matrices is not None and e.shapes]
        self.number = {volume: k for k, volume in enumerate(volumes)}
        self.size = len(volumes) * len(block.indices)
        if self.size < FEWEST_PAIRS:
            return
        matrices = np.concatenate([e.matrices for e in volumes if e.matrices is not None])
        levels = np.concatenate([volume.levels for volume in volumes])
        shape = len(volumes), len(block.indices)
        self._low, self._high, self._sure = volume_boxes(
            matrices.reshape(*shape, 4, 4), levels.reshape(shape), _bounds(volumes)
        )

    def meet(self, low: F64, high: F64, *, is_bent: bool = False) -> list[bool]:
        """Test each volume for meeting a box with corners (3,), m; True for an unknown box.

        ``is_bent`` enlarges the volumes' boxes by their size and 5 cm.
        """
        spare = np.nan_to_num(self._high - self._low) + _BEND_M if is_bent else 0.0
        meets = ((self._low - spare <= high) & (self._high + spare >= low)).all(axis=1)
        near: list[bool] = (meets | ~self._sure).tolist()
        return near


def _bounds(volumes: list[EffectBlock]) -> F64:
    """Box (lowest, highest corner) around all shapes of each volume, shape space, (E, 2, 3)."""
    known: dict[int, F64] = {}
    boxes = []
    for volume in volumes:
        for shape in volume.shapes:
            if id(shape) not in known:
                known[id(shape)] = shape.bounds
        box = known[id(volume.shapes[0])]
        if len(volume.shapes) > 1:
            low, high = np.stack([known[id(shape)] for shape in volume.shapes], axis=1)
            box = np.stack([low.min(axis=0), high.max(axis=0)])
        boxes.append(box)
    return np.concatenate(boxes).reshape(-1, 2, 3)


def volume_boxes(matrices: F64, levels: F64, bounds: F64) -> tuple[F64, F64, Bool]:
    """World boxes of E volumes over all rows: lowest and highest corner (E, 3), m, and a mask (E,).

    ``matrices`` (E, T, 4, 4) are shape space to world; a volume is left out at rows with a level of
    0 or less in ``levels`` (E, T); ``bounds`` (E, 2, 3) are lowest and highest corner in shape
    space. The mask is False where a placement is not usable, and the box undefined.
    """
    count, rows = levels.shape
    boxes, is_sure = np.empty((count, 2, 3)), np.empty(count, np.bool_)
    loaded().hfx_volume_boxes(count, rows, matrices, levels, bounds, boxes, is_sure)
    return boxes[:, 0], boxes[:, 1], is_sure
