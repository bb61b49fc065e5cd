# SPDX-License-Identifier: GPL-3.0-or-later
"""Models moved by bones: linear blend skinning."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import F64, I32, I64
from ..body.model import PerceptualModel
from ..matmul import stacked_product
from ..native import skin as native
from ..native.cluster_bounds import Outline
from ..native.skin_arrays import SkinTableArrays
from ..scene import PoseBlock, SkinBinding
from .bound_weights import BoneBoxes, BoundWeights
from .posing import cluster_slices, clusters_of


class SkinnedModel:
    """Perceptual model posed by linear blend skinning.

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
    def _boxes(self) -> BoneBoxes:
        return BoneBoxes.of(self._weights, self.clusters)

    @cached_property
    def _native(self) -> native.Clusters:
        bound = self._weights.clusters(self.clusters)
        return native.Clusters(bound, self._boxes.ends, self._boxes.bones)

    def cluster_bones(self, cluster: int) -> I64:
        """Bones with weights in a cluster, ascending."""
        return self._boxes.bones[self._boxes.ends[cluster] : self._boxes.ends[cluster + 1]]

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

    def cluster_bounds(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        assert pose.bones is not None
        return self.outline.bounds(pose.bones, rows, to_target, None)[:2]

    @cached_property
    def outline(self) -> Outline:
        """Bone boxes of each cluster for the native library."""
        slots, boxes = self._boxes.slots, (self._boxes.centres, self._boxes.halves)
        return Outline(self._boxes.used, self._boxes.ends, slots, *boxes)

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

    @property
    def used_bones(self) -> I64:
        """Bones with weights, ascending; the number of bones is the bone at rest."""
        return self._boxes.used

    def native_clusters(
        self, clusters: I64, table: SkinTableArrays | None = None
    ) -> native.Clusters:
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
