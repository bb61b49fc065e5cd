# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths on the skin: shortest paths, smooth curves and traced lines."""

from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64
from ..volume.mesh_distance import SurfaceLocator
from .skin_distance import edge_graph

STEP_M: Final = 0.004
"""Spacing of path points, metres; below all two-point thresholds except the fingertips'."""

OFF_SKIN_M: Final = 0.05  # largest distance from the skin of a valid path point, metres
_COARSE_M: Final = 0.04
_TIGHT_M: Final = 0.012
_SETTLED_M: Final = 3e-5
_MOST_ROUNDS: Final = 150
_SHALLOW_M: Final = 0.015
_SAME_PLACE_M: Final = 1e-7


class SkinPaths:
    """Path construction on one triangle mesh; points are (n, 3) float64, metres."""

    def __init__(self, vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> None:
        self._points = np.asarray(vertices, np.float64)
        self._triangles = np.asarray(triangles, np.int64)

    def on_skin(self, places: npt.ArrayLike) -> F64:
        """Nearest places on the skin, (n, 3). Raises InputError: no place (n, 3) is given, or a
        place is not finite or farther than 5 cm from the skin."""
        points = np.asarray(places, np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise InputError("A path needs at least one place: three numbers, in metres.")
        if not np.isfinite(points).all():
            raise InputError("A path has a place that is not a finite number.")
        projected = self._skin.nearest(points).place
        distances = np.linalg.norm(projected - points, axis=1)
        worst = int(np.argmax(distances))
        if distances[worst] > OFF_SKIN_M:
            raise InputError(
                f"Place {worst + 1} of a path, {np.round(points[worst], 3).tolist()}, is "
                f"{distances[worst]:.2f} m from the skin, allowed are {OFF_SKIN_M} m."
            )
        return projected

    def straight(self, knots: F64, closed: bool = False) -> F64:
        """Shortest path along the skin through knots (n, 3) in order, back to the first if closed
        (three or more); a copy of a single knot. Raises InputError: two knots are on unconnected
        parts of the skin."""
        parts = [self._shortest(a, b) for a, b in _pairs(knots, closed)]
        if not parts:
            return knots.copy()
        return _distinct(np.concatenate([parts[0][:1], *(part[1:] for part in parts)]))

    def curve(self, knots: F64, closed: bool = False) -> F64:
        """Smooth curve (m, 3) (Catmull-Rom 1974) through knots (n, 3), projected on the skin, in
        steps of at most 4 mm; where it leaves the skin, knots are added. Raises InputError: two
        knots are on unconnected parts of the skin."""
        knots = _distinct(knots)
        if len(knots) < 2:
            return knots
        # A spline that leaves the skin (over a bend) gets another knot half way along the skin.
        for _ in range(4):
            depths = [
                float(np.linalg.norm(self._skin.nearest(part).place - part, axis=1).max())
                for part in _splines(knots, closed, 4)
            ]
            deep = [k for k, depth in enumerate(depths) if depth > _SHALLOW_M]
            if not deep:
                break
            pairs = _pairs(knots, closed)
            middles = [_evenly(self._shortest(*pairs[k]), 2)[1] for k in deep]
            knots = np.insert(knots, [k + 1 for k in deep], middles, axis=0)
        parts = _splines(knots, closed, 16)
        # Sampled twice: first for the lengths, then with a step count per segment.
        counts = [max(int(np.ceil(_length(part) / STEP_M)), 1) for part in parts]
        smooth = _splines(knots, closed, counts)
        joined = np.concatenate([smooth[0][:1], *(part[1:] for part in smooth)])
        return self._skin.nearest(joined).place

    def traced(self, places: F64) -> tuple[F64, F64]:
        """Path (P, 3) on the skin through places (n, 3) drawn by hand, in metres at rest, and the
        fraction (n,) of the path length at each given place.
        Straight lines between the places are projected on the skin; repeated places are skipped."""
        path, knot_indices = [places[0]], [0]
        for a, b in _pairs(places, closed=False):
            length = float(np.linalg.norm(b - a))
            if length > _SAME_PLACE_M:
                count = max(int(np.ceil(length / STEP_M)), 1)
                between = a + (b - a) * (np.arange(1, count + 1) / count)[:, None]
                # The last point is a given place, and is stored as given.
                if count > 1:
                    between[:-1] = self._skin.nearest(between[:-1]).place
                path += list(between)
            knot_indices.append(len(path) - 1)
        points = np.array(path)
        lengths = np.concatenate([[0.0], np.cumsum(_steps(points))])
        total = lengths[-1] if lengths[-1] > 0.0 else 1.0
        return points, lengths[knot_indices] / total

    def _shortest(self, a: F64, b: F64) -> F64:
        """Shortest path (n, 3) between two points on the skin in steps of at most 4 mm: over mesh
        edges, then tightened. Both points themselves if they coincide. Raises InputError for
        unconnected points."""
        if np.linalg.norm(b - a) <= _SAME_PLACE_M:
            return np.stack([a, b])
        path = self._over_edges(a, b)
        length = _length(path)
        # Only triangles near the edge path are searched, which is quick. The shortest path is
        # shorter, so it stays within a margin that grows with the length.
        about = _evenly(path, max(int(length / _COARSE_M), 1))
        radius = self._tree.query(about)[0] + 0.15 * length + 1e-9
        is_near = np.zeros(len(self._points), np.bool_)
        for ids in self._tree.query_ball_point(about, 2.0 * radius + 0.03):
            is_near[ids] = True
        triangles = self._triangles[is_near[self._triangles].any(axis=1)]
        near = SurfaceLocator(self._points[triangles])
        count = max(int(np.ceil(length / _COARSE_M)), 2)
        # Coarse to fine: few points settle the course quickly, doubled numbers refine the course.
        while True:
            path = self._tightened(_evenly(path, count), near)
            if _length(path) / count <= _TIGHT_M:
                break
            count *= 2
        return near.nearest(_evenly(path, int(np.ceil(_length(path) / STEP_M)))).place

    @staticmethod
    def _tightened(path: F64, near: SurfaceLocator) -> F64:
        """Move inner points (n, 3) to the projected middle of their neighbours until the path
        settles, or for ``_MOST_ROUNDS`` rounds. Returns a new path; the ends stay."""
        path = path.copy()
        path[1:-1] = near.nearest(path[1:-1]).place
        for _ in range(_MOST_ROUNDS):
            moved = 0.0
            for first in (1, 2):  # odd and even points in turn (Gauss-Seidel): half the rounds
                inner = slice(first, -1, 2)
                if not len(path[inner]):
                    continue
                middle = 0.5 * (path[first - 1 : -2 : 2] + path[first + 1 :: 2])
                projected = near.nearest(middle).place
                moved = max(moved, float(np.abs(projected - path[inner]).max()))
                path[inner] = projected
            if moved <= _SETTLED_M:
                break
        return path

    def _over_edges(self, a: F64, b: F64) -> F64:
        """Points (m, 3) of the shortest path over mesh edges between the vertices nearest to ``a``
        and ``b`` (3,), with ``a`` and ``b`` as ends. Raises InputError if unconnected."""
        from scipy.sparse.csgraph import dijkstra

        first, last = self._tree.query(np.stack([a, b]))[1].tolist()
        distances, before = dijkstra(
            self._graph, directed=False, indices=first, return_predecessors=True
        )
        if not np.isfinite(distances[last]):
            raise InputError("Two places of a path are on unconnected parts of the skin.")
        chain = [last]
        while chain[-1] != first:
            chain.append(int(before[chain[-1]]))
        return np.concatenate([a[None], self._points[chain[::-1]], b[None]])

    @cached_property
    def _skin(self) -> SurfaceLocator:
        return SurfaceLocator(self._points[self._triangles])

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self._points)

    @cached_property
    def _graph(self) -> Any:
        return edge_graph(self._points, self._triangles)


def _steps(path: F64) -> F64:
    """Distances (n - 1,) between successive points of a path (n, 3)."""
    return np.asarray(np.linalg.norm(np.diff(path, axis=0), axis=1))


def _length(path: F64) -> float:
    return float(_steps(path).sum())


def _distinct(knots: F64) -> F64:
    """Knots without those within 0.1 micrometres of the predecessor."""
    return np.asarray(knots[np.append(True, _steps(knots) > _SAME_PLACE_M)])


def _pairs(knots: F64, closed: bool) -> list[tuple[F64, F64]]:
    """Successive pairs of knots; with the closing pair if closed and more than two."""
    ends = np.roll(knots, -1, axis=0) if closed and len(knots) > 2 else knots[1:]
    return list(zip(knots, ends, strict=False))


def _evenly(path: F64, count: int) -> F64:
    """Resample a path, linearly, into ``count`` parts of equal length, (count + 1, 3)."""
    lengths = np.concatenate([[0.0], np.cumsum(_steps(path))])
    at = np.linspace(0.0, lengths[-1], count + 1)
    return np.stack([np.interp(at, lengths, path[:, axis]) for axis in range(3)], axis=1)


def _splines(knots: F64, closed: bool, counts: int | list[int]) -> list[F64]:
    """Points of Catmull-Rom segments between successive knots (n, 3), ends included, before
    projection. ``counts`` are the numbers of steps of a segment; one number applies to all
    segments."""
    closed = closed and len(knots) > 2
    if closed:
        padded = np.concatenate([knots[-1:], knots, knots[:2]])
    else:
        ends = 2.0 * knots[[0, -1]] - knots[[1, -2]]
        # Mirrored end points make the curve start and end straight.
        padded = np.concatenate([ends[:1], knots, ends[1:]])
    number = len(padded) - 3
    part_counts = [counts] * number if isinstance(counts, int) else counts
    parts = []
    for k, count in enumerate(part_counts):
        p, q, r, s = padded[k : k + 4]
        t = np.linspace(0.0, 1.0, count + 1)[:, None]
        parts.append(
            0.5
            * (
                2.0 * q
                + (r - p) * t
                + (2.0 * p - 5.0 * q + 4.0 * r - s) * t**2
                + (3.0 * q - p - 3.0 * r + s) * t**3
            )
        )
    return parts
