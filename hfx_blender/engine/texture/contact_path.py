# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of contacts on a surface between samples, in surface coordinates.

A contact is a point of skin and the nearest place on the mesh. Its way is what that place did
relative to the material: where the place of the sample before has gone with the (moving,
deforming) mesh is the start, the place of now the end. So an object that carries a resting
finger along gives no way at all.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64, Bool
from ..body.surface_locator import NearestPlaces, SurfaceLocator

_SEAM_SHARE: Final = 0.5
"""Coordinates that jump by so much more than the way itself have crossed a seam."""

_IDS: Final = 1 << 32


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """A mesh with surface coordinates."""

    triangles: I32  # (F, 3)
    coordinates_m: F64  # (F, 3, 2) of the corners, metres

    def __post_init__(self) -> None:
        object.__setattr__(self, "coordinates_m", np.ascontiguousarray(self.coordinates_m))


@dataclass(frozen=True, eq=False)
class ContactPaths:
    """Contacts at some times, one time after the other, each with its path from the time before.

    The way is two straight pieces. Where coordinates are continuous, the second goes on where
    the first ends; across a seam, the first is on the side that is left and the second on the
    one that is entered.
    """

    time: I64  # (n,) which time, ascending
    ids: I64  # (n,) which point of skin, ascending within a time
    triangle: I64  # (n,)
    weights: F64  # (n, 3) barycentric
    distance_m: F64  # (n,) from skin to surface
    coordinates_m: F64  # (n, 2)
    ends_m: F64  # (4, 2, n) begin and end of both pieces; coordinate. No way at a new contact
    moved_m: F64  # (n, 3) the way in the space of the mesh, relative to the material
    before: I64  # (n,) the same contact at the time before, by its place here; -1: new
    seams: I64  # those whose two pieces are apart
    carried: int  # number of first entries from the last time of the call before, at time -1

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def length_m(self) -> F64:
        """Length of each path in surface coordinates, (n,)."""
        steps = self.ends_m[1::2] - self.ends_m[::2]
        steps *= steps
        lengths = np.sqrt(steps[:, 0] + steps[:, 1])
        return np.asarray(lengths[0] + lengths[1])


