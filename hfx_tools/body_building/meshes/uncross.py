# SPDX-License-Identifier: GPL-3.0-or-later
"""Freeing limbs that are thinner than their cells from triangles that cross.

Three vertices a forearm make a prism that few triangulations close without running through
themselves. Around each crossing, diagonals are exchanged and vertices moved along the skin by
simulated annealing (Kirkpatrick, Gelatt and Vecchi 1983), its chances fixed, until none is left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64, U8, Bool

from . import mesh_edges
from .crossings import crossings, depth_m, pierced
from .remesher import Remesher

COARSE_M: Final = 0.1
"""Spacing from which a limb is thinner than its cells."""

STEPS: Final = 3000
_TRIES: Final = 8
_WARMEST: Final = 6.0  # in units of the cost
_COLDEST: Final = 0.05
_FLIPS: Final = 0.6  # share of the steps that exchange a diagonal; the others move a vertex
_MOVES_M: Final = (0.003, 0.01)  # standard deviations of a move
_MOVE_LIMIT: Final = 0.2  # of the spacing
_FLATTEST: Final = 0.06  # twice the area of a triangle over the square of its longest side
_DEPTH_SAMPLES: Final = 3000  # of the skin around a patch

# Cost of a state: first crossings, then triangles turned over, then distance from the skin.
_PER_CROSSING: Final = 4.0
_PER_CROSSING_M: Final = 1000.0
_PER_TURNED: Final = 1.0
_PER_DEPTH_M: Final = 50.0
_PER_MOVE_M: Final = 30.0


def uncross(mesh: Remesher) -> None:
    """Remove crossings around the vertices of coarse parts, in place.

    What cannot be freed stays as it is.
    """
    coarse = mesh.spacing_m[mesh.part] >= COARSE_M
    if not coarse.any():
        return
    for cluster in _clusters(crossings(mesh.points, mesh.triangles)):
        patch = _Patch(mesh, cluster, coarse & ~mesh.is_midline)
        found = patch.freed()
        if found is not None:
            mesh.points[patch.local] = found.points
            mesh.normals[patch.local] = found.normals
            mesh.triangles[patch.rows] = patch.local[found.triangles]


def _clusters(crossing: I64) -> list[I64]:
    """Connected groups of crossings, as vertices."""
    found: list[set[int]] = []
    for row in crossing.tolist():
        joined = set(row).union(*(each for each in found if each & set(row)))
        found = [each for each in found if not each & set(row)] + [joined]
    return [np.array(sorted(each)) for each in found]


@dataclass(frozen=True, eq=False)
class _State:
    """The triangles near a crossing, in a numbering of their own."""

    points: F64  # (L, 3)
    normals: F64  # (L, 3)
    triangles: I64  # (T, 3)
    cost: float = np.inf
    crossing: int = 0


class _Patch:
    """Surroundings of a crossing: triangles that may change, and those not to be crossed."""

    def __init__(self, mesh: Remesher, cluster: I64, may_move: Bool) -> None:
        from scipy.spatial import cKDTree

        limit = _MOVE_LIMIT * mesh.spacing_m.max()
        beside = np.unique(mesh.triangles[np.isin(mesh.triangles, cluster).any(axis=1)])
        movable = beside[may_move[beside]]
        own = np.isin(mesh.triangles, np.union1d(cluster, movable)).any(axis=1)
        around = mesh.points[mesh.triangles[own]].reshape(-1, 3)
        low, high = around.min(axis=0) - limit, around.max(axis=0) + limit
        corners = mesh.points[mesh.triangles]
        near = (corners.max(axis=1) > low).all(axis=1) & (corners.min(axis=1) < high).all(axis=1)
        self.rows = np.flatnonzero(near)
        self.local, triangles = np.unique(mesh.triangles[near], return_inverse=True)
        triangles = triangles.reshape(-1, 3).astype(np.int64)
        self.own: Bool = own[near]
        self.part: U8 = mesh.part[self.local]
        self.is_midline: Bool = mesh.is_midline[self.local]
        self.movable = np.searchsorted(self.local, movable)
        self.limit_m: F64 = _MOVE_LIMIT * mesh.spacing_m[self.part]
        self.start = _State(mesh.points[self.local], mesh.normals[self.local], triangles)
        samples = mesh.samples
        inside = ((samples.points > low) & (samples.points < high)).all(axis=1)
        self.skin, self.skin_normals = samples.points[inside], samples.normals[inside]
        self.skin_part = samples.part[inside]
        self.tree = cKDTree(self.skin)
        self.sparse_tree = cKDTree(self.skin[:: max(1, len(self.skin) // _DEPTH_SAMPLES)])

    def freed(self) -> _State | None:
        """Find the best state without a crossing; None if there is none."""
        for seed in range(_TRIES):
            found = self._annealed(np.random.default_rng(seed))
            if found is not None:
                return found
        return None

    def _annealed(self, rng: np.random.Generator) -> _State | None:
        state = self._weighed(self.start)
        best: _State | None = None
        for step in range(STEPS):
            warmth = _COLDEST + _WARMEST * (1.0 - step / STEPS) ** 2
            change = self._flipped if rng.random() < _FLIPS else self._moved
            new = change(state, rng)
            if new is None:
                continue
            new = self._weighed(new)
            if new.cost < state.cost or rng.random() < np.exp((state.cost - new.cost) / warmth):
                state = new
                if not state.crossing and (best is None or state.cost < best.cost):
                    best = state
        return best

    def _weighed(self, state: _State) -> _State:
        own = state.triangles[self.own]
        found = self._crossings(state, own)
        facing = mesh_edges.triangle_normals(state.points, own)
        turned = np.einsum("ij,ij->i", facing, state.normals[own].sum(axis=1)) < 0.0
        corners = state.points[own]
        middles = 0.5 * (corners + np.roll(corners, 1, axis=1))
        places = np.concatenate((middles.reshape(-1, 3), corners.mean(axis=1)))
        away = self.sparse_tree.query(places)[0]
        moved = np.linalg.norm((state.points - self.start.points)[self.movable], axis=1)
        cost = (
            _PER_CROSSING * len(found)
            + _PER_CROSSING_M * depth_m(state.points, found).sum()
            + _PER_TURNED * turned.sum()
            + _PER_DEPTH_M * away.mean()
            + _PER_MOVE_M * moved.mean()
        )
        return replace(state, cost=float(cost), crossing=len(found))

    def _crossings(self, state: _State, own: I64) -> I64:
        """Find crossings of the movable part, with itself and its surroundings."""
        points = state.points
        found = []
        for ends, corners in (
            (_edges(own), state.triangles),
            (_edges(state.triangles[~self.own]), own),
        ):
            edge, triangle = points[ends], points[corners]
            starts, stops = edge.min(axis=1).T, edge.max(axis=1).T
            lows, highs = triangle.min(axis=1).T, triangle.max(axis=1).T
            meet = np.ones((len(ends), len(corners)), bool)
            for axis in range(3):
                meet &= starts[axis][:, None] < highs[axis]
                meet &= stops[axis][:, None] > lows[axis]
            one, other = np.nonzero(meet)
            found.append(pierced(points, ends[one], corners[other]))
        return np.concatenate(found)

    def _flipped(self, state: _State, rng: np.random.Generator) -> _State | None:
        """Flip one diagonal, chosen at random; None where that would tear a part apart."""
        edges = mesh_edges.edges_of(state.triangles, len(state.points))
        inner = np.flatnonzero(self.own[edges.triangle].all(axis=1) & ~edges.is_border)
        edge = rng.choice(inner)
        (a, b), (c, d) = edges.ends[edge], edges.opposite[edge]
        if c == d or edges.exists(np.array([c]), np.array([d]))[0]:
            return None
        if self.part[a] == self.part[b] and self.part[a] not in (self.part[c], self.part[d]):
            return None
        if self.is_midline[c] and self.is_midline[d]:
            return None
        first, second = edges.triangle[edge]
        turn = int(np.flatnonzero(state.triangles[first] == c)[0])
        start, end = state.triangles[first][[(turn + 1) % 3, (turn + 2) % 3]]
        triangles = state.triangles.copy()
        triangles[first], triangles[second] = (c, start, d), (c, d, end)
        if _flatness(state.points[triangles[[first, second]]]).min() < _FLATTEST:
            return None
        return replace(state, triangles=triangles)

    def _moved(self, state: _State, rng: np.random.Generator) -> _State | None:
        """Move one random vertex a little along the skin; None where it would leave its part."""
        vertex = rng.choice(self.movable)
        place = state.points[vertex] + rng.normal(0.0, rng.choice(_MOVES_M), 3)
        nearest = int(self.tree.query(place)[1])
        normal = self.skin_normals[nearest]
        place -= normal * (normal @ (place - self.skin[nearest]))
        far = np.linalg.norm(place - self.start.points[vertex]) > self.limit_m[vertex]
        if far or self.skin_part[nearest] != self.part[vertex]:
            return None
        points, normals = state.points.copy(), state.normals.copy()
        points[vertex], normals[vertex] = place, normal
        touched = points[state.triangles[(state.triangles == vertex).any(axis=1)]]
        if _flatness(touched).min() < _FLATTEST:
            return None
        return replace(state, points=points, normals=normals)


def _edges(triangles: I64) -> I64:
    """Edges that run upward in their triangle: of two triangles at an edge it is one."""
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return ends[ends[:, 0] < ends[:, 1]]


def _flatness(corners: F64) -> F64:
    """Twice the area of triangles over the square of their longest sides."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    found: F64 = np.linalg.norm(across, axis=1) / sides.max(axis=1) ** 2
    return found
