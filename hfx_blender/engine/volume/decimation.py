# SPDX-License-Identifier: GPL-3.0-or-later
"""Decimation of closed meshes within a bound: the same volume with fewer faces.

fast-simplification collapses edges by quadrics (Garland and Heckbert, SIGGRAPH 1997), which bounds
nothing: how far the surfaces are apart is measured both ways, and what is too far is not taken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from ..arrays import F64, I32
from .mesh_distance import TriangleTree
from .mesh_topology import is_closed

_SHARE: Final = 4  # of the faces, one is left at each step
_STEPS: Final = 3
_LEAST_GAIN: Final = 0.5  # of the faces that a step leaves; more are not worth it
_SPARSE: Final = 8  # of the vertices, one is looked at to see how many steps may be kept
_AGGRESSIVENESS: Final = 3.0  # of the 7 by default, whose largest errors are six times as large
_FINE: Final = 16.0  # mean lengths of edges are at most so many bounds, or nothing can be gained


def decimated(
    vertices: F64, triangles: I32, bound: float, to_surface: Callable[[F64], F64]
) -> tuple[F64, I32] | None:
    """Fewer faces of a closed mesh, between whose surface and its own are at most ``bound``.

    Looked at are all vertices of the mesh, and of what is found the vertices and the middles of
    faces. It is closed, and encloses what the mesh does, but for as much as its area times the
    bound.

    Parameters
    ----------
    vertices : (V, 3) float64
    triangles : (F, 3) int32
    bound : float
        In the unit of the vertices.
    to_surface : callable
        Distances (N,) of places (3, N) to the mesh.

    Returns
    -------
    (vertices, triangles) or None
        None where the bound allows no fewer.
    """
    import fast_simplification
    from trimesh.triangles import area

    corners = vertices[triangles]
    size, total = float(np.ptp(vertices, axis=0).max()), float(area(corners).sum())
    if not 0.0 < np.sqrt(total / len(triangles)) <= _FINE * bound:
        return None
    middle = vertices.mean(axis=0)
    points, faces = (vertices - middle) / size, triangles  # its thresholds are for a size of 1
    found: list[tuple[F64, I32]] = []
    for _ in range(_STEPS):
        before = len(faces)
        points, faces = fast_simplification.simplify(
            points, faces, target_count=before // _SHARE, agg=_AGGRESSIVENESS
        )
        if not 4 <= len(faces) <= _LEAST_GAIN * before:
            break
        step = points * size + middle, faces.astype(np.int32)
        if _farthest(vertices[::_SPARSE], *step) > bound:
            break
        found.append(step)
    while found:
        step = found.pop()
        if _is_kept(vertices, triangles, *step, bound, to_surface):
            return step
    return None


def _is_kept(
    vertices: F64,
    triangles: I32,
    points: F64,
    faces: I32,
    bound: float,
    to_surface: Callable[[F64], F64],
) -> bool:
    """Test that a mesh of fewer faces is as good."""
    from trimesh.triangles import area, mass_properties

    if not is_closed(faces) or _farthest(vertices, points, faces) > bound:
        return False
    corners = (vertices - vertices[0])[triangles]
    one, other = (
        mass_properties(each, skip_inertia=True).volume
        for each in (corners, (points - vertices[0])[faces])
    )
    if abs(one - other) > bound * area(corners).sum():
        return False
    places = np.concatenate([points[np.unique(faces)], points[faces].mean(axis=1)])
    return bool(to_surface(np.ascontiguousarray(places.T)).max() <= bound)


def _farthest(places: F64, points: F64, faces: I32) -> float:
    """The largest distance of places (n, 3) to a mesh."""
    tree = TriangleTree(points[faces] - points[0])
    return float(tree.distances(np.ascontiguousarray((places - points[0]).T)).max())
