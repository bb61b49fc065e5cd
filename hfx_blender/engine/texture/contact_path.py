# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of contacts on a surface between samples, in surface coordinates.

A contact is a point of skin with the nearest place on the mesh. Its path is relative to the
material: it starts where the material at the last sample's place has moved with the (moving,
deforming) mesh, and ends at the present place. An object that carries a resting finger along gives
no path.
"""

from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64, Bool, ramp
from ..volume.mesh_distance import NearestPlaces, SurfaceLocator

_SEAM_SHARE: Final = 0.5
"""Least deviation of coordinates from the path, share of its length, that means a seam."""

_IDS: Final = 1 << 32


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """Mesh with surface coordinates."""

    triangles: I32  # (F, 3)
    coordinates_m: F64  # (F, 3, 2) of the corners, metres

    def __post_init__(self) -> None:
        object.__setattr__(self, "coordinates_m", np.ascontiguousarray(self.coordinates_m))


@dataclass(frozen=True, eq=False)
class ContactPaths:
    """Contacts at successive times with their paths since the time before. A path has two straight
    pieces. With continuous coordinates the second continues the first; at a seam, the first is on
    the departing side and the second on the arriving side."""

    time: I64  # (n,) index of the time, ascending
    ids: I64  # (n,) point of skin, ascending within a time
    triangle: I64  # (n,)
    weights: F64  # (n, 3) barycentric
    distance_m: F64  # (n,) from skin to surface
    coordinates_m: F64  # (n, 2)
    ends_m: F64  # (4, 2, n) begin and end of both pieces, by coordinate; no length at new contacts
    moved_m: F64  # (n, 3) path in the space of the mesh, relative to the material
    before: I64  # (n,) index of this contact at the time before; -1: new
    seams: I64  # indices of paths across a seam
    carried: int  # number of leading entries from the call before, at time -1

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def length_m(self) -> F64:
        """Length of each path (both pieces) in surface coordinates, (n,), m."""
        steps = self.ends_m[1::2] - self.ends_m[::2]
        steps *= steps
        lengths = np.sqrt(steps[:, 0] + steps[:, 1])
        return np.asarray(lengths[0] + lengths[1])


class ContactFollower:
    """Tracker of points of skin on one mesh, for any number of times at once.

    Skin up to ``reach_m`` from the surface touches it. At most ``max_contacts`` at one time are
    tracked: points preferred by the mask ``first`` (ids,), then the nearest. The attribute
    ``crowded`` counts the times with more contacts.
    """

    def __init__(
        self, mesh: SurfaceMesh, reach_m: float, max_contacts: int = 100, first: Bool | None = None
    ) -> None:
        self._mesh = mesh
        self._reach_m = reach_m
        self._max_contacts = max_contacts
        self.crowded = 0
        self._first = first
        self._still: _Still | None = None
        self._known_turn: tuple[F64, F64] | None = None  # linear part of a matrix, and rotation
        self._places_stand = True  # last places are in search space
        self._last = _no_places()
        self._last_ids = np.zeros(0, np.int64)

    def follow(
        self, matrices: F64, vertices: F64, time: I64, ids: I64, points: F64, follows: Bool
    ) -> ContactPaths:
        """Track contacts at the next times; returns paths.

        ``matrices`` (T, 4, 4) are mesh to world, ``vertices`` (T or 1, V, 3) of the mesh have a
        single row for a rigid mesh. ``points`` (n, 3) of skin are in world space, m, with time
        index ``time`` (n,) and ``ids`` (n,), ascending by time, then by id. ``follows`` (T,): a
        time is the sample after the time before, the first after the last call's last.
        """
        places, space = self.nearest(matrices, vertices, time, points)
        places = self._chosen(places, time, ids)
        if len(places.point) < len(points):
            time, ids = time[places.point], ids[places.point]
        carried = len(self._last_ids) if follows[0] else 0
        now, now_ids = places, ids
        if len(matrices) > 1:
            last_time = (time == len(matrices) - 1).nonzero()[0]
            now, now_ids = _part(places, last_time), ids[last_time]
        if carried:
            places = _joined([self._last, places])
            time = np.concatenate([np.full(carried, -1), time])
            ids = np.concatenate([self._last_ids, ids])
        is_still = self._still is not None and space is self._still.placed
        if not (is_still and self._places_stand) and len(space) == 1:
            # In a fixed space, paths are differences of places: move the carried places there.
            corners = space[0][self._mesh.triangles[places.triangle[:carried]]]
            places.place[:carried] = np.einsum("nk,nkc->nc", places.weights[:carried], corners)
        paths = self._paths(space, places, time, ids, follows, carried)
        self._last, self._last_ids, self._places_stand = now, now_ids, is_still
        return paths

    def restart(self) -> None:
        """Forget the tracked contacts: the next contacts are new."""
        self._last, self._last_ids = _no_places(), np.zeros(0, np.int64)

    def _chosen(self, places: NearestPlaces, time: I64, ids: I64) -> NearestPlaces:
        """Places with at most ``max_contacts`` at each time, preferred points first, then the
        nearest. Adds the number of cut times to ``crowded``."""
        if len(places.point) <= self._max_contacts:
            return places
        counts = np.bincount(time[places.point])
        if counts.max() <= self._max_contacts:
            return places
        self.crowded += int(np.count_nonzero(counts > self._max_contacts))
        # Preferred points sort first, as False is less than True.
        later = np.zeros(len(places.point), np.bool_)
        if self._first is not None:
            later = ~self._first[ids[places.point]]
        # Rank of each contact among the contacts of a time.
        order = np.lexsort((places.distance, later, time[places.point]))
        rank, _ = ramp(counts)
        return _part(places, np.sort(order[rank < self._max_contacts]))

    def nearest(
        self, matrices: F64, vertices: F64, time: I64, points: F64
    ) -> tuple[NearestPlaces, F64]:
        """Places of the points within reach, with arguments as of :meth:`follow`; mesh vertices (T
        or 1, V, 3) in the same space. For a rigid mesh one row of vertices, in the space of the
        first placement."""
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
        return _joined([_no_places(), *parts]), world

    def _turns(self, matrices: F64, vertices: F64) -> F64 | None:
        """Rotations from search to world space, (1 or T, 3, 3); None for a mesh that deforms, or is
        scaled or sheared since the first call."""
        if len(vertices) > 1:
            return None
        linear = matrices[:, :3, :3]
        if self._still is None:
            self._still = _Still(self._mesh, vertices[0], linear[0], self._reach_m)
        still = self._still
        if not (vertices[0] == still.local).all():
            return None  # deformed between calls
        if len(linear) > 1 and (linear == linear[0]).all():
            linear = linear[:1]
        if self._known_turn is not None and np.array_equal(linear, self._known_turn[0]):
            return self._known_turn[1]
        # From the first placement to this one: a rotation, without scale or shear in between.
        turns = linear @ still.inverse
        # A rotation times its transpose is the identity.
        error = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max()
        if not error <= 1e-6:
            return None
        if len(linear) == 1:
            self._known_turn = linear.copy(), turns
        return turns

    def _nearest_at(self, world: F64, time: I64, points: F64, k: int) -> NearestPlaces:
        """Nearest places of the points at time ``k`` on a mesh with vertices ``world`` (V, 3). Only
        triangles near the points are searched."""
        at_time = np.flatnonzero(time == k)
        triangles = self._mesh.triangles
        low = points[at_time].min(axis=0) - self._reach_m
        high = points[at_time].max(axis=0) + self._reach_m
        # A triangle with all corners beyond one side of the box cannot reach into the box.
        below, above = (world < low).T, (world > high).T
        outside = np.zeros(len(triangles), np.bool_)
        for beyond in (*below, *above):
            a, b, c = beyond[triangles.T]
            outside |= a & b & c
        near = np.flatnonzero(~outside)
        corners = world[triangles[near]]
        places = SurfaceLocator(corners, self._reach_m).nearest(points[at_time])
        return replace(places, point=at_time[places.point], triangle=near[places.triangle])

    def _paths(
        self, vertices: F64, places: NearestPlaces, time: I64, ids: I64, follows: Bool, carried: int
    ) -> ContactPaths:
        """Paths of places since the time before; no length for new contacts. ``vertices`` (T or 1,
        V, 3) are in the space of the places; the first ``carried`` entries are of the call
        before."""
        triangle, weights = places.triangle, places.weights
        coordinates = self._mesh.coordinates_m.take(triangle, axis=0)
        now = np.einsum("nk,nkc->cn", weights, coordinates)
        ends = np.zeros((4, 2, len(ids)))
        ends[:] = now
        moved = np.zeros((len(ids), 3))
        before = np.full(len(ids), -1, np.int64)
        seams = np.zeros(0, np.int64)
        key = time * _IDS + ids
        # Keys order contacts by time, then id: a binary search finds the id one time earlier.
        slot = key.searchsorted(key - _IDS)
        continued = ((key.take(slot) == key - _IDS) & (time >= 0) & follows[time]).nonzero()[0]
        if len(continued):
            was = before[continued] = slot[continued]
            # Start of the path; on a deforming mesh, old barycentric weights on new vertices.
            material = places.place.take(was, axis=0)
            if len(vertices) > 1:
                at = time[continued][:, None], self._mesh.triangles[triangle[was]]
                material = np.einsum("nk,nkc->nc", weights[was], vertices[at])
            # A slice copies less than indices, when all contacts after the carried ones continue.
            all_new = len(continued) == len(ids) - carried
            chosen = slice(carried, None) if all_new else continued
            way = moved[chosen] = places.place[chosen] - material
            start = ends[0][:, chosen] = now.take(was, axis=1)
            ends[1:3, :, chosen] = 0.5 * (start + now[:, chosen])
            changed = (triangle[was] != triangle[continued]).nonzero()[0]
            if len(changed):
                continued, was = continued[changed], was[changed]
                seams = self._over_seams(
                    vertices, time[continued], triangle, ends, continued, was, way[changed]
                )
        apart_m = places.distance
        return ContactPaths(
            time, ids, triangle, weights, apart_m, now.T, ends, moved, before, seams, carried
        )

    def _over_seams(
        self, vertices: F64, time: I64, triangle: I64, ends: F64, continued: I64, was: I64, way: F64
    ) -> I64:
        """Split paths at seams in ``ends`` (4, 2, n); returns indices of ``continued`` at seams.
        ``was`` are the contacts' entries at the time before, ``way`` (m, 3) their paths in
        space."""
        # The path in the surface coordinates of the triangle before and of the present triangle.
        both = np.stack([triangle[was], triangle[continued]])
        if self._still is not None and vertices is self._still.placed:
            charts = self._still.charts.take(both, axis=0)
        else:
            flat = both.ravel()
            corners = vertices[np.tile(time, 2)[:, None], self._mesh.triangles[flat]]
            charts = _charts(corners, self._mesh.coordinates_m[flat]).reshape(*both.shape, 2, 3)
        sides = np.einsum("snci,ni->scn", charts, way)
        # Continuous coordinates change by the mean of both triangles' predictions.
        expected = 0.5 * (sides[0] + sides[1])
        error = ends[3].take(continued, axis=1) - ends[0].take(continued, axis=1) - expected
        error *= error
        expected *= expected
        apart = error[0] + error[1] > _SEAM_SHARE**2 * (expected[0] + expected[1]) + 1e-24
        seams = continued[apart]
        if len(seams):
            leaving, arriving = sides[:, :, apart]
            ends[1][:, seams] = ends[0][:, seams] + 0.5 * leaving
            ends[2][:, seams] = ends[3][:, seams] - 0.5 * arriving
        return seams


class _Still:
    """First placement of a rigid mesh, by vertices (V, 3) and the linear part (3, 3), with search.
    ``placed`` (1, V, 3) are the vertices in the space of the search, ``charts`` (F, 2, 3) as of
    :func:`_charts` there."""

    def __init__(self, mesh: SurfaceMesh, local: F64, linear: F64, reach_m: float) -> None:
        self.local = local.copy()
        # The pseudoinverse of a flattened object gives no rotation, so that _turns rejects it.
        self.inverse = np.linalg.pinv(linear)
        self.placed = (local @ linear.T)[None]
        corners = self.placed[0][mesh.triangles]
        self.search = SurfaceLocator(corners, reach_m)
        self.charts = _charts(corners, mesh.coordinates_m)


def _no_places() -> NearestPlaces:
    nothing = np.zeros(0, np.int64)
    return NearestPlaces(nothing, nothing, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


_PLACES: Final = tuple(item.name for item in fields(NearestPlaces))


def _part(places: NearestPlaces, chosen: I64) -> NearestPlaces:
    """Entries ``chosen`` of places, in that order."""
    return NearestPlaces(*(getattr(places, name)[chosen] for name in _PLACES))


def _joined(parts: list[NearestPlaces]) -> NearestPlaces:
    """Entries of all parts, part after part."""
    columns = ([getattr(part, name) for part in parts] for name in _PLACES)
    return NearestPlaces(*map(np.concatenate, columns))


def _charts(corners: F64, coordinates_m: F64) -> F64:
    """Linear maps (n, 2, 3) from space to surface coordinates, for each triangle. Corners are (n,
    3, 3), their coordinates (n, 3, 2). 0 for a triangle without area."""
    edges = corners[:, 1:] - corners[:, :1]
    # Gram matrix of two edges; its inverse gives the dual basis in the triangle's plane.
    gram = edges @ edges.transpose(0, 2, 1)
    det = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    det = np.where(det > 0.0, det, np.inf)[:, None]
    to_v = (gram[:, 1, 1, None] * edges[:, 0] - gram[:, 0, 1, None] * edges[:, 1]) / det
    to_w = (gram[:, 0, 0, None] * edges[:, 1] - gram[:, 0, 1, None] * edges[:, 0]) / det
    steps = coordinates_m[:, 1:] - coordinates_m[:, :1]
    return np.asarray(steps[:, 0, :, None] * to_v[:, None] + steps[:, 1, :, None] * to_w[:, None])
