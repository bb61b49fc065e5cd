# SPDX-License-Identifier: GPL-3.0-or-later
"""Broad phase: boxes of whole bodies against whole volumes, then clusters of skin within reach.

A volume that keeps clear of a body over all times of a block costs a few comparisons; clusters are
bounded only near volumes, and tested row by row (``broad_phase.c``).
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..active_rows import posed_rows
from ..arrays import F64, I64, U8, Bool
from ..kinematics.placement_motion import turned_by
from ..native import library
from ..native.cluster_bounds import Outline
from ..native.library import f64, loaded, structure
from ..scene import AnimationBlock, BodyDescription, EffectBlock
from ..skin.bound_clusters import PosedBones, UsedBones
from ..skin.cell_coverage import BoundSkins
from ..skin.posing import PointwiseModel
from .compiled_target import PlacedTarget
from .reachable_bounds import ReachableBounds, bounds_of, box_of

FEWEST_PAIRS: Final = 32
"""Least number of volumes times rows for which tests of whole boxes pay."""

_ROUNDING: Final = 1e-12

_BEND_M: Final = 0.05
"""Largest distance of skin from the box of all rows on a curved path between two rows, metres."""

NOT: Final = 0
COVERED: Final = 1
BY_VERTEX: Final = 2
WHOLE: Final = 3
"""Tests of a pair's cells: none, share of covered skin, vertices only, entirely inside."""


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
        """World boxes of a model's clusters on a body at all rows with a known pose; cached."""
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
        Enlarged by the arc of a turning body between rows, and by rounding."""
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
        # Rounding grows with the distance from the origin.
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
        # All volumes in one call: most are far from all skin, and cost nothing else.
        matrices = np.concatenate([e.matrices for e in volumes if e.matrices is not None])
        levels = np.concatenate([volume.levels for volume in volumes])
        shape = len(volumes), len(block.indices)
        self._low, self._high, self._sure = volume_boxes(
            matrices.reshape(*shape, 4, 4), levels.reshape(shape), _bounds(volumes)
        )

    def meet(self, low: F64, high: F64, *, is_bent: bool = False) -> list[bool]:
        """Test each volume for meeting a world box with corners (3,), m; True for an unknown box.
        ``is_bent`` enlarges the volumes' boxes by their size and 5 cm."""
        # Volumes on a curved path leave their box by at most its size, skin by at most 5 cm.
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
            # Volumes share shapes; each box is read once.
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


@dataclass(frozen=True, eq=False)
class Pairs:
    """Cluster-row pairs, ascending, with the kind of test for each.

    With ``steps`` above 0 a pair follows the pair of the same cluster at the row before.
    """

    clusters: I64  # (p,)
    rows: I64  # (p,)
    how: U8  # (p,) NOT, COVERED, BY_VERTEX or WHOLE
    steps: I64  # (p,) straight steps of tracking from the row before; 0: untracked
    filled: Any = None  # ``hfx_pairs`` filled by the library

    @property
    def pointers(self) -> Any:
        """Structure ``hfx_pairs`` of these arrays."""
        arrays = self.clusters, self.rows, self.how, self.steps
        return self.filled or structure("hfx_pairs")(len(self.clusters), *arrays)


@dataclass(frozen=True, eq=False)
class Reached:
    """Result of the broad phase: cluster-row pairs for the narrow phase."""

    pairs: Pairs
    clusters: I64  # unique
    wide: I64  # clusters with sampled or tracked skin
    by_vertex: I64  # clusters for which vertices suffice
    most_steps: int  # of any pair
    bones: PosedBones | None  # to shape space; only bones of these clusters
    surface: Any  # ``hfx_surface_places``; None for a body with bones


