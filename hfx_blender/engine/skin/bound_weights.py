# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin weights of a perceptual model bound to the bones of a body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Self
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np

from ..arrays import F64, I32, I64, expand
from ..body.model import PerceptualModel
from ..native import skin as native


@dataclass(frozen=True, eq=False)
class BoundWeights:
    """Skin weights of vertices by the body's bone indices; rows sum to 1."""

    offsets: I64  # (V + 1,) first entry of each vertex
    bones: I64  # (E,) index into the body's bones; bone_count is a bone at rest
    values: F64  # (E,)
    rest: F64  # (V, 4) homogeneous rest positions
    bone_count: int  # number of bones of the body

    @classmethod
    def of(cls, model: PerceptualModel, bone_names: tuple[str, ...]) -> BoundWeights:
        """Weights of a model on a body with these bones; cached, the model must not change.

        Raises ValueError: a bone with weights is missing.
        """
        cache = _KNOWN.setdefault(model, WeakValueDictionary())
        bound = cache.get(bone_names)
        if bound is None:
            bound = cache[bone_names] = cls._made(model, bone_names)
        return bound

    @classmethod
    def _made(cls, model: PerceptualModel, bone_names: tuple[str, ...]) -> BoundWeights:
        """Uncached version of :meth:`of`. Rows are normalised in float64; vertices without weights
        get weight 1 on an additional bone at rest."""
        index = {name: i for i, name in enumerate(bone_names)}
        weights, rest_bone = model.weights, len(bone_names)
        bone_of = np.array([index.get(name, -1) for name in model.bone_names], np.int64)
        # Bones without weights may be missing: rigs omit helpers.
        if (bone_of < 0).any():
            missing = np.unique(weights.bones[bone_of[weights.bones] < 0])
            if len(missing):
                raise ValueError(
                    f"bones missing from the pose: {[model.bone_names[b] for b in missing]}"
                )
        offsets = weights.offsets.astype(np.int64)
        owners = np.repeat(np.arange(len(model)), np.diff(offsets))
        bones = bone_of[weights.bones]
        # Rows sum to 1 in float32 only. A deficit pulls vertices towards the armature's origin, by
        # more the farther the body is away, so rows are normalised in float64.
        values = weights.values.astype(np.float64)
        sums = np.bincount(owners, values, len(model))
        # Vertices without weights stay in rest pose, as in Blender.
        unweighted = np.flatnonzero(~(sums > 0.0))
        if len(unweighted):
            weighted = np.flatnonzero(sums[owners] > 0.0)
            owners = np.concatenate([owners[weighted], unweighted])
            # Unweighted vertices get weight 1 on the additional bone at rest.
            order = np.argsort(owners, kind="stable")
            owners = owners[order]
            bones = np.concatenate([bones[weighted], np.full(len(unweighted), rest_bone)])[order]
            values = np.concatenate([values[weighted], np.ones(len(unweighted))])[order]
            sums[unweighted] = 1.0
            offsets = np.searchsorted(owners, np.arange(len(model) + 1)).astype(np.int64)
        rest = np.ones((len(model), 4))
        rest[:, :3] = model.vertices
        return cls(offsets, bones, values / sums[owners], rest, rest_bone)

    def entries(self, ids: I32) -> tuple[I64, I64]:
        """Indices of the entries of vertices (n,), and the position in ``ids`` of each entry."""
        return expand(self.offsets, ids)

    def clusters(self, clusters: list[I32]) -> native.BoundClusters:
        """Clusters of vertices with weights and rest positions for the native library."""
        arrays = self.offsets, self.bones, self.values, self.rest
        return native.BoundClusters(*arrays, clusters, self.bone_count + 1)


# Weights in use by model and bone names, shared by skins of a model
_KNOWN: Final[WeakKeyDictionary[Any, WeakValueDictionary[tuple[str, ...], BoundWeights]]] = (
    WeakKeyDictionary()
)


@dataclass(frozen=True, eq=False)
class BoneBoxes:
    """Rest-pose boxes of the vertices of each cluster weighted to each bone.

    A pair is a cluster and a bone with weights in the cluster.
    """

    ends: I64  # (C + 1,) first pair of each cluster
    bones: I64  # (P,) ascending within a cluster
    low: F64  # (P, 3)
    high: F64  # (P, 3)

    @classmethod
    def of(cls, weights: BoundWeights, clusters: list[I32]) -> Self:
        """Boxes of the clusters' vertices by bone; clusters must not be empty."""
        return cls(*weights.clusters(clusters).bone_boxes())

    @cached_property
    def centres(self) -> F64:
        """Centres (P, 3) of the boxes."""
        return np.asarray((self.low + self.high) / 2)

    @cached_property
    def halves(self) -> F64:
        """Half edge lengths (P, 3) of the boxes."""
        return np.asarray((self.high - self.low) / 2)

    @cached_property
    def _used(self) -> tuple[I64, I64]:
        used, slots = np.unique(self.bones, return_inverse=True)
        return used, slots

    @property
    def used(self) -> I64:
        """Indices of bones with weights in any cluster, ascending, unique."""
        return self._used[0]

    @property
    def slots(self) -> I64:
        """Index (P,) into ``used`` of the bone of each pair."""
        return self._used[1]
