# SPDX-License-Identifier: GPL-3.0-or-later
"""Broad phase: clusters of a body's skin that a volume can reach, at rows and between them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from ..kinematics.motion import Motion, turns_since_before
from ..native.skin import PosedBones
from ..scene import EffectBlock, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..skin.skinned_model import SkinnedModel
from ..skin.surface_posing import PointwiseModel
from ..volume.mesh import MeshVolume
from ..volume.placing_matrix import world_bounds
from ..volume.shape import Falloff, Shape
from . import continuous_collision
from .target import Target

_PARTS: Final = 8  # of the way of a turning mesh


@dataclass(frozen=True, eq=False)
class ReachableBounds:
    """World boxes of a posed model's clusters over some rows of a block."""

    rows: I64  # (n,) rows whose pose is known, ascending
    low: F64  # (n, C, 3)
    high: F64  # (n, C, 3)
    of_rows: F64  # (n, 2, 3) around all clusters at a row
    of_clusters: F64  # (C, 2, 3) around a cluster at all rows

    @property
    def boxes(self) -> tuple[F64, F64, F64, F64]:
        """Boxes without the rows."""
        return self.low, self.high, self.of_rows, self.of_clusters

    @classmethod
    def around(cls, rows: I64, low: F64, high: F64) -> ReachableBounds:
        """Bounds of the skin's clusters, from boxes (n, C, 3) at some rows."""
        of_rows = low.min(axis=1, initial=np.inf), high.max(axis=1, initial=-np.inf)
        # If one row is not a number, the cluster's other rows still count.
        lowest = np.fmin.reduce(low, axis=0, initial=np.inf)
        highest = np.fmax.reduce(high, axis=0, initial=-np.inf)
        of_clusters = np.stack([lowest, highest], axis=1)
        return cls(rows, low, high, np.stack(of_rows, axis=1), of_clusters)


