# SPDX-License-Identifier: GPL-3.0-or-later
"""World boxes of posed skin, and positions of skin that no bones move."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import F64, I64, Bool
from ..kinematics.placement_motion import largest_stretch
from ..scene import PoseBlock
from ..skin.cell_coverage import BodySkin
from ..skin.posing import PointwiseModel
from ..skin.skinned_model import SkinnedModel


@dataclass(frozen=True, eq=False)
class ReachableBounds:
    """World boxes of a posed model's clusters at some rows of a block, metres."""

    rows: I64  # (n,) rows whose pose is known, ascending
    low: F64  # (n, C, 3)
    high: F64  # (n, C, 3)
    of_rows: F64  # (n, 2, 3) around all clusters at a row
    of_clusters: F64  # (C, 2, 3) around a cluster at all rows
    places: F64 | None = None  # (n, P, 3) positions of skin without bones, body space
    own: F64 | None = None  # (n, cells, 3) positions of the cells' own vertices

    @property
    def boxes(self) -> tuple[F64, F64, F64, F64]:
        """Boxes as of :meth:`..native.cluster_bounds.Outline.bounds`, from low to of_clusters."""
        return self.low, self.high, self.of_rows, self.of_clusters

    @cached_property
    def bends_m(self) -> F64:
        """Deviation of each cluster's path, from the row before to each row, from a straight line:
        upper bound (n, C), metres, by :func:`bends_m`; cached."""
        boxes = np.stack([self.low, self.high], axis=2)
        follows = np.diff(self.rows, prepend=-2) == 1
        return bends_m(boxes, follows)

    @classmethod
    def around(
        cls, rows: I64, low: F64, high: F64, places: F64 | None = None, own: F64 | None = None
    ) -> "ReachableBounds":
        """Bounds from world cluster boxes (n, C, 3) at rows (n,). NaN at a row makes ``of_rows``
        NaN there, and is ignored in ``of_clusters``; boxes around nothing are inf to -inf."""
        of_rows = low.min(axis=1, initial=np.inf), high.max(axis=1, initial=-np.inf)
        # A NaN at one row must not hide the cluster's boxes at all the rest.
        lowest = np.fmin.reduce(low, axis=0, initial=np.inf)
        highest = np.fmax.reduce(high, axis=0, initial=-np.inf)
        of_clusters = np.stack([lowest, highest], axis=1)
        return cls(rows, low, high, np.stack(of_rows, axis=1), of_clusters, places, own)


def bends_m(boxes: F64, follows: Bool) -> F64:
    """Deviation of moving boxes (n, ..., 2, 3) from a straight line between the row before and each
    row: upper bound (n, ...), metres.

    Half of the larger second difference at both ends of the path, over all box corners.
    ``follows`` (n,) is True for a row one sample after the row before. A second difference enters
    only for three successive samples, without NaN. 0: straight motion, or none known, as at row 0.
    """
    bends = np.zeros(boxes.shape[:-2])
    known = (follows[1:-1] & follows[2:]).reshape(-1, *[1] * (bends.ndim - 1))
    ways = np.abs(boxes[2:] - 2.0 * boxes[1:-1] + boxes[:-2]).max(axis=(-2, -1))
    bends[1:-1] = np.where(known, np.nan_to_num(ways), 0.0)
    # A path between two rows is bounded by the larger second difference of both.
    before = np.concatenate([np.zeros_like(bends[:1]), bends[:-1]])
    return np.asarray(0.5 * np.maximum(bends, before))


def bounds_of(skin: BodySkin, pose: PoseBlock, rows: I64) -> ReachableBounds:
    """World boxes of a body's C skin clusters at ``rows`` (n,) of the block's times: lower and
    upper corners (n, C, 3), metres.

    Boxes contain the bulge of curved skin. Skin without bones also gets ``places``; if its vertices
    belong to another model than its surface, ``own`` are their positions.
    """
    to_world = pose.to_world[rows]
    surface, margins_m = skin.surface, skin.skin.margins_m
    if isinstance(surface, SkinnedModel):
        assert pose.bones is not None
        boxes = surface.outline.bounds(pose.bones, rows, to_world, margins_m)
        return ReachableBounds(rows, *boxes)
    assert isinstance(surface, PointwiseModel)
    places, own = surface.places(pose, rows), None
    if skin.is_grouped:
        assert isinstance(skin.vertices, PointwiseModel)
        own = skin.vertices.places(pose, rows)
    low, high = surface.bounds_around(places, to_world)
    if margins_m is not None:
        # Margins are of the rest pose: the placement stretches a bulge as much as any direction.
        bulge = largest_stretch(to_world)[:, None, None] * margins_m[:, None]
        low, high = low - bulge, high + bulge
    return ReachableBounds.around(rows, low, high, places, own)


def box_of(skin: BodySkin, pose: PoseBlock, rows: I64) -> tuple[F64, F64]:
    """World boxes around skin that is posed point by point (no bones), at each of ``rows`` (n,) of
    the block's times, with the bulge of curved skin; may be larger than the skin. Lowest and
    highest corners, (n, 3) each, metres."""
    assert isinstance(skin.surface, PointwiseModel)
    to_world = pose.to_world[rows]
    low, high = skin.surface.box(pose, rows, to_world)
    if skin.skin.margins_m is not None:
        bulge = largest_stretch(to_world)[:, None] * skin.skin.margins_m.max(initial=0.0)
        low, high = low - bulge, high + bulge
    return low, high
