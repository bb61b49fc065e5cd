# SPDX-License-Identifier: GPL-3.0-or-later
"""Stateless part of responses: touched and near skin, speeds, values of filters.

Nothing here remembers anything, so blocks of times may be worked out anywhere, in any order.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..arrays import F32, F64, I32, I64, Bool
from ..contact.reachable_bounds import ReachableBounds
from ..response_filters.controls import About, Filter, FilterKind
from ..response_filters.filters import (
    distance_value,
    mixed,
    proximity_value,
    sine_value,
    speed_value,
    within_limits,
)
from ..samples import SampleRun, Stream
from ..scene import EffectBlock, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..volume.nearest_surface import distances_m
from ..volume.placing_matrix import inverse_placement, world_bounds
from .paths import Path

WeightedSet = tuple[I32, F32]
"""Vertices, ascending, and their weights."""


@dataclass(frozen=True, eq=False)
class Between:
    """Moments between samples at which skin is touched, in the order of time."""

    rows: I64  # (m,) of the samples after them
    times_s: F64  # (m,)
    set_of: I64  # (m,)

    def part(self, rows: slice) -> Between:
        """Moments before some of the samples."""
        first, last = np.searchsorted(self.rows, [rows.start, rows.stop]).tolist()
        mine = slice(first, last)
        return Between(self.rows[mine] - rows.start, self.times_s[mine], self.set_of[mine])


_NOTHING: Final = Between(np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class Touches:
    """Contact of one volume and one body over some times, before the response's memory.

    A stack without impacts has the times at which skin is touched or near; one with impacts all
    at which the effect is on, as an impact may still be felt.
    """

    stream: Stream
    filters: tuple[Filter, ...]
    indices: I64  # (n,) sample indices, ascending
    times_s: F64  # (n,)
    levels: F64  # (n,) activation times intensity
    parameters: F64  # (n, P)
    controls: F64  # (n, F, WIDTH)
    values: F64  # (n, F) of each filter; 0 for impacts, 1 for those in space
    is_touched: Bool  # (n,)
    speeds_m_s: F64  # (n,) of skin and volume against each other; 0 where not known
    set_of: I64  # (n,) -1: neither touched nor near
    offsets: I64  # (m + 1,) set j has the vertices slice(offsets[j], offsets[j + 1])
    vertices: I32  # (total,) ascending within a set
    weights: F32  # (total,) in (0, 1]
    onsets_s: F64 | None = None  # (n,) when a touch began since the sample before, else NaN
    between: Between = _NOTHING  # where impacts need them
    resumes_s: float = 0.0  # a touch that begins so soon after the last one is no new impact

    def __len__(self) -> int:
        return len(self.indices)

    def part(self, rows: slice) -> Touches:
        """Touches at some of the times, with all sets."""
        columns = {
            name: getattr(self, name)[rows] for name in _COLUMNS if getattr(self, name) is not None
        }
        return replace(self, **columns, between=self.between.part(rows))

    def weighted_set(self, number: int) -> WeightedSet:
        """Vertices of a set, and their weights."""
        part = slice(int(self.offsets[number]), int(self.offsets[number + 1]))
        return self.vertices[part], self.weights[part]


_COLUMNS: Final = (
    *("indices", "times_s", "levels", "parameters", "controls", "values", "is_touched"),
    *("speeds_m_s", "set_of", "onsets_s"),
)
"""Fields of :class:`Touches` with a row for each time."""


class BodyPlaces:
    """World positions of a body's clusters over a block, each computed when first needed."""

    def __init__(self, skin: BodySkin, pose: PoseBlock, rows: I64) -> None:
        self._skin = skin
        self._pose = pose
        self._rows = rows  # whose pose is known
        self._known: dict[int, F64] = {}
        # Of the pose between samples: estimated, and exactly.
        self.paths: dict[tuple[str, int, int, int], Path] = {}
        self.motion: dict[tuple[str, int, bytes], F64] = {}

    def of(self, cluster: int) -> F64:
        """World places (3, number of rows, number of vertices)."""
        if cluster not in self._known:
            self._known[cluster] = self._skin.vertices.cluster_points(
                cluster, self._pose, self._rows, self._pose.to_world[self._rows]
            )
        return self._known[cluster]


