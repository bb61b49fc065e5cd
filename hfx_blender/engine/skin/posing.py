# SPDX-License-Identifier: GPL-3.0-or-later
"""Posable models: interface, and clusters of neighbouring vertices that share bounds.

Results are in a *target* space (a volume's shape space, or world), given by matrices from armature
space. All positions are float64, because float32 is too coarse far from the origin.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final, Protocol

import numpy as np

from ..arrays import F64, I32, I64
from ..body.model import PerceptualModel
from ..native import cluster_bounds as native
from ..native import library
from ..scene import PoseBlock

LEAF_SIZE: Final = 128
"""Largest number of vertices in a cluster: fewer need more bounds, more pose too many vertices."""


class PosableModel(Protocol):
    """Perceptual model bound to a body; target space is given by ``to_target`` matrices."""

    clusters: list[I32]

    def cluster_bounds(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        """Lower and upper corners (n, C, 3) of cluster bounding boxes, target space.

        ``rows`` (n,) are rows of the pose; ``to_target`` (n, 4, 4) has a matrix for each.
        """

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        """Positions (3, n, Vc) of a cluster's vertices at rows (n,), target space."""

    def pair_points(
        self, clusters: I64, at: I64, pose: PoseBlock, rows: I64, to_target: F64
    ) -> F64:
        """Positions (3, N) of the vertices of (cluster, row) pairs, concatenated.

        ``clusters`` (m,) ascend; ``at`` (m,) are indices into ``rows``.
        """

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        """Positions (3, k) of vertices at one row, target space; ``to_target`` is (4, 4)."""


def clusters_of(model: PerceptualModel, load: I64 | None = None) -> list[I32]:
    """Split a model into compact clusters (ascending vertex ids) within one body part and side.

    ``load`` (V,) is the weight of each vertex towards :data:`LEAF_SIZE`, 1 by default. Without the
    compiled library, there is one cluster per part and side.
    """
    label = model.part.astype(np.int32) * 4 + model.side
    pieces = [np.flatnonzero(label == value).astype(np.int32) for value in np.unique(label)]
    return native.split(pieces, model.vertices, load, LEAF_SIZE) if library.is_there() else pieces


def cluster_slices(clusters: I64) -> Iterator[tuple[int, slice]]:
    """Yield (cluster, slice) for each run of equal cluster ids; ``clusters`` ascend."""
    cuts = np.flatnonzero(np.diff(clusters, prepend=-1, append=-1)).tolist()
    return ((int(clusters[first]), slice(first, last)) for first, last in pairwise(cuts))