class CompiledBroadPhase:
    """Broad phase of one volume and one body.

    Call :meth:`overlaps` first, then :meth:`reach` or :meth:`reach_surface` once. ``outline`` is
    that of the body's clusters, None for skin that no bones move. ``rows`` (m,) are the rows of the
    block with ``boxes`` (:meth:`..native.cluster_bounds.Outline.bounds`), ascending; they contain
    the target's rows, at the indices ``at`` (n,), valid after :meth:`overlaps`. ``follows`` and
    ``reported`` (n,) are of :class:`.contact_query.ContactQuery`, ``edge_m`` is the accepted error
    of a contact's edge. ``is_split``: cells have samples; ``is_always``: track all skin that may
    pass, however slow. Raises IndexError: a row of the target has no boxes.
    """

    def __init__(
        self,
        target: PlacedTarget,
        outline: Outline | None,
        rows: I64,
        boxes: tuple[F64, F64, F64, F64],
        follows: Bool,
        reported: Bool,
        edge_m: float,
        is_split: bool,
        is_always: bool,
    ) -> None:
        count, clusters = target.count, boxes[0].shape[1]
        if count and not (len(rows) and target.rows[-1] <= rows[-1]):
            raise IndexError(f"row {target.rows[-1]} has no boxes")
        self._flags = np.empty(count * clusters, np.uint8)
        self.at, self._near = np.empty(count, np.int64), np.empty(clusters, np.int64)
        self._target = target
        self._pointers = structure("hfx_broad")(
            *(outline and outline.pointers, clusters, target.rows, rows, *boxes),
            *(follows, reported, edge_m, is_split, is_always, self.at, self._flags, self._near),
        )

    def overlaps(self) -> I64:
        """Clusters whose world boxes meet the volume's box at any row, ascending."""
        met = np.empty(len(self._near), np.int64)
        count = loaded().hfx_overlaps(self._pointers, self._target.pointers, met)
        return met[:count]

    @property
    def near_count(self) -> int:
        """Number of clusters in reach at or between rows; set by :meth:`overlaps`."""
        return int(self._pointers.near_count)

    def reach(self, posed: F64, used: UsedBones, own: Outline | None, groups: Any) -> Reached:
        """Finish the broad phase of a body with bones; IndexError for a row beyond the pose.

        ``posed`` (T, B, 3, 4) is rest to posed armature space at each row of the block; ``used``
        are bones of all clusters; ``own`` is the outline of the cells' vertices, None where they
        are units of the skin; ``groups`` are bounds of cell sizes, see
        :meth:`..skin.cell_coverage.BodySkin.cell_groups`, None without falloff or where amplitudes
        must be exact.
        """
        count, posed = self._target.count, f64(posed)
        if count and not self._target.rows[-1] < len(posed):
            raise IndexError(f"row {self._target.rows[-1]} of a pose of {len(posed)}")
        bones = PosedBones(count, used, posed.shape[1])
        where = structure("hfx_posed")(posed, posed.shape[1], used.ids, own and own.pointers)
        is_used = np.empty(len(used.ids), np.uint8)
        return self._reached(bones, None, (where, bones.pointers, is_used, None), groups)

    def reach_surface(self, places: F64, own: F64 | None, starts: I64) -> Reached:
        """Finish the broad phase of a body that no bones move, with its positions in body space.

        ``places`` (m, P, 3) are the skin's at the m rows, ``own`` (m, cells, 3) the cells'
        vertices, None where they are places of the skin. ``starts`` (clusters + 1,) is the first
        place of each cluster.
        """
        counts = places.shape[1], 0 if own is None else own.shape[1]
        surface = structure("hfx_surface_places")(places, own, self.at, starts, *counts)
        return self._reached(None, surface, (None, None, None, surface), None)

    def _reached(
        self, bones: PosedBones | None, surface: Any, body: tuple[Any, ...], groups: Any
    ) -> Reached:
        """Run ``hfx_reach``, with room for every near cluster at every row; returns the used part.
        ``body``: pointers of pose, bones, bone mask and surface places, None where absent."""
        near, count = self.near_count, self._target.count
        # Room for every near cluster at every row; the library returns the used part.
        clusters, rows, steps = np.empty((3, near * count), np.int64)
        how = np.empty(near * count, np.uint8)
        pairs = Pairs(clusters, rows, how, steps).pointers
        lists, counts = np.empty((3, near), np.int64), np.empty(4, np.int64)
        where, posed, is_used, places = body
        loaded().hfx_reach(
            *(self._pointers, self._target.pointers, where, posed, is_used, places, groups),
            *(pairs, lists, counts),
        )
        *numbers, most_steps = counts.tolist()
        every, wide, by_vertex = (ids[:n] for ids, n in zip(lists, numbers, strict=True))
        total = pairs.count
        reached = Pairs(clusters[:total], rows[:total], how[:total], steps[:total], pairs)
        return Reached(reached, every, wide, by_vertex, most_steps, bones, surface)
