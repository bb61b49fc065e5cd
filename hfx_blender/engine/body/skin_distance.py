# SPDX-License-Identifier: GPL-3.0-or-later
"""Geodesic distances near a place on a body model's skin; numpy only.

The distance of a triangle's third corner follows from the two others by unfolding: the source is
laid into the triangle's plane at the known distances from both corners (Novotni and Klein 2002,
after Kimmel and Sethian 1998). Exact on flat patches.
"""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from ..volume.mesh_distance import barycentric

_FAR: Final = 1e9  # metres, an unreached vertex; finite, because inf - inf is NaN
_SETTLED_M: Final = 1e-6
_FEWEST_ROUNDS: Final = 8
_ROUNDS_PER_RING: Final = 2.0  # each round settles one more ring of vertices; doubled for detours
_MARGIN_M: Final = 0.06  # additional radius of a cached patch, metres, reused while the place moves
# Number of nearest vertices whose triangles are tested for the nearest place
_NEAR_CORNERS: Final = 8


@dataclass(frozen=True, eq=False)
class SkinPlace:
    """Place on the surface of a mesh."""

    point: F64  # (3,) metres
    corners: I64  # (3,) vertex ids of the triangle
    weights: F64  # (3,) barycentric, sum 1


@dataclass(frozen=True, eq=False)
class _Patch:
    """Triangles near a centre; each triangle has three entries, with each corner as apex. Entries
    are sorted by apex."""

    centre: F64  # (3,)
    nearest_m: float  # distance from the centre to the nearest vertex
    radius_m: float  # all triangles with a corner within this radius are included
    ids: I64  # (n,) vertices of the model, ascending
    points: F64  # (n, 3)
    triangles: I64  # (T, 3) indices into ids
    triangle_of: I64  # (3 T,) triangle of each entry
    firsts: I64  # (n + 1,) first entry of each vertex
    apex: I64  # (3 T,) index into ids
    base: I64  # (2, 3 T) the two other corners
    length_m: F64  # (3 T,) length of the base
    sides_m: F64  # (2, 3 T) distances from the apex to the base corners
    along_m: F64  # (3 T,) projection of the apex on the base, from the first corner
    above_m: F64  # (3 T,) height of the apex above the base


