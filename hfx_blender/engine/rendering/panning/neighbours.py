# SPDX-License-Identifier: GPL-3.0-or-later
"""Neighbours of a phantom sensation: actuators on one limb, and not far apart on the skin.

Whatever a scheme asks for, no two actuators play one place together that are on different limbs or
more than 200 mm of skin apart: over such a gap nobody feels one sensation between them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from ...arrays import F64, I64, Bool
from ...body.mesh_edges import edge_graph
from ...body.model import PerceptualModel
from ...body.parts import PARTS
from ...body.skin_distance import SkinDistances

MAX_SPAN_M: Final = 0.2
"""Farthest that two neighbours may be apart, along the skin."""

_SURELY_NEAR_M: Final = 0.1
"""Skin between two places this close in space is not measured."""

_ELLIPSOID_MARGIN_M: Final = 0.01

_MEASURED_ONE_BY_ONE: Final = 64
_SOURCES_AT_ONCE: Final = 64
"""Number of sources whose distances are held together: 20 MiB on the finest body model."""
_ROWS_AT_ONCE: Final = 1 << 12

AreJoined = Callable[[I64, I64], Bool]
"""Tells of pairs of actuators, (k,) and (k,), whether they may share a place."""

_LIMBS: Final = {
    "head": 0,
    "torso": 1,
    **dict.fromkeys(("upper_arm", "forearm", "hand_dorsum", "hand_palm", "fingers"), 2),
    **dict.fromkeys(("upper_leg", "lower_leg", "foot_dorsum", "foot_sole"), 3),
}


def limbs_of(model: PerceptualModel) -> I64:
    """Limb of each vertex, or the head or torso, as a number, (V,)."""
    kind = np.array([_LIMBS[part] for part in PARTS])[model.part]
    is_trunk = kind <= 1  # one piece from left to right
    return np.asarray(kind * 3 + np.where(is_trunk, 0, model.side), np.int64)


class SkinNeighbours:
    """Pairs of A actuators that are near enough to share a place.

    Only pairs that somebody asks for are measured, as few of a large array ever play together.

    Parameters
    ----------
    centres : (A, 3) float64
        Rest space, metres.
    anchors : (A,) int64
        The vertex under each actuator.
    """

    def __init__(self, model: PerceptualModel, centres: F64, anchors: I64) -> None:
        self._model = model
        self._centres = centres
        self._anchors = anchors
        self._limb = limbs_of(model)[anchors]
        self._measured: dict[tuple[int, int], bool] = {}
        self._skin: SkinDistances | None = None

    def are_joined(self, one: I64, other: I64) -> Bool:
        """Test pairs of actuators for being on one limb, and near along the skin, (k,) bool."""
        straight_m = np.linalg.norm(self._centres[one] - self._centres[other], axis=1)
        found = (straight_m <= MAX_SPAN_M) & (self._limb[one] == self._limb[other])
        doubtful = np.flatnonzero(found & (straight_m > _SURELY_NEAR_M))
        pairs = [
            (min(a, b), max(a, b))
            for a, b in zip(one[doubtful].tolist(), other[doubtful].tolist(), strict=True)
        ]
        self._measure({pair for pair in pairs if pair not in self._measured})
        found[doubtful] = [self._measured[pair] for pair in pairs]
        return found

    def _measure(self, pairs: set[tuple[int, int]]) -> None:
        left = sorted(pairs)
        if len(left) > _MEASURED_ONE_BY_ONE:
            # A path along edges is never shorter than the skin's.
            graph = edge_graph(self._model.vertices, self._model.triangles)
            ends, allowed_m = self._anchors[np.array(left)], np.full(len(left), MAX_SPAN_M)
            is_near = np.isfinite(along_edges_m(graph, ends, allowed_m)).tolist()
            self._measured |= {p: True for p, near in zip(left, is_near, strict=True) if near}
            left = [p for p, near in zip(left, is_near, strict=True) if not near]
        for pair in left:
            self._measured[pair] = self._is_near(*pair)

    def _is_near(self, one: int, other: int) -> bool:
        """Test for a short path along the skin: it stays in an ellipsoid round both."""
        model, anchor = self._model, int(self._anchors[other])
        self._skin = self._skin or SkinDistances(model.vertices, model.triangles)
        source = self._skin.nearest(self._centres[one])
        away_m = np.linalg.norm(model.vertices - source.point, axis=1)
        away_m += np.linalg.norm(model.vertices - model.vertices[anchor], axis=1)
        inside = away_m <= MAX_SPAN_M + _ELLIPSOID_MARGIN_M
        inside[source.corners] = True
        triangles = model.triangles[inside[model.triangles].any(axis=1)]
        reached, _ = SkinDistances(model.vertices, triangles).around(source, MAX_SPAN_M)
        return bool(np.isin(anchor, reached))


def along_edges_m(graph: Any, ends: I64, allowed_m: F64) -> F64:
    """Lengths (k,) of the shortest paths along edges between pairs of vertices (k, 2).

    Infinite: longer than is allowed, (k,).
    """
    from scipy.sparse.csgraph import dijkstra

    found = np.full(len(ends), np.inf)
    sources, row = np.unique(ends[:, 0], return_inverse=True)
    for first in range(0, len(sources), _SOURCES_AT_ONCE):
        mine = np.flatnonzero((row >= first) & (row < first + _SOURCES_AT_ONCE))
        away_m = dijkstra(
            graph,
            directed=False,
            indices=sources[first : first + _SOURCES_AT_ONCE],
            limit=float(allowed_m[mine].max()),
        )
        found[mine] = away_m[row[mine] - first, ends[mine, 1]]
    return np.where(found <= allowed_m, found, np.inf)


def parted(gains: F64, are_joined: AreJoined) -> F64:
    """Restrict gains (n, A) so that no two unjoined actuators play together.

    Of two that are not, the weaker is silent, and the stronger fades out until both are as
    strong: on a gap between two, from a quarter of the way to the middle. So nothing jumps.
    """
    one, other = playing_together(gains)
    is_apart = ~are_joined(one, other)
    if not is_apart.any():
        return gains
    one, other = one[is_apart], other[is_apart]
    where = {k: np.flatnonzero(gains[:, k] > 0.0) for k in np.union1d(one, other).tolist()}
    share = np.ones_like(gains)
    for a, b in zip(one.tolist(), other.tolist(), strict=True):
        rows = np.intersect1d(where[a], where[b], assume_unique=True)
        power_a, power_b = gains[rows, a] ** 2, gains[rows, b] ** 2
        total = power_a + power_b
        lead = np.divide(power_a - power_b, total, out=0.0 * total, where=total > 0.0)
        share[rows, a] = np.minimum(share[rows, a], 2.0 * lead)
        share[rows, b] = np.minimum(share[rows, b], -2.0 * lead)
    np.clip(share, 0.0, 1.0, out=share)
    share *= gains
    return share


def playing_together(gains: F64) -> tuple[I64, I64]:
    """Pairs of actuators, one < other, that play at one of n places together: gains (n, A)."""
    columns = np.flatnonzero((gains > 0.0).any(axis=0))
    shared = np.zeros((len(columns),) * 2, np.float32)
    for first in range(0, len(gains), _ROWS_AT_ONCE):
        playing = (gains[first : first + _ROWS_AT_ONCE, columns] > 0.0).astype(np.float32)
        shared += playing.T @ playing
    one, other = np.nonzero(np.triu(shared, 1))
    return columns[one].astype(np.int64), columns[other].astype(np.int64)
