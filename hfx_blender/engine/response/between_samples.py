# SPDX-License-Identifier: GPL-3.0-or-later
"""Impacts between two samples: when they begin, how fast, and the deepest contact.

An impact's strength follows from its beginning, and its place from its deepest moment, so both
would depend on the sampling rate if they were looked for at samples only. Where a touch begins,
where it is deepest at a sample beside, and where a volume may have touched and turned back in
between, contacts are found at steps of half a millisecond, along :mod:`.paths`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from typing import Final

import numpy as np

from ..arrays import F32, F64, I32, I64, Bool
from ..contact.reachable_bounds import bends_m, bounds_of
from ..samples import SampleRun
from ..scene import EffectBlock, PoseBlock
from ..volume.mesh import MeshVolume
from .paths import NEIGHBOURS, Path
from .touches import BodyPlaces, Moments, Touches, boxes_at, strongest

STEP_S: Final = 0.0005
"""Time between two steps, seconds; rates that divide 2000 Hz have them at the same times."""

_MOST_STEPS: Final = 100  # of an interval: at rates below 20 Hz they are longer
_FINER: Final = 16  # parts of a step, for the beginning of a touch
_LEAST_M: Final = 1e-4  # a smaller way beside the straight one touches no skin worth telling

Contacts = Callable[[Moments, Bool], SampleRun | None]
"""Contacts of the volume at the rows of moments, without its response. The second argument (n,)
tells which rows follow the one before, as in :class:`.contact_query.ContactQuery`."""


@dataclass(frozen=True, eq=False)
class _Steps:
    """Contacts at steps of some intervals, each with its start and its end, without filters."""

    run: SampleRun | None
    rows: I64  # (k,) of the steps, interval by interval, that the run has samples for
    shares: F64  # (n, S + 1) of the intervals
    sums: F64  # (n, S + 1) of the weights

    @property
    def is_touched(self) -> Bool:
        """Steps (n, S + 1) at which skin is touched; the start counts as none."""
        touched = self.sums > 0.0
        touched[:, 0] = False
        return touched


def refined(
    moments: Moments,
    touches: Touches,
    parameters: F64,
    contacts: Contacts,
    *,
    is_live: bool,
) -> Touches:
    """Touches of a volume with impacts, with what happened since the sample before.

    Live, nothing is known of later samples: motion is straight, and only the time at which a
    touch begins is found; its speed is that since the sample before.
    """
    follows = _follows(moments)
    before = np.concatenate([[False], touches.is_touched[:-1]])
    begins = touches.is_touched & ~before & follows
    grazes = np.zeros(len(touches), np.bool_)
    deepest = grazes
    if not is_live:
        grazes = ~touches.is_touched & ~before & follows
        grazes &= _may_touch(moments, grazes & may_graze(moments), contacts)
        deepest = _is_deepest(touches, follows)
    chosen = np.flatnonzero(begins | grazes | deepest)
    if not len(chosen):
        return touches
    rows = moments.rows[chosen]
    length_s = moments.times_s[rows] - moments.times_s[rows - 1]
    count = min(max(ceil(float(length_s.max()) / STEP_S - 1e-6), 2), _MOST_STEPS)
    intervals = _Intervals(moments, chosen, parameters, contacts, is_straight=is_live)
    every = np.arange(len(chosen))
    steps = intervals.steps(every, np.tile(np.linspace(0.0, 1.0, count + 1), (len(chosen), 1)))
    touched = steps.is_touched
    is_some = touched.any(axis=1)
    new = np.flatnonzero(begins[chosen] | (grazes[chosen] & is_some))
    deep = np.flatnonzero(is_some) if not is_live else new[:0]
    # Where a touch begins, and where it is deepest, a second time, closer.
    first = np.where(is_some, touched.argmax(axis=1), count)[new]
    most = np.where(touched, steps.sums, 0.0)[deep].argmax(axis=1)
    low = np.concatenate([steps.shares[new, first - 1], steps.shares[deep, most - 1]])
    at_most = np.minimum(most + 1, count)
    high = np.concatenate([steps.shares[new, first], steps.shares[deep, at_most]])
    which = np.concatenate([new, deep])
    if not len(which):
        return touches
    finer = intervals.steps(which, np.linspace(low, high, _FINER + 1, axis=1))
    is_in = finer.is_touched[: len(new)]
    is_in[:, -1] = True
    onset = finer.shares[np.arange(len(new)), is_in.argmax(axis=1)]
    onsets = np.full(len(touches), np.nan)
    onsets[chosen[new]] = moments.times_s[rows[new]] - (1.0 - onset) * length_s[new]
    touches = replace(touches, onsets_s=onsets)
    if is_live:
        return touches
    deepest_at = finer.sums[len(new) :].argmax(axis=1)
    deepest_share = finer.shares[len(new) + np.arange(len(deep)), deepest_at]
    begun = steps.shares[new, first]
    ends = np.concatenate([begun, deepest_share])
    back = np.minimum(1.0 / count, ends)
    found = intervals.answered(which, np.stack([ends - back, ends], axis=1))
    if found is None:
        return touches
    speeds = touches.speeds_m_s.copy()
    speeds[chosen[new]] = found.speeds_m_s[1 : 2 * len(new) : 2]
    peaks = _Peaks(replace(touches, speeds_m_s=speeds))
    for k, n in enumerate(deep.tolist()):
        peaks.add(int(chosen[n]), found.set_of_row(2 * (len(new) + k) + 1))
        if not any(each.is_in_space for each in moments.filters):
            peaks.add_all(int(chosen[n]), steps, n)
            peaks.add_all(int(chosen[n]), finer, len(new) + k)
    return peaks.touches(grazes)


def may_graze(moments: Moments) -> Bool:
    """Rows (n,) before which a volume may have touched skin on a bent way, near it at both ends.

    Told from boxes: of the volume, and of the body's clusters.
    """
    assert moments.effect.matrices is not None
    rows, found = moments.rows, np.zeros(len(moments.rows), np.bool_)
    if len(rows) < 3:
        return found
    bounds, follows = moments.bounds, _follows(moments)
    at = np.searchsorted(bounds.rows, rows)
    boxes = boxes_at(moments.effect, rows)
    beside = bends_m(boxes, follows)
    most = float(beside.max(initial=0.0)) + float(bounds.bends_m.max(initial=0.0))
    if not most > _LEAST_M:
        return found
    meets = _meets(boxes, bounds.of_rows[at], most)
    for k in np.flatnonzero(meets & follows).tolist():
        reach = beside[k] + bounds.bends_m[at[k]]
        for row in (k - 1, k):
            low, high = bounds.low[at[row]], bounds.high[at[row]]
            overlaps = (boxes[row, 0] - reach[:, None] <= high).all(axis=1)
            overlaps &= (boxes[row, 1] + reach[:, None] >= low).all(axis=1)
            found[k] |= bool((overlaps & (reach > _LEAST_M)).any())
    return found


def _may_touch(moments: Moments, grazes: Bool, contacts: Contacts) -> Bool:
    """Select rows (n,) at which a volume larger by half of its way, and all beside, is touched."""
    effect, chosen = moments.effect, np.flatnonzero(grazes)
    if not len(chosen) or any(isinstance(each, MeshVolume) for each in effect.shapes):
        return grazes
    assert effect.matrices is not None
    bounds, rows = moments.bounds, moments.rows
    at, boxes = np.searchsorted(bounds.rows, rows), boxes_at(effect, rows)
    beside = bends_m(boxes, _follows(moments))[chosen] + bounds.bends_m[at[chosen]].max(axis=1)
    ways = np.abs(boxes[chosen] - boxes[chosen - 1]).max(axis=(1, 2))
    moved = np.abs(bounds.low[at[chosen]] - bounds.low[at[chosen - 1]]).max(axis=(1, 2))
    more = np.zeros(len(rows))
    for part in (chosen, chosen - 1):
        more[part] = np.maximum(more[part], beside + 0.5 * (ways + moved))
    grown = effect.matrices.copy()
    lengths = np.maximum(np.linalg.norm(grown[rows, :3, :3], axis=1), 1e-9)
    grown[rows, :3, :3] *= (1.0 + more[:, None] / lengths)[:, None, :]
    near = np.union1d(chosen, chosen - 1)
    larger = replace(moments, effect=replace(effect, matrices=grown), rows=rows[near])
    run = contacts(larger, np.zeros(len(near), np.bool_))
    is_near = np.zeros(len(rows), np.bool_)
    if run is not None:
        is_near[np.isin(moments.indices[rows], run.indices)] = True
    return grazes & (is_near | np.concatenate([[False], is_near[:-1]]))


def _meets(boxes: F64, bodies: F64, reach: float) -> Bool:
    """Test whether boxes (n, 2, 3) come within a reach at a row or the one before."""
    both = []
    for part in (slice(None, -1), slice(1, None)):
        low = boxes[part, 0] - reach <= bodies[part, 1]
        high = boxes[part, 1] + reach >= bodies[part, 0]
        both.append((low & high).all(axis=1))
    return np.concatenate([[False], both[0] | both[1]])


def _follows(moments: Moments) -> Bool:
    """Rows (n,) that follow the one before: at the next sample, where the effect was on."""
    rows = moments.rows
    steps = (np.diff(rows) == 1) & (np.diff(moments.indices[rows]) == 1)
    return np.concatenate([[False], steps])


def _is_deepest(touches: Touches, follows: Bool) -> Bool:
    """Rows (n,) before which, or one before, a touch was deepest: between them may be deeper."""
    parts = np.concatenate([[0.0], np.cumsum(touches.weights, dtype=np.float64)])
    sums = parts[touches.offsets[1:]] - parts[touches.offsets[:-1]]
    depth = np.where(touches.is_touched, sums[touches.set_of] if len(sums) else 0.0, 0.0)
    before = np.concatenate([[0.0], depth[:-1]])
    after = np.concatenate([depth[1:], [0.0]])
    is_peak = (depth > 0.0) & (depth >= before) & (depth >= after)
    is_peak &= (depth > before) | (depth > after)
    known = follows & np.concatenate([follows[1:], [False]])
    is_peak &= known
    peaks: Bool = (is_peak | np.concatenate([[False], is_peak[:-1]])) & follows
    return peaks


class _Intervals:
    """Intervals that end at some rows of moments, and the motion over them.

    Parameters
    ----------
    moments : Moments
    chosen : (n,) int64
        Places among its rows.
    parameters : (T, P) float64
        Of the effect.
    contacts : callable
    is_straight : bool
        Whether motion is straight, whatever the samples beside.
    """

    def __init__(
        self,
        moments: Moments,
        chosen: I64,
        parameters: F64,
        contacts: Contacts,
        *,
        is_straight: bool,
    ) -> None:
        self._moments = moments
        self._parameters = parameters
        self._own: dict[tuple[str, int, int, int], Path] = {}
        self._contacts = contacts
        self._rows = moments.rows[chosen]
        follows = np.concatenate([_follows(moments), [False]])
        # Numbers of samples that are known on either side, with the interval's own end.
        self._before = 1 + _chain(follows, chosen, -1, is_straight)
        self._after = 1 + _chain(follows, chosen + 1, 1, is_straight)

    def steps(self, which: I64, shares: F64) -> _Steps:
        """Contacts at shares (n, S + 1) of some of the intervals."""
        closer = self._closer(which, shares)
        run = self._contacts(closer, closer.rows % shares.shape[1] != 0)
        sums, rows = np.zeros(shares.size), np.zeros(0, np.int64)
        if run is not None:
            rows = np.searchsorted(closer.indices, run.indices)
            sums[rows] = np.add.reduceat(run.weights, run.offsets[:-1])[run.set_of]
        return _Steps(run, rows, shares, sums.reshape(shares.shape))

    def answered(self, which: I64, shares: F64) -> Touches | None:
        """Touches at shares (n, S + 1) of some of the intervals, with the filters."""
        closer = self._closer(which, shares)
        run = self._contacts(closer, closer.rows % shares.shape[1] != 0)
        if run is None:
            return None
        return closer.touches(run.stream, closer.effect.parameters, run)

    def _closer(self, which: I64, shares: F64) -> Moments:
        """Moments at shares (n, S + 1) of some of the intervals."""
        moments, count = self._moments, shares.shape[1]
        effect, pose = moments.effect, moments.pose
        assert effect.matrices is not None
        ends = np.repeat(self._rows[which], count)
        s = shares.ravel()
        # Column by column: what bounces may go on turning as it did.
        columns = effect.matrices.transpose(0, 2, 1), pose.to_world.transpose(0, 2, 1)
        matrices = self._path("matrices", columns[0], which, shares).transpose(0, 2, 1)
        to_world = self._path("to_world", columns[1], which, shares).transpose(0, 2, 1)
        bones: F64 | None = None
        surface: F32 | None = None
        if pose.bones is not None:
            own = pose.bones.reshape(len(pose.bones), -1, 12)
            bones = self._path("bones", own, which, shares).reshape(len(s), -1, 3, 4)
        if pose.surface is not None:
            skin = self._path("surface", pose.surface, which, shares).reshape(len(s), -1, 3)
            surface = skin.astype(np.float32)
        response = effect.response
        if response is not None:
            mix = s[:, None, None]
            response = (1.0 - mix) * response[ends - 1] + mix * response[ends]
        between_ends = EffectBlock(
            (1.0 - s) * effect.levels[ends - 1] + s * effect.levels[ends],
            self._parameters[ends],
            np.ascontiguousarray(matrices),
            effect.shapes,
            None if effect.shape_index is None else effect.shape_index[ends],
            response=response,
        )
        posed = PoseBlock(np.ones(len(s), np.bool_), np.ascontiguousarray(to_world), bones, surface)
        rows = np.arange(len(s))
        times = moments.times_s
        return replace(
            moments,
            effect=between_ends,
            rows=rows,
            indices=rows + rows // count,
            times_s=times[ends - 1] + (times[ends] - times[ends - 1]) * s,
            posed=rows,
            pose=posed,
            bounds=bounds_of(moments.skin, posed, rows),
            places=BodyPlaces(moments.skin, posed, rows),
        )

    def _path(self, name: str, values: F64 | F32, which: I64, shares: F64) -> F64:
        """Values (T, N, D) of the block at shares (n, S) of some intervals, (n S, N, D)."""
        if len(values) and (values == values[0]).all():
            still = values[0].astype(np.float64)
            return np.broadcast_to(still, (shares.size, *still.shape))
        # A body moves alike for all volumes.
        known = self._own if name == "matrices" else self._moments.places.paths
        parts = []
        for n, mine in zip(which.tolist(), shares, strict=True):
            row, before, after = (int(each[n]) for each in (self._rows, self._before, self._after))
            key = name, row, before, after
            if key not in known:
                known[key] = Path(
                    [values[row - 1 - k].astype(np.float64) for k in range(before)],
                    [values[row + k].astype(np.float64) for k in range(after)],
                )
            parts.append(known[key].at(mine))
        return np.concatenate(parts)


def _chain(follows: Bool, at: I64, way: int, is_straight: bool) -> I64:
    """Numbers of samples beside intervals that are known, (n,) up to :data:`NEIGHBOURS`."""
    count, known = np.zeros(len(at), np.int64), np.full(len(at), not is_straight)
    for k in range(NEIGHBOURS):
        place = at - 1 - k if way < 0 else at + k
        known = known & follows[np.clip(place, 0, len(follows) - 1)] & (place >= 0)
        count += known
    return count


class _Peaks:
    """Largest weights between samples, added to touches."""

    def __init__(self, touches: Touches) -> None:
        self._touches = touches
        self._found: dict[int, tuple[I32, F64]] = {}

    def add(self, k: int, one: tuple[I32, F32] | None) -> None:
        """Take a set of the time before row ``k``."""
        if one is not None and len(one[0]):
            self._found[k] = strongest(self._found.get(k), one[0], one[1].astype(np.float64))

    def add_all(self, k: int, steps: _Steps, n: int) -> None:
        """Take all sets of the time before row ``k`` from the steps of interval ``n``."""
        run, count = steps.run, steps.shares.shape[1]
        if run is None or k not in self._found:
            return
        first, last = np.searchsorted(steps.rows, [n * count + 1, (n + 1) * count])
        for j in np.unique(run.set_of[first:last]).tolist():
            part = slice(int(run.offsets[j]), int(run.offsets[j + 1]))
            self.add(k, (run.vertices[part], run.weights[part]))

    def touches(self, grazes: Bool) -> Touches:
        """Touches with the peaks; a touch that was over at the later sample (n,) counts there."""
        touches, rows = self._touches, np.array(sorted(self._found), np.int64)
        if not len(rows):
            return touches
        sets = [self._found[k] for k in rows.tolist()]
        numbers = len(touches.offsets) - 1 + np.arange(len(rows))
        peak_of = np.full(len(touches), -1, np.int64)
        peak_of[rows] = numbers
        is_over = np.zeros(len(touches), np.bool_)
        is_over[rows] = grazes[rows]
        ends = touches.offsets[-1] + np.cumsum([len(vertices) for vertices, _ in sets])
        return replace(
            touches,
            peak_of=peak_of,
            set_of=np.where(is_over, peak_of, touches.set_of),
            is_touched=touches.is_touched | is_over,
            offsets=np.concatenate([touches.offsets, ends]),
            vertices=np.concatenate([touches.vertices, *(vertices for vertices, _ in sets)]),
            weights=np.concatenate(
                [touches.weights, *(weights.astype(np.float32) for _, weights in sets)]
            ),
        )