@dataclass(frozen=True, eq=False)
class VolumeBroadPhase:
    """A volume and a body over some rows."""

    skin: BodySkin
    pose: PoseBlock
    rows: I64  # (n,)
    matrices: F64  # (n, 4, 4) shape space to world
    inverses: F64  # (n, 4, 4)
    to_shape: F64  # (n, 4, 4) body's space to shape space
    target: Target
    boxes: F64  # (n, 2, 3) world
    low: F64  # (n, C, 3) world, of the body's clusters
    high: F64

    @classmethod
    def of(
        cls,
        effect: EffectBlock,
        falloff: Falloff,
        rows: I64,
        inverses: F64,
        skin: BodySkin,
        pose: PoseBlock,
        bounds: ReachableBounds,
    ) -> VolumeBroadPhase:
        assert effect.matrices is not None
        which = effect.shapes_at(rows)
        matrices, to_world = effect.matrices[rows], pose.to_world[rows]
        target = Target(
            effect.shapes,
            which,
            falloff,
            inverses[:, :3, :3],
            to_world[:, :3, :3],
            matrices[:, :3, :3],
            skin.skin.tolerance.amplitude,
        )
        boxes = np.zeros((len(rows), 2, 3))
        for shape, mine in target.places:
            boxes[mine] = world_bounds(shape, matrices[mine])
        at = np.searchsorted(bounds.rows, rows)
        return cls(
            skin,
            pose,
            rows,
            matrices,
            inverses,
            inverses @ to_world,
            target,
            boxes,
            bounds.low[at],
            bounds.high[at],
        )

    def reached(self, falloff: Falloff) -> tuple[Bool, Bool]:
        """Clusters that the volume can reach, and those where vertices suffice, (n, C) bool each.

        They do where all is inside, and where strength hardly changes within a cell.
        """
        low, high = self.boxes[:, None, 0], self.boxes[:, None, 1]
        reached = ((self.low <= high) & (self.high >= low)).all(axis=2)
        if not falloff.is_flat:
            return reached, self._is_even(reached)
        simple = np.zeros_like(reached)
        for shape, mine in self.target.places:
            if shape.is_convex:
                within = ((self.low[mine] >= low[mine]) & (self.high[mine] <= high[mine])).all(2)
                simple[mine] = _enclosed(
                    shape, self.inverses[mine], self.low[mine], self.high[mine], within
                )
        return reached, simple

    def _is_even(self, reached: Bool) -> Bool:
        """Test clusters for strength so even within cells that their vertices suffice, (n, C) bool.

        A cell's mean is no farther from the value at its vertex than the steepest slope times
        the mean distance of its skin, as it is posed. What is not reached is even.
        """
        even = ~reached
        some, clusters = np.flatnonzero(reached.any(axis=1)), np.flatnonzero(reached.any(axis=0))
        if not len(some) or not self.skin.skin.is_split:
            return np.ones_like(reached)
        amplitude = self.skin.skin.tolerance.amplitude
        sizes = self.skin.cell_sizes
        if sizes is not None and amplitude > 0.0:
            assert self.bones is not None
            means = self.bones.cell_means(sizes.pointers(clusters), some, clusters)
            slopes = self.target.slopes_of(some)
            even[np.ix_(some, clusters)] |= slopes[:, None] * means <= amplitude
        return even

    def followed(self, follows: Bool, simple: Bool, *, always: bool) -> Bool:
        """Clusters that may meet the volume between a row and the one before it, (n, C) bool."""
        followed = np.zeros(simple.shape, np.bool_)
        edge_m = self.skin.skin.edge_m
        if not follows.any() or not math.isfinite(edge_m):
            return followed
        later = np.flatnonzero(follows)
        earlier = later - 1
        low, high = self._swept_boxes(later)
        meets = (
            (np.minimum(self.low[later], self.low[earlier]) <= high[:, None])
            & (np.maximum(self.high[later], self.high[earlier]) >= low[:, None])
        ).all(axis=2)
        if self.target.falloff.is_flat:
            # From wholly inside nothing enters; on arrival there it is felt anyway.
            meets &= ~simple[earlier]
            if not always:
                meets &= ~simple[later]
        some, clusters = np.flatnonzero(meets.any(axis=1)), np.flatnonzero(meets.any(axis=0))
        if len(some) and not always:
            moves = self._moves(clusters, earlier[some], later[some])
            limits = self._unseen_m(later[some], edge_m)
            meets[np.ix_(some, clusters)] &= ~(moves <= limits[:, None])
        followed[later] = meets
        return followed

    def _unseen_m(self, later: I64, edge_m: float) -> F64:
        """Largest untracked motion of skin before some rows, metres (n,)."""
        limits = np.zeros(len(later))
        which = self.target.which[later]
        for k in np.unique(which).tolist():
            mine = np.flatnonzero(which == k)
            limits[mine] = continuous_collision.max_untracked_motion_m(
                self.target.shapes[k],
                self.inverses[later[mine]],
                self.target.falloff,
                self.skin.skin.tolerance,
                edge_m,
            )
        return limits

    def _swept_boxes(self, later: I64) -> tuple[F64, F64]:
        """World boxes of what the volume may meet since the rows before some, (n, 3) each.

        A mesh that turns is looked at in parts of its way: there its skin costs most, and the
        ends of half a turn do not show how little a blade passes through.
        """
        earlier = later - 1
        low = np.minimum(self.boxes[later, 0], self.boxes[earlier, 0])
        high = np.maximum(self.boxes[later, 1], self.boxes[earlier, 1])
        is_turning = self._turns[0, later] > 0.0
        parts = np.ones(len(later))
        for shape, mine in self._meshes:
            some = np.flatnonzero(is_turning & mine[later])
            rows, parts[some] = later[some], _PARTS
            motion = Motion.between(self.matrices[rows - 1], self.matrices[rows])
            for share in np.arange(1, _PARTS) / _PARTS:
                boxes = world_bounds(shape, motion.at(share))
                low[some] = np.minimum(low[some], boxes[:, 0])
                high[some] = np.maximum(high[some], boxes[:, 1])
        swing = self._swings(later, parts)[:, None]
        return low - swing, high + swing

    @property
    def _meshes(self) -> Iterator[tuple[Shape, Bool]]:
        """Meshes that occur, and whether a row has them, (n,)."""
        for k in np.unique(self.target.which).tolist():
            if isinstance(self.target.shapes[k], MeshVolume):
                yield self.target.shapes[k], self.target.which == k

    def _swings(self, later: I64, parts: F64) -> F64:
        """Largest distance that rotation may take anything out of the boxes of ``parts`` (n,) of
        the volume's path, and of both ends of the skin's, metres (n,)."""
        swing = np.zeros(len(later))
        own = self.matrices, self.boxes[:, None, 0], self.boxes[:, None, 1], parts
        skin = self.pose.to_world[self.rows], self.low, self.high, 1.0
        for turns, (matrices, low, high, share) in zip(self._turns, (own, skin), strict=True):
            angles = turns[later] / share
            if angles.any():
                lowest, highest = low.min(axis=1), high.max(axis=1)
                origins = matrices[:, :3, 3]
                arms = np.maximum(np.abs(lowest - origins), np.abs(highest - origins))
                longest = np.sqrt(np.square(arms).sum(axis=1))
                arm = np.maximum(longest[later - 1], longest[later])
                swing += arm * (1.0 - np.cos(0.5 * angles))
        return swing

    def _moves(self, clusters: I64, earlier: I64, later: I64) -> F64:
        """Upper bound of the displacement of clusters relative to the volume, metres (n, k)."""
        surface = self.skin.surface
        if isinstance(surface, SkinnedModel):
            assert self.bones is not None
            linear = self.matrices[later, :3, :3]
            return surface.moves_by(self.bones, clusters, (earlier, later), linear)
        assert isinstance(surface, PointwiseModel)
        to_metres = self.matrices[later].copy()
        to_metres[:, :3, 3] = 0.0
        return surface.cluster_moves(
            clusters,
            self.pose,
            (self.rows[earlier], self.rows[later]),
            (to_metres @ self.to_shape[earlier], to_metres @ self.to_shape[later]),
        )

    def followed_in_steps(self, later: Bool, clusters: I64, rows: I64) -> I64:
        """Number of straight steps that track pairs of a cluster and a row, (pairs,); 0 where not
        later.
        """
        steps = later.astype(np.int64)
        turns = self._turns.sum(axis=0)
        turning = np.flatnonzero(later & (turns[rows] > 0.0))
        if len(turning):
            columns, at = np.unique(clusters[turning], return_inverse=True)
            ends, row = np.unique(rows[turning], return_inverse=True)
            moves = self._moves(columns, ends - 1, ends)[row, at]
            angles = turns[rows[turning]]
            steps[turning] = continuous_collision.steps_for(angles, moves, self.skin.skin.edge_m)
        return steps

    def drift(self, steps: int) -> continuous_collision.Drift:
        """Relative motion of skin in the intervals that end at the rows from the second on."""
        if steps not in self._drifts:
            to_world = self.pose.to_world[self.rows]
            self._drifts[steps] = continuous_collision.Drift.of(
                (self.matrices[:-1], self.matrices[1:]), (to_world[:-1], to_world[1:]), steps
            )
        return self._drifts[steps]

    @cached_property
    def bones(self) -> PosedBones | None:
        """Matrices of the bones that move the skin, rest to shape space; None without bones."""
        return self.skin.posed_bones(self.pose, self.rows, self.to_shape)

    @cached_property
    def _drifts(self) -> dict[int, continuous_collision.Drift]:
        return {}

    @cached_property
    def _turns(self) -> F64:
        """Angles by which the volume, and the body, turns since the row before, radians (2, n)."""
        return turns_since_before(self.matrices, self.pose.to_world[self.rows])


def _enclosed(shape: Shape, inverses: F64, low: F64, high: F64, candidates: Bool) -> Bool:
    """Cluster boxes, world space (n, C, 3), that lie wholly inside a convex shape, (n, C) bool."""
    row, cluster = np.nonzero(candidates)
    if not len(row):
        return np.zeros_like(candidates)
    ends = np.stack([low[row, cluster], high[row, cluster]])  # (2, K, 3)
    picks = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    corners = np.stack([ends[picks[:, axis], :, axis] for axis in range(3)], axis=-1)  # (8, K, 3)
    local = (
        np.einsum("kij,ckj->ick", inverses[row, :3, :3], corners) + inverses[row, :3, 3].T[:, None]
    )
    inside = np.zeros_like(candidates)
    inside[row, cluster] = shape.contains(local.reshape(3, -1)).reshape(8, -1).all(axis=0)
    return inside
