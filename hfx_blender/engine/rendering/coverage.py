# SPDX-License-Identifier: GPL-3.0-or-later
"""Coverage scheme of HFX Studio: actuators respond to the vertices shared with samples.

Danieau et al., VRST 2018, section 3.3: data and devices refer to vertices of the same perceptual
model; shared vertices are rendered.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..arrays import F32, F64, I32, I64
from ..native.library import library
from .device_config import Statistic

DENSE_ENTRIES = 1 << 18
"""Weights laid out densely at a time: 1 MiB, to stay in the processor's cache."""


class ActuatorCells:
    """Vertices of one model reached by each of A actuators. ``rows`` (n,) are vertices of each
    actuator, possibly empty or overlapping; ``vertex_count`` is V; ``factors`` (n,) a factor of
    each vertex, for panning schemes; 1 by default."""

    def __init__(
        self, rows: Sequence[I32], vertex_count: int, factors: Sequence[F64] | None = None
    ) -> None:
        self.rows = tuple(rows)
        self.factors: F32 | None = None
        if factors is not None:
            self.factors = np.concatenate([np.zeros(0), *factors]).astype(np.float32)
        self.counts = np.array([len(row) for row in rows], np.int64)
        every = np.concatenate([np.zeros(0, np.int32), *rows])
        reached, slots = np.unique(every, return_inverse=True)
        self.reached = reached  # (D,) vertices that any actuator reaches
        self._slots = slots.ravel()
        self._overlaps = not np.array_equal(self._slots, np.arange(len(reached)))
        self._is_reached = np.zeros(vertex_count, np.bool_)
        self._is_reached[reached] = True
        self._slot_of = np.cumsum(self._is_reached) - 1  # valid for reached vertices

    def gains(self, offsets: I64, vertices: I32, weights: F32, statistic: Statistic) -> F64:
        """Gains (n, A) of the actuators for n samples; 0 where nothing is shared.

        ``strongest``: largest weight (times factor) among the shared vertices, ``mean``: mean over
        all vertices of the actuator, with 0 for vertices outside the sample. Sample ``k`` has the
        entries ``slice(offsets[k], offsets[k + 1])`` of ``vertices`` and ``weights`` (total,).
        """
        count = len(offsets) - 1
        gains = np.zeros((count, len(self.rows)))
        if not len(self.reached):
            return gains
        native = library() if statistic == "strongest" else None
        if native is not None:
            starts, reached, factors = self._by_vertex
            native.hfx_strongest(
                *(count, offsets, vertices, weights, len(starts) - 1, starts, reached, factors),
                *(len(self.rows), gains),
            )
            return gains
        # A block of samples at a time, for the cache.
        step = max(1, DENSE_ENTRIES // len(self.reached))
        for first in range(0, count, step):
            stop = min(first + step, count)
            entries = slice(int(offsets[first]), int(offsets[stop]))
            dense = self._dense(offsets[first : stop + 1], vertices[entries], weights[entries])
            gains[first:stop] = self._reduce(dense, statistic)
        return gains

    @cached_property
    def _by_vertex(self) -> tuple[I64, I32, F32 | None]:
        """Actuators of each vertex: starts (V + 1,) of a vertex's entries, and for each entry the
        actuator's index and factor (None: all 1)."""
        every = np.concatenate(self.rows)
        order = np.argsort(every, kind="stable")
        counts = np.bincount(every, minlength=len(self._is_reached))
        owners = np.repeat(np.arange(len(self.rows), dtype=np.int32), self.counts)
        factors = None if self.factors is None else self.factors[order]
        return np.concatenate(([0], np.cumsum(counts))), owners[order], factors

    def _dense(self, offsets: I64, vertices: I32, weights: F32) -> F32:
        """Weights (n, D) of samples at the D reached vertices; 0 outside the sample."""
        count = len(offsets) - 1
        dense = np.zeros((count, len(self.reached)), np.float32)
        shared = np.flatnonzero(self._is_reached[vertices])
        # Scatter each sample's shared weights into its row of the dense array.
        firsts = np.searchsorted(shared, offsets - offsets[0])
        row_starts = np.repeat(np.arange(count) * len(self.reached), np.diff(firsts))
        dense.ravel()[row_starts + self._slot_of[vertices[shared]]] = weights[shared]
        return dense

    def _reduce(self, dense: F32, statistic: Statistic) -> F64:
        """Reduce dense weights (n, D), multiplied by the vertices' ``factors``, to gains (n, A) by
        their maximum or mean. 0 for an actuator without vertices."""
        gains = np.zeros((len(dense), len(self.rows)))
        filled = np.flatnonzero(self.counts)  # reduceat has no identity for an empty row
        starts = (np.cumsum(self.counts) - self.counts)[filled]
        spread = dense[:, self._slots] if self._overlaps else dense
        if self.factors is not None:
            spread = spread * self.factors
        if statistic == "strongest":
            gains[:, filled] = np.maximum.reduceat(spread, starts, axis=1)
        else:
            sums = np.add.reduceat(spread, starts, axis=1, dtype=np.float64)
            gains[:, filled] = sums / self.counts[filled]
        return gains
