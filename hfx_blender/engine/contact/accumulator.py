# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact weights of one volume on one body, gathered from all that it can reach."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64, Bool, Weights
from ..counters import Counters
from ..native.library import i64
from ..skin.posed_skin import PosedSkin
from . import compiled_broad_phase
from . import compiled_narrow_phase as native
from .broad_phase import VolumeBroadPhase
from .compiled_target import Target, is_known
from .contact_details import Details, tell_deepest
from .continuous_collision import crossings, passing
from .narrow_phase import Inside, coverage_weights

_AT_ONCE: Final = 1 << 16
"""Points that are looked at together: with fewer, calls cost more; with more, memory does."""


@dataclass(frozen=True, eq=False)
class ContactAccumulator:
    """Contact accumulator: results so far, at rows and vertices of all clusters that are needed."""

    broad: VolumeBroadPhase
    counters: Counters
    columns: I32  # (C,) vertices, ascending
    column_of: I64  # (V,) where each vertex is in ``columns``
    weights: Weights  # (n, C)
    details: Details | None
    inside: list[Inside] | None

    @classmethod
    def empty(
        cls, broad: VolumeBroadPhase, needed: Bool, counters: Counters, with_details: bool
    ) -> ContactAccumulator:
        """Empty accumulator for the rows and clusters ``needed`` (n, clusters)."""
        is_column = needed.any(axis=0)[broad.skin.cluster_of]
        columns = np.flatnonzero(is_column).astype(np.int32)
        shape = len(broad.rows), len(columns)
        weights: Weights = np.zeros(shape, broad.target.falloff.precision)
        details = Details.empty(*weights.shape) if with_details else None
        inside: list[Inside] | None = [] if with_details else None
        column_of = np.cumsum(is_column) - 1
        return cls(broad, counters, columns, column_of, weights, details, inside)

    def look_at_vertices(self, asked: Bool, enclosed: Bool) -> None:
        """Weights by vertex, of rows and clusters ``asked`` (n, clusters).

        Where the volume has no falloff, clusters that are ``enclosed`` need not be posed.
        """
        broad, skin = self.broad, self.broad.skin
        if broad.target.falloff.is_flat:
            whole = asked & enclosed
            if whole.any():
                self.weights[whole[:, skin.cluster_of[self.columns]]] = 1.0
            asked = asked & ~enclosed
        is_asked = skin.asked_groups(asked)
        groups, rows = np.nonzero(is_asked.T)
        if not len(groups):
            return
        members, some = skin.groups.clusters, np.flatnonzero(is_asked.any(axis=0))
        posed = skin.groups.posed(some, broad.pose, broad.rows, broad.to_shape)
        for part in _batches(groups, skin.group_sizes):
            points = posed.all_points(groups[part], rows[part])
            row = np.repeat(rows[part], skin.group_sizes[groups[part]])
            vertex = np.concatenate([members[group] for group in groups[part].tolist()])
            self.counters.vertices_posed += points.shape[1]
            found = broad.target.weights(points, row)
            if skin.is_grouped:
                mine = asked[row, skin.cluster_of[vertex]]
                row, vertex, found = row[mine], vertex[mine], found[mine]
            self.weights[row, self.column_of[vertex]] = found

    def look_at_skin(self, wide: Bool, followed: Bool) -> None:
        """Add weights of cells, at rows and clusters ``wide`` (n, clusters), and of passages before
        the rows of those ``followed``."""
        broad, surface = self.broad, self.broad.skin.surface
        needed = wide | followed
        needed[:-1] |= followed[1:]
        clusters, rows = np.nonzero(needed.T)
        if not len(clusters):
            return
        table, some = broad.skin.skin.table, np.flatnonzero(needed.any(axis=0))
        table.need(some)
        if self.details is None and is_known(broad.target.shapes):
            later = followed[rows, clusters]
            steps = broad.followed_in_steps(later, clusters, rows)
            how = np.where(
                wide[rows, clusters], compiled_broad_phase.COVERED, compiled_broad_phase.NOT
            ).astype(np.uint8)
            self._look_natively(
                compiled_broad_phase.Pairs(i64(clusters), i64(rows), how, steps), some
            )
            return
        allowed_m = self._allowed_m(some, clusters, rows)
        posed = surface.posed(some, broad.pose, broad.rows, broad.to_shape)
        for part in _batches(clusters, table.place_counts):
            pair, row = clusters[part], rows[part]
            points, gaps = posed.skin(pair, row, table)
            clear = broad.target.clearances(points, np.repeat(row, table.place_counts[pair]))
            skin = PosedSkin(table, pair, row, points, gaps, clear, allowed_m[part])
            self.counters.vertices_posed += points.shape[1]
            self._cover(skin, wide[row, pair])
            self._follow(skin, followed[row, pair])

    def _look_natively(self, pairs: compiled_broad_phase.Pairs, some: I64) -> None:
        """:meth:`look_at_skin` by the library."""
        broad, table = self.broad, self.broad.skin.skin.table
        surface, target = broad.skin.surface, broad.target
        posed = surface.posed(some, broad.pose, broad.rows, broad.to_shape)
        points, _ = posed.skin(pairs.clusters, pairs.rows, table)
        self.counters.vertices_posed += points.shape[1]
        turning = [number for number in np.unique(pairs.steps).tolist() if number > 1]
        drifts = {number: broad.drift(number) for number in turning}
        native.look_at_skin(
            pairs,
            table,
            native.Posing(
                points=points, allowed_m=self._allowed_m(some, pairs.clusters, pairs.rows)
            ),
            Target(
                target.shapes,
                target.which,
                target.falloff,
                target.amplitude,
                broad.matrices,
                broad.inverses,
                broad.pose.to_world[broad.rows],
            ),
            {number: (drift.from_before, drift.from_after) for number, drift in drifts.items()},
            self.weights,
            self.column_of[table.cells],
        )

    def _allowed_m(self, some: I64, clusters: I64, rows: I64) -> F64:
        """Accepted distance of the skin of cluster-row pairs from its samples, metres (pairs,)."""
        broad, distance_m = self.broad, self.broad.skin.skin.tolerance.distance_m
        if not math.isfinite(distance_m):
            return np.full(len(clusters), distance_m)
        at = broad.rows
        stretches = broad.skin.surface.least_stretches(
            some, broad.pose, at, broad.pose.to_world[at]
        )
        allowed: F64 = distance_m * stretches[rows, np.searchsorted(some, clusters)]
        return allowed

    def _places(self, skin: PosedSkin, contacts: I64) -> tuple[I64, I64]:
        """Rows and columns of some contacts."""
        rows, cells = skin.cells_of(contacts)
        return rows, self.column_of[skin.table.cells[cells]]

    def _cover(self, skin: PosedSkin, wide: Bool) -> None:
        if not wide.any():
            return
        found = coverage_weights(skin, wide, self.broad.target, self.inside)
        felt = np.flatnonzero(found)  # the others are 0 already
        self.weights[self._places(skin, felt)] = found[felt]

    def _follow(self, skin: PosedSkin, later: Bool) -> None:
        """Add cells that were passed since the row before, without contact at that row."""
        if not later.any():
            return
        broad, target = self.broad, self.broad.target
        steps = broad.followed_in_steps(later, skin.clusters, skin.rows)
        felt = []
        for number in np.unique(steps[later]).tolist():
            slots = passing(skin, steps == number, target, is_straight=number == 1)
            rows, columns = self._places(skin, skin.contacts_of(slots))
            is_open = self.weights[rows - 1, columns] == 0.0
            if self.details is None:
                is_open &= self.weights[rows, columns] < 1.0
            crossed = crossings(skin, slots[is_open], target, broad.drift(number))
            peaks = crossed.peaks(skin.contact_count)
            met = np.flatnonzero(peaks)
            felt.append((self._places(skin, met), peaks[met]))
            if self.details is not None and self.inside is not None:
                crossed.tell(self.details, partial(self._places, skin))
                # Where skin is inside at the row itself, its place then is the contact's.
                is_over = np.zeros(skin.contact_count, np.bool_)
                is_over[met] = self.weights[self._places(skin, met)] == 0.0
                self.inside.append(crossed.inside(skin, is_over))
        for places, weights in felt:
            self.weights[places] = np.maximum(self.weights[places], weights)

    def place_all(self, needed: Bool) -> None:
        """Set the places of contacts: the vertex if that is inside, else the deepest sample."""
        broad, vertices = self.broad, self.broad.skin.vertices
        target = broad.target
        assert self.details is not None and self.inside is not None
        clusters = np.flatnonzero(needed.any(axis=0))
        posed = vertices.posed(clusters, broad.pose, broad.rows, broad.to_shape)
        is_open = self.weights > 0.0
        for cluster in clusters.tolist():
            rows = np.flatnonzero(needed[:, cluster])
            columns = self.column_of[vertices.clusters[cluster]]
            points = posed.points(cluster, rows)
            self.counters.vertices_posed += points[0].size
            self.details.places[:, rows[:, None], columns] = points
            row = np.repeat(rows, points.shape[2])
            is_in = target.weights(points.reshape(3, -1), row) > 0.0
            is_open[rows[:, None], columns] &= ~is_in.reshape(len(rows), -1)
        shapes = [target.shapes[k] for k in target.which.tolist()]
        column_of = self.column_of[broad.skin.skin.table.cells]
        tell_deepest(self.details, is_open, self.inside, column_of, shapes, broad.matrices)


def _batches(clusters: I64, sizes: I64) -> Iterator[slice]:
    """Cut pairs of ascending clusters into batches with few points, each cluster whole."""
    total = np.cumsum(sizes[clusters])
    if total[-1] <= _AT_ONCE:
        yield slice(0, len(clusters))
        return
    cuts = (np.flatnonzero(clusters[1:] != clusters[:-1]) + 1).tolist()
    first = done = 0
    for last, following in pairwise([*cuts, len(clusters), len(clusters)]):
        if last == following or total[following - 1] - done > _AT_ONCE:
            yield slice(first, last)
            first, done = last, int(total[last - 1])
