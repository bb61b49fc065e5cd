# SPDX-License-Identifier: GPL-3.0-or-later
"""Neighbours of a phantom sensation: actuators on one limb and close along the skin.

Under every scheme, actuators on different limbs or more than 200 mm of skin apart never render one
place together: over such gaps no single sensation is felt in between.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from ...arrays import F64, I64, Bool
from ...body.model import PerceptualModel
from ...body.parts import PARTS
from ...body.skin_distance import SkinDistances, edge_graph

MAX_SPAN_M: Final = 0.2
"""Largest distance of two neighbours along the skin, metres."""

_SURELY_NEAR_M: Final = 0.1
"""Distance in space, metres, up to which skin is not measured."""

_ELLIPSOID_MARGIN_M: Final = 0.01

_MEASURED_ONE_BY_ONE: Final = 64
_SOURCES_AT_ONCE: Final = 64
"""Sources of one shortest-path search: 20 MiB on the finest body model."""
_ROWS_AT_ONCE: Final = 1 << 12

AreJoined = Callable[[I64, I64], Bool]
"""Test of pairs of actuators, (k,) and (k,), for rendering a place together, (k,) bool."""

_LIMBS: Final = {
    "head": 0,
    "torso": 1,
    **dict.fromkeys(("upper_arm", "forearm", "hand_dorsum", "hand_palm", "fingers"), 2),
    **dict.fromkeys(("upper_leg", "lower_leg", "foot_dorsum", "foot_sole"), 3),
}


def limbs_of(model: PerceptualModel) -> I64:
    """Number (V,) of each vertex's region: head, torso, or arm or leg of a side."""
    kind = np.array([_LIMBS[part] for part in PARTS])[model.part]
    is_trunk = kind <= 1  # no sides
    return np.asarray(kind * 3 + np.where(is_trunk, 0, model.side), np.int64)


class SkinNeighbours:
    """Pairs of A actuators that may render a place together; measured on demand and cached.

    Parameters
    ----------
    centres : (A, 3) float64
        Rest space, metres.
    anchors : (A,) int64
        Vertex under each actuator.
    """

    def __init__(self, model: PerceptualModel, centres: F64, anchors: I64) -> None:
        self._model = model
        self._centres = centres
        self._anchors = anchors
        self._limb = limbs_of(model)[anchors]
        self._measured: dict[tuple[int, int], bool] = {}
        self._skin: SkinDistances | None = None

    def are_joined(self, firsts: I64, seconds: I64) -> Bool:
        """Test pairs of actuators for one limb and at most 200 mm along the skin, (k,) bool.

        Pairs up to 100 mm apart in space count as joined without measuring.
        """
        straight_m = np.linalg.norm(self._centres[firsts] - self._centres[seconds], axis=1)
        joined = (straight_m <= MAX_SPAN_M) & (self._limb[firsts] == self._limb[seconds])
        doubtful = np.flatnonzero(joined & (straight_m > _SURELY_NEAR_M))
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
        """Test a pair for a skin path up to 200 mm, inside an ellipsoid about both ends."""
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
    """Lengths (k,) of shortest edge paths of vertex pairs (k, 2), m; inf beyond ``allowed_m``."""
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
    """Pairs of actuators, first < second, with positive gains (n, A) at a common place."""
    columns = np.flatnonzero((gains > 0.0).any(axis=0))
    shared = np.zeros((len(columns),) * 2, np.float32)
    for first in range(0, len(gains), _ROWS_AT_ONCE):
        playing = (gains[first : first + _ROWS_AT_ONCE, columns] > 0.0).astype(np.float32)
        shared += playing.T @ playing
    firsts, seconds = np.nonzero(np.triu(shared, 1))
    return columns[firsts].astype(np.int64), columns[seconds].astype(np.int64)