@dataclass(frozen=True, eq=False)
class Moments:
    """A volume and a body over the rows of a block."""

    effect: EffectBlock
    filters: tuple[Filter, ...]
    rows: I64  # (n,) at which the effect is on and the pose is known
    indices: I64  # (T,) of the block
    times_s: F64  # (T,) of the block
    posed: I64  # rows whose pose is known
    skin: BodySkin
    pose: PoseBlock
    bounds: ReachableBounds
    places: BodyPlaces  # at the rows of the bounds

    def touches(self, stream: Stream, parameters: F64, run: SampleRun | None) -> Touches | None:
        """Collect touched skin from the engine's contacts (``run``), and skin that is near.

        Parameters
        ----------
        parameters : (T, P) float64
            Of the effect, in its modality's ranges.
        run : SampleRun or None
            Contacts without a response; None: there are none.
        """
        assert self.effect.response is not None and self.effect.matrices is not None
        filters, rows = self.filters, self.rows
        controls = within_limits(filters, self.effect.response[rows])
        sets: dict[int, tuple[I32, F64]] = {}
        if run is not None:
            at = np.searchsorted(self.indices[rows], run.indices)
            for k, j in zip(at.tolist(), run.set_of.tolist(), strict=True):
                part = slice(int(run.offsets[j]), int(run.offsets[j + 1]))
                sets[k] = (run.vertices[part], run.weights[part].astype(np.float64))
        is_touched = np.zeros(len(rows), np.bool_)
        is_touched[list(sets)] = True
        speeds = self._speeds(sets, len(rows))
        values = np.ones((len(rows), len(filters)))
        for f, each in enumerate(filters):
            if each.kind is FilterKind.SPEED:
                values[:, f] = speed_value(speeds, controls[:, f])
            elif each.kind is FilterKind.IMPACT:
                values[:, f] = 0.0
            elif each.kind is FilterKind.SINE and each.about is About.TIME:
                turns = self.times_s[rows] * controls[:, f, 1]
                values[:, f] = sine_value(turns, controls[:, f])
            elif each.kind is FilterKind.PROXIMITY:
                values[:, f] = self._add_near(sets, controls[:, f], is_touched)
        if any(each.is_in_space for each in filters):
            sets = {k: self._in_space(k, *found, controls[k]) for k, found in sets.items()}
            sets = {k: found for k, found in sets.items() if len(found[0])}
            is_touched &= np.isin(np.arange(len(rows)), list(sets))
        kept = np.arange(len(rows))
        if not any(each.kind is FilterKind.IMPACT for each in filters):
            kept = np.array(sorted(sets), np.int64)
        if not len(kept):
            return None
        stored = {k: (each[0], each[1].astype(np.float32)) for k, each in sets.items()}
        set_of, offsets, vertices, weights = packed(map(stored.get, kept.tolist()))
        return Touches(
            stream,
            filters,
            self.indices[rows[kept]],
            self.times_s[rows[kept]],
            np.clip(self.effect.levels[rows[kept]], 0.0, 1.0),
            parameters[rows[kept]],
            controls[kept],
            values[kept],
            is_touched[kept],
            speeds[kept],
            set_of,
            offsets,
            vertices,
            weights,
        )

    def _speeds(self, sets: dict[int, tuple[I32, F64]], count: int) -> F64:
        """Mean speed of touched skin against the volume since the sample before, (n,) m/s."""
        speeds = np.zeros(count)
        if not sets or all(
            each.kind not in (FilterKind.SPEED, FilterKind.IMPACT) for each in self.filters
        ):
            return speeds
        assert self.effect.matrices is not None
        posed = frozenset(self.posed.tolist())
        for k, (vertices, weights) in sets.items():
            row = int(self.rows[k])
            # Without a sample before it nothing has a speed; bad places are told by contacts.
            if row == 0 or row - 1 not in posed or not self.effect.levels[row - 1] > 0.0:
                continue
            if self.indices[row - 1] != self.indices[row] - 1:
                continue
            pair = self.effect.matrices[row - 1 : row + 1]
            inverses, usable = inverse_placement(pair)
            step_s = self.times_s[row] - self.times_s[row - 1]
            if not usable.all() or not step_s > 0.0:
                continue
            before, here = (
                self.skin.vertices.points(vertices, self.pose, r, inverse @ self.pose.to_world[r])
                for r, inverse in ((row - 1, inverses[0]), (row, inverses[1]))
            )
            way = pair[1, :3, :3] @ (here - before)
            lengths = np.sqrt(np.einsum("in,in->n", way, way))
            speeds[k] = float(weights @ lengths / weights.sum()) / step_s
        return speeds

    def _add_near(self, sets: dict[int, tuple[I32, F64]], controls: F64, is_touched: Bool) -> F64:
        """Add the skin within the range before contact to the sets; returns its nearness, (n,)."""
        assert self.effect.matrices is not None
        nearness = is_touched.astype(np.float64)
        matrices = self.effect.matrices[self.rows]
        boxes = boxes_at(self.effect, self.rows)
        reach = controls[:, 1, None]
        at = np.searchsorted(self.bounds.rows, self.rows)
        low, high = (boxes[:, 0] - reach)[:, None], (boxes[:, 1] + reach)[:, None]
        candidates = (self.bounds.low[at] <= high) & (self.bounds.high[at] >= low)
        candidates = candidates.all(axis=2) & (controls[:, 0] > 0.0)[:, None]
        some = np.flatnonzero(candidates.any(axis=1))
        inverses = np.zeros_like(matrices)
        inverses[some], usable = inverse_placement(matrices[some])
        candidates[some[~usable]] = False
        found: list[tuple[I64, I32, F64]] = []
        for cluster in np.flatnonzero(candidates.any(axis=0)).tolist():
            mine = np.flatnonzero(candidates[:, cluster])
            world = self.places.of(cluster)[:, at[mine]]
            local = np.einsum("nij,jnv->inv", inverses[mine, :3, :3], world)
            local += inverses[mine, :3, 3].T[:, :, None]
            near = proximity_value(self._distances(mine, local, matrices), controls[mine])
            i, v = np.nonzero(near > 0.0)
            vertices = self.skin.skin.clusters[cluster][v].astype(np.int32)
            found.append((mine[i], vertices, near[i, v]))
        if not found:
            return nearness
        rows, ids, near = (np.concatenate(each) for each in zip(*found, strict=True))
        order = np.lexsort((ids, rows))
        rows, ids, near = rows[order], ids[order], near[order]
        ends = np.searchsorted(rows, np.arange(len(self.rows) + 1))
        for k in np.unique(rows).tolist():
            part = slice(int(ends[k]), int(ends[k + 1]))
            peak = 1.0 if is_touched[k] else float(near[part].max())
            nearness[k] = max(nearness[k], peak)
            sets[k] = strongest(sets.get(k), ids[part], near[part] / peak)
        return nearness

    def _distances(self, mine: I64, local: F64, matrices: F64) -> F64:
        """Distances (n, V) to the volume of points (3, n, V) in its shape space."""
        index = self.effect.shape_index
        if index is None:
            return distances_m(self.effect.shapes[0], local, matrices[mine])
        which = index[self.rows[mine]]
        distances = np.zeros(local.shape[1:])
        for shape in np.unique(which).tolist():
            rows = np.flatnonzero(which == shape)
            distances[rows] = distances_m(
                self.effect.shapes[shape], local[:, rows], matrices[mine[rows]]
            )
        return distances

    def _in_space(self, k: int, vertices: I32, weights: F64, controls: F64) -> tuple[I32, F64]:
        """Weights times the filters that have a value for each vertex."""
        assert self.effect.matrices is not None
        row = int(self.rows[k])
        points = self.skin.vertices.points(vertices, self.pose, row, self.pose.to_world[row])
        matrix = self.effect.matrices[row]
        offsets = points - matrix[:3, 3:]
        for f, each in enumerate(self.filters):
            if not each.is_in_space:
                continue
            distances = _distances(offsets, matrix[:3, 2] if each.about is About.AXIS else None)
            if each.kind is FilterKind.DISTANCE:
                value = distance_value(distances, controls[f])
            else:
                value = sine_value(distances / max(float(controls[f, 1]), 1e-6), controls[f])
            weights = weights * mixed(value, controls[f, 0])
        felt = weights > 0.0
        return vertices[felt], weights[felt]


