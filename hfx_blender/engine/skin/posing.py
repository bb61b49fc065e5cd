# SPDX-License-Identifier: GPL-3.0-or-later
"""Interface of posable models: bounds of their clusters, and positions of chosen vertices.

Everything comes out in a *target* space (a volume's shape space, or the world) that the caller
names by matrices from armature space, composed in float64: positions are never rounded
to float32 far from the origin.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Protocol

import numpy as np

from ..arrays import F64, I32, I64
from ..scene import PoseBlock


class PosableModel(Protocol):
    """A perceptual model bound to a body."""

    clusters: list[I32]

    def cluster_bounds(self, pose: PoseBlock, rows: I64, to_target: F64) -> tuple[F64, F64]:
        """Boxes that hold each cluster: two (n, C, 3), target space.

        ``rows`` (n,) are rows of the pose, ``to_target`` (n, 4, 4) the matrix for each.
        """

    def cluster_points(self, cluster: int, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        """Positions of a cluster's vertices, (3, n, Vc), target space."""

    def pair_points(
        self, clusters: I64, at: I64, pose: PoseBlock, rows: I64, to_target: F64
    ) -> F64:
        """Positions of the vertices of cluster-row pairs, one pair after the other, (3, N).

        ``clusters`` (m,) ascend, ``at`` (m,) are places among the rows.
        """

    def points(self, vertices: I32, pose: PoseBlock, row: int, to_target: F64) -> F64:
        """Positions of some vertices at one row, (3, k), target space; ``to_target`` (4, 4)."""


def runs(clusters: I64) -> Iterator[tuple[int, slice]]:
    """Each of ascending clusters, and where it stands."""
    cuts = np.flatnonzero(np.diff(clusters, prepend=-1, append=-1)).tolist()
    return ((int(clusters[first]), slice(first, last)) for first, last in pairwise(cuts))
