# SPDX-License-Identifier: GPL-3.0-or-later
"""Decimation of closed meshes within a bound: the same volume with fewer faces, and its choice.

fast-simplification collapses edges by quadrics (Garland and Heckbert, SIGGRAPH 1997), which bounds
nothing: how far the surfaces are apart is measured both ways, and what is too far is not taken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64
from .mesh import MeshVolume
from .mesh_distance import TriangleTree
from .mesh_topology import is_closed
from .shape import Shape

SHARE: Final = 1.0 / 8.0
"""Share of the accepted error of a contact's edge that the mesh may take."""

_STEPS_IN_OCTAVE: Final = 2.0  # of bounds, so that a turning volume keeps its mesh

_SHARE: Final = 4  # of the faces, one is left at each step
_STEPS: Final = 3
_LEAST_GAIN: Final = 0.5  # of the faces that a step leaves; more are not worth it
_SPARSE: Final = 8  # of the vertices, one is looked at to see how many steps may be kept
_AGGRESSIVENESS: Final = 3.0  # of the 7 by default, whose largest errors are six times as large
_FINE: Final = 16.0  # mean lengths of edges are at most so many bounds, or nothing can be gained


def of_fewer_faces(
    shapes: tuple[Shape, ...], which: I64, matrices: F64, bounds_m: F64
) -> tuple[tuple[Shape, ...], I32]:
    """Shapes whose surfaces are within a bound of the given ones, row by row.

    A row's choice depends on nothing but the row, so that parts of a scene give what it gives.

    Parameters
    ----------
    shapes : tuple of Shape
    which : (n,) int64
        The shape of each row.
    matrices : (n, 4, 4) float64
        From shape space to the world.
    bounds_m : (n,) float64
        World space; 0 where the shape itself is wanted.

    Returns
    -------
    shapes : tuple of Shape
        Those that occur.
    which : (n,) int32
    """
    linear = matrices[:, :3, :3]
    is_asked = np.isfinite(linear).all(axis=(1, 2)) & (bounds_m > 0.0)
    is_asked &= np.array([isinstance(s, MeshVolume) and s.is_fine for s in shapes])[which]
    stretches = np.ones(len(which))
    stretches[is_asked] = np.linalg.norm(linear[is_asked], 2, axis=(1, 2))
    is_asked &= stretches > 0.0
    steps = np.zeros(len(which), np.int64)
    allowed = bounds_m[is_asked] / stretches[is_asked]
    steps[is_asked] = np.floor(_STEPS_IN_OCTAVE * np.log2(allowed)).astype(np.int64)
    keys = np.stack([which, is_asked, steps], axis=1)
    found: list[Shape] = []
    index = np.zeros(len(which), np.int32)
    for number, asked, step in np.unique(keys, axis=0).tolist():
        shape = shapes[number]
        if asked and isinstance(shape, MeshVolume):
            shape = shape.within(2.0 ** (step / _STEPS_IN_OCTAVE))
        if shape not in found:  # meshes are the same only where they are one
            found.append(shape)
        index[(keys == (number, asked, step)).all(axis=1)] = found.index(shape)
    return tuple(found), index


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
