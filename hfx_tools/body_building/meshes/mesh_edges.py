# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges and normals of a triangle mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hfx_blender.engine.arrays import F64, I64, Bool


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of a triangle mesh, each with its two triangles."""

    ends: I64  # (E, 2) lower vertex first
    triangle: I64  # (E, 2) -1 in the second column at the border
    opposite: I64  # (E, 2) third vertex of each triangle, -1 at the border
    keys: I64  # (E,) ascending; see key()
    count: int  # number of vertices

    @property
    def is_border(self) -> Bool:
        return self.triangle[:, 1] < 0

    def exists(self, start: I64, end: I64) -> Bool:
        """Test pairs of vertices for a common edge, (N,)."""
        keys = key(start, end, self.count)
        index = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return self.keys[index] == keys


def key(start: I64, end: I64, count: int) -> I64:
    """Unique number of an unordered pair of vertices."""
    return np.minimum(start, end) * count + np.maximum(start, end)


def edges_of(triangles: I64, count: int) -> Edges:
    """Find the edges of an oriented manifold triangle mesh, in ascending order."""
    starts, ends = triangles, np.roll(triangles, -1, axis=1)
    opposite = np.roll(triangles, -2, axis=1).ravel()
    keys = key(starts, ends, count).ravel()
    # Both half edges of an inner edge have one key, so they are neighbours after sorting.
    order = np.argsort(keys, kind="stable")
    sorted_keys = keys[order]
    first = np.flatnonzero(np.diff(sorted_keys, prepend=-1))
    is_paired = np.zeros(len(first), bool)
    inner = first[first + 1 < len(keys)]
    is_paired[: len(inner)] = sorted_keys[inner] == sorted_keys[inner + 1]
    corner = np.column_stack((order[first], order[np.minimum(first + 1, len(keys) - 1)]))
    triangle, across = corner // 3, opposite[corner]
    triangle[~is_paired, 1] = across[~is_paired, 1] = -1
    unique = sorted_keys[first]
    return Edges(
        np.column_stack((unique // count, unique % count)), triangle, across, unique, count
    )


def triangle_normals(points: F64, triangles: I64) -> F64:
    """Normals (F, 3), of length twice the triangle's area."""
    corners = points[triangles]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
