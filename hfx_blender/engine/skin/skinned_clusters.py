# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of a skinned model at some rows, posed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ..arrays import F64, I32, I64
from .posing import joined

_SMALL = 96
"""Vertices in a cluster, on average: where fewer, weights are looked at one by one."""


class BoneWeighted(Protocol):
    """Clusters with the weights of bones; see :class:`.skinned_model.SkinnedModel`."""

    @property
    def clusters(self) -> Sequence[I32]: ...
    def cluster_bones(self, cluster: int) -> I64: ...
    def cluster_factors(self, cluster: int) -> tuple[I64, F64]: ...
    def cluster_entries(self, cluster: int) -> tuple[I64, F64, I64]: ...
    def posed_by(self, cluster: int, matrices: F64) -> F64: ...


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