class SkinDistances:
    """Nearest places and geodesic distances on one triangle mesh. ``vertices`` (V, 3) are in
    metres. The patch of the last query is cached: not thread-safe."""

    def __init__(self, vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> None:
        self._points = np.asarray(vertices, np.float64)
        self._triangles = np.asarray(triangles, np.int64)
        self._patch: _Patch | None = None

    def nearest(self, point: F64) -> SkinPlace:
        """Nearest place of the surface to a point (3,). Only triangles at the eight nearest
        vertices are tested; exact for meshes without slivers."""
        point = np.asarray(point, np.float64)
        patch = self._around(point, 0.0)
        offsets = patch.points - point
        squares = np.einsum("ij,ij->i", offsets, offsets)
        count = min(_NEAR_CORNERS, len(squares))
        near = np.argpartition(squares, count - 1)[:count]
        entries = [np.arange(patch.firsts[k], patch.firsts[k + 1]) for k in near]
        corner_ids = patch.triangles[np.unique(patch.triangle_of[np.concatenate(entries)])]
        corners = patch.points[corner_ids]
        weights = barycentric(np.repeat(point[None], len(corner_ids), axis=0), corners)
        places = np.einsum("ij,ijk->ik", weights, corners)
        best = int(np.argmin(np.linalg.norm(places - point, axis=1)))
        return SkinPlace(places[best], patch.ids[corner_ids[best]], weights[best])

    def around(self, place: SkinPlace, reach_m: float) -> tuple[I64, F64]:
        """Vertices (n,), ascending, within a geodesic distance of a place, and their distances
        (n,), metres."""
        patch = self._around(place.point, reach_m)
        source = np.searchsorted(patch.ids, place.corners)
        distances = _distances(patch, place.point, source, reach_m)
        within = np.flatnonzero(distances <= reach_m)
        return patch.ids[within], distances[within]

    def _around(self, point: F64, reach_m: float) -> _Patch:
        """Patch of triangles with a corner within ``reach_m`` of a point, beyond its distance from
        the skin; the cached patch while this is covered."""
        cached = self._patch
        if cached is not None:
            # A move by m brings the nearest vertex, and the rim, up to m closer: 2 m in all.
            moved = float(np.linalg.norm(point - cached.centre))
            if 2.0 * moved + cached.nearest_m + reach_m <= cached.radius_m:
                return cached
        offsets = self._points - point
        squares = np.einsum("ij,ij->i", offsets, offsets)
        nearest_m = float(np.sqrt(squares.min()))
        radius_m = nearest_m + reach_m + _MARGIN_M
        is_near = squares <= radius_m**2
        triangles = self._triangles[is_near[self._triangles].any(axis=1)]
        self._patch = _patch(self._points, triangles, point, nearest_m, radius_m)
        return self._patch


def edge_graph(vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> Any:
    """Edge lengths of a mesh as a sparse matrix (V, V) for ``scipy.sparse.csgraph``. Upper triangle
    only: each edge has a single entry, from the smaller to the larger vertex id."""
    from scipy.sparse import coo_array, csr_array

    points = np.asarray(vertices, np.float64)
    corners = np.asarray(triangles, np.int64)
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    ends = np.unique(np.sort(edges, axis=1), axis=0)
    lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    return csr_array(coo_array((lengths, tuple(ends.T)), shape=(len(points),) * 2))


def _patch(points: F64, triangles: I64, centre: F64, nearest_m: float, radius_m: float) -> _Patch:
    """Patch of the given triangles (T, 3) around ``centre``, with edge lengths and heights of all 3
    T entries, sorted by apex."""
    ids, places = np.unique(triangles, return_inverse=True)
    local = places.reshape(-1, 3)
    corners = points[ids]
    order = np.argsort(local.ravel(), kind="stable")
    apex = local.ravel()[order]
    base = np.stack([np.roll(local, -1, axis=1).ravel(), np.roll(local, -2, axis=1).ravel()])
    base = base[:, order]
    edge, side = corners[base[1]] - corners[base[0]], corners[apex] - corners[base[0]]
    # 1e-12 m: an edge of no length must not divide by 0.
    length = np.maximum(np.linalg.norm(edge, axis=1), 1e-12)
    along = np.einsum("ij,ij->i", side, edge) / length
    return _Patch(
        centre=centre.copy(),
        nearest_m=nearest_m,
        radius_m=radius_m,
        ids=ids,
        points=corners,
        triangles=local,
        triangle_of=order // 3,
        firsts=np.searchsorted(apex, np.arange(len(ids) + 1)).astype(np.int64),
        apex=apex,
        base=base,
        length_m=length,
        sides_m=np.stack([np.linalg.norm(corners[apex] - corners[end], axis=1) for end in base]),
        along_m=along,
        above_m=np.sqrt(np.maximum(np.einsum("ij,ij->i", side, side) - along**2, 0.0)),
    )


def _distances(patch: _Patch, point: F64, source: I64, reach_m: float) -> F64:
    """Geodesic distances (n,) of a patch's vertices, metres; upper bounds beyond reach. ``source``
    (3,) are the corners around the point."""
    straight = np.linalg.norm(patch.points - point, axis=1)
    distances = np.full(len(straight), _FAR)
    distances[source] = straight[source]
    is_near = straight <= reach_m
    is_near[source] = True
    near = np.flatnonzero(is_near[patch.apex] & is_near[patch.base].any(axis=0))
    if not len(near):
        return distances
    # Only triangles within reach spread distances; ``triangle_of`` and ``firsts`` become stale.
    by_entry = ("apex", "base", "length_m", "sides_m", "along_m", "above_m")
    patch = replace(patch, **{name: getattr(patch, name)[..., near] for name in by_entry})
    starts = np.flatnonzero(np.diff(patch.apex, prepend=-1))
    apexes = patch.apex[starts]
    rings = reach_m / float(np.median(patch.length_m))
    # Jacobi iteration: distances spread by one ring of triangles in each round.
    for _ in range(_FEWEST_ROUNDS + int(_ROUNDS_PER_RING * rings)):
        updated = np.full(len(straight), _FAR)
        updated[apexes] = np.minimum.reduceat(_through_triangles(patch, distances), starts)
        # No path is shorter than the chord; unfolding from unsettled distances can fall below.
        np.maximum(updated, straight, out=updated)
        updated[source] = straight[source]
        change = float(np.abs(updated - distances).max(initial=0.0))
        distances = updated
        if change <= _SETTLED_M:
            break
    return distances


def _through_triangles(patch: _Patch, distances: F64) -> F64:
    """Distance of each entry's apex through the triangle of the entry, (entries,). Straight across
    the base if the line to the unfolded source crosses the base, otherwise along an edge."""
    first, second = distances[patch.base]
    length = patch.length_m
    # Along an edge, in case the straight way leaves the triangle.
    by_edge = np.minimum(first + patch.sides_m[0], second + patch.sides_m[1])
    x = (first**2 - second**2 + length**2) / (2.0 * length)
    # (x, -y) is the unfolded source: distances ``first`` and ``second`` from the base corners.
    y = np.sqrt(np.maximum(first**2 - x**2, 0.0))
    height = np.maximum(patch.above_m + y, 1e-12)
    crossing = x + (patch.along_m - x) * y / height
    is_visible = (np.abs(first - second) <= length) & (first < _FAR) & (second < _FAR)
    is_visible &= (crossing >= 0.0) & (crossing <= length)
    across = np.hypot(patch.along_m - x, patch.above_m + y)
    return np.where(is_visible, across, by_edge)
