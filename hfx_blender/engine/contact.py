# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies against volumes: whose skin is inside, and how much of it.

Broad phase: boxes of vertex clusters against boxes of volumes, in the world. Narrow phase:
only the clusters that a volume can reach are posed, straight into the volume's shape space.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from . import swept
from .counters import Counters
from .coverage import BodySkin
from .motion import turned_by
from .narrow import Details, Inside, Target, cells_covered, steepest
from .scene import EffectBlock, PoseBlock
from .volume.placement import inverse_placement, world_bounds
from .volume.shape import Falloff, Shape

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
Weights = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Vertices whose skin is inside a volume over some times; a set that stays is held once."""

    rows: I64  # (n,) rows of the block at which anything is inside, ascending
    sets: I64  # (n,) which vertex set each has, from 0, rising by 0 or 1
    offsets: I64  # (m + 1,) set j has the vertices slice(offsets[j], offsets[j + 1])
    vertices: I32  # (total,) ascending within a set
    weights: Weights  # (total,) in (0, 1]
    details: Details | None  # where asked for; each row has its own set then


@dataclass(frozen=True, eq=False)
class ReachableBounds:
    """World boxes of a posed model's clusters over some rows of a block."""

    rows: I64  # (n,) rows whose pose is known, ascending
    low: F64  # (n, C, 3)
    high: F64  # (n, C, 3)


def bounds_of(skin: BodySkin, pose: PoseBlock, rows: I64) -> ReachableBounds:
    """World boxes of a model's skin, cluster by cluster, at ``rows`` of the block."""
    to_world = pose.to_world[rows]
    low, high = skin.surface.cluster_bounds(pose, rows, to_world)
    if skin.skin.margins_m is not None:
        bulge = _largest_stretch(to_world)[:, None, None] * skin.skin.margins_m[:, None]
        low, high = low - bulge, high + bulge
    return ReachableBounds(rows, low, high)


def _largest_stretch(matrices: F64) -> F64:
    """No less than what a matrix stretches any direction by, (n,)."""
    linear = matrices[:, :3, :3]
    gram = linear @ linear.transpose(0, 2, 1)
    stretch: F64 = np.sqrt(np.abs(gram).sum(axis=2).max(axis=1))
    return stretch


def find(
    effect: EffectBlock,
    falloff: Falloff,
    rows: I64,
    skin: BodySkin,
    pose: PoseBlock,
    bounds: ReachableBounds,
    counters: Counters,
    *,
    follows: Bool | None = None,
    heard: Bool | None = None,
    own_sets: bool = False,
    with_details: bool = False,
    with_impact: bool = False,
) -> Contacts:
    """Vertices of a body whose skin is inside a volume at some rows of a block.

    Parameters
    ----------
    rows : (n,) int64
        Rows at which the volume is active, a subset of ``bounds.rows``.
    follows : (n,) bool, optional
        Whether the row before in ``rows`` is the sample before, so that what passed in between
        is felt too.
    heard : (n,) bool, optional
        Rows that are reported; the others are only there to be followed from.
    own_sets : bool
        Do not share vertex sets between rows.
    with_details : bool
        Also tell where each contact is.
    with_impact : bool
        And how it began, however slowly.

    Returns
    -------
    Contacts
        What is on the boundary is inside; what falloff weakens to nothing is left out.
    """
    assert effect.matrices is not None
    everyone = np.ones(len(rows), np.bool_)
    heard = everyone if heard is None else heard
    follows = ~everyone if follows is None else follows
    inverses, usable = inverse_placement(effect.matrices[rows])
    if not usable.all():
        counters.warn(
            "a volume is flattened, endless or not a number: it is not felt",
            int(np.count_nonzero(~usable & heard)),
        )
        follows = follows.copy()
        follows[1:] &= usable[:-1]
        rows, inverses = rows[usable], inverses[usable]
        heard, follows = heard[usable], follows[usable]
    placed = _Placed.of(effect, falloff, rows, inverses, skin, pose, bounds)
    reached, simple = placed.reached(falloff)
    reached &= heard[:, None]
    counters.volume_tests += int(np.count_nonzero(heard))
    counters.clusters_tested += int(np.count_nonzero(heard)) * reached.shape[1]
    followed = placed.followed(follows, simple, always=with_impact)
    needed = reached | followed
    needed[:-1] |= followed[1:]

    clusters = skin.skin.clusters
    touched = np.flatnonzero(needed.any(axis=0))
    columns = np.sort(np.concatenate([np.zeros(0, np.int32), *(clusters[c] for c in touched)]))
    # Shares of a cell without falloff, in half the memory.
    precision = np.float32 if falloff.is_flat else np.float64
    weights: Weights = np.zeros((len(rows), len(columns)), precision)
    details = Details.none_yet(*weights.shape) if with_details or with_impact else None
    if details is None:
        # All at once where vertices tell enough; the rest cluster by cluster.
        placed.fill(needed & simple, columns, weights, counters)
        touched = np.flatnonzero((needed & ~simple).any(axis=0) | followed.any(axis=0))
    for cluster in touched.tolist():
        mine = np.flatnonzero(needed[:, cluster])
        place = np.searchsorted(columns, clusters[cluster])
        found = placed.weights(
            cluster, mine, simple[mine, cluster], followed[mine, cluster], counters, details, place
        )
        weights[mine[:, None], place] = found
    weights[~heard] = 0.0
    return _gathered(rows, columns, weights, details, own_sets)


