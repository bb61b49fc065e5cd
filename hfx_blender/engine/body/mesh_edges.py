# SPDX-License-Identifier: GPL-3.0-or-later
"""Edge graph of a triangle mesh, and indexing of sparse rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import I32, I64


def edge_graph(vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> Any:
    """Edge lengths of a mesh as a sparse matrix (V, V) for ``scipy.sparse.csgraph``.

    Upper triangle only: each edge has a single entry, from the smaller to the larger vertex id.
    """
    from scipy.sparse import coo_array, csr_array

    points = np.asarray(vertices, np.float64)
    corners = np.asarray(triangles, np.int64)
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    ends = np.unique(np.sort(edges, axis=1), axis=0)
    lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    return csr_array(coo_array((lengths, tuple(ends.T)), shape=(len(points),) * 2))


def expand(offsets: I64, rows: I64 | I32) -> tuple[I64, I64]:
    """Indices of all entries of sparse rows, and the position in ``rows`` of each entry.

    Row ``r`` holds the entries ``offsets[r]`` to ``offsets[r + 1]``.
    """
    lengths = offsets[rows + 1] - offsets[rows]
    owner = np.repeat(np.arange(len(rows)), lengths)
    start = np.repeat(offsets[rows] - (np.cumsum(lengths) - lengths), lengths)
    return start + np.arange(len(owner)), owner
