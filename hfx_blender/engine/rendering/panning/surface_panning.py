# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning along the skin: neighbours for all schemes, and barycentric rendering between them.

Schneider et al. (UIST 2015) triangulate a flat pad. On a body the dual of the actuators' geodesic
Voronoi cells replaces the Delaunay triangulation, so that no edge crosses air between two fingers,
or an arm and the chest. Under every scheme, actuators on different limbs or more than 200 mm of
skin apart never render one place together: over such gaps no single sensation is felt in between.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...arrays import F64, I32, I64, Bool
from ...body.model import PerceptualModel
from ...body.parts import PARTS
from ...body.skin_distance import SkinDistances, edge_graph
from ..device_config import Law
from .complex import ActuatorComplex, gain, merged_places

MAX_SPAN_M: Final = 0.2  # largest distance of two neighbours along the skin, metres
_SURELY_NEAR_M: Final = 0.1  # distance in space, metres, up to which skin is not measured
_ELLIPSOID_MARGIN_M: Final = 0.01

_MEASURED_ONE_BY_ONE: Final = 64
_SOURCES_AT_ONCE: Final = 64  # sources of one shortest-path search: 20 MiB on the finest body model
_ROWS_AT_ONCE: Final = 1 << 12

AreJoined = Callable[[I64, I64], Bool]
"""Test of pairs of actuators, (k,) and (k,), for rendering a place together, (k,) bool."""

_LIMBS: Final = {
    "head": 0,
    "torso": 1,
    **dict.fromkeys(("upper_arm", "forearm", "hand_dorsum", "hand_palm", "fingers"), 2),
    **dict.fromkeys(("upper_leg", "lower_leg", "foot_dorsum", "foot_sole"), 3),
}

_ROUND_ABOUT: Final = 1.7
"""Largest ratio of the path along the skin to the straight path (half around a limb: 1.57)."""

_HOLLOW: Final = 0.1  # largest height of a path above skin, share of its length

_BLEND: Final = 0.2  # relative distance up to which further triangles take part in a place


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
        """Edge path lengths (k,) of pairs (k, 2), m; infinity for pairs not to be joined. Joined:
        one limb, path at most 200 mm and 1.7 times the straight path, not through the air."""
        places = self._model.vertices[self._anchors].astype(np.float64)
        first, second = pairs.T
        straight_m = np.linalg.norm(places[first] - places[second], axis=1)
        lengths_m = np.full(len(pairs), np.inf)
        near = np.flatnonzero(
            (self._limb[first] == self._limb[second]) & (straight_m <= MAX_SPAN_M)
        )
        if len(near):
            # A long detour leads around a gap, such as that between two fingers.
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
    # Actuators at the same vertex share a cell.
    unique, first, place_of = np.unique(anchors, return_index=True, return_inverse=True)
    graph = edge_graph(model.vertices, model.triangles)
    # Geodesic Voronoi cells; triangles of skin that touch three cells join their actuators.
    nearest, distance_m = _cells(graph, unique)
    cells = nearest[model.triangles.astype(np.int64)]
    cells = np.unique(np.sort(cells[(cells >= 0).all(axis=1)], axis=1), axis=0)
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

    # Fade by each vertex's distance in spacings of its nearest actuator: the actuator's longest
    # joined pair, or 50 mm for a lone actuator.
    span_m = np.zeros(len(unique))
    for end in pairs.T:
        np.maximum.at(span_m, end, length_m)
    span_m[span_m == 0.0] = MAX_SPAN_M / 4.0
    near = np.flatnonzero(nearest >= 0)
    fade = np.clip(2.0 - distance_m[near] / span_m[nearest[near]], 0.0, 1.0)
    near, fade = near[fade > 0.0], fade[fade > 0.0]
    gains = at(points[near])
    gains *= fade[:, None]
    return SurfaceGains(near.astype(np.int32), gains, first[simplices], fade, at)


def _cells(graph: Any, anchors: I64) -> tuple[I64, F64]:
    """Index (V,) of the anchor nearest along edges (-1: beyond 400 mm), and distance (V,), m.
    ``anchors`` are ascending vertices."""
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


def _through_the_air(model: PerceptualModel, places: F64, pairs: I64) -> npt.NDArray[np.bool_]:
    """Mask (k,) of pairs of places whose straight path is outside the body, as between fingertips.
    Tested at three points; outside: above skin by more than a tenth of the path's length."""
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
    ``count`` is the number of cells. A triangle needs three joined pairs."""
    i, j, k = cells.T
    # A pair as one number, so that membership is a search in a sorted array.
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


def limbs_of(model: PerceptualModel) -> I64:
    """Number (V,) of each vertex's region: head, torso, or arm or leg of a side."""
    kind = np.array([_LIMBS[part] for part in PARTS])[model.part]
    is_trunk = kind <= 1  # no sides
    return np.asarray(kind * 3 + np.where(is_trunk, 0, model.side), np.int64)