@dataclass(frozen=True, eq=False)
class _Placed:
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
    ) -> _Placed:
        assert effect.matrices is not None
        which = np.zeros(len(rows), np.int64)
        if effect.shape_index is not None:
            which = effect.shape_index[rows].astype(np.int64)
        matrices, to_world = effect.matrices[rows], pose.to_world[rows]
        boxes = np.zeros((len(rows), 2, 3))
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            boxes[mine] = world_bounds(effect.shapes[k], matrices[mine])
        target = Target(
            effect.shapes,
            which,
            falloff,
            inverses[:, :3, :3],
            np.sign(np.linalg.det(to_world[:, :3, :3])),
            skin.skin.tolerance.amplitude,
        )
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
        """Which clusters the volume can reach, and in which vertices tell enough, (n, C).

        They do where all is inside, and where strength hardly changes within a cell.
        """
        low, high = self.boxes[:, None, 0], self.boxes[:, None, 1]
        reached = ((self.low <= high) & (self.high >= low)).all(axis=2)
        if not falloff.is_flat:
            slopes = steepest(falloff) * _largest_stretch(self.to_shape)
            tolerance = self.skin.skin.tolerance
            return reached, self.skin.skin.changes(slopes) <= tolerance.amplitude
        simple = np.zeros_like(reached)
        for k in np.unique(self.target.which):
            shape = self.target.shapes[k]
            mine = np.flatnonzero(self.target.which == k)
            if shape.is_convex:
                within = ((self.low[mine] >= low[mine]) & (self.high[mine] <= high[mine])).all(2)
                simple[mine] = _enclosed(
                    shape, self.inverses[mine], self.low[mine], self.high[mine], within
                )
        return reached, simple

    def followed(self, follows: Bool, simple: Bool, *, always: bool) -> Bool:
        """Which clusters may meet the volume between a row and the one before it, (n, C)."""
        followed = np.zeros_like(simple)
        edge_m = self.skin.skin.edge_m
        later = np.flatnonzero(follows)
        if not len(later) or not np.isfinite(edge_m):
            return followed
        earlier = later - 1
        swing = self._swings(earlier, later)
        low, high = self.boxes[:, 0], self.boxes[:, 1]
        near = np.minimum(low[later], low[earlier]) - swing[:, None]
        far = np.maximum(high[later], high[earlier]) + swing[:, None]
        meets = (
            (np.minimum(self.low[later], self.low[earlier]) <= far[:, None])
            & (np.maximum(self.high[later], self.high[earlier]) >= near[:, None])
        ).all(axis=2)
        if self.target.falloff.is_flat:
            # From wholly inside nothing enters; to there it is felt anyway.
            meets &= ~simple[earlier]
            if not always:
                meets &= ~simple[later]
        limits = np.array(
            [
                swept.unseen_m(
                    self.target.shapes[self.target.which[k]],
                    self.inverses[k],
                    self.target.falloff,
                    self.skin.skin.tolerance,
                    edge_m,
                )
                for k in later.tolist()
            ]
        )
        some, clusters = np.flatnonzero(meets.any(axis=1)), np.flatnonzero(meets.any(axis=0))
        if len(some) and not always:
            moves = self._moves(clusters, earlier[some], later[some])
            meets[np.ix_(some, clusters)] &= ~(moves <= limits[some, None])
        followed[later] = meets
        return followed

    def _swings(self, earlier: I64, later: I64) -> F64:
        """How far turning may take anything out of both ends' boxes, metres (n,)."""
        to_world = self.pose.to_world[self.rows]
        swing = np.zeros(len(later))
        for matrices, low, high in (
            (self.matrices, self.boxes[:, None, 0], self.boxes[:, None, 1]),
            (to_world, self.low, self.high),
        ):
            angles = turned_by(matrices[earlier], matrices[later])
            if angles.any():
                origins = matrices[:, None, :3, 3]
                arms = np.maximum(np.abs(low - origins), np.abs(high - origins))
                longest = np.sqrt(np.square(arms).sum(axis=2).max(axis=1))
                arm = np.maximum(longest[earlier], longest[later])
                swing += arm * (1.0 - np.cos(0.5 * angles))
        return swing

    def _moves(self, clusters: I64, earlier: I64, later: I64) -> F64:
        """How far clusters can have moved against the volume, metres (n, k)."""
        to_metres = self.matrices[later].copy()
        to_metres[:, :3, 3] = 0.0
        return self.skin.surface.cluster_moves(
            clusters,
            self.pose,
            (self.rows[earlier], self.rows[later]),
            (to_metres @ self.to_shape[earlier], to_metres @ self.to_shape[later]),
        )

    def fill(self, whole: Bool, columns: I32, weights: Weights, counters: Counters) -> None:
        """Weights by vertex, of the rows and clusters ``whole`` (n, C)."""
        asked = whole[:, self.skin.cluster_of[columns]]
        if self.target.falloff.is_flat:
            weights[asked] = 1.0
            return
        group_of = self.skin.group_of[columns]
        for group in np.unique(group_of[asked.any(axis=0)]).tolist():
            place = np.flatnonzero(group_of == group)
            mine = np.flatnonzero(asked[:, place].any(axis=1))
            points = self.skin.groups.cluster_points(
                group, self.pose, self.rows[mine], self.to_shape[mine]
            )
            counters.vertices_posed += points[0].size
            picked = np.searchsorted(self.skin.groups.clusters[group], columns[place])
            found = self.target.at(mine).weights_of(points[:, :, picked])
            weights[mine[:, None], place] = np.where(asked[np.ix_(mine, place)], found, 0.0)

    def weights(
        self,
        cluster: int,
        mine: I64,
        simple: Bool,
        followed: Bool,
        counters: Counters,
        details: Details | None,
        columns: I64,
    ) -> F64:
        """Weights of a cluster's cells at some rows, (n, C); what passed before them counts."""
        skin, target = self.skin.skin, self.target.at(mine)
        by_vertex = simple if skin.is_split else np.ones(len(mine), np.bool_)
        weights = np.ones((len(mine), len(skin.clusters[cluster])))
        some = np.flatnonzero(by_vertex)
        if len(some) and not (target.falloff.is_flat and simple[some].all()):
            points = self._vertices(cluster, mine[some])
            counters.vertices_posed += points[0].size
            weights[some] = target.at(some).weights_of(points)
        is_posed = ~by_vertex | followed
        is_posed[:-1] |= followed[1:]
        inside: list[Inside] | None = None if details is None else []
        posed = np.flatnonzero(is_posed)
        if len(posed):
            patch = skin.patch(cluster)
            rows, to_shape = self.rows[mine[posed]], self.to_shape[mine[posed]]
            points, gaps = self.skin.surface.cluster_skin(
                cluster, patch.units, patch.links, self.pose, rows, to_shape
            )
            counters.vertices_posed += points[0].size
            place = np.cumsum(is_posed) - 1
            wide = np.flatnonzero(~by_vertex)
            if len(wide):
                chosen = slice(None) if len(wide) == len(posed) else place[wide]
                found: list[Inside] | None = None if inside is None else []
                weights[wide] = cells_covered(
                    patch, points[:, chosen], gaps[chosen], target.at(wide), found
                )
                if inside is not None and found is not None:
                    inside += [Inside(wide[part.rows], part.cells, part.points) for part in found]
            later = np.flatnonzero(followed)
            if len(later):
                before, after = weights[later - 1], weights[later]
                reaches = gaps * patch.reaches
                crossed = swept.crossings(
                    patch,
                    points[:, place[later - 1]],
                    points[:, place[later]],
                    np.maximum(reaches[place[later - 1]], reaches[place[later]]),
                    (before == 0.0) & ((after < 1.0) | (details is not None)),
                    target.at(later),
                    self._drift(cluster, mine[later - 1], mine[later]),
                )
                weights[later] = np.maximum(after, crossed.peaks(*after.shape))
                if inside is not None and details is not None:
                    crossed.tell(details, mine[later], columns)
                    inside.append(Inside(later[crossed.rows], crossed.cells, crossed.middles))
        if inside is not None and details is not None:
            counters.vertices_posed += weights.size
            self._tell_places(cluster, mine, inside, weights, details, columns)
        return weights

    def _vertices(self, cluster: int, mine: I64) -> F64:
        """Places of a cluster's own vertices, (3, n, C) shape space."""
        return self.skin.vertices.cluster_points(
            cluster, self.pose, self.rows[mine], self.to_shape[mine]
        )

    def _tell_places(
        self,
        cluster: int,
        mine: I64,
        inside: list[Inside],
        weights: F64,
        details: Details,
        columns: I64,
    ) -> None:
        """Fill in where contacts are: at the vertex if that is inside, else at the deepest."""
        points = self._vertices(cluster, mine)
        is_in = self.target.at(mine).weights_of(points) > 0.0
        open_cells = (weights > 0.0) & ~is_in
        for row in np.flatnonzero(open_cells.any(axis=1)).tolist():
            found = [each.of_row(row) for each in inside]
            cells = np.concatenate([cell for cell, _ in found])
            places = np.concatenate([place for _, place in found], axis=1)
            shape = self.target.shapes[self.target.which[mine[row]]]
            depths = shape.depth_m(places, self.matrices[mine[row]])
            order = np.lexsort((-depths, cells))
            order = order[np.flatnonzero(np.diff(cells[order], prepend=-1))]
            order = order[open_cells[row, cells[order]]]
            points[:, row, cells[order]] = places[:, order]
        details.places[:, mine[:, None], columns] = points

    def _drift(self, cluster: int, earlier: I64, later: I64) -> swept.Drift:
        """How a cluster drifts into rows from those before them."""
        angles = self._turns[later]
        steps = 1
        if angles.any():
            moves = self._moves(np.array([cluster]), earlier, later)[:, 0]
            steps = swept.steps_for(angles, moves, self.skin.skin.edge_m)
        if steps not in self._drifts:
            to_world = self.pose.to_world[self.rows]
            self._drifts[steps] = swept.Drift.of(
                (self.matrices[:-1], self.matrices[1:]), (to_world[:-1], to_world[1:]), steps
            )
        return self._drifts[steps].at(earlier)

    @cached_property
    def _drifts(self) -> dict[int, swept.Drift]:
        return {}

    @cached_property
    def _turns(self) -> F64:
        """By how much volume and body turn since the row before, radians (n,)."""
        to_world = self.pose.to_world[self.rows]
        turns = np.zeros(len(self.rows))
        for matrices in (self.matrices, to_world):
            turns[1:] += turned_by(matrices[:-1], matrices[1:])
        return turns


