# SPDX-License-Identifier: GPL-3.0-or-later
"""Removal of crossing triangles from limbs thinner than their cells.

Three vertices a forearm make a prism, and few triangulations close this prism without
self-intersections. Around each crossing, diagonals are flipped and vertices moved along the skin
by simulated annealing (Kirkpatrick, Gelatt and Vecchi 1983) with fixed seeds.
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
"""Smallest spacing of limbs thinner than their cells."""

STEPS: Final = 3000
_TRIES: Final = 8
_WARMEST: Final = 6.0  # in units of the cost
_COLDEST: Final = 0.05
_FLIPS: Final = 0.6  # share of the steps with a flip; the rest moves a vertex
_MOVES_M: Final = (0.003, 0.01)  # standard deviations of a move
_MOVE_LIMIT: Final = 0.2  # of the spacing
_FLATTEST: Final = 0.06  # smallest allowed _flatness()
_DEPTH_SAMPLES: Final = 3000  # number of skin samples around a patch

# Cost of a state: first crossings, then triangles turned over, then distance from the skin.
_PER_CROSSING: Final = 4.0
_PER_CROSSING_M: Final = 1000.0
_PER_TURNED: Final = 1.0
_PER_DEPTH_M: Final = 50.0
_PER_MOVE_M: Final = 30.0


def uncross(mesh: Remesher) -> None:
    """Remove crossings around the vertices of coarse parts, in place, as far as possible."""
    coarse = mesh.spacing_m[mesh.part] >= COARSE_M
    if not coarse.any():
        return
    for cluster in _clusters(crossings(mesh.points, mesh.triangles)):
        patch = _Patch(mesh, cluster, coarse & ~mesh.is_midline)
        best_state = patch.best_state()
        if best_state is not None:
            mesh.points[patch.local] = best_state.points
            mesh.normals[patch.local] = best_state.normals
            mesh.triangles[patch.rows] = patch.local[best_state.triangles]


def _clusters(crossing: I64) -> list[I64]:
    """Sorted vertex ids of each connected group of crossings."""
    clusters: list[set[int]] = []
    for row in crossing.tolist():
        joined = set(row).union(*(cluster for cluster in clusters if cluster & set(row)))
        clusters = [cluster for cluster in clusters if not cluster & set(row)] + [joined]
    return [np.array(sorted(cluster)) for cluster in clusters]


@dataclass(frozen=True, eq=False)
class _State:
    """State of the triangles near a crossing, in local vertex ids."""

    points: F64  # (L, 3)
    normals: F64  # (L, 3)
    triangles: I64  # (T, 3)
    cost: float = np.inf
    crossing: int = 0


class _Patch:
    """Surroundings of a crossing: changeable triangles, and fixed triangles around them."""

    def __init__(self, mesh: Remesher, cluster: I64, may_move: Bool) -> None:
        from scipy.spatial import cKDTree

        limit = _MOVE_LIMIT * mesh.spacing_m.max()
        adjacent = np.unique(mesh.triangles[np.isin(mesh.triangles, cluster).any(axis=1)])
        movable = adjacent[may_move[adjacent]]
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

    def best_state(self) -> _State | None:
        """Search a state without a crossing, of low cost; None if all tries fail."""
        for seed in range(_TRIES):
            annealed = self._anneal(np.random.default_rng(seed))
            if annealed is not None:
                return annealed
        return None

    def _anneal(self, rng: np.random.Generator) -> _State | None:
        state = self._with_cost(self.start)
        best: _State | None = None
        for step in range(STEPS):
            # Metropolis rule: the chance of accepting a higher cost falls with the temperature.
            warmth = _COLDEST + _WARMEST * (1.0 - step / STEPS) ** 2
            change = self._flip_edge if rng.random() < _FLIPS else self._move_vertex
            new = change(state, rng)
            if new is None:
                continue
            new = self._with_cost(new)
            if new.cost < state.cost or rng.random() < np.exp((state.cost - new.cost) / warmth):
                state = new
                if not state.crossing and (best is None or state.cost < best.cost):
                    best = state
        return best

    def _with_cost(self, state: _State) -> _State:
        own = state.triangles[self.own]
        crossing = self._crossings(state, own)
        facing = mesh_edges.triangle_normals(state.points, own)
        turned = np.einsum("ij,ij->i", facing, state.normals[own].sum(axis=1)) < 0.0
        corners = state.points[own]
        middles = 0.5 * (corners + np.roll(corners, 1, axis=1))
        probes = np.concatenate((middles.reshape(-1, 3), corners.mean(axis=1)))
        away = self.sparse_tree.query(probes)[0]
        moved = np.linalg.norm((state.points - self.start.points)[self.movable], axis=1)
        cost = (
            _PER_CROSSING * len(crossing)
            + _PER_CROSSING_M * depth_m(state.points, crossing).sum()
            + _PER_TURNED * turned.sum()
            + _PER_DEPTH_M * away.mean()
            + _PER_MOVE_M * moved.mean()
        )
        return replace(state, cost=float(cost), crossing=len(crossing))

    def _crossings(self, state: _State, own: I64) -> I64:
        """Crossings of changeable triangles with each other and with the surroundings, (N, 5)."""
        points = state.points
        rows = []
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
            edge_rows, corner_rows = np.nonzero(meet)
            rows.append(pierced(points, ends[edge_rows], corners[corner_rows]))
        return np.concatenate(rows)

    def _flip_edge(self, state: _State, rng: np.random.Generator) -> _State | None:
        """Flip a random edge; None if unsafe, too flat, or the flip could disconnect a part."""
        edges = mesh_edges.edges_of(state.triangles, len(state.points))
        inner = np.flatnonzero(self.own[edges.triangle].all(axis=1) & ~edges.is_border)
        edge = rng.choice(inner)
        (a, b), (c, d) = edges.ends[edge], edges.opposite[edge]
        if c == d or edges.exists(np.array([c]), np.array([d]))[0]:
            return None
        # The edge could be the only connection of its part.
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

    def _move_vertex(self, state: _State, rng: np.random.Generator) -> _State | None:
        """Move a random vertex along the skin; None if too far, too flat, or outside its part."""
        vertex = rng.choice(self.movable)
        moved = state.points[vertex] + rng.normal(0.0, rng.choice(_MOVES_M), 3)
        nearest = int(self.tree.query(moved)[1])
        normal = self.skin_normals[nearest]
        moved -= normal * (normal @ (moved - self.skin[nearest]))
        far = np.linalg.norm(moved - self.start.points[vertex]) > self.limit_m[vertex]
        if far or self.skin_part[nearest] != self.part[vertex]:
            return None
        points, normals = state.points.copy(), state.normals.copy()
        points[vertex], normals[vertex] = moved, normal
        touched = points[state.triangles[(state.triangles == vertex).any(axis=1)]]
        if _flatness(touched).min() < _FLATTEST:
            return None
        return replace(state, points=points, normals=normals)


def _edges(triangles: I64) -> I64:
    """Edges with ascending ids in their triangle: each edge of a manifold mesh at most once."""
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return ends[ends[:, 0] < ends[:, 1]]


def _flatness(corners: F64) -> F64:
    """Twice the area of triangles, divided by the square of their longest side."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.linalg.norm(across, axis=1) / sides.max(axis=1) ** 2