def boxes_at(effect: EffectBlock, rows: I64) -> F64:
    """World boxes of a volume at some rows, (n, 2, 3)."""
    assert effect.matrices is not None
    which, matrices = effect.shapes_at(rows), effect.matrices[rows]
    boxes = np.zeros((len(rows), 2, 3))
    for shape in np.unique(which).tolist():
        mine = which == shape
        boxes[mine] = world_bounds(effect.shapes[shape], matrices[mine])
    return boxes


def _distances(offsets: F64, axis: F64 | None) -> F64:
    """Distances from the origin, or from an axis through it, (n,)."""
    if axis is not None:
        length = float(np.sqrt(axis @ axis))
        if length > 0.0:
            unit = axis / length
            offsets = offsets - unit[:, None] * (unit @ offsets)
    return np.asarray(np.sqrt(np.einsum("in,in->n", offsets, offsets)))


def strongest(known: tuple[I32, F64] | None, vertices: I32, weights: F64) -> tuple[I32, F64]:
    """Union of two weighted sets of vertices, with the larger weight of each."""
    if known is None:
        return vertices, weights
    ids = np.concatenate([known[0], vertices])
    order = np.argsort(ids, kind="stable")
    ids, values = ids[order], np.concatenate([known[1], weights])[order]
    first = np.flatnonzero(np.concatenate([[True], ids[1:] != ids[:-1]]))
    return ids[first], np.maximum.reduceat(values, first) if len(first) else values


def packed(sets: Iterable[WeightedSet | None]) -> tuple[I64, I64, I32, F32]:
    """Pack sets into columns: number of each set, offsets, vertices and weights.

    Equal successive sets are stored once; the number of None is -1.
    """
    numbers: list[int] = []
    stored: list[WeightedSet] = []
    for each in sets:
        if each is None:
            numbers.append(-1)
            continue
        if not stored or not _equal(stored[-1], each):
            stored.append(each)
        numbers.append(len(stored) - 1)
    offsets = np.concatenate([[0], np.cumsum([len(v) for v, _ in stored])]).astype(np.int64)
    return (
        np.array(numbers, np.int64),
        offsets,
        np.concatenate([np.zeros(0, np.int32), *(v for v, _ in stored)]),
        np.concatenate([np.zeros(0, np.float32), *(w for _, w in stored)]),
    )


def _equal(one: WeightedSet, other: WeightedSet) -> bool:
    return (one[0] is other[0] and one[1] is other[1]) or (
        np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1])
    )
