# SPDX-License-Identifier: GPL-3.0-or-later
"""Barycentric rendering on the body's surface, between neighbours along the skin.

Schneider et al. (UIST 2015) triangulate a flat pad. On a body the dual of the actuators' geodesic
Voronoi cells replaces the Delaunay triangulation, so that no edge crosses air between two fingers,
or an arm and the chest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...arrays import F64, I32, I64
from ...body.model import PerceptualModel
from ...body.skin_distance import edge_graph
from ..device_config import Law
from .complex import ActuatorComplex, gain, merged_places
from .neighbours import MAX_SPAN_M, along_edges_m, limbs_of, parted

_ROUND_ABOUT: Final = 1.7
"""Largest ratio of the path along the skin to the straight path (half around a limb: 1.57)."""

_HOLLOW: Final = 0.1  # largest height of a path above skin, share of its length

_BLEND: Final = 0.2
"""Relative distance up to which further triangles take part in a place."""


class SurfaceNeighbours:
    """Path lengths between P places on the skin; measured on demand and cached."""

    def __init__(self, model: PerceptualModel, graph: Any, anchors: I64) -> None:
        self._model = model
        self._graph = graph
        self._anchors = anchors  # (P,) vertices
        self._limb = limbs_of(model)[anchors]
        self._known: dict[tuple[int, int], float] = {}

    def lengths_m(self, pairs: I64) -> F64:
        """Skin path lengths (k,) of pairs of places (k, 2), m; inf if not to be joined."""
        ordered = [(a, b) if a < b else (b, a) for a, b in pairs.tolist()]
        new = [pair for pair in dict.fromkeys(ordered) if pair not in self._known]
        if new:
            self._known.update(zip(new, self._measured(np.array(new)).tolist(), strict=True))
        return np.array([self._known[pair] for pair in ordered], np.float64)

    def _measured(self, pairs: I64) -> F64:
        """Edge path lengths (k,) of pairs (k, 2), m; infinity for pairs not to be joined.

        Joined: one limb, path at most 200 mm and 1.7 times the straight path, not through the air.
        """
        places = self._model.vertices[self._anchors].astype(np.float64)
        first, second = pairs.T
        straight_m = np.linalg.norm(places[first] - places[second], axis=1)
        lengths_m = np.full(len(pairs), np.inf)
        near = np.flatnonzero(
            (self._limb[first] == self._limb[second]) & (straight_m <= MAX_SPAN_M)
        )
        if len(near):
            allowed_m = np.minimum(MAX_SPAN_M, _ROUND_ABOUT * straight_m[near])
            lengths_m[near] = along_edges_m(self._graph, self._anchors[pairs[near]], allowed_m)
            near = near[np.isfinite(lengths_m[near])]
            lengths_m[near[_through_the_air(self._model, places, pairs[near])]] = np.inf
        return lengths_m


@dataclass(frozen=True, eq=False)
class SurfaceGains:
    """Gains of A actuators for each vertex within reach."""

    vertices: I32  # (n,) ascending
    gains: F64  # (n, A)
    simplices: I64  # (S, 3) neighbours; edges and points repeat their last corner
    fade: F64  # (n,) included in the gains
    at: Callable[[F64], F64]  # places (m, 3) to gains (m, A), without the fade beyond the layout


def surface_gains(model: PerceptualModel, anchors: I64, law: Law = "log") -> SurfaceGains:
    """Panning between actuators on the skin, at the vertices ``anchors`` (A,), possibly repeated.

    Within a triangle of neighbours a vertex has the barycentric shares of the nearest point. Beyond
    all triangles the nearest point counts, faded out between one and two spacings from the nearest
    actuator, with a crossfade between triangles that are about equally near.
    """
    points = model.vertices.astype(np.float64)
    unique, first, place_of = np.unique(anchors, return_index=True, return_inverse=True)
    graph = edge_graph(model.vertices, model.triangles)
    # Geodesic Voronoi cells; triangles of skin that touch three cells join their actuators.
    nearest, distance_m = _cells(graph, unique)
    cells = _meeting(model.triangles.astype(np.int64), nearest)
    pairs = np.unique(
        np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [0, 2]]]), axis=0
    )
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    neighbours = SurfaceNeighbours(model, graph, unique)
    length_m = neighbours.lengths_m(pairs)
    pairs, length_m = pairs[np.isfinite(length_m)], length_m[np.isfinite(length_m)]
    simplices = _dual(cells, pairs, len(unique))
    places, same = merged_places(points[unique])
    complex_ = ActuatorComplex(places, same[simplices], same[place_of.ravel()])
    place_of = place_of.ravel()

    def are_joined(firsts: I64, seconds: I64) -> npt.NDArray[np.bool_]:
        ends = np.column_stack((place_of[firsts], place_of[seconds]))
        return np.isfinite(neighbours.lengths_m(ends)) | (ends[:, 0] == ends[:, 1])

    def at(where: F64) -> F64:
        return parted(gain(complex_.shares(where, _BLEND)[0], law), are_joined)

    # Fade by each vertex's distance in spacings of its nearest actuator.
    span_m = _spacing(pairs, length_m, len(unique))
    near = np.flatnonzero(nearest >= 0)
    fade = np.clip(2.0 - distance_m[near] / span_m[nearest[near]], 0.0, 1.0)
    near, fade = near[fade > 0.0], fade[fade > 0.0]
    gains = at(points[near])
    gains *= fade[:, None]
    return SurfaceGains(near.astype(np.int32), gains, first[simplices], fade, at)


def _cells(graph: Any, anchors: I64) -> tuple[I64, F64]:
    """Index (V,) of the anchor nearest along edges (-1: beyond 400 mm), and distance (V,), m.

    ``anchors`` are ascending vertices.
    """
    from scipy.sparse.csgraph import dijkstra

    distance, _, source = dijkstra(
        graph,
        directed=False,
        indices=anchors,
        limit=2.0 * MAX_SPAN_M,
        min_only=True,
        return_predecessors=True,
    )
    index = np.searchsorted(anchors, np.maximum(source, 0))
    return np.where(np.isfinite(distance), index, -1).astype(np.int64), distance


def _meeting(triangles: I64, nearest: I64) -> I64:
    """Distinct triples of cells (n, 3) at the corners of a skin triangle, ascending in each row.

    Cells may repeat in a row; triangles with a vertex in no cell (-1) are left out.
    """
    cells = nearest[triangles]
    return np.unique(np.sort(cells[(cells >= 0).all(axis=1)], axis=1), axis=0)


def _through_the_air(model: PerceptualModel, places: F64, pairs: I64) -> npt.NDArray[np.bool_]:
    """Mask (k,) of pairs of places whose straight path is outside the body, as between fingertips.

    Tested at three points; outside: above skin by more than a tenth of the path's length.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(model.vertices.astype(np.float64))
    start, way = places[pairs[:, 0]], places[pairs[:, 1]] - places[pairs[:, 0]]
    is_outside = np.zeros(len(pairs), np.bool_)
    length_m = np.linalg.norm(way, axis=1)
    for share in (0.25, 0.5, 0.75):
        points = start + share * way
        _, skin = tree.query(points)
        offset = points - model.vertices[skin]
        height_m = np.einsum("ij,ij->i", offset, model.normals[skin].astype(np.float64))
        is_outside |= height_m > _HOLLOW * length_m
    return is_outside


