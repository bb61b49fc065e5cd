# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of a skinned model at some rows, posed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ..arrays import F64, I32, I64
from ..indexing import ramp
from ..kinematics.motion import largest_stretch
from ..matmul import stacked_product
from .posing import LinkTable, joined, runs

_SMALL = 96
"""Vertices in a cluster, on average: where fewer, weights are looked at one by one."""


@dataclass(frozen=True, eq=False)
class Links:
    """Distances of a cluster's vertices to their neighbours at rest, and weight differences."""

    distances: F64  # (U,) to the farthest neighbour
    differences: F64  # (B, U) of weights, to the neighbour whose weight differs most
    moved: F64  # (B, 6) mean weight in the cluster; its box's centre, homogeneous, and radius


class BoneWeighted(Protocol):
    """Clusters with the weights of bones; see :class:`.skinned_model.SkinnedModel`."""

    @property
    def clusters(self) -> Sequence[I32]: ...
    def cluster_bones(self, cluster: int) -> I64: ...
    def cluster_factors(self, cluster: int) -> tuple[I64, F64]: ...
    def cluster_entries(self, cluster: int) -> tuple[I64, F64, I64]: ...
    def posed_by(self, cluster: int, matrices: F64) -> F64: ...
    def links(self, cluster: int, table: LinkTable) -> Links: ...


class SkinnedClusters:
    """Clusters of a skinned model under the matrices (n, B, 3, 4) of some bones.

    ``slots`` say where a bone's matrix is.
    """

    def __init__(self, model: BoneWeighted, slots: I64, matrices: F64) -> None:
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
        """Upper bound of the stretch by each bone at each row, (n B,)."""
        return largest_stretch(self._matrices.reshape(-1, 3, 4))

    @cached_property
    def _rows(self) -> F64:
        """The rows of all matrices, (3, n B, 4)."""
        return np.ascontiguousarray(self._matrices.transpose(2, 0, 1, 3)).reshape(3, -1, 4)

    def skin(self, clusters: I64, at: I64, table: LinkTable) -> tuple[F64, F64]:
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


def _moves(matrices: F64, moved: F64, counts: I64, firsts: I64) -> F64:
    """Upper bound of the way that bones move a place of their cluster from the mean, (E,).

    ``matrices`` (3, E, 4) and ``moved`` (E, 6), see :class:`Links`, of pairs of which each has
    ``counts`` bones.
    """
    middle = np.add.reduceat(matrices * moved[:, :1], firsts, axis=1)
    apart = matrices - np.repeat(middle, counts, axis=1)
    ways = np.einsum("iej,ej->ie", apart, moved[:, 1:5])
    turned = np.einsum("iej,iej->e", apart[..., :3], apart[..., :3])
    moves: F64 = np.sqrt(np.einsum("ie,ie->e", ways, ways))
    moves += np.sqrt(turned) * moved[:, 5]
    return moves
