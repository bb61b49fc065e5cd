# SPDX-License-Identifier: GPL-3.0-or-later
"""Joints following an avatar's surface, for file formats limited to skinned meshes.

The skin is divided into patches with a joint each. A joint follows its patch by the similarity
transform (rotation, uniform scale, translation) of weighted least squares (Umeyama 1991). Vertices
are blended from the patches nearest along the skin (modified Shepard weights, Franke and Nielson
1980).
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from ..arrays import F32, F64, I64
from ..body.model import PerceptualModel
from ..body.skin_distance import edge_graph
from ..scene import PoseBlock, SurfaceBinding
from .posing import SurfaceModel
from .skinned_model import BoundWeights

_SPACING_M: Final = 0.1  # patch spacing: about 240 joints; game engines allow 256
_NEAREST: Final = 4  # patches per vertex: one set of glTF weights
_NEIGHBOURS: Final = 0.02  # weight of neighbouring patches in the motion of a joint
_CORE: Final = 0.05  # smallest counted distance, relative to the nearest patch left out
_FARTHEST_M: Final = 0.5  # largest distance along the skin from vertex to patch


class SurfaceJoints:
    """Joints of a body bound to a surface. ``models`` loads a perceptual model by id; the anchored
    model with most vertices is used."""

    def __init__(self, binding: SurfaceBinding, models: Callable[[str], PerceptualModel]) -> None:
        self._model = models(max(binding.anchors, key=lambda id: len(binding.anchors[id].corners)))
        centres = _patches(self._model)
        self._nearest, self._weights = _nearest_patches(self._model, centres)  # (V, 4)
        self.names = tuple(f"skin {k}" for k in range(len(centres)))
        everywhere = np.arange(len(self._model), dtype=np.int32)
        self._surface = SurfaceModel(self._model, binding.anchors[self._model.id], [everywhere])
        self._rest = self._model.vertices.astype(np.float64)
        self._mix = _mix(self._nearest, self._weights, len(centres))  # (J, V)
        self._sums = np.asarray(self._mix.sum(axis=1))
        self._middles = (self._mix @ self._rest) / self._sums  # (J, 3)
        squares = self._mix @ np.square(self._rest).sum(axis=1, keepdims=True) / self._sums
        spread = squares[:, 0] - np.square(self._middles).sum(axis=1)
        self._spread = np.maximum(spread, 1e-9)

    def matrices(self, pose: PoseBlock, rows: I64) -> tuple[F32, F64]:
        """Motion (T, J, 3, 4) of the joints, rest to the avatar's local space, and errors (2,). The
        errors are the 99th percentile and the maximum over vertices of the distance between blended
        and true positions, each at its worst row, in units of the avatar."""
        joint_matrices = np.empty((len(rows), len(self.names), 3, 4), np.float32)
        errors = np.zeros(2)
        for k in range(len(rows)):
            points = self._surface.cluster_points(0, pose, rows[k : k + 1], np.eye(4)[None])[:, 0].T
            matrices = self._followed(points)
            joint_matrices[k] = matrices
            blended = np.einsum("vk,vkij->vij", self._weights, matrices[self._nearest])
            blended_points = (
                np.einsum("vij,vj->vi", blended[:, :, :3], self._rest) + blended[:, :, 3]
            )
            distances = np.sqrt(np.square(blended_points - points).sum(axis=1))
            errors = np.maximum(errors, np.quantile(distances, [0.99, 1.0]))
        return joint_matrices, errors

    def bound(self, model: PerceptualModel) -> BoundWeights:
        """Joint weights of a model's vertices: the 4 of the nearest vertex, in rest pose, of the
        anchored model."""
        from scipy.spatial import cKDTree

        _, nearest_vertex = cKDTree(self._model.vertices).query(model.vertices)
        rest = np.ones((len(model), 4))
        rest[:, :3] = model.vertices
        offsets = np.arange(0, _NEAREST * len(model) + 1, _NEAREST, dtype=np.int64)
        bones, values = self._nearest[nearest_vertex].ravel(), self._weights[nearest_vertex].ravel()
        return BoundWeights(offsets, bones, values, rest, len(self.names))

    def _followed(self, points: F64) -> F64:
        """Least-squares similarity transforms (J, 3, 4), without reflection, of the joints' patches
        from rest to moved vertices (V, 3)."""
        middles = (self._mix @ points) / self._sums
        # Outer products of moved and rest positions, averaged per joint in one sparse product.
        products = (points[:, :, None] * self._rest[:, None, :]).reshape(-1, 9)
        spread = (self._mix @ products / self._sums).reshape(-1, 3, 3)
        spread -= middles[:, :, None] * self._middles[:, None, :]
        left, sizes, right = np.linalg.svd(spread)
        is_mirrored = np.linalg.det(left) * np.linalg.det(right) < 0.0
        # Umeyama: flip the smallest singular direction, so that the result is no reflection.
        left[is_mirrored, :, 2] *= -1.0
        sizes[is_mirrored, 2] *= -1.0
        scales = np.maximum(sizes.sum(axis=1) / self._spread, 1e-3)
        similarities = np.empty((len(middles), 3, 4))
        similarities[:, :, :3] = scales[:, None, None] * (left @ right)
        similarities[:, :, 3] = middles - np.einsum(
            "nij,nj->ni", similarities[:, :, :3], self._middles
        )
        return similarities


def _mix(nearest: I64, weights: F64, count: int) -> Any:
    """Sparse matrix (count, V): weighted sum over the vertices of each patch. Vertices of
    neighbouring patches have a small weight, because a patch of one vertex has no defined
    rotation."""
    from scipy.sparse import csr_matrix, diags

    vertices = np.repeat(np.arange(len(nearest)), nearest.shape[1])
    entries = weights.ravel(), (nearest.ravel(), vertices)
    own = csr_matrix(entries, shape=(count, len(nearest)))
    overlap = own @ own.T
    share = diags(_NEIGHBOURS / np.asarray(overlap.sum(axis=1))[:, 0])
    return csr_matrix(own + share @ overlap @ own)


def _patches(model: PerceptualModel) -> I64:
    """Centre vertices of patches, ascending: for each bone, among the vertices where it is
    strongest, farthest points until all are within 0.1 m of one."""
    weights = model.weights
    owners = np.repeat(np.arange(len(model)), np.diff(weights.offsets))
    order = np.lexsort([-weights.values, owners])
    firsts = order[np.flatnonzero(np.diff(owners[order], prepend=-1))]
    bone = np.full(len(model), -1)
    bone[owners[firsts]] = weights.bones[firsts]
    centres: list[int] = []
    for strongest in np.unique(bone):
        ids = np.flatnonzero(bone == strongest)
        # Farthest-point sampling, from the vertex nearest to the mean.
        points = model.vertices[ids].astype(np.float64)
        middle = points.mean(axis=0)
        chosen = [int(np.square(points - middle).sum(axis=1).argmin())]
        away = np.linalg.norm(points - points[chosen[0]], axis=1)
        while away.max() > _SPACING_M:
            chosen.append(int(away.argmax()))
            away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
        centres += ids[chosen].tolist()
    return np.unique(np.array(centres, np.int64))


def _nearest_patches(model: PerceptualModel, centres: I64) -> tuple[I64, F64]:
    """Four nearest patches along the skin, fewer if there are fewer, and their weights, (V, 4)
    each; weights sum to 1. An island without a patch takes straight distances."""
    from scipy.sparse.csgraph import dijkstra

    graph = edge_graph(model.vertices.astype(np.float64), model.triangles)
    away = dijkstra(graph, directed=False, indices=centres, limit=_FARTHEST_M).T  # (V, J)
    is_unreached = ~np.isfinite(away).any(axis=1)  # an island without a patch: straight distances
    if is_unreached.any():
        across = model.vertices[is_unreached, None] - model.vertices[None, centres]
        away[is_unreached] = np.linalg.norm(across, axis=2)
    count = min(_NEAREST + 1, len(centres))
    nearest = np.argpartition(away, count - 1, axis=1)[:, :count]
    nearest = np.take_along_axis(
        nearest, np.argsort(np.take_along_axis(away, nearest, axis=1), axis=1), axis=1
    )
    distance = np.take_along_axis(away, nearest, axis=1)
    nearest, edge = nearest[:, :_NEAREST], distance[:, -1:]
    edge = np.where(np.isfinite(edge), np.maximum(edge, 1e-6), 2.0 * _FARTHEST_M)
    distance = np.maximum(distance[:, :_NEAREST], _CORE * edge)
    # Shepard weights with compact support: 0 at the nearest patch left out, so no jumps.
    weights = np.where(np.isfinite(distance), np.maximum(edge - distance, 0.0) / distance, 0.0)
    weights = np.square(weights / edge)
    weights[weights.sum(axis=1) == 0.0, 0] = 1.0
    return nearest, weights / weights.sum(axis=1, keepdims=True)