class SkinNeighbours:
    """Pairs of A actuators that may render a place together; measured on demand and cached.
    ``centres`` (A, 3) are in rest space, m; ``anchors`` (A,) are the vertices under the
    actuators."""

    def __init__(self, model: PerceptualModel, centres: F64, anchors: I64) -> None:
        self._model = model
        self._centres = centres
        self._anchors = anchors
        self._limb = limbs_of(model)[anchors]
        self._measured: dict[tuple[int, int], bool] = {}
        self._skin: SkinDistances | None = None

    def are_joined(self, firsts: I64, seconds: I64) -> Bool:
        """Test pairs of actuators for one limb and at most 200 mm along the skin, (k,) bool. Pairs
        up to 100 mm apart in space count as joined without measuring."""
        straight_m = np.linalg.norm(self._centres[firsts] - self._centres[seconds], axis=1)
        joined = (straight_m <= MAX_SPAN_M) & (self._limb[firsts] == self._limb[seconds])
        doubtful = np.flatnonzero(joined & (straight_m > _SURELY_NEAR_M))
        # One entry of the cache for both directions.
        pairs = [
            (min(a, b), max(a, b))
            for a, b in zip(firsts[doubtful].tolist(), seconds[doubtful].tolist(), strict=True)
        ]
        self._measure({pair for pair in pairs if pair not in self._measured})
        joined[doubtful] = [self._measured[pair] for pair in pairs]
        return joined

    def _measure(self, pairs: set[tuple[int, int]]) -> None:
        """Measure and cache pairs: edge paths first for more than 64, then exact paths."""
        left = sorted(pairs)
        if len(left) > _MEASURED_ONE_BY_ONE:
            # A path along edges is never shorter than the exact path, so a short one decides.
            graph = edge_graph(self._model.vertices, self._model.triangles)
            ends, allowed_m = self._anchors[np.array(left)], np.full(len(left), MAX_SPAN_M)
            is_near = np.isfinite(along_edges_m(graph, ends, allowed_m)).tolist()
            self._measured |= {p: True for p, near in zip(left, is_near, strict=True) if near}
            left = [p for p, near in zip(left, is_near, strict=True) if not near]
        for pair in left:
            self._measured[pair] = self._is_near(*pair)

    def _is_near(self, first: int, second: int) -> bool:
        """Test for a path up to 200 mm across triangles of skin, from the centre of actuator
        ``first`` to the vertex under actuator ``second`` (indices)."""
        model, anchor = self._model, int(self._anchors[second])
        self._skin = self._skin or SkinDistances(model.vertices, model.triangles)
        source = self._skin.nearest(self._centres[first])
        # Points of a path within the span have distances to both ends that sum to at most the span.
        away_m = np.linalg.norm(model.vertices - source.point, axis=1)
        away_m += np.linalg.norm(model.vertices - model.vertices[anchor], axis=1)
        inside = away_m <= MAX_SPAN_M + _ELLIPSOID_MARGIN_M
        inside[source.corners] = True
        triangles = model.triangles[inside[model.triangles].any(axis=1)]
        reached, _ = SkinDistances(model.vertices, triangles).around(source, MAX_SPAN_M)
        return bool(np.isin(anchor, reached))


def along_edges_m(graph: Any, ends: I64, allowed_m: F64) -> F64:
    """Lengths (k,) of shortest edge paths of vertex pairs (k, 2), m; inf beyond ``allowed_m`` (k,).
    ``graph``: sparse matrix (V, V) of edge lengths, m."""
    from scipy.sparse.csgraph import dijkstra

    lengths_m = np.full(len(ends), np.inf)
    sources, row = np.unique(ends[:, 0], return_inverse=True)
    for first in range(0, len(sources), _SOURCES_AT_ONCE):
        in_batch = np.flatnonzero((row >= first) & (row < first + _SOURCES_AT_ONCE))
        away_m = dijkstra(
            graph,
            directed=False,
            indices=sources[first : first + _SOURCES_AT_ONCE],
            limit=float(allowed_m[in_batch].max()),
        )
        lengths_m[in_batch] = away_m[row[in_batch] - first, ends[in_batch, 1]]
    return np.where(lengths_m <= allowed_m, lengths_m, np.inf)


def parted(gains: F64, are_joined: AreJoined) -> F64:
    """Restrict gains (n, A) so that no two unjoined actuators play together; gains stay continuous.

    Of an unjoined pair the weaker is silent, and the stronger fades out until both are equal: on a
    gap from a quarter of the way to the middle. Without such a pair ``gains`` itself is returned.
    """
    firsts, seconds = playing_together(gains)
    is_apart = ~are_joined(firsts, seconds)
    if not is_apart.any():
        return gains
    firsts, seconds = firsts[is_apart], seconds[is_apart]
    # Rows of each actuator once: most pairs share few places.
    where = {k: np.flatnonzero(gains[:, k] > 0.0) for k in np.union1d(firsts, seconds).tolist()}
    share = np.ones_like(gains)
    for a, b in zip(firsts.tolist(), seconds.tolist(), strict=True):
        rows = np.intersect1d(where[a], where[b], assume_unique=True)
        power_a, power_b = gains[rows, a] ** 2, gains[rows, b] ** 2
        total = power_a + power_b
        # From 0 at equal power to 1 where the pair's second actuator is silent.
        lead = np.divide(power_a - power_b, total, out=0.0 * total, where=total > 0.0)
        share[rows, a] = np.minimum(share[rows, a], 2.0 * lead)
        share[rows, b] = np.minimum(share[rows, b], -2.0 * lead)
    np.clip(share, 0.0, 1.0, out=share)
    share *= gains
    return share


def playing_together(gains: F64) -> tuple[I64, I64]:
    """Pairs of actuators, (k,) and (k,), first < second, with positive gains (n, A) at a common
    place; sorted."""
    columns = np.flatnonzero((gains > 0.0).any(axis=0))
    # Counts of common places, as a product of masks; float32 products use the fast path of BLAS.
    shared = np.zeros((len(columns),) * 2, np.float32)
    for first in range(0, len(gains), _ROWS_AT_ONCE):
        playing = (gains[first : first + _ROWS_AT_ONCE, columns] > 0.0).astype(np.float32)
        shared += playing.T @ playing
    firsts, seconds = np.nonzero(np.triu(shared, 1))
    return columns[firsts].astype(np.int64), columns[seconds].astype(np.int64)
