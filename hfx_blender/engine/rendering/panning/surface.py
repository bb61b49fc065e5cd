# SPDX-License-Identifier: GPL-3.0-or-later
"""Barycentric rendering on the body's surface: neighbours are found along the skin.

Schneider et al. (UIST 2015) triangulate a flat pad. On a body the dual of the actuators'
geodesic Voronoi cells takes the place of the Delaunay triangulation, so that nothing is joined
through the air: not two fingers, not an arm and the chest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ...body.mesh_edit import edges_of
from ...body.model import PerceptualModel
from .complex import ActuatorComplex, merged_places
from .laws import Law, gain
from .neighbours import MAX_SPAN_M, limbs_of

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
I32 = npt.NDArray[np.int32]

_ROUND_ABOUT: Final = 1.7
"""How much longer the way along the skin may be than straight on (half round a limb: 1.57)."""

_HOLLOW: Final = 0.1


@dataclass(frozen=True, eq=False)
class SurfaceGains:
    """How strongly each of A actuators is driven by each vertex that the device reaches."""

    vertices: I32  # (n,) ascending
    gains: F64  # (n, A)
    simplices: I64  # (S, 3) neighbouring actuators; an edge or a point repeats its last corner
    fade: F64  # (n,) what the gains hold of it
    complex: ActuatorComplex
    law: Law

    def at(self, points: F64) -> F64:
        """Gains (m, A) for any places (m, 3), without the fade beyond the layout."""
        return gain(self.complex.shares(points)[0], self.law)


def surface_gains(model: PerceptualModel, anchors: I64, law: Law = "log") -> SurfaceGains:
    """Panning between actuators on the skin.

    Within the triangles of neighbours a vertex has the barycentric shares of the nearest place
    of its triangle. Beyond them the nearest place is shown, fading out between one and two
    spacings from the nearest actuator.

    Parameters
    ----------
    model : PerceptualModel
    anchors : (A,) int64
        The vertex of ``model`` under each actuator; several may share one.
    law : {"linear", "log", "power"}
    """
    points = model.vertices.astype(np.float64)
    unique, first, place_of = np.unique(anchors, return_index=True, return_inverse=True)
    nearest, distance_m, between_m = _along_the_skin(model, unique)
    straight_m = np.linalg.norm(points[unique][:, None] - points[unique][None], axis=2)
    limb = limbs_of(model)
    is_joined = (between_m <= MAX_SPAN_M) & (between_m <= _ROUND_ABOUT * straight_m)
    is_joined &= limb[unique][:, None] == limb[unique][None]
    is_joined &= ~_through_the_air(model, points[unique], is_joined)
    simplices = _dual(model.triangles.astype(np.int64), nearest, is_joined)
    places, same = merged_places(points[unique])
    complex_ = ActuatorComplex(places, same[simplices], same[place_of.ravel()])
    span_m = _spacing(simplices, between_m, len(unique))
    near = np.flatnonzero(nearest >= 0)
    fade = np.clip(2.0 - distance_m[near] / span_m[nearest[near]], 0.0, 1.0)
    near, fade = near[fade > 0.0], fade[fade > 0.0]
    shares, _ = complex_.shares(points[near])
    return SurfaceGains(
        near.astype(np.int32),
        gain(shares, law) * fade[:, None],
        first[simplices],
        fade,
        complex_,
        law,
    )


def _along_the_skin(model: PerceptualModel, anchors: I64) -> tuple[I64, F64, F64]:
    """Nearest anchor of each vertex (-1: none within reach), its distance, anchors' distances."""
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import dijkstra

    points = model.vertices.astype(np.float64)
    ends = edges_of(model.triangles.astype(np.int64), len(model)).ends
    lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    graph = csr_array(coo_array((lengths, tuple(ends.T)), shape=(len(model),) * 2))
    reach = 2.0 * MAX_SPAN_M
    distances = dijkstra(graph, directed=False, indices=anchors, limit=reach)
    nearest = np.argmin(distances, axis=0)
    distance = distances[nearest, np.arange(len(model))]
    nearest = np.where(np.isfinite(distance), nearest, -1)
    return nearest.astype(np.int64), distance, distances[:, anchors]


def _through_the_air(
    model: PerceptualModel, places: F64, candidates: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Which pairs of places, (A, A), see each other from outside, as two fingertips do.

    The way straight on may leave the body by a tenth of its length: skin is hollow in places.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(model.vertices.astype(np.float64))
    one, other = np.nonzero(np.triu(candidates, 1))
    is_outside = np.zeros(len(one), np.bool_)
    length_m = np.linalg.norm(places[one] - places[other], axis=1)
    for share in (0.25, 0.5, 0.75):
        points = places[one] + share * (places[other] - places[one])
        _, skin = tree.query(points)
        offset = points - model.vertices[skin]
        height_m = np.einsum("ij,ij->i", offset, model.normals[skin].astype(np.float64))
        is_outside |= height_m > _HOLLOW * length_m
    found = np.zeros_like(candidates)
    found[one, other] = found[other, one] = is_outside
    return found


def _dual(triangles: I64, nearest: I64, is_joined: npt.NDArray[np.bool_]) -> I64:
    """Neighbours by the cells that meet: triangles, then edges and points that are in none."""
    cells = nearest[triangles]
    cells = np.unique(np.sort(cells[(cells >= 0).all(axis=1)], axis=1), axis=0)
    i, j, k = cells.T
    is_triangle = (i != j) & (j != k) & is_joined[i, j] & is_joined[j, k] & is_joined[i, k]
    found = [cells[is_triangle]]
    pairs = np.unique(
        np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [0, 2]]]), axis=0
    )
    a, b = pairs.T
    pairs = pairs[(a != b) & is_joined[a, b]]
    count = len(is_joined)
    sides = np.sort(found[0][:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1)
    pairs = pairs[~np.isin(pairs @ [count, 1], sides @ [count, 1])]
    found.append(pairs[:, [0, 1, 1]])
    alone = np.setdiff1d(np.arange(count), np.concatenate([each.ravel() for each in found]))
    found.append(np.repeat(alone[:, None], 3, axis=1))
    return np.concatenate(found).astype(np.int64)


def _spacing(simplices: I64, between_m: F64, count: int) -> F64:
    """Distance of each anchor to the farthest of its neighbours; a lone one: a quarter span."""
    spacing = np.full(count, MAX_SPAN_M / 4.0)
    longest = np.zeros(count)
    for a, b in ((0, 1), (1, 2), (0, 2)):
        one, other = simplices[:, a], simplices[:, b]
        np.maximum.at(longest, one, between_m[one, other])
        np.maximum.at(longest, other, between_m[one, other])
    return np.where(longest > 0.0, longest, spacing)
