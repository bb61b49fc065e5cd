# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a model's vertices are: bounds of its clusters, and positions of those that are asked for.

Everything comes out in a *target* space (a volume's shape space, or the world) that the caller
names by matrices from armature space, composed in float64: positions are never rounded
to float32 far from the origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..indexing import largest, ramp
from ..motion import largest_stretch
from ..native import skin as native
from ..native.bounds import Outline
from ..native.skin import PosedBones, UsedBones
from ..native.skin_table import Table
from ..products import stacked_product
from ..scene import PoseBlock, SkinBinding
from .bound_weights import BoneBoxes, BoundWeights
from .clusters import clusters_of
from .model import PerceptualModel

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]


_SMALL = 96
"""Vertices in a cluster, on average: where fewer, weights are looked at one by one."""


class PosableModel(Protocol):
    """A perceptual model bound to a body."""

    clusters: list[I32]

    def cluster_bounds(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        """Boxes that hold each cluster: two (n, C, 3), target space.

        ``rows`` (n,) are rows of the pose, ``to_target`` (n, 4, 4) the matrix for each.
        """

    def box(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        """A box that holds all of the model: two (n, 3), target space."""

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        """Positions of a cluster's vertices, (3, n, Vc), target space."""

    def posed(self, clusters: I64, pose: PoseBlock, rows: I64, to_target: F64) -> PosedClusters:
        """Some clusters at some rows, of which :class:`PosedClusters` tells more."""

    def cluster_moves(
        self, clusters: I64, pose: PoseBlock, rows: tuple[I64, I64], to_target: tuple[F64, F64]
    ) -> F64:
        """How far a vertex of some clusters can be from where it was, (n, k), target space.

        ``rows`` and ``to_target`` are those before and those after.
        """

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        """Positions of some vertices at one row, (3, k), target space; ``to_target`` (4, 4)."""


class PosedClusters(Protocol):
    """Clusters of a model at some rows. ``at`` (m,) are places among these rows."""

    def points(self, cluster: int, at: I64) -> F64:
        """Positions of a cluster's vertices, (3, m, Vc), target space."""

    def all_points(self, clusters: I64, at: I64) -> F64:
        """The same of pairs of a cluster, ascending, and a place, one after the other, (3, N)."""

    def skin(self, clusters: I64, at: I64, table: Skin) -> tuple[F64, F64]:
        """Positions of clusters' vertices, and how far from the first their neighbours can be.

        The positions are those of :meth:`all_points`, the distances one for each unit of each
        pair, (slots,), target space.
        """


class Skin(Protocol):
    """Which vertices of clusters count, and which are neighbours."""

    unit_counts: I64
    """How many of each cluster's first vertices have neighbours that count."""

    def links(self, cluster: int) -> I64:
        """One of these vertices and a neighbour of it, (E, 2), by their places in the cluster
        and in this order; they must be the same whenever the cluster is."""


class SkinnedModel:
    """Linear blend skinning: a vertex is a convex combination of where its bones take it.

    That convexity bounds a cluster without posing it: by the hull, over its bones, of the
    bone's matrix times the box of the vertices that it moves.
    """

    def __init__(
        self, model: PerceptualModel, binding: SkinBinding, clusters: list[I32] | None = None
    ) -> None:
        self.clusters = clusters_of(model) if clusters is None else clusters
        self._weights = BoundWeights.of(model, binding.bone_names)
        self._still = self._weights.bone_count
        self._factors: dict[int, tuple[I64, F64]] = {}
        self._sparse: dict[int, tuple[I64, F64, I64]] = {}
        self._links: dict[int, _Links] = {}
        self._moved_by: dict[int, F64] = {}

    @cached_property
    def _boxes(self) -> BoneBoxes:
        return BoneBoxes.of(self._weights, self.clusters)

    @cached_property
    def _native(self) -> native.Clusters:
        bound = self._weights.clusters(self.clusters)
        return native.Clusters(bound, self._boxes.ends, self._boxes.bones)

    def cluster_bones(self, cluster: int) -> I64:
        """Bones that move anything in a cluster, ascending."""
        return self._boxes.bones[self._boxes.ends[cluster] : self._boxes.ends[cluster + 1]]

    def cluster_factors(self, cluster: int) -> tuple[I64, F64]:
        """Bones of a cluster, and weight times homogeneous rest position (Vc, 4 Bc)."""
        if cluster not in self._factors:
            ids, bones = self.clusters[cluster], self.cluster_bones(cluster)
            entries, owners = self._weights.entries(ids)
            column = np.searchsorted(bones, self._weights.bones[entries])
            factors = np.zeros((len(ids), len(bones), 4))
            factors[owners, column] = (
                self._weights.values[entries, None] * self._weights.rest[ids[owners]]
            )
            self._factors[cluster] = bones, factors.reshape(len(ids), -1)
        return self._factors[cluster]

    def cluster_entries(self, cluster: int) -> tuple[I64, F64, I64]:
        """A cluster's weights one by one: bone, weight times homogeneous rest position (E, 4),
        and where those of each vertex begin."""
        if cluster not in self._sparse:
            ids = self.clusters[cluster]
            bones, owners, factors = self._weights.factors(ids)
            self._sparse[cluster] = bones, factors, np.searchsorted(owners, np.arange(len(ids)))
        return self._sparse[cluster]

    def bone_matrices(self, pose: PoseBlock, rows: I64, to_target: F64, bones: I64) -> F64:
        """Rest to target space for some bones, (n, len(bones), 3, 4)."""
        assert pose.bones is not None
        if native.is_there():
            return PosedBones(pose.bones, rows, to_target, UsedBones(bones)).matrices
        if len(bones) and bones.max() == self._still:
            posed = np.tile(np.eye(3, 4), (len(rows), len(bones), 1, 1))
            moving = np.flatnonzero(bones < self._still)
            posed[:, moving] = pose.bones[rows[:, None], bones[None, moving]]
        else:
            posed = pose.bones[rows[:, None], bones[None, :]]
        moved = to_target[:, None, :3, :3] @ posed
        moved[..., 3] += to_target[:, None, :3, 3]
        return moved

    def cluster_bounds(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        if native.is_there():
            assert pose.bones is not None
            return self.outline.bounds(pose.bones, rows, to_target, None)[:2]
        matrices = self.bone_matrices(pose, rows, to_target, self._boxes.used)
        pairs = matrices[:, self._boxes.slots]
        centres = np.einsum("npij,pj->npi", pairs[..., :3], self._boxes.centres) + pairs[..., 3]
        halves = np.einsum("npij,pj->npi", np.abs(pairs[..., :3]), self._boxes.halves)
        low = np.minimum.reduceat(centres - halves, self._boxes.ends[:-1], axis=1)
        high = np.maximum.reduceat(centres + halves, self._boxes.ends[:-1], axis=1)
        return low, high

    def box(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        if native.is_there():
            assert pose.bones is not None
            around = self._whole.bounds(pose.bones, rows, to_target, None)[2]
            return around[:, 0], around[:, 1]
        matrices = self.bone_matrices(pose, rows, to_target, self._boxes.used)
        linear, (middles, edges) = matrices[..., :3], self._boxes.of_bones
        centres = np.einsum("nbij,bj->nbi", linear, middles) + matrices[..., 3]
        halves = np.einsum("nbij,bj->nbi", np.abs(linear), edges)
        return (centres - halves).min(axis=1), (centres + halves).max(axis=1)

    @cached_property
    def outline(self) -> Outline:
        """What bones move of each cluster, as the library knows it."""
        slots, boxes = self._boxes.slots, (self._boxes.centres, self._boxes.halves)
        return Outline(self._boxes.used, self._boxes.ends, slots, *boxes)

    @cached_property
    def _whole(self) -> Outline:
        """The same of all of the model as one."""
        bones = np.arange(len(self._boxes.used), dtype=np.int64)
        boxes = self._boxes.of_bones
        return Outline(self._boxes.used, np.array([0, len(bones)]), bones, *boxes)

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        bones = self.cluster_bones(cluster)
        return self.posed_by(cluster, self.bone_matrices(pose, rows, to_target, bones))

    def posed_by(self, cluster: int, matrices: F64) -> F64:
        """Positions under the matrices (n, B, 3, 4) of a cluster's bones."""
        factors = self.cluster_factors(cluster)[1]
        count = len(matrices)
        stacked = np.ascontiguousarray(matrices.transpose(2, 0, 1, 3)).reshape(1, 3 * count, -1)
        return stacked_product(stacked, factors).reshape(3, count, -1)

    def posed(self, clusters: I64, pose: PoseBlock, rows: I64, to_target: F64) -> PosedClusters:
        is_used = np.zeros(self._still + 1, np.bool_)
        is_used[np.concatenate([self.cluster_bones(c) for c in clusters.tolist()])] = True
        matrices = self.bone_matrices(pose, rows, to_target, np.flatnonzero(is_used))
        return _SkinnedClusters(self, np.cumsum(is_used) - 1, matrices)

    def cluster_moves(
        self, clusters: I64, pose: PoseBlock, rows: tuple[I64, I64], to_target: tuple[F64, F64]
    ) -> F64:
        starts = self._boxes.ends[clusters]
        counts = self._boxes.ends[clusters + 1] - starts
        firsts = np.cumsum(counts) - counts
        pairs = np.repeat(starts - firsts, counts) + np.arange(int(counts.sum()))
        bones, slots = np.unique(self._boxes.slots[pairs], return_inverse=True)
        before, after = (
            self.bone_matrices(pose, row, target, self._boxes.used[bones])
            for row, target in zip(rows, to_target, strict=True)
        )
        changes = (after - before)[:, slots]
        moves = np.abs(
            np.einsum("npij,pj->npi", changes[..., :3], self._boxes.centres[pairs])
            + changes[..., 3]
        )
        moves += np.einsum("npij,pj->npi", np.abs(changes[..., :3]), self._boxes.halves[pairs])
        squared = np.maximum.reduceat(np.square(moves).sum(axis=2), firsts, axis=1)
        return np.sqrt(squared)

    @property
    def used_bones(self) -> I64:
        """Bones that move anything, ascending; the number of bones stands for what rests."""
        return self._boxes.used

    def native_clusters(self, clusters: I64, table: Table | None = None) -> native.Clusters:
        """All clusters where the library finds them, these filled in.

        Without the ``table`` it knows nothing of neighbours, which only skin around vertices has.
        """
        self._native.add(clusters, table)
        return self._native

    @property
    def pairs(self) -> tuple[I64, I64, F64, F64]:
        """Bones of clusters, and boxes of what each moves at rest: each cluster's first pair
        (C + 1,), bones (P,), centres and half edges of boxes (P, 3)."""
        return self._boxes.ends, self._boxes.bones, self._boxes.centres, self._boxes.halves

    def moves_by(self, bones: PosedBones, clusters: I64, rows: tuple[I64, I64], linear: F64) -> F64:
        """As :meth:`cluster_moves` between ``rows`` of the bones, in the space that ``linear``
        (n, 3, 3) leads to."""
        before, after = rows
        return bones.cluster_moves(before, after, linear, clusters, *self.pairs)

    def links(self, cluster: int, table: Skin) -> _Links:
        """What a cluster's neighbours are like; see :class:`PosedClusters`."""
        if cluster not in self._links:
            units = int(table.unit_counts[cluster])
            self._links[cluster] = self._made_links(cluster, units, table.links(cluster))
        return self._links[cluster]

    def _made_links(self, cluster: int, units: int, links: I64) -> _Links:
        ids = self.clusters[cluster]
        bones = self.cluster_bones(cluster)
        entries, owners = self._weights.entries(ids)
        weights = np.zeros((len(ids), len(bones)))
        weights[owners, np.searchsorted(bones, self._weights.bones[entries])] = (
            self._weights.values[entries]
        )
        rest = self._weights.rest[ids, :3]
        one, other = links.T
        gaps = np.sqrt(np.square(rest[one] - rest[other]).sum(axis=1))
        distances = largest(gaps, one, units)
        differences = largest(np.abs(weights[one] - weights[other]), one, units)
        return _Links(distances, np.ascontiguousarray(differences.T), self._moved(cluster))

    def _moved(self, cluster: int) -> F64:
        """What each bone moves of a cluster; see :class:`_Links`."""
        if cluster in self._moved_by:
            return self._moved_by[cluster]
        ids, bones = self.clusters[cluster], self.cluster_bones(cluster)
        entries, _ = self._weights.entries(ids)
        columns = np.searchsorted(bones, self._weights.bones[entries])
        rest = self._weights.rest[ids, :3]
        low, high = rest.min(axis=0), rest.max(axis=0)
        moved = np.zeros((len(bones), 6))
        moved[:, 0] = np.bincount(columns, self._weights.values[entries], len(bones)) / len(ids)
        moved[:, 1:4], moved[:, 4] = 0.5 * (low + high), 1.0
        moved[:, 5] = 0.5 * np.sqrt(np.square(high - low).sum())
        self._moved_by[cluster] = moved
        return moved

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        entries, owners = self._weights.entries(vertices)
        bones, slot = np.unique(self._weights.bones[entries], return_inverse=True)
        matrices = self.bone_matrices(pose, np.array([row]), to_target[None], bones)[0]
        blended = np.zeros((len(vertices), 3, 4))
        np.add.at(blended, owners, self._weights.values[entries, None, None] * matrices[slot])
        return np.einsum("vij,vj->iv", blended, self._weights.rest[vertices])


@dataclass(frozen=True, eq=False)
class _Links:
    """What a cluster's neighbours are like in the rest pose."""

    distances: F64  # (U,) to the farthest neighbour
    differences: F64  # (B, U) of weights, to the neighbour whose weight differs most
    moved: F64  # (B, 6) mean weight in the cluster; its box's centre, homogeneous, and radius


class _SkinnedClusters:
    """Clusters of a skinned model under the matrices (n, B, 3, 4) of some bones.

    ``slots`` say where a bone's matrix is.
    """

    def __init__(self, model: SkinnedModel, slots: I64, matrices: F64) -> None:
        self._model = model
        self._matrices = matrices
        self._slots = slots

    def _of(self, cluster: int, at: I64) -> tuple[I64, F64]:
        slots = self._slots[self._model.cluster_bones(cluster)]
        return slots, self._matrices[at[:, None], slots]

    def points(self, cluster: int, at: I64) -> F64:
        return self._model.posed_by(cluster, self._of(cluster, at)[1])

    def all_points(self, clusters: I64, at: I64) -> F64:
        total = sum(len(self._model.clusters[cluster]) for cluster in clusters.tolist())
        if len(self._matrices) > 1 or total > _SMALL * len(clusters):
            return joined(self, clusters, at)
        # One moment of many small clusters: what each weight moves, all at once.
        bones, factors, firsts = zip(
            *(self._model.cluster_entries(cluster) for cluster in clusters.tolist()), strict=True
        )
        before = np.cumsum([0, *(len(each) for each in bones[:-1])])
        starts = np.concatenate([each + first for each, first in zip(firsts, before, strict=True)])
        matrices = self._matrices[0, self._slots[np.concatenate(bones)]]
        moved = np.einsum("eij,ej->ie", matrices, np.concatenate(factors))
        points: F64 = np.add.reduceat(moved, starts, axis=1)
        return points

    @cached_property
    def _stretches(self) -> F64:
        """No less than what each bone stretches at each row, (n B,)."""
        return largest_stretch(self._matrices.reshape(-1, 3, 4))

    @cached_property
    def _rows(self) -> F64:
        """The rows of all matrices, (3, n B, 4)."""
        return np.ascontiguousarray(self._matrices.transpose(2, 0, 1, 3)).reshape(3, -1, 4)

    def skin(self, clusters: I64, at: I64, table: Skin) -> tuple[F64, F64]:
        """The distances are upper bounds; see :meth:`PosedClusters.skin`.

        With weights u, v and rest places x, y of two neighbours, and any matrix R,
        sum u M x - sum v M y = sum u L (x - y) + sum (u - v) (M - R) y: the first part is at
        most the largest stretch of a bone times their distance, the second what the bones do
        to the cluster differently, times how far the weights differ.
        """
        pieces = runs(clusters)
        of_runs = clusters[[first for first, _ in pieces]].tolist()
        known = [self._model.links(cluster, table) for cluster in of_runs]
        factors = [self._model.cluster_factors(cluster) for cluster in of_runs]
        # An entry is a bone of a cluster at a row; those of a pair follow each other.
        slots = self._slots[np.concatenate([bones for bones, _ in factors])]
        moved = np.concatenate([each.moved for each in known])
        counts = np.array([len(bones) for bones, _ in factors])
        if len(pieces) < len(clusters):
            before, lengths = np.cumsum(counts) - counts, [last - first for first, last in pieces]
            counts = np.repeat(counts, lengths)
            step, owner = ramp(counts)
            entries = np.repeat(before, lengths)[owner] + step
            slots, moved = slots[entries], moved[entries]
        places = slots + np.repeat(at * self._matrices.shape[1], counts)
        firsts = np.cumsum(counts) - counts
        matrices = self._rows.take(places, axis=1)
        stretches = np.maximum.reduceat(self._stretches[places], firsts)
        moves = _moves(matrices, moved, counts, firsts)
        points, gaps = [], []
        entry = 0
        for (first, last), (bones, factor), each in zip(pieces, factors, known, strict=True):
            rows, end = last - first, entry + (last - first) * len(bones)
            points.append(stacked_product(matrices[:, entry:end].reshape(3, rows, -1), factor))
            gap = np.multiply.outer(stretches[first:last], each.distances).ravel()
            if len(bones) > 1:
                moved_by = moves[entry:end].reshape(1, rows, -1)
                gap += stacked_product(moved_by, each.differences.T)[0]
            gaps.append(gap)
            entry = end
        return np.concatenate(points, axis=1), np.concatenate(gaps)


def runs(clusters: I64) -> list[tuple[int, int]]:
    """Where the pairs of each of ascending clusters begin and end."""
    cuts = (np.flatnonzero(clusters[1:] != clusters[:-1]) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, len(clusters)], strict=True))


def _moves(matrices: F64, moved: F64, counts: I64, firsts: I64) -> F64:
    """How far bones move any place of their cluster from where all together do, (E,).

    ``matrices`` (3, E, 4) and ``moved`` (E, 6), see :class:`_Links`, of pairs of which each has
    ``counts`` bones.
    """
    middle = np.add.reduceat(matrices * moved[:, :1], firsts, axis=1)
    apart = matrices - np.repeat(middle, counts, axis=1)
    ways = np.einsum("iej,ej->ie", apart, moved[:, 1:5])
    turned = np.einsum("iej,iej->e", apart[..., :3], apart[..., :3])
    moves: F64 = np.sqrt(np.einsum("ie,ie->e", ways, ways))
    moves += np.sqrt(turned) * moved[:, 5]
    return moves


def joined(posed: PosedClusters, clusters: I64, at: I64) -> F64:
    points = [
        posed.points(int(clusters[first]), at[first:last]).reshape(3, -1)
        for first, last in runs(clusters)
    ]
    return np.concatenate(points, axis=1)
