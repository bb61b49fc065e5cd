# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact weights of one volume on one body, gathered from all that it can reach."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from .counters import Counters
from .details import Details, tell_deepest
from .narrow import Inside, covered
from .placed import Placed
from .posed_skin import PosedSkin
from .swept import crossings

I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
Weights = npt.NDArray[np.floating[Any]]

_AT_ONCE: Final = 1 << 14
"""Points that are looked at together: their arrays stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Found:
    """What has been found so far, at rows and vertices of all clusters that are needed."""

    placed: Placed
    counters: Counters
    columns: I32  # (C,) vertices, ascending
    column_of: I64  # (V,) where each vertex is in ``columns``
    weights: Weights  # (n, C)
    details: Details | None
    inside: list[Inside] | None

    @classmethod
    def none_yet(
        cls, placed: Placed, needed: Bool, counters: Counters, with_details: bool
    ) -> Found:
        """Nothing, of the rows and clusters ``needed`` (n, clusters)."""
        is_column = needed.any(axis=0)[placed.skin.cluster_of]
        columns = np.flatnonzero(is_column).astype(np.int32)
        # Shares of a cell without falloff, in half the memory.
        precision = np.float32 if placed.target.falloff.is_flat else np.float64
        weights: Weights = np.zeros((len(placed.rows), len(columns)), precision)
        details = Details.none_yet(*weights.shape) if with_details else None
        inside: list[Inside] | None = [] if with_details else None
        column_of = np.cumsum(is_column) - 1
        return cls(placed, counters, columns, column_of, weights, details, inside)

    def look_at_vertices(self, asked: Bool, enclosed: Bool) -> None:
        """Weights by vertex, of rows and clusters ``asked`` (n, clusters).

        Where the volume has no falloff, clusters that are ``enclosed`` need not be posed.
        """
        placed, skin = self.placed, self.placed.skin
        if placed.target.falloff.is_flat:
            whole = asked & enclosed
            if whole.any():
                self.weights[whole[:, skin.cluster_of[self.columns]]] = 1.0
            asked = asked & ~enclosed
        groups, rows_of_groups = _asked(skin.asked_groups(asked))
        if not len(groups):
            return
        posed = skin.groups.posed(groups, placed.pose, placed.rows, placed.to_shape)
        for batch in _batches(groups, rows_of_groups, skin.groups.clusters):
            members = [skin.groups.clusters[group] for group, _ in batch]
            rows_of = [rows for _, rows in batch]
            points = posed.all_points(batch)
            pairs = list(zip(rows_of, members, strict=True))
            sizes = np.repeat([len(ids) for ids in members], [len(rows) for rows in rows_of])
            row = np.repeat(np.concatenate(rows_of), sizes)
            vertex = np.concatenate([ids for rows, ids in pairs for _ in range(len(rows))])
            self.counters.vertices_posed += points.shape[1]
            found = placed.target.weights(points, row)
            if skin.is_grouped:
                mine = asked[row, skin.cluster_of[vertex]]
                row, vertex, found = row[mine], vertex[mine], found[mine]
            self.weights[row, self.column_of[vertex]] = found

    def look_at_skin(self, wide: Bool, followed: Bool) -> None:
        """Weights of cells, of rows and clusters ``wide`` (n, clusters), and of what passed
        before the rows of those ``followed``."""
        placed, surface = self.placed, self.placed.skin.surface
        needed = wide | followed
        needed[:-1] |= followed[1:]
        clusters, rows_of_clusters = _asked(needed)
        if not len(clusters):
            return
        table = placed.skin.skin.table
        table.need(clusters)
        posed = surface.posed(clusters, placed.pose, placed.rows, placed.to_shape)
        for batch in _batches(clusters, rows_of_clusters, surface.clusters):
            parts = [
                posed.skin(cluster, rows, int(table.unit_counts[cluster]), table.links)
                for cluster, rows in batch
            ]
            skin = PosedSkin(
                table,
                np.repeat([cluster for cluster, _ in batch], [len(rows) for _, rows in batch]),
                np.concatenate([rows for _, rows in batch]),
                np.concatenate([points.reshape(3, -1) for points, _ in parts], axis=1),
                np.concatenate([gaps.ravel() for _, gaps in parts]),
            )
            self.counters.vertices_posed += skin.points.shape[1]
            self._cover(skin, wide[skin.rows, skin.clusters])
            self._follow(skin, followed[skin.rows, skin.clusters])

    def _places(self, skin: PosedSkin) -> tuple[I64, I64]:
        """Row and column of each contact."""
        vertices = skin.table.cells[skin.contact_cells]
        return skin.rows[skin.contact_pairs], self.column_of[vertices]

    def _cover(self, skin: PosedSkin, wide: Bool) -> None:
        if not wide.any():
            return
        found = covered(skin, wide, self.placed.target, self.inside)
        rows, columns = self._places(skin)
        if not wide.all():
            mine = np.flatnonzero(wide[skin.contact_pairs])
            rows, columns, found = rows[mine], columns[mine], found[mine]
        self.weights[rows, columns] = found

    def _follow(self, skin: PosedSkin, later: Bool) -> None:
        """Cells that were passed since the row before; at the row before they were not felt."""
        if not later.any():
            return
        placed = self.placed
        rows, columns = self._places(skin)
        before, after = self.weights[rows - 1, columns], self.weights[rows, columns]
        is_open = later[skin.contact_pairs] & (before == 0.0)
        if self.details is None:
            is_open &= after < 1.0
        steps = placed.followed_in_steps(later, skin.clusters, skin.rows)
        for number in np.unique(steps[later]).tolist():
            crossed = crossings(skin, steps == number, is_open, placed.target, placed.drift(number))
            np.maximum(after, crossed.peaks(len(after)), out=after, casting="same_kind")
            if self.details is not None and self.inside is not None:
                crossed.tell(self.details, rows, columns)
                self.inside.append(crossed.inside(skin))
        self.weights[rows[is_open], columns[is_open]] = after[is_open]

    def place_all(self, needed: Bool) -> None:
        """Tell where contacts are: at the vertex if that is inside, else at the deepest."""
        placed, vertices = self.placed, self.placed.skin.vertices
        target = placed.target
        assert self.details is not None and self.inside is not None
        clusters = np.flatnonzero(needed.any(axis=0))
        posed = vertices.posed(clusters, placed.pose, placed.rows, placed.to_shape)
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
        column_of = self.column_of[placed.skin.skin.table.cells]
        tell_deepest(self.details, is_open, self.inside, column_of, shapes, placed.matrices)


def _asked(asked: Bool) -> tuple[I64, list[I64]]:
    """The clusters that are asked for at any row (n, clusters), and the rows of each."""
    cluster, row = np.nonzero(asked.T)
    starts = np.flatnonzero(np.diff(cluster, prepend=-1))
    ends = [*starts[1:].tolist(), len(cluster)]
    return cluster[starts], [row[a:b] for a, b in zip(starts.tolist(), ends, strict=False)]


def _batches(
    clusters: I64, rows_of: list[I64], members: list[I32]
) -> Iterator[list[tuple[int, I64]]]:
    """Clusters and their rows, as many at a time as have few points."""
    batch: list[tuple[int, I64]] = []
    size = 0
    for cluster, rows in zip(clusters.tolist(), rows_of, strict=True):
        more = len(rows) * len(members[cluster])
        if batch and size + more > _AT_ONCE:
            yield batch
            batch, size = [], 0
        batch.append((cluster, rows))
        size += more
    yield batch