class ContactFollower:
    """Tracker of points of skin on one mesh, over any number of times at once.

    Parameters
    ----------
    reach_m : float
        Skin that is no farther from the surface touches it.
    max_contacts : int
        At one time; what is in ``first`` comes first, then what is nearest.
    first : (ids,) bool, optional
        Points of skin that come first, by id.
    """

    def __init__(
        self,
        mesh: SurfaceMesh,
        reach_m: float,
        max_contacts: int = 100,
        first: Bool | None = None,
    ) -> None:
        self._mesh = mesh
        self._reach_m = reach_m
        self._max_contacts = max_contacts
        self.crowded = 0  # times at which there were more
        self._first = first
        self._still: _Still | None = None
        self._known_turn: tuple[F64, F64] | None = None  # of a placing, the linear part
        self._places_stand = True  # those of the last time are in the space of the search
        self._last = _none_yet()
        self._last_ids = np.zeros(0, np.int64)

    def follow(
        self, matrices: F64, vertices: F64, time: I64, ids: I64, points: F64, follows: Bool
    ) -> ContactPaths:
        """Track contacts at some times with their paths.

        Parameters
        ----------
        matrices : (T, 4, 4) float64
            Mesh to world.
        vertices : (T or 1, V, 3) float64
            Of the mesh; one row if it does not deform.
        time, ids : (n,) int64
            Of each point of skin; ascending by time, then by id.
        points : (n, 3) float64
            Where it is, world, metres.
        follows : (T,) bool
            Whether each time is the sample after the one before it; the first: after the last
            time of the call before.
        """
        found, space = self._nearest(matrices, vertices, time, points)
        found = self._chosen(found, time, ids)
        if len(found.point) < len(points):
            time, ids = time[found.point], ids[found.point]
        carried = len(self._last_ids) if follows[0] else 0
        now, now_ids = found, ids
        if len(matrices) > 1:
            mine = (time == len(matrices) - 1).nonzero()[0]
            now, now_ids = _part(found, mine), ids[mine]
        if carried:
            found = _joined([self._last, found])
            time = np.concatenate([np.full(carried, -1), time])
            ids = np.concatenate([self._last_ids, ids])
        is_still = self._still is not None and space is self._still.placed
        if not (is_still and self._places_stand) and len(space) == 1:
            # All in one fixed space: differences of places are the paths.
            corners = space[0][self._mesh.triangles[found.triangle[:carried]]]
            found.place[:carried] = np.einsum("nk,nkc->nc", found.weights[:carried], corners)
        paths = self._paths(space, found, time, ids, follows, carried)
        self._last, self._last_ids, self._places_stand = now, now_ids, is_still
        return paths

    def restart(self) -> None:
        """Forget the tracked contacts."""
        self._last, self._last_ids = _none_yet(), np.zeros(0, np.int64)

    def _chosen(self, found: NearestPlaces, time: I64, ids: I64) -> NearestPlaces:
        """Drop contacts beyond the allowed number at each time, the farthest first."""
        if len(found.point) <= self._max_contacts:
            return found
        counts = np.bincount(time[found.point])
        if counts.max() <= self._max_contacts:
            return found
        self.crowded += int(np.count_nonzero(counts > self._max_contacts))
        later = np.zeros(len(found.point), np.bool_)
        if self._first is not None:
            later = ~self._first[ids[found.point]]
        order = np.lexsort((found.distance, later, time[found.point]))
        rank = np.arange(len(order)) - np.repeat(np.cumsum(counts) - counts, counts)
        return _part(found, np.sort(order[rank < self._max_contacts]))

    def _nearest(
        self, matrices: F64, vertices: F64, time: I64, points: F64
    ) -> tuple[NearestPlaces, F64]:
        """Places of the points within reach, and the vertices in the same space.

        That is one row, in the space of the first placing, where the mesh only moves and turns.
        """
        turns = self._turns(matrices, vertices)
        if turns is not None:
            assert self._still is not None
            places = matrices[:, :3, 3]
            offset = points - (places if len(places) == 1 else places[time])
            if len(turns) == 1:
                turned = offset @ turns[0]
            else:
                turned = np.einsum("nj,njk->nk", offset, turns[time])
            return self._still.search.nearest(turned), self._still.placed
        world = vertices @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]
        parts = [self._nearest_at(world[k], time, points, k) for k in np.unique(time).tolist()]
        return _joined([_none_yet(), *parts]), world

    def _turns(self, matrices: F64, vertices: F64) -> F64 | None:
        """Linear parts from the search to world space, (n, 3, 3); None where it is not kept."""
        if len(vertices) > 1:
            return None
        linear = matrices[:, :3, :3]
        if self._still is None:
            self._still = _still(self._mesh, vertices[0], linear[0], self._reach_m)
        still = self._still
        if not (vertices[0] == still.local).all():
            return None  # it deforms, one call after the other
        if len(linear) > 1 and (linear == linear[0]).all():
            linear = linear[:1]
        if self._known_turn is not None and np.array_equal(linear, self._known_turn[0]):
            return self._known_turn[1]
        turns = linear @ still.inverse
        error = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max()
        if not error <= 1e-6:
            return None
        if len(linear) == 1:
            self._known_turn = linear.copy(), turns
        return turns

    def _nearest_at(self, world: F64, time: I64, points: F64, k: int) -> NearestPlaces:
        """Nearest places at one time of a deforming mesh, of the triangles near the points only."""
        mine = np.flatnonzero(time == k)
        triangles = self._mesh.triangles
        low = points[mine].min(axis=0) - self._reach_m
        high = points[mine].max(axis=0) + self._reach_m
        # A triangle that reaches into the box has a corner on neither far side of it.
        below, above = (world < low).T, (world > high).T
        outside = np.zeros(len(triangles), np.bool_)
        for beyond in (*below, *above):
            a, b, c = beyond[triangles.T]
            outside |= a & b & c
        near = np.flatnonzero(~outside)
        corners = world[triangles[near]]
        found = SurfaceLocator(corners, self._reach_m).nearest(points[mine])
        return NearestPlaces(
            mine[found.point], near[found.triangle], found.weights, found.place, found.distance
        )

    def _paths(
        self, vertices: F64, found: NearestPlaces, time: I64, ids: I64, follows: Bool, carried: int
    ) -> ContactPaths:
        triangle, weights = found.triangle, found.weights
        coordinates = self._mesh.coordinates_m.take(triangle, axis=0)
        now = np.einsum("nk,nkc->cn", weights, coordinates)
        ends = np.zeros((4, 2, len(ids)))
        ends[:] = now
        moved = np.zeros((len(ids), 3))
        before = np.full(len(ids), -1, np.int64)
        seams = np.zeros(0, np.int64)
        key = time * _IDS + ids
        slot = key.searchsorted(key - _IDS)
        kept = ((key.take(slot) == key - _IDS) & (time >= 0) & follows[time]).nonzero()[0]
        if len(kept):
            was = before[kept] = slot[kept]
            material = found.place.take(was, axis=0)
            if len(vertices) > 1:
                at = time[kept][:, None], self._mesh.triangles[triangle[was]]
                material = np.einsum("nk,nkc->nc", weights[was], vertices[at])
            all_new = len(kept) == len(ids) - carried
            chosen = slice(carried, None) if all_new else kept
            way = moved[chosen] = found.place[chosen] - material
            start = ends[0][:, chosen] = now.take(was, axis=1)
            ends[1:3, :, chosen] = 0.5 * (start + now[:, chosen])
            other = (triangle[was] != triangle[kept]).nonzero()[0]
            if len(other):
                kept, was = kept[other], was[other]
                seams = self._over_seams(
                    vertices, time[kept], triangle, ends, kept, was, way[other]
                )
        return ContactPaths(
            time,
            ids,
            triangle,
            weights,
            found.distance,
            now.T,
            ends,
            moved,
            before,
            seams,
            carried,
        )

    def _over_seams(
        self, vertices: F64, time: I64, triangle: I64, ends: F64, kept: I64, was: I64, way: F64
    ) -> I64:
        """Split paths where coordinates jump, at seams; returns those of ``kept`` that do."""
        sides = self._along(vertices, time, np.stack([triangle[was], triangle[kept]]), way)
        expected = 0.5 * (sides[0] + sides[1])
        error = ends[3].take(kept, axis=1) - ends[0].take(kept, axis=1) - expected
        error *= error
        expected *= expected
        apart = error[0] + error[1] > _SEAM_SHARE**2 * (expected[0] + expected[1]) + 1e-24
        seams = kept[apart]
        if len(seams):
            leaving, arriving = sides[:, :, apart]
            ends[1][:, seams] = ends[0][:, seams] + 0.5 * leaving
            ends[2][:, seams] = ends[3][:, seams] - 0.5 * arriving
        return seams

    def _along(self, vertices: F64, time: I64, triangle: I64, way: F64) -> F64:
        """Convert paths (n, 3) in the mesh's space to coordinates of triangles (s, n).

        Returns
        -------
        (s, 2, n) float64
        """
        if self._still is not None and vertices is self._still.placed:
            charts = self._still.charts.take(triangle, axis=0)
        else:
            corners = vertices[time[:, None], self._mesh.triangles[triangle]]
            count = triangle.size
            charts = _charts(
                corners.reshape(count, 3, 3), self._mesh.coordinates_m[triangle.reshape(count)]
            ).reshape(*triangle.shape, 2, 3)
        return np.asarray(np.einsum("snci,ni->scn", charts, way))