def _gathered(
    rows: I64,
    columns: I32,
    weights: Weights,
    details: Details | None,
    own_sets: bool,
) -> Contacts:
    felt = weights.any(axis=1)
    rows, weights = rows[felt], weights[felt]
    is_new = np.ones(len(rows), np.bool_)
    if not own_sets:
        is_new[1:] = (weights[1:] != weights[:-1]).any(axis=1)
    owners, felt_columns = np.nonzero(weights[is_new])
    if details is not None:
        at = np.flatnonzero(felt)[owners], felt_columns
        details = Details(
            details.places[:, *at],
            details.since[at],
            details.entries[:, *at],
            details.ways[:, *at],
        )
    return Contacts(
        rows,
        np.cumsum(is_new) - 1,
        np.searchsorted(owners, np.arange(np.count_nonzero(is_new) + 1)),
        columns[felt_columns],
        weights[is_new][owners, felt_columns],
        details,
    )


def _enclosed(shape: Shape, inverses: F64, low: F64, high: F64, candidates: Bool) -> Bool:
    """Which cluster boxes, world space (n, C, 3), lie wholly inside a convex shape, (n, C)."""
    row, cluster = np.nonzero(candidates)
    ends = np.stack([low[row, cluster], high[row, cluster]])  # (2, K, 3)
    picks = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    corners = np.stack([ends[picks[:, axis], :, axis] for axis in range(3)], axis=-1)  # (8, K, 3)
    local = (
        np.einsum("kij,ckj->ick", inverses[row, :3, :3], corners) + inverses[row, :3, 3].T[:, None]
    )
    inside = np.zeros_like(candidates)
    inside[row, cluster] = shape.contains(local.reshape(3, -1)).reshape(8, -1).all(axis=0)
    return inside
