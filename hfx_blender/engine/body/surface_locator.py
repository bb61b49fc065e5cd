# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on a triangle mesh, prepared for repeated queries."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

import numpy as np

from ..arrays import F64, I64
from .mesh_edges import expand
from .nearest import barycentric

_TRIES: Final = 4
"""Nearest vertices whose triangles are tried; three do on an even mesh."""

_AT_ONCE: Final = 50
"""Places that are compared with every point at once where there is no search tree."""


class SurfaceLocator:
    """Prepared search for the nearest places on one mesh.

    Parameters
    ----------
    points : (V, 3) float64
    triangles : (F, 3) int64
        Of which the nearest are looked for; they may use some of the points only.
    """

    def __init__(self, points: F64, triangles: I64) -> None:
        used, corners = np.unique(triangles, return_inverse=True)
        corners = corners.ravel()
        order = np.argsort(corners, kind="stable")
        self.triangles = triangles
        self._corners = points[triangles]
        self._used = points[used]
        self._triangle = order // 3
        self._offsets = np.searchsorted(corners[order], np.arange(len(used) + 1)).astype(np.int64)
        self._tries = min(_TRIES, len(used))

    def locate(self, places: F64) -> tuple[I64, F64, F64]:
        """Row of ``triangles`` (n,), barycentric weights (n, 3) and the nearest places (n, 3)."""
        near = self._nearest(places)
        place, row = expand(self._offsets, near.ravel())
        point, triangle = row // self._tries, self._triangle[place]
        weights = barycentric(places[point], self._corners[triangle])
        found = np.einsum("ij,ijk->ik", weights, self._corners[triangle])
        distance = np.linalg.norm(found - places[point], axis=1)
        best = np.lexsort((triangle, distance, point))
        best = best[np.flatnonzero(np.diff(point[best], prepend=-1))]
        return triangle[best], weights[best], found[best]

    def _nearest(self, places: F64) -> I64:
        """The nearest points that are used, (n, tries), the nearest first."""
        if self._tree is not None:
            return self._tree.query(places, k=[*range(1, self._tries + 1)])[1]
        found = [np.zeros((0, self._tries), np.int64)]
        for some in np.array_split(places, max(len(places) // _AT_ONCE, 1)):
            squares = ((some[:, None] - self._used) ** 2).sum(axis=2)
            found.append(np.argsort(squares, axis=1, kind="stable")[:, : self._tries])
        return np.concatenate(found)

    @cached_property
    def _tree(self) -> Any:
        """Search tree; None without scipy, as in the small zip of the extension."""
        try:
            from scipy.spatial import cKDTree
        except ModuleNotFoundError:
            return None
        return cKDTree(self._used)
