# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin weights of a perceptual model, bound to the bones of one body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Self
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np

from ..arrays import F64, I32, I64
from ..body.model import PerceptualModel
from ..native import skin as native


@dataclass(frozen=True, eq=False)
class BoundWeights:
    """Skin weights of each vertex, which sum to 1, as indices of the body's bones."""

    offsets: I64  # (V + 1,) each vertex's first weight
    bones: I64  # (E,)
    values: F64  # (E,)
    rest: F64  # (V, 4) homogeneous
    bone_count: int  # of the body; this number is the index of the resting bone

    @classmethod
    def of(cls, model: PerceptualModel, bone_names: tuple[str, ...]) -> BoundWeights:
        """Return the weights of a model, which must not change, on a body with these bones; cached.

        Raises
        ------
        ValueError
            A bone that moves something is missing.
        """
        known = _KNOWN.setdefault(model, WeakValueDictionary())
        found = known.get(bone_names)
        if found is None:
            found = known[bone_names] = cls._made(model, bone_names)
        return found

    @classmethod
    def _made(cls, model: PerceptualModel, bone_names: tuple[str, ...]) -> BoundWeights:
        index = {name: i for i, name in enumerate(bone_names)}
        weights, still = model.weights, len(bone_names)
        bone_of = np.array([index.get(name, -1) for name in model.bone_names], np.int64)
        if (bone_of < 0).any():
            missing = np.unique(weights.bones[bone_of[weights.bones] < 0])
            if len(missing):
                raise ValueError(
                    f"bones missing from the pose: {[model.bone_names[b] for b in missing]}"
                )
        offsets = weights.offsets.astype(np.int64)
        owners = np.repeat(np.arange(len(model)), np.diff(offsets))
        bones = bone_of[weights.bones]
        # Rows sum to 1 only up to float32; in float64 they must, or a body far from the origin
        # of its armature would shrink towards it.
        values = weights.values.astype(np.float64)
        sums = np.bincount(owners, values, len(model))
        # Vertices without bones stay in the rest pose, as in Blender.
        idle = np.flatnonzero(~(sums > 0.0))
        if len(idle):
            moved_too = np.flatnonzero(sums[owners] > 0.0)
            owners = np.concatenate([owners[moved_too], idle])
            order = np.argsort(owners, kind="stable")
            owners = owners[order]
            bones = np.concatenate([bones[moved_too], np.full(len(idle), still)])[order]
            values = np.concatenate([values[moved_too], np.ones(len(idle))])[order]
            sums[idle] = 1.0
            offsets = np.searchsorted(owners, np.arange(len(model) + 1)).astype(np.int64)
        rest = np.ones((len(model), 4))
        rest[:, :3] = model.vertices
        return cls(offsets, bones, values / sums[owners], rest, still)

    def entries(self, ids: I32) -> tuple[I64, I64]:
        """Indices of some vertices' weights in the weight arrays, and the owner of each."""
        counts = self.offsets[ids + 1] - self.offsets[ids]
        owners = np.repeat(np.arange(len(ids)), counts)
        firsts = np.repeat(np.cumsum(counts) - counts, counts)
        return np.repeat(self.offsets[ids], counts) + np.arange(len(owners)) - firsts, owners

    def clusters(self, clusters: list[I32]) -> native.BoundClusters:
        """Clusters of the vertices, for the native library."""
        arrays = self.offsets, self.bones, self.values, self.rest
        return native.BoundClusters(*arrays, clusters, self.bone_count + 1)


_KNOWN: Final[WeakKeyDictionary[Any, WeakValueDictionary[tuple[str, ...], BoundWeights]]] = (
    WeakKeyDictionary()
)
"""Cache of bound weights in use, by model: several skins of a model share them."""


@dataclass(frozen=True, eq=False)
class BoneBoxes:
    """Boxes at rest of the part of each cluster that each bone moves. A pair is a cluster and a
    bone that moves some of it."""

    ends: I64  # (C + 1,) each cluster's first pair
    bones: I64  # (P,) ascending in each cluster
    low: F64  # (P, 3)
    high: F64  # (P, 3)

    @classmethod
    def of(cls, weights: BoundWeights, clusters: list[I32]) -> Self:
        """Boxes of the clusters, none of which may be empty."""
        return cls(*weights.clusters(clusters).bone_boxes())

    @cached_property
    def centres(self) -> F64:
        """Centres of the boxes, (P, 3)."""
        centres: F64 = (self.low + self.high) / 2
        return centres

    @cached_property
    def halves(self) -> F64:
        """Half edge lengths of the boxes, (P, 3)."""
        halves: F64 = (self.high - self.low) / 2
        return halves

    @cached_property
    def _used(self) -> tuple[I64, I64]:
        used, slots = np.unique(self.bones, return_inverse=True)
        return used, slots

    @property
    def used(self) -> I64:
        """Bones that move anything, ascending."""
        return self._used[0]

    @property
    def slots(self) -> I64:
        """Index into ``used`` of the bone of each pair."""
        return self._used[1]
