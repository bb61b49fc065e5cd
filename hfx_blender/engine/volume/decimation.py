# SPDX-License-Identifier: GPL-3.0-or-later
"""Decimation of closed meshes within a distance bound.

fast-simplification collapses edges by quadrics (Garland and Heckbert, SIGGRAPH 1997) and bounds no
distance. The distances between both surfaces are therefore measured, and results beyond the bound
are discarded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from ..arrays import F64, I32
from .mesh_distance import TriangleTree
from .mesh_topology import is_closed

_SHARE: Final = 4  # factor of face counts between steps
_STEPS: Final = 3
_LEAST_GAIN: Final = 0.5  # largest share of faces that a useful step leaves
_SPARSE: Final = 8  # one of so many vertices is measured after each step
_AGGRESSIVENESS: Final = 3.0  # the default of 7 has six times as large errors
_FINE: Final = 16.0  # largest mean edge length in bounds with any hope of a gain


def decimated(
    vertices: F64, triangles: I32, bound: float, to_surface: Callable[[F64], F64]
) -> tuple[F64, I32] | None:
    """Decimate a closed mesh, both surfaces at most ``bound`` apart; None without much gain.

    Measured at all vertices of the mesh, and at the vertices and face centres of the result. The
    result, vertices (v, 3) and triangles (f, 3), is closed; its volume differs by at most the
    mesh's area times the bound. ``to_surface`` gives distances (N,) of points (3, N) to the mesh.
    Raises ImportError without fast-simplification or trimesh.
    """
    import fast_simplification
    from trimesh.triangles import area

    corners = vertices[triangles]
    size, total = float(np.ptp(vertices, axis=0).max()), float(area(corners).sum())
    if not 0.0 < np.sqrt(total / len(triangles)) <= _FINE * bound:
        return None
    middle = vertices.mean(axis=0)
    points, faces = (vertices - middle) / size, triangles  # thresholds suit size 1
    candidates: list[tuple[F64, I32]] = []
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
        candidates.append(step)
    # The coarsest step first; the full measurement is dear.
    while candidates:
        step = candidates.pop()
        if _is_within(vertices, triangles, *step, bound, to_surface):
            return step
    return None


def _is_within(
    vertices: F64,
    triangles: I32,
    points: F64,
    faces: I32,
    bound: float,
    to_surface: Callable[[F64], F64],
) -> bool:
    """Test a decimated mesh (points, faces): closed, within ``bound`` both ways and in volume.

    The volume may differ by the area times ``bound``.
    """
    from trimesh.triangles import area, mass_properties

    if not is_closed(faces) or _farthest(vertices, points, faces) > bound:
        return False
    corners = (vertices - vertices[0])[triangles]
    volume, new_volume = (
        mass_properties(part, skip_inertia=True).volume
        for part in (corners, (points - vertices[0])[faces])
    )
    # A lost part, such as a thin fin, may be near the surface and still change the volume.
    if abs(volume - new_volume) > bound * area(corners).sum():
        return False
    places = np.concatenate([points[np.unique(faces)], points[faces].mean(axis=1)])
    return bool(to_surface(np.ascontiguousarray(places.T)).max() <= bound)


def _farthest(places: F64, points: F64, faces: I32) -> float:
    """Largest distance of ``places`` (n, 3) to the surface of the mesh (points, faces)."""
    tree = TriangleTree(points[faces] - points[0])
    return float(tree.distances(np.ascontiguousarray((places - points[0]).T)).max())
