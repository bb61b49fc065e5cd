# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances along the skin from a place on a body model, near that place; numpy only.

A triangle's third corner gets its distance from the other two by unfolding: the source is laid
into the triangle's plane where it has the right distance to both (Novotni and Klein 2002, after
Kimmel and Sethian 1998). That is exact on a flat patch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from .surface_locator import barycentric

_FAR: Final = 1e9  # metres: not reached; finite, so that nothing becomes a NaN
_SETTLED_M: Final = 1e-6
_FEWEST_ROUNDS: Final = 8
_ROUNDS_PER_RING: Final = 2.0
"""A round settles at least one more ring of vertices; the rest is for detours."""
_MARGIN_M: Final = 0.06
"""Additional radius of prepared skin, metres, so that a moving place stays on it."""

_NEAR_CORNERS: Final = 8
"""Vertices whose triangles are tried for the nearest place: enough for a mesh without slivers."""


@dataclass(frozen=True, eq=False)
class SkinPlace:
    """A place on a model's surface."""

    point: F64  # (3,) metres
    corners: I64  # (3,) of its triangle
    weights: F64  # (3,) barycentric, sum 1


@dataclass(frozen=True, eq=False)
class _Patch:
    """Part of a mesh around a centre, with the data of its triangles.

    Each triangle has three entries, one for each corner as its apex, sorted by apex.
    """

    centre: F64  # (3,)
    nearest_m: float  # from there to the nearest vertex
    radius_m: float  # every triangle with a corner this near is in it
    ids: I64  # (n,) vertices of the model, ascending
    points: F64  # (n, 3)
    triangles: I64  # (T, 3) places in ids
    triangle_of: I64  # (3 T,) each entry's triangle
    firsts: I64  # (n + 1,) where the entries of each vertex begin
    apex: I64  # (3 T,) places in ids
    base: I64  # (2, 3 T) the corners opposite to it
    length_m: F64  # (3 T,) between them
    sides_m: F64  # (2, 3 T) from the apex to each of them
    along_m: F64  # (3 T,) the apex: along the base from its first corner ...
    above_m: F64  # (3 T,) ... and beside it

    def taken(self, entries: I64) -> _Patch:
        """Copy of the patch with only some of its entries."""
        return replace(
            self,
            apex=self.apex[entries],
            base=self.base[:, entries],
            length_m=self.length_m[entries],
            sides_m=self.sides_m[:, entries],
            along_m=self.along_m[entries],
            above_m=self.above_m[entries],
        )