def _dual(cells: I64, pairs: I64, count: int) -> I64:
    """Simplices (S, 3) of meeting cells: triangles, then edges and points outside all triangles.

    ``cells`` (n, 3) meet, ascending in each row; ``pairs`` (k, 2) are joined, the smaller first;
    ``count`` is the number of cells. A triangle needs three joined pairs.
    """
    i, j, k = cells.T
    joined = pairs @ [count, 1]
    is_triangle = (i != j) & (j != k)
    for a, b in ((i, j), (j, k), (i, k)):
        is_triangle &= np.isin(a * count + b, joined)
    simplices = [cells[is_triangle]]
    sides = simplices[0][:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2)
    edges = pairs[~np.isin(joined, sides @ [count, 1])]
    simplices.append(edges[:, [0, 1, 1]])
    alone = np.setdiff1d(np.arange(count), np.concatenate([part.ravel() for part in simplices]))
    simplices.append(np.repeat(alone[:, None], 3, axis=1))
    return np.concatenate(simplices).astype(np.int64)


def _spacing(pairs: I64, length_m: F64, count: int) -> F64:
    """Largest length (count,) of the ``pairs`` (k, 2) of each anchor; 50 mm for a lone anchor."""
    longest = np.zeros(count)
    for end in pairs.T:
        np.maximum.at(longest, end, length_m)
    return np.where(longest > 0.0, longest, MAX_SPAN_M / 4.0)
