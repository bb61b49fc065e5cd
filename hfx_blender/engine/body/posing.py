# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a model's vertices are: bounds of its clusters, and positions of those that are asked for.

Everything comes out in a *target* space (a volume's shape space, or the world) that the caller
names by matrices from armature space, composed in float64: positions are never rounded
to float32 far from the origin.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..scene import PoseBlock, SkinBinding, SurfaceAnchors
from .clusters import clusters_of
from .model import PerceptualModel

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]


_UNTHREADED = 1 << 18
"""Multiplications in one product: more, and OpenBLAS starts threads that wait for each other
longer than they work, several times over where the processors are busy (measured)."""


class PosableModel(Protocol):
    """A perceptual model bound to a body."""

    clusters: list[I32]

    def cluster_bounds(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        """Boxes that hold each cluster: two (n, C, 3), target space.

        ``rows`` (n,) are rows of the pose, ``to_target`` (n, 4, 4) the matrix for each.
        """

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        """Positions of a cluster's vertices, (3, n, Vc), target space."""

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        """Positions of some vertices at one row, (3, k), target space; ``to_target`` (4, 4)."""


class SkinnedModel:
    """Linear blend skinning: a vertex is a convex combination of where its bones take it.

    That convexity bounds a cluster without posing it: by the hull, over its bones, of the
    bone's matrix times the box of the vertices that it moves.
    """

    def __init__(self, model: PerceptualModel, binding: SkinBinding) -> None:
        index = {name: i for i, name in enumerate(binding.bone_names)}
        weights = model.weights
        bone_of = np.array([index.get(name, -1) for name in model.bone_names], np.int64)
        missing = np.unique(weights.bones[bone_of[weights.bones] < 0])
        if len(missing):
            raise ValueError(
                f"bones missing from the pose: {[model.bone_names[b] for b in missing]}"
            )
        self.clusters = clusters_of(model)
        self._offsets = weights.offsets.astype(np.int64)
        self._bones = bone_of[weights.bones]
        # Rows sum to 1 only up to float32; in float64 they must, or a body far from the origin
        # of its armature would shrink towards it.
        values = weights.values.astype(np.float64)
        sums = np.add.reduceat(values, self._offsets[:-1])
        self._values = values / np.repeat(sums, np.diff(self._offsets))
        self._rest = np.hstack([model.vertices.astype(np.float64), np.ones((len(model), 1))])
        self._factors: dict[int, tuple[I64, F64]] = {}

        # A pair is a cluster and a bone that moves some of it, with the box of what it moves.
        cluster_of = np.zeros(len(model), np.int64)
        for cluster, ids in enumerate(self.clusters):
            cluster_of[ids] = cluster
        owners = np.repeat(np.arange(len(model)), np.diff(self._offsets))
        pair_of = cluster_of[owners] * len(binding.bone_names) + self._bones
        order = np.argsort(pair_of, kind="stable")
        pairs, firsts = np.unique(pair_of[order], return_index=True)
        moved = self._rest[owners[order], :3]
        low = np.minimum.reduceat(moved, firsts, axis=0)
        high = np.maximum.reduceat(moved, firsts, axis=0)
        self._pair_centres = (low + high) / 2
        self._pair_halves = (high - low) / 2
        pair_clusters, pair_bones = np.divmod(pairs, len(binding.bone_names))
        self._pair_starts = np.searchsorted(pair_clusters, np.arange(len(self.clusters)))
        self._used_bones, self._pair_slots = np.unique(pair_bones, return_inverse=True)

    def _cluster_factors(self, cluster: int) -> tuple[I64, F64]:
        """Bones of a cluster, and weight times homogeneous rest position (Vc, 4 Bc)."""
        if cluster not in self._factors:
            ids = self.clusters[cluster]
            entries, owners = self._entries(ids)
            bones, column = np.unique(self._bones[entries], return_inverse=True)
            factors = np.zeros((len(ids), len(bones), 4))
            factors[owners, column] = self._values[entries, None] * self._rest[ids[owners]]
            self._factors[cluster] = bones, factors.reshape(len(ids), -1)
        return self._factors[cluster]

    def _entries(self, ids: I32) -> tuple[I64, I64]:
        """Positions in the weight arrays of some vertices' weights, and whose each is."""
        counts = self._offsets[ids + 1] - self._offsets[ids]
        owners = np.repeat(np.arange(len(ids)), counts)
        firsts = np.repeat(np.cumsum(counts) - counts, counts)
        return np.repeat(self._offsets[ids], counts) + np.arange(len(owners)) - firsts, owners

    def _matrices(self, pose: PoseBlock, rows: I64, to_target: F64, bones: I64) -> F64:
        """Rest to target space for some bones, (n, len(bones), 3, 4)."""
        assert pose.bones is not None
        posed = pose.bones[rows[:, None], bones[None, :]]
        moved = to_target[:, None, :3, :3] @ posed
        moved[..., 3] += to_target[:, None, :3, 3]
        return moved

    def cluster_bounds(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        matrices = self._matrices(pose, rows, to_target, self._used_bones)
        pairs = matrices[:, self._pair_slots]
        centres = np.einsum("npij,pj->npi", pairs[..., :3], self._pair_centres) + pairs[..., 3]
        halves = np.einsum("npij,pj->npi", np.abs(pairs[..., :3]), self._pair_halves)
        low = np.minimum.reduceat(centres - halves, self._pair_starts, axis=1)
        high = np.maximum.reduceat(centres + halves, self._pair_starts, axis=1)
        return low, high

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        bones, factors = self._cluster_factors(cluster)
        matrices = self._matrices(pose, rows, to_target, bones)
        stacked = np.ascontiguousarray(matrices.transpose(2, 0, 1, 3)).reshape(3 * len(rows), -1)
        points = np.zeros((len(stacked), len(factors)))
        step = max(1, _UNTHREADED // factors.size)
        for first in range(0, len(stacked), step):
            part = slice(first, first + step)
            np.matmul(stacked[part], factors.T, out=points[part])
        return points.reshape(3, len(rows), -1)

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        entries, owners = self._entries(vertices)
        bones, slot = np.unique(self._bones[entries], return_inverse=True)
        matrices = self._matrices(pose, np.array([row]), to_target[None], bones)[0]
        blended = np.zeros((len(vertices), 3, 4))
        np.add.at(blended, owners, self._values[entries, None, None] * matrices[slot])
        return np.einsum("vij,vj->iv", blended, self._rest[vertices])


class SurfaceModel:
    """Vertices ride on the triangles of an avatar's evaluated mesh."""

    def __init__(self, model: PerceptualModel, anchors: SurfaceAnchors) -> None:
        self.clusters = clusters_of(model)
        self._anchors = anchors

    def _on_surface(self, vertices: I32, surface: npt.NDArray[np.float32]) -> F64:
        """Positions on surfaces (n, A, 3) -> (n, k, 3), avatar's local space."""
        anchors = self._anchors
        corners = surface[:, anchors.corners[vertices]].astype(np.float64)
        edge_1 = corners[:, :, 1] - corners[:, :, 0]
        edge_2 = corners[:, :, 2] - corners[:, :, 0]
        normals = np.cross(edge_1, edge_2)
        lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
        points: F64 = np.einsum("nvci,vc->nvi", corners, anchors.weights[vertices])
        return points + normals * anchors.offset_m[vertices][:, None]

    def cluster_bounds(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        lows, highs = [], []
        for cluster in range(len(self.clusters)):
            points = self.cluster_points(cluster, pose, rows, to_target)
            lows.append(points.min(axis=2).T)
            highs.append(points.max(axis=2).T)
        return np.stack(lows, axis=1), np.stack(highs, axis=1)

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        assert pose.surface is not None
        local = self._on_surface(self.clusters[cluster], pose.surface[rows])
        moved: F64 = local @ to_target[:, :3, :3].transpose(0, 2, 1) + to_target[:, None, :3, 3]
        return np.ascontiguousarray(moved.transpose(2, 0, 1))

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        assert pose.surface is not None
        local = self._on_surface(vertices, pose.surface[row : row + 1])[0]
        moved: F64 = to_target[:3, :3] @ local.T + to_target[:3, 3:]
        return moved