class SkinDistances:
    """Nearest places and distances along the skin of one triangle mesh.

    Parameters
    ----------
    vertices : (V, 3) float
        Metres.
    triangles : (F, 3) int
    """

    def __init__(self, vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> None:
        self._points = np.asarray(vertices, np.float64)
        self._triangles = np.asarray(triangles, np.int64)
        self._patch: _Patch | None = None

    def nearest(self, point: F64) -> SkinPlace:
        """Find the place of the surface that is nearest to a point (3,)."""
        point = np.asarray(point, np.float64)
        patch = self._around(point, 0.0)
        offsets = patch.points - point
        squares = np.einsum("ij,ij->i", offsets, offsets)
        count = min(_NEAR_CORNERS, len(squares))
        near = np.argpartition(squares, count - 1)[:count]
        entries = [np.arange(patch.firsts[k], patch.firsts[k + 1]) for k in near]
        tried = patch.triangles[np.unique(patch.triangle_of[np.concatenate(entries)])]
        corners = patch.points[tried]
        weights = barycentric(np.repeat(point[None], len(tried), axis=0), corners)
        places = np.einsum("ij,ijk->ik", weights, corners)
        best = int(np.argmin(np.linalg.norm(places - point, axis=1)))
        return SkinPlace(places[best], patch.ids[tried[best]], weights[best])

    def around(self, place: SkinPlace, reach_m: float) -> tuple[I64, F64]:
        """Vertices within a distance along the skin of a place on it.

        Returns
        -------
        vertices : (n,) int64
            Ascending.
        distances : (n,) float64
            Metres, at most ``reach_m``.
        """
        patch = self._around(place.point, reach_m)
        source = np.searchsorted(patch.ids, place.corners)
        distances = _distances(patch, place.point, source, reach_m)
        within = np.flatnonzero(distances <= reach_m)
        return patch.ids[within], distances[within]

    def _around(self, point: F64, reach_m: float) -> _Patch:
        """Patch that holds all skin within reach; cached as long as the point stays in it."""
        known = self._patch
        if known is not None:
            moved = float(np.linalg.norm(point - known.centre))
            if 2.0 * moved + known.nearest_m + reach_m <= known.radius_m:
                return known
        offsets = self._points - point
        squares = np.einsum("ij,ij->i", offsets, offsets)
        nearest_m = float(np.sqrt(squares.min()))
        radius_m = nearest_m + reach_m + _MARGIN_M
        is_near = squares <= radius_m**2
        triangles = self._triangles[is_near[self._triangles].any(axis=1)]
        self._patch = _patch(self._points, triangles, point, nearest_m, radius_m)
        return self._patch


def _patch(points: F64, triangles: I64, centre: F64, nearest_m: float, radius_m: float) -> _Patch:
    ids, places = np.unique(triangles, return_inverse=True)
    local = places.reshape(-1, 3)
    mine = points[ids]
    order = np.argsort(local.ravel(), kind="stable")
    apex = local.ravel()[order]
    base = np.stack([np.roll(local, -1, axis=1).ravel(), np.roll(local, -2, axis=1).ravel()])
    base = base[:, order]
    edge, side = mine[base[1]] - mine[base[0]], mine[apex] - mine[base[0]]
    length = np.maximum(np.linalg.norm(edge, axis=1), 1e-12)
    along = np.einsum("ij,ij->i", side, edge) / length
    return _Patch(
        centre=centre.copy(),
        nearest_m=nearest_m,
        radius_m=radius_m,
        ids=ids,
        points=mine,
        triangles=local,
        triangle_of=order // 3,
        firsts=np.searchsorted(apex, np.arange(len(ids) + 1)).astype(np.int64),
        apex=apex,
        base=base,
        length_m=length,
        sides_m=np.stack([np.linalg.norm(mine[apex] - mine[each], axis=1) for each in base]),
        along_m=along,
        above_m=np.sqrt(np.maximum(np.einsum("ij,ij->i", side, side) - along**2, 0.0)),
    )


def _distances(patch: _Patch, point: F64, source: I64, reach_m: float) -> F64:
    """Distances of a patch's vertices along the skin; upper bounds beyond reach."""
    straight = np.linalg.norm(patch.points - point, axis=1)
    distances = np.full(len(straight), _FAR)
    distances[source] = straight[source]
    is_near = straight <= reach_m
    is_near[source] = True
    near = np.flatnonzero(is_near[patch.apex] & is_near[patch.base].any(axis=0))
    if not len(near):
        return distances
    patch = patch.taken(near)
    starts = np.flatnonzero(np.diff(patch.apex, prepend=-1))
    apexes = patch.apex[starts]
    rings = reach_m / float(np.median(patch.length_m))
    for _ in range(_FEWEST_ROUNDS + int(_ROUNDS_PER_RING * rings)):
        found = np.full(len(straight), _FAR)
        found[apexes] = np.minimum.reduceat(_through_triangles(patch, distances), starts)
        np.maximum(found, straight, out=found)  # unsettled distances may mislead the unfolding
        found[source] = straight[source]
        change = float(np.abs(found - distances).max(initial=0.0))
        distances = found
        if change <= _SETTLED_M:
            break
    return distances


def _through_triangles(patch: _Patch, distances: F64) -> F64:
    """The distance of each entry's apex by way of its own triangle."""
    one, other = distances[patch.base]
    length = patch.length_m
    by_edge = np.minimum(one + patch.sides_m[0], other + patch.sides_m[1])
    x = (one**2 - other**2 + length**2) / (2.0 * length)
    y = np.sqrt(np.maximum(one**2 - x**2, 0.0))  # the source, below the base
    height = np.maximum(patch.above_m + y, 1e-12)
    crossing = x + (patch.along_m - x) * y / height
    is_seen = (np.abs(one - other) <= length) & (one < _FAR) & (other < _FAR)
    is_seen &= (crossing >= 0.0) & (crossing <= length)
    across = np.hypot(patch.along_m - x, patch.above_m + y)
    return np.where(is_seen, across, by_edge)
