# SPDX-License-Identifier: GPL-3.0-or-later
"""Posable models: clusters of neighbouring vertices that share bounds, and models posed point by
point: on an avatar's surface, or by bones without the compiled library.

Results are in a *target* space (a volume's shape space, or world), given by matrices from armature
space. All positions are float64, because float32 is too coarse far from the origin.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64
from ..body.model import PerceptualModel
from ..native import cluster_bounds as native
from ..native import library
from ..reference.pose import by_bones
from ..scene import PoseBlock, SkinBinding, SurfaceAnchors

LEAF_SIZE: Final = 128
"""Largest number of vertices in a cluster: fewer need more bounds, more pose too many vertices."""


def clusters_of(model: PerceptualModel, load: I64 | None = None) -> list[I32]:
    """Split a model into compact clusters (ascending vertex ids) within one body part and side.
    ``load`` (V,) is the weight of each vertex towards :data:`LEAF_SIZE`, 1 by default. Without the
    compiled library, there is one cluster per part and side."""
    label = model.part.astype(np.int32) * 4 + model.side
    pieces = [np.flatnonzero(label == value).astype(np.int32) for value in np.unique(label)]
    return native.split(pieces, model.vertices, load, LEAF_SIZE) if library.is_there() else pieces


def cluster_slices(clusters: I64) -> Iterator[tuple[int, slice]]:
    """Yield (cluster, slice) for each run of equal cluster ids; ``clusters`` ascend."""
    cuts = np.flatnonzero(np.diff(clusters, prepend=-1, append=-1)).tolist()
    return ((int(clusters[first]), slice(first, last)) for first, last in pairwise(cuts))


class PointwiseModel(ABC):
    """Posable model with cluster bounds from posed vertices; clusters are not empty."""

    clusters: list[I32]

    @abstractmethod
    def _local(self, vertices: I32, pose: PoseBlock, rows: I64) -> F64:
        """Positions (n, k, 3) of vertices (k,) at rows (n,), the body's own space."""

    def places(self, pose: PoseBlock, rows: I64) -> F64:
        """Positions (n, P, 3) of all clusters' vertices, concatenated, the body's own space."""
        return self._local(np.concatenate(self.clusters), pose, rows)

    def bounds_around(self, places: F64, to_target: F64) -> tuple[F64, F64]:
        """Lower and upper corners, (n, C, 3) each, in target space, of the clusters' boxes around
        the points of :meth:`places`; ``to_target`` (n, 4, 4)."""
        moved = places @ to_target[:, :3, :3].transpose(0, 2, 1) + to_target[:, None, :3, 3]
        starts = np.cumsum([0, *(len(ids) for ids in self.clusters[:-1])])
        return np.minimum.reduceat(moved, starts, 1), np.maximum.reduceat(moved, starts, 1)

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        """Positions (3, n, Vc) of a cluster's vertices at rows (n,) of the pose, target space.
        ``to_target`` (n, 4, 4) has a matrix for each row."""
        local = self._local(self.clusters[cluster], pose, rows)
        moved: F64 = local @ to_target[:, :3, :3].transpose(0, 2, 1) + to_target[:, None, :3, 3]
        return np.ascontiguousarray(moved.transpose(2, 0, 1))

    def pair_points(
        self, clusters: I64, at: I64, pose: PoseBlock, rows: I64, to_target: F64
    ) -> F64:
        """Positions (3, N), in the space of ``to_target``, of the vertices of (cluster, row) pairs,
        concatenated. ``clusters`` (m,) ascend; ``at`` (m,) are indices into ``rows``."""
        points = [
            self.cluster_points(cluster, pose, rows[at[pairs]], to_target[at[pairs]]).reshape(3, -1)
            for cluster, pairs in cluster_slices(clusters)
        ]
        return np.concatenate(points, axis=1)

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        """Positions (3, k) of vertices at one row, target space; ``to_target`` is (4, 4)."""
        local = self._local(vertices, pose, np.array([row]))[0]
        return np.asarray(to_target[:3, :3] @ local.T + to_target[:3, 3:])

    def box(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        """Lower and upper corners (n, 3) of a box that contains the whole model, target space."""
        low, high = self.bounds_around(self.places(pose, rows), to_target)
        return low.min(axis=1), high.max(axis=1)


class BlendedModel(PointwiseModel):
    """Linear blend skinning by :mod:`..reference`, without the compiled library."""

    def __init__(self, model: PerceptualModel, binding: SkinBinding, clusters: list[I32]) -> None:
        self.clusters, self._model, self._names = clusters, model, binding.bone_names

    def _local(self, vertices: I32, pose: PoseBlock, rows: I64) -> F64:
        points = [_blended(self._model, self._names, pose, row)[vertices] for row in rows.tolist()]
        return np.stack(points) if points else np.zeros((0, len(vertices), 3))


@lru_cache(maxsize=80)
def _blended(model: PerceptualModel, names: tuple[str, ...], pose: PoseBlock, row: int) -> F64:
    """Positions (V, 3) of all vertices at a row, armature space; cached, must not be changed."""
    assert pose.bones is not None
    return by_bones(model, names, pose.bones[row]).T


class SurfaceModel(PointwiseModel):
    """Model anchored to the triangles of an avatar's evaluated mesh."""

    def __init__(
        self, model: PerceptualModel, anchors: SurfaceAnchors, clusters: list[I32] | None = None
    ) -> None:
        self.clusters = clusters_of(model) if clusters is None else clusters
        self._anchors = anchors

    def _local(self, vertices: I32, pose: PoseBlock, rows: I64) -> F64:
        assert pose.surface is not None
        anchors, surface = self._anchors, pose.surface[rows]
        corners = surface[:, anchors.corners[vertices]].astype(np.float64)
        edge_1 = corners[:, :, 1] - corners[:, :, 0]
        edge_2 = corners[:, :, 2] - corners[:, :, 0]
        # Offsets are along the unit normal of the posed triangle; none on degenerate triangles.
        normals = np.cross(edge_1, edge_2)
        lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
        points: F64 = np.einsum("nvci,vc->nvi", corners, anchors.weights[vertices])
        return points + normals * anchors.offset_m[vertices][:, None]

    def box(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        assert pose.surface is not None
        surface = pose.surface[rows]
        low, high = surface.min(axis=1).astype(np.float64), surface.max(axis=1).astype(np.float64)
        # Negative barycentric weights reach outside the triangle, at most by their sum times the
        # size of the mesh; offsets add along any direction.
        beyond = float(np.maximum(-self._anchors.weights, 0.0).sum(axis=1).max(initial=0.0))
        above = float(np.abs(self._anchors.offset_m).max(initial=0.0))
        half = 0.5 * (high - low) + 2.0 * beyond * (high - low).max(axis=1)[:, None] + above
        linear = to_target[:, :3, :3]
        centre = np.einsum("nij,nj->ni", linear, 0.5 * (low + high)) + to_target[:, :3, 3]
        reach = np.einsum("nij,nj->ni", np.abs(linear), half)
        return centre - reach, centre + reach