@dataclass(frozen=True, eq=False)
class _Still:
    """First placement of a mesh, cached: valid for as long as the mesh only moves and turns."""

    local: F64  # (V, 3)
    inverse: F64  # (3, 3) of the linear part of its placing
    placed: F64  # (1, V, 3) in the space of the search
    search: SurfaceLocator
    charts: F64  # (F, 2, 3)


def _still(mesh: SurfaceMesh, local: F64, linear: F64, reach_m: float) -> _Still:
    placed = local @ linear.T
    corners = placed[mesh.triangles]
    # A flattened object has no inverse; the nearest one is no rotation, and is rejected.
    return _Still(
        local.copy(),
        np.linalg.pinv(linear),
        placed[None],
        SurfaceLocator(corners, reach_m),
        _charts(corners, mesh.coordinates_m),
    )


def _none_yet() -> NearestPlaces:
    nothing = np.zeros(0, np.int64)
    return NearestPlaces(nothing, nothing, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


_PLACES: Final = tuple(each.name for each in fields(NearestPlaces))


def _part(found: NearestPlaces, chosen: I64) -> NearestPlaces:
    return NearestPlaces(*(getattr(found, name)[chosen] for name in _PLACES))


def _joined(parts: list[NearestPlaces]) -> NearestPlaces:
    columns = ([getattr(part, name) for part in parts] for name in _PLACES)
    return NearestPlaces(*map(np.concatenate, columns))


def _charts(corners: F64, coordinates_m: F64) -> F64:
    """Linear maps from space to surface coordinates, one for each triangle, (n, 2, 3)."""
    edges = corners[:, 1:] - corners[:, :1]
    gram = edges @ edges.transpose(0, 2, 1)
    det = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    det = np.where(det > 0.0, det, np.inf)[:, None]
    to_v = (gram[:, 1, 1, None] * edges[:, 0] - gram[:, 0, 1, None] * edges[:, 1]) / det
    to_w = (gram[:, 0, 0, None] * edges[:, 1] - gram[:, 0, 1, None] * edges[:, 0]) / det
    steps = coordinates_m[:, 1:] - coordinates_m[:, :1]
    charts: F64 = steps[:, 0, :, None] * to_v[:, None] + steps[:, 1, :, None] * to_w[:, None]
    return charts
