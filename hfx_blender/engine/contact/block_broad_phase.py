# SPDX-License-Identifier: GPL-3.0-or-later
"""Per-block broad phase on whole-body and whole-volume boxes.

A volume whose box, over all times of a block, keeps clear of a body's box costs a few numbers;
clusters are bounded only where some volume comes near.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..active_rows import posed_rows
from ..arrays import F64, I64, Bool
from ..kinematics.motion import turned_by
from ..native import volume_boxes as native
from ..scene import AnimationBlock, BodyDescription, EffectBlock
from ..skin.bound_skins import BoundSkins
from .broad_phase import ReachableBounds
from .contacts import bounds_of, box_of

_FEWEST: Final = 32
"""Volumes times rows from which looking at whole boxes first pays."""

_UPRIGHT: Final = 0.05
"""Determinant over the product of the columns' lengths: far above that of flattened matrices."""

_ROUNDING: Final = 1e-12


class BlockBroadPhase:
    """Broad-phase data of a block's volumes and bodies, each computed once.

    Parameters
    ----------
    block : AnimationBlock
    bodies : sequence of BodyDescription
        Those of the block's poses, in their order.
    skins : BoundSkins
    """

    def __init__(
        self, block: AnimationBlock, bodies: tuple[BodyDescription, ...], skins: BoundSkins
    ) -> None:
        self._block = block
        self._skins = skins
        self._number = {body.id: k for k, body in enumerate(bodies)}
        self._posed: dict[str, I64] = {}
        self._turns: dict[str, float] = {}
        self._bounds: dict[tuple[str, str], ReachableBounds] = {}
        self._near: dict[tuple[str, str], list[bool]] = {}
        self._boxes: _VolumeBoxes | None = None

    def posed(self, body: BodyDescription) -> I64:
        """Rows at which the pose of a body is known."""
        if body.id not in self._posed:
            self._posed[body.id] = posed_rows(self._block.poses[self._number[body.id]])
        return self._posed[body.id]

    def bounds(self, body: BodyDescription, model_id: str) -> ReachableBounds:
        """Boxes of a model's clusters on a body, wherever its pose is known."""
        key = (body.id, model_id)
        if key not in self._bounds:
            pose = self._block.poses[self._number[body.id]]
            self._bounds[key] = bounds_of(self._skins.of(body, model_id), pose, self.posed(body))
        return self._bounds[key]

    def is_clear(self, animated: EffectBlock, body: BodyDescription, model_id: str) -> bool:
        """Test that a volume surely touches no skin of a model on a body, at any time of the block.

        A volume that is flattened or not a number is never clear: it is to be told of.
        """
        boxes = self._boxes
        if boxes is None:
            boxes = self._boxes = _VolumeBoxes(self._block)
        number = boxes.number.get(animated)
        if number is None or boxes.size < _FEWEST:
            return False
        key = (body.id, model_id)
        if key not in self._near:
            self._near[key] = boxes.meet(*self._body_box(body, model_id))
        return not self._near[key][number]

    def _largest_turn(self, body: BodyDescription) -> float:
        """Largest rotation of a body from one row to the next, radians."""
        if body.id not in self._turns:
            pose, rows = self._block.poses[self._number[body.id]], self.posed(body)
            angles = turned_by(pose.to_world[rows[:-1]], pose.to_world[rows[1:]])
            self._turns[body.id] = float(angles.max())
        return self._turns[body.id]

    def _body_box(self, body: BodyDescription, model_id: str) -> tuple[F64, F64]:
        """Lowest and highest corner of all that a body is and moves through in the block, (3,)."""
        pose, rows = self._block.poses[self._number[body.id]], self.posed(body)
        low, high = box_of(self._skins.of(body, model_id), pose, rows)
        origins = pose.to_world[rows, :3, 3]
        swing = 0.0
        if len(rows) > 1:
            angle = self._largest_turn(body)
            arms = np.maximum(np.abs(low - origins), np.abs(high - origins))
            arm = float(np.sqrt(np.square(arms).sum(axis=1).max()))
            swing = arm * (1.0 - np.cos(0.5 * angle))
        swing += _ROUNDING * float(np.maximum(np.abs(low), np.abs(high)).max())
        return low.min(axis=0) - swing, high.max(axis=0) + swing


class _VolumeBoxes:
    """World boxes of a block's volumes, each around all that the volume moves through."""

    def __init__(self, block: AnimationBlock) -> None:
        volumes = [each for each in block.effects if each.matrices is not None and each.shapes]
        self.number = {each: k for k, each in enumerate(volumes)}
        self.size = len(volumes) * len(block.indices)
        if self.size < _FEWEST:
            return
        matrices = np.concatenate([each.matrices for each in volumes if each.matrices is not None])
        levels = np.concatenate([each.levels for each in volumes])
        shape = len(volumes), len(block.indices)
        made = native.volume_boxes if native.is_there() else _boxes
        self._low, self._high, self._sure = made(
            matrices.reshape(*shape, 4, 4), levels.reshape(shape), _bounds(volumes)
        )

    def meet(self, low: F64, high: F64) -> list[bool]:
        """Volumes that may meet a box, (number of volumes,) bool."""
        meets = ((self._low <= high) & (self._high >= low)).all(axis=1)
        found: list[bool] = (meets | ~self._sure).tolist()
        return found


def _bounds(volumes: list[EffectBlock]) -> F64:
    """Boxes around all shapes of each volume, shape space, (E, 2, 3)."""
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


def _boxes(matrices: F64, levels: F64, bounds: F64) -> tuple[F64, F64, Bool]:
    """See :func:`..native.volume_boxes.volume_boxes`."""
    # Rows where a volume is off may hold anything; rows before count if it was on there.
    on = levels > 0.0
    low, high = bounds[:, 0], bounds[:, 1]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    linear, origins = matrices[..., :3, :3], matrices[..., :3, 3]
    with np.errstate(all="ignore"):
        lengths = np.sqrt(np.square(linear).sum(axis=2))
        upright = np.abs(_determinants(linear)) >= _UPRIGHT * lengths.prod(axis=2)
        sizes = (lengths > 1e-90) & (lengths < 1e90)
        usable = upright & sizes.all(axis=2) & np.isfinite(origins).all(axis=2)
        is_sure: Bool = (~on | usable).all(axis=1)
        centres = np.einsum("etij,ej->eti", linear, middle) + origins
        reaches = np.einsum("etij,ej->eti", np.abs(linear), half)
        arms = np.einsum("etij,ej->eti", np.abs(linear), np.abs(middle) + half)
        reaches += _ROUNDING * (arms + np.abs(origins))
        # Between two rows a turning volume stays within its longest arm of both boxes.
        turns = (linear[:, 1:] != linear[:, :-1]).any(axis=(1, 2, 3))
        longest = np.sqrt(np.square(arms).sum(axis=2).max(axis=1, initial=0.0, where=on))
        swing = np.where(turns, longest, 0.0)[:, None]
        counts = on[..., None]
        lowest = (centres - reaches).min(axis=1, initial=np.inf, where=counts) - swing
        highest = (centres + reaches).max(axis=1, initial=-np.inf, where=counts) + swing
    return lowest, highest, is_sure


def _determinants(linear: F64) -> F64:
    a, b, c = (linear[..., k, :] for k in range(3))
    found: F64 = (
        a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1])
        - a[..., 1] * (b[..., 0] * c[..., 2] - b[..., 2] * c[..., 0])
        + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
    )
    return found
