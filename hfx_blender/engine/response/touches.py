# SPDX-License-Identifier: GPL-3.0-or-later
"""Stateless part of responses: touched and near skin, speeds, filter values.

Without memory, blocks can be evaluated anywhere and in any order.
"""

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
from ..volume.shape import inverse_placement, world_bounds
from .motion_estimate import MotionEstimate

WeightedSet = tuple[I32, F32]  # ascending vertices and the weights


@dataclass(frozen=True, eq=False)
class Between:
    """Moments between samples with touched skin, in the order of time."""

    rows: I64  # (m,) of the samples after the moments
    times_s: F64  # (m,)
    set_of: I64  # (m,) set numbers

    def part(self, rows: slice) -> "Between":
        """Moments in the intervals before the samples ``rows`` (a slice), with rows counted from
        the slice's start."""
        first, last = np.searchsorted(self.rows, [rows.start, rows.stop]).tolist()
        part = slice(first, last)
        return Between(self.rows[part] - rows.start, self.times_s[part], self.set_of[part])


_NOTHING: Final = Between(np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class Touches:
    """Contact of a volume and a body at n times, before the response's memory. With impacts, all
    times with the effect on are included, because an impact may still be felt; otherwise times with
    touched or near skin only."""

    stream: Stream
    filters: tuple[Filter, ...]
    indices: I64  # (n,) sample indices, ascending
    times_s: F64  # (n,)
    levels: F64  # (n,) activation times intensity, 0..1
    parameters: F64  # (n, P)
    controls: F64  # (n, F, WIDTH)
    values: F64  # (n, F) by filter; 0 for impacts, 1 for filters in space
    is_touched: Bool  # (n,)
    speeds_m_s: F64  # (n,) relative speed of skin and volume; 0 if unknown
    set_of: I64  # (n,) -1 without touched and near skin
    offsets: I64  # (m + 1,) set j has entries offsets[j] to offsets[j + 1]
    vertices: I32  # (total,) ascending within a set
    weights: F32  # (total,) in (0, 1]
    onsets_s: F64 | None = None  # (n,) beginning of a touch since the sample before, else NaN
    between: Between = _NOTHING  # only with impacts
    resumes_s: float = 0.0  # longest pause within a touch, seconds

    def __len__(self) -> int:
        return len(self.indices)

    def part(self, rows: slice) -> "Touches":
        """Touches at times ``rows`` (a slice), with all vertex sets."""
        columns = {
            name: getattr(self, name)[rows] for name in _COLUMNS if getattr(self, name) is not None
        }
        return replace(self, **columns, between=self.between.part(rows))

    def weighted_set(self, number: int) -> WeightedSet:
        """Vertices and weights of set ``number`` (0 or more), as views."""
        part = slice(int(self.offsets[number]), int(self.offsets[number + 1]))
        return self.vertices[part], self.weights[part]


_COLUMNS: Final = (
    *("indices", "times_s", "levels", "parameters", "controls", "values", "is_touched"),
    *("speeds_m_s", "set_of", "onsets_s"),
)
"""Fields of :class:`Touches` with a row for each time."""


class BodyPlaces:
    """World positions of a body's clusters over a block, computed on demand."""

    def __init__(self, skin: BodySkin, pose: PoseBlock, rows: I64) -> None:
        self._skin = skin
        self._pose = pose
        self._rows = rows  # rows with a known pose
        self._known: dict[int, F64] = {}
        # Motion between samples, estimated and computed, shared by all volumes.
        self.paths: dict[tuple[str, int, int, int], MotionEstimate] = {}
        self.motion: dict[tuple[str, int, bytes], F64] = {}

    def of(self, cluster: int) -> F64:
        """World positions (3, rows, vertices) of a cluster in metres, at all rows with a pose;
        cached."""
        if cluster not in self._known:
            self._known[cluster] = self._skin.vertices.cluster_points(
                cluster, self._pose, self._rows, self._pose.to_world[self._rows]
            )
        return self._known[cluster]


@dataclass(frozen=True, eq=False)
class Moments:
    """A volume and a body over rows of a block."""

    effect: EffectBlock
    filters: tuple[Filter, ...]
    rows: I64  # (n,) with the effect on and a known pose
    indices: I64  # (T,) of the block
    times_s: F64  # (T,) of the block
    posed: I64  # rows with a known pose
    skin: BodySkin
    pose: PoseBlock
    bounds: ReachableBounds
    places: BodyPlaces  # at the rows of the bounds

    def touches(self, stream: Stream, parameters: F64, run: SampleRun | None) -> Touches | None:
        """Touched and near skin with filter values, from contacts ``run`` before the response
        (None: none). None without any time: with impacts all rows are times, otherwise those with
        touched or near skin. ``parameters`` (T, P) of the effect are clamped to the modality's
        ranges."""
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
        for f, filter_ in enumerate(filters):
            if filter_.kind is FilterKind.SPEED:
                values[:, f] = speed_value(speeds, controls[:, f])
            elif filter_.kind is FilterKind.IMPACT:
                values[:, f] = 0.0
            elif filter_.kind is FilterKind.SINE and filter_.about is About.TIME:
                turns = self.times_s[rows] * controls[:, f, 1]
                values[:, f] = sine_value(turns, controls[:, f])
            elif filter_.kind is FilterKind.PROXIMITY:
                values[:, f] = self._add_near(sets, controls[:, f], is_touched)
        if any(filter_.is_in_space for filter_ in filters):
            sets = {k: self._in_space(k, *pair, controls[k]) for k, pair in sets.items()}
            sets = {k: pair for k, pair in sets.items() if len(pair[0])}
            is_touched &= np.isin(np.arange(len(rows)), list(sets))
        # With impacts, times without skin count as well: an impact may still ring.
        times = np.arange(len(rows))
        if not any(filter_.kind is FilterKind.IMPACT for filter_ in filters):
            times = np.array(sorted(sets), np.int64)
        if not len(times):
            return None
        stored = {k: (ids, values.astype(np.float32)) for k, (ids, values) in sets.items()}
        set_of, offsets, vertices, weights = packed(map(stored.get, times.tolist()))
        return Touches(
            stream,
            filters,
            self.indices[rows[times]],
            self.times_s[rows[times]],
            np.clip(self.effect.levels[rows[times]], 0.0, 1.0),
            parameters[rows[times]],
            controls[times],
            values[times],
            is_touched[times],
            speeds[times],
            set_of,
            offsets,
            vertices,
            weights,
        )

    def _speeds(self, sets: dict[int, tuple[I32, F64]], count: int) -> F64:
        """Mean speed (n,) of touched skin relative to the volume since the sample before, weighted,
        m/s. 0 if unknown: no such sample, effect off there, no pose; for stacks without speed and
        impact; and for impacts alone after touched samples."""
        speeds = np.zeros(count)
        kinds = {filter_.kind for filter_ in self.filters}
        if not kinds & {FilterKind.SPEED, FilterKind.IMPACT}:
            return speeds
        # An impact has the speed of its beginning. Filters in space may end a touch, so that
        # another one begins after a sample in contact.
        is_every = FilterKind.SPEED in kinds or any(one.is_in_space for one in self.filters)
        assert self.effect.matrices is not None
        posed = frozenset(self.posed.tolist())
        for k, (vertices, weights) in sets.items():
            row = int(self.rows[k])
            if not is_every and k - 1 in sets and self.rows[k - 1] == row - 1:
                continue
            # A speed needs the sample before; unusable placements are reported by contacts.
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
            # Displacement in shape space, mapped by the present placement: the motion of the volume
            # itself cancels.
            way = pair[1, :3, :3] @ (here - before)
            lengths = np.sqrt(np.einsum("in,in->n", way, way))
            speeds[k] = float(weights @ lengths / weights.sum()) / step_s
        return speeds

    def _add_near(self, sets: dict[int, tuple[I32, F64]], controls: F64, is_touched: Bool) -> F64:
        """Add skin within the range of a proximity filter to ``sets`` by row, in place, with
        weights relative to the strongest; returns nearness (n,): 1 if touched, else that of the
        nearest vertex, 0 if none. ``controls`` (n, WIDTH)."""
        assert self.effect.matrices is not None
        nearness = is_touched.astype(np.float64)
        matrices = self.effect.matrices[self.rows]
        boxes = boxes_at(self.effect, self.rows)
        reach = controls[:, 1, None]
        at = np.searchsorted(self.bounds.rows, self.rows)
        low, high = (boxes[:, 0] - reach)[:, None], (boxes[:, 1] + reach)[:, None]
        # Boxes first: exact distances only for clusters within reach.
        candidates = (self.bounds.low[at] <= high) & (self.bounds.high[at] >= low)
        candidates = candidates.all(axis=2) & (controls[:, 0] > 0.0)[:, None]
        candidate_rows = np.flatnonzero(candidates.any(axis=1))
        inverses = np.zeros_like(matrices)
        inverses[candidate_rows], usable = inverse_placement(matrices[candidate_rows])
        candidates[candidate_rows[~usable]] = False
        parts: list[tuple[I64, I32, F64]] = []
        for cluster in np.flatnonzero(candidates.any(axis=0)).tolist():
            at_rows = np.flatnonzero(candidates[:, cluster])
            world = self.places.of(cluster)[:, at[at_rows]]
            local = np.einsum("nij,jnv->inv", inverses[at_rows, :3, :3], world)
            local += inverses[at_rows, :3, 3].T[:, :, None]
            near = proximity_value(self._distances(at_rows, local, matrices), controls[at_rows])
            i, v = np.nonzero(near > 0.0)
            vertices = self.skin.skin.clusters[cluster][v].astype(np.int32)
            parts.append((at_rows[i], vertices, near[i, v]))
        if not parts:
            return nearness
        rows, ids, near = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        order = np.lexsort((ids, rows))
        rows, ids, near = rows[order], ids[order], near[order]
        ends = np.searchsorted(rows, np.arange(len(self.rows) + 1))
        for k in np.unique(rows).tolist():
            part = slice(int(ends[k]), int(ends[k + 1]))
            # Weights are relative to the strongest vertex, nearness is the level.
            peak = 1.0 if is_touched[k] else float(near[part].max())
            nearness[k] = max(nearness[k], peak)
            sets[k] = strongest(sets.get(k), ids[part], near[part] / peak)
        return nearness

    def _distances(self, mine: I64, local: F64, matrices: F64) -> F64:
        """Distances (n, V) from the volume, metres, of points (3, n, V) in shape space at rows
        ``mine`` (n,)."""
        which = self.effect.shapes_at(self.rows[mine])
        distances = np.zeros(local.shape[1:])
        for shape in np.unique(which).tolist():
            rows = np.flatnonzero(which == shape)
            distances[rows] = distances_m(
                self.effect.shapes[shape], local[:, rows], matrices[mine[rows]]
            )
        return distances

    def _in_space(self, k: int, vertices: I32, weights: F64, controls: F64) -> tuple[I32, F64]:
        """Vertices and weights of row ``k`` times all filters in space (distance, spatial sine),
        blended by influence; vertices with weight 0 are dropped. ``controls`` (F, WIDTH)."""
        assert self.effect.matrices is not None
        row = int(self.rows[k])
        points = self.skin.vertices.points(vertices, self.pose, row, self.pose.to_world[row])
        matrix = self.effect.matrices[row]
        # Distances in space are from the volume's origin, or from its z axis.
        offsets = points - matrix[:3, 3:]
        for f, filter_ in enumerate(self.filters):
            if not filter_.is_in_space:
                continue
            distances = _distances(offsets, matrix[:3, 2] if filter_.about is About.AXIS else None)
            if filter_.kind is FilterKind.DISTANCE:
                value = distance_value(distances, controls[f])
            else:
                value = sine_value(distances / max(float(controls[f, 1]), 1e-6), controls[f])
            weights = weights * mixed(value, controls[f, 0])
        is_felt = weights > 0.0
        return vertices[is_felt], weights[is_felt]


def boxes_at(effect: EffectBlock, rows: I64) -> F64:
    """World boxes (n, 2, 3) of a volume at rows (n,): lowest and highest corner, metres."""
    assert effect.matrices is not None
    which, matrices = effect.shapes_at(rows), effect.matrices[rows]
    boxes = np.zeros((len(rows), 2, 3))
    for shape in np.unique(which).tolist():
        mine = which == shape
        boxes[mine] = world_bounds(effect.shapes[shape], matrices[mine])
    return boxes


def _distances(offsets: F64, axis: F64 | None) -> F64:
    """Distances (n,) of offsets (3, n) from the origin, or from an axis through the origin."""
    if axis is not None:
        length = float(np.sqrt(axis @ axis))
        if length > 0.0:
            unit = axis / length
            offsets = offsets - unit[:, None] * (unit @ offsets)
    return np.asarray(np.sqrt(np.einsum("in,in->n", offsets, offsets)))


def strongest(known: tuple[I32, F64] | None, vertices: I32, weights: F64) -> tuple[I32, F64]:
    """Union, ascending, of two weighted sets of vertices with the larger weight of each vertex;
    ``known`` None: the second set itself."""
    if known is None:
        return vertices, weights
    ids = np.concatenate([known[0], vertices])
    order = np.argsort(ids, kind="stable")
    ids, values = ids[order], np.concatenate([known[1], weights])[order]
    first = np.flatnonzero(np.concatenate([[True], ids[1:] != ids[:-1]]))
    return ids[first], np.maximum.reduceat(values, first) if len(first) else values


def packed(
    sets: Iterable[WeightedSet | None], *, own_sets: bool = False
) -> tuple[I64, I64, I32, F32]:
    """Pack N sets into columns: set numbers (N,), offsets (m + 1,), vertices and weights (total,).
    Equal successive sets are stored once, unless ``own_sets``; None gets the number -1."""
    numbers: list[int] = []
    stored: list[WeightedSet] = []
    for weighted_set in sets:
        if weighted_set is None:
            numbers.append(-1)
            continue
        if own_sets or not stored or not all(map(np.array_equal, stored[-1], weighted_set)):
            stored.append(weighted_set)
        numbers.append(len(stored) - 1)
    offsets = np.concatenate([[0], np.cumsum([len(v) for v, _ in stored])]).astype(np.int64)
    return (
        np.array(numbers, np.int64),
        offsets,
        np.concatenate([np.zeros(0, np.int32), *(v for v, _ in stored)]),
        np.concatenate([np.zeros(0, np.float32), *(w for _, w in stored)]),
    )
