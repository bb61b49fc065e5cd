# SPDX-License-Identifier: GPL-3.0-or-later
"""Models moved by bones: linear blend skinning, and skin weights bound to the bones of a body."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np

from ..arrays import F64, I32, I64, expand, stacked_product
from ..body.model import PerceptualModel
from ..native.cluster_bounds import Outline
from ..scene import PoseBlock, SkinBinding
from .bound_clusters import BoundClusters, Clusters
from .posing import cluster_slices, clusters_of
from .skin_table import SkinTable


@dataclass(frozen=True, eq=False)
class BoundWeights:
    """Skin weights of vertices by the body's bone indices; rows sum to 1."""

    offsets: I64  # (V + 1,) first entry of each vertex
    bones: I64  # (E,) index into the body's bones; bone_count is a bone at rest
    values: F64  # (E,)
    rest: F64  # (V, 4) homogeneous rest positions
    bone_count: int  # number of bones of the body

    @classmethod
    def of(cls, model: PerceptualModel, bone_names: tuple[str, ...]) -> "BoundWeights":
        """Weights of a model on a body with these bones; vertices without weights get weight 1 on
        an additional bone at rest. Cached, the model must not change. Raises ValueError: a bone
        with weights is missing."""
        cache = _KNOWN.setdefault(model, WeakValueDictionary())
        if (known := cache.get(bone_names)) is not None:
            return known
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
        bound = cache[bone_names] = cls(offsets, bones, values / sums[owners], rest, rest_bone)
        return bound

    def entries(self, ids: I32) -> tuple[I64, I64]:
        """Indices of the entries of vertices (n,), and the position in ``ids`` of each entry."""
        return expand(self.offsets, ids)

    def clusters(self, clusters: list[I32]) -> BoundClusters:
        """Clusters of vertices with weights and rest positions for the native library."""
        arrays = self.offsets, self.bones, self.values, self.rest
        return BoundClusters(*arrays, clusters, self.bone_count + 1)


# Weights in use by model and bone names, shared by skins of a model
_KNOWN: Final[WeakKeyDictionary[Any, WeakValueDictionary[tuple[str, ...], BoundWeights]]] = (
    WeakKeyDictionary()
)


class SkinnedModel:
    """Perceptual model posed by linear blend skinning, by the methods of :class:`.PointwiseModel`.

    A posed vertex is a convex combination of bone transforms of its rest position. So a cluster is
    bounded, without posing, by the hull over its bones of the bone's matrix times the rest-pose box
    of the vertices weighted to the bone.
    """

    def __init__(
        self, model: PerceptualModel, binding: SkinBinding, clusters: list[I32] | None = None
    ) -> None:
        self.clusters = clusters_of(model) if clusters is None else clusters
        self._weights = BoundWeights.of(model, binding.bone_names)
        self._factors: dict[int, tuple[I64, F64]] = {}

    @cached_property
    def _bound(self) -> BoundClusters:
        return self._weights.clusters(self.clusters)

    @cached_property
    def _native(self) -> Clusters:
        return Clusters(self._bound)

    def cluster_bones(self, cluster: int) -> I64:
        """Bones with weights in a cluster, ascending."""
        starts, bones, *_ = self._bound.bone_boxes
        return bones[starts[cluster] : starts[cluster + 1]]

    def _cluster_factors(self, cluster: int) -> tuple[I64, F64]:
        """Ascending bones of a cluster (Bc,), and skin weights times homogeneous rest positions
        (Vc, 4 Bc); cached."""
        if cluster not in self._factors:
            ids, bones = self.clusters[cluster], self.cluster_bones(cluster)
            entries, owners = self._weights.entries(ids)
            # Dense matrix over the cluster's own few bones: posing is one matrix product.
            column = np.searchsorted(bones, self._weights.bones[entries])
            factors = np.zeros((len(ids), len(bones), 4))
            factors[owners, column] = (
                self._weights.values[entries, None] * self._weights.rest[ids[owners]]
            )
            self._factors[cluster] = bones, factors.reshape(len(ids), -1)
        return self._factors[cluster]

    def bone_matrices(self, pose: PoseBlock, rows: I64, to_target: F64, bones: I64) -> F64:
        """Matrices (n, k, 3, 4) of k ascending ``bones``, rest to target space, at rows (n,);
        ``to_target`` (n, 4, 4). A last bone equal to the number of bones is at rest."""
        assert pose.bones is not None
        if len(bones) and bones[-1] == pose.bones.shape[1]:  # the additional bone at rest
            still = np.broadcast_to(np.eye(3, 4), (len(rows), 1, 3, 4))
            posed = np.concatenate([pose.bones[rows], still], axis=1)[:, bones]
        else:
            posed = pose.bones[rows[:, None], bones]
        matrices: F64 = to_target[:, None, :3, :3] @ posed
        matrices[..., 3] += to_target[:, None, :3, 3]
        return matrices

    @cached_property
    def outline(self) -> Outline:
        """Bone boxes of each cluster for the native library."""
        starts, bones, low, high = self._bound.bone_boxes
        slots = np.searchsorted(self.used_bones, bones)
        return Outline(self.used_bones, starts, slots, (low + high) / 2, (high - low) / 2)

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        bones, factors = self._cluster_factors(cluster)
        matrices = self.bone_matrices(pose, rows, to_target, bones)
        return _products(matrices, factors).reshape(3, len(rows), -1)

    def pair_points(
        self, clusters: I64, at: I64, pose: PoseBlock, rows: I64, to_target: F64
    ) -> F64:
        # Matrices of all used bones at once, then picked per cluster and row.
        is_used = np.zeros(self._weights.bone_count + 1, np.bool_)
        for cluster, _ in cluster_slices(clusters):
            is_used[self.cluster_bones(cluster)] = True
        slots = np.cumsum(is_used) - 1
        matrices = self.bone_matrices(pose, rows, to_target, np.flatnonzero(is_used))
        points = []
        for cluster, pairs in cluster_slices(clusters):
            bones, factors = self._cluster_factors(cluster)
            points.append(_products(matrices[at[pairs, None], slots[bones]], factors))
        return np.concatenate(points, axis=1)

    @cached_property
    def used_bones(self) -> I64:
        """Bones with weights, ascending; the number of bones is the bone at rest."""
        return np.unique(self._bound.bone_boxes[1])

    def native_clusters(self, clusters: I64, table: SkinTable | None = None) -> Clusters:
        """Native table of all clusters, with the given clusters filled (ids); neighbours around the
        vertices only with ``table``."""
        self._native.add(clusters, table)
        return self._native

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        if not len(vertices):
            return np.zeros((3, 0))
        entries, owners = self._weights.entries(vertices)
        bones, slot = np.unique(self._weights.bones[entries], return_inverse=True)
        matrices = self.bone_matrices(pose, np.array([row]), to_target[None], bones)[0]
        factors = self._weights.values[entries, None] * self._weights.rest[vertices[owners]]
        moved = np.einsum("eij,ej->ie", matrices[slot], factors)
        points: F64 = np.add.reduceat(moved, np.searchsorted(owners, np.arange(len(vertices))), 1)
        return points


def _products(matrices: F64, factors: F64) -> F64:
    """Positions (3, n V) from factors (V, 4 B), weights times rest positions, and matrices (n, B,
    3, 4)."""
    stacked = np.ascontiguousarray(matrices.transpose(2, 0, 1, 3))
    return stacked_product(stacked.reshape(1, 3 * len(matrices), -1), factors).reshape(3, -1)
