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
from .paths import NEIGHBOURS, between
from .touches import BodyPlaces, Moments, Touches, boxes_at, strongest

STEP_S: Final = 0.0005
"""Time between two steps, seconds; rates that divide 2000 Hz have them at the same times."""

_MOST_STEPS: Final = 100  # of an interval: at rates below 20 Hz they are longer
_FINER: Final = 16  # parts of a step, for the beginning of a touch
_LEAST_M: Final = 1e-4  # a smaller way beside the straight one touches no skin worth telling

Contacts = Callable[[Moments, Bool, Bool], SampleRun | None]
"""Contacts of the volume at the rows of moments, without its response. ``follows`` and
``reported`` (n,) are as in :class:`.contact_query.ContactQuery`."""


@dataclass(frozen=True, eq=False)
class _Steps:
    """Touches at steps of some intervals, each with its start and its end."""

    touches: Touches | None
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
        grazes = ~touches.is_touched & ~before & follows & may_graze(moments)
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
    new = np.flatnonzero(begins[chosen] | (grazes[chosen] & touched.any(axis=1)))
    first = np.where(touched.any(axis=1), touched.argmax(axis=1), count)[new]
    onsets = np.full(len(touches), np.nan)
    onset = _onset(intervals, new, steps.shares[new, first - 1], steps.shares[new, first])
    onsets[chosen[new]] = moments.times_s[rows[new]] - (1.0 - onset) * length_s[new]
    if is_live or steps.touches is None:
        return replace(touches, onsets_s=onsets)
    speeds = touches.speeds_m_s.copy()
    speeds[chosen[new]] = steps.touches.speeds_m_s.reshape(steps.shares.shape)[new, first]
    deep = np.flatnonzero(touched.any(axis=1))
    at = np.where(touched, steps.sums, 0.0)[deep].argmax(axis=1)
    ends = steps.shares[deep, at - 1], steps.shares[deep, np.minimum(at + 1, count)]
    closer = intervals.steps(deep, np.linspace(*ends, _FINER + 1, axis=1)) if len(deep) else None
    peaks = _Peaks(replace(touches, onsets_s=onsets, speeds_m_s=speeds))
    for n in deep.tolist():
        peaks.add(int(chosen[n]), steps, n)
        if closer is not None:
            peaks.add(int(chosen[n]), closer, int(np.searchsorted(deep, n)))
    return peaks.touches(grazes)


def _onset(intervals: _Intervals, new: I64, low: F64, high: F64) -> F64:
    """Shares (n,) of intervals at which touches begin, between two steps."""
    if not len(new):
        return high
    shares = np.linspace(low, high, _FINER + 1, axis=1)
    touched = intervals.steps(new, shares).is_touched
    touched[:, -1] = True
    return np.asarray(shares[np.arange(len(new)), touched.argmax(axis=1)])


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
        self._contacts = contacts
        self._rows = moments.rows[chosen]
        follows = np.concatenate([_follows(moments), [False]])
        # Numbers of samples that are known on either side, with the interval's own end.
        self._before = 1 + _chain(follows, chosen, -1, is_straight)
        self._after = 1 + _chain(follows, chosen + 1, 1, is_straight)

    def steps(self, which: I64, shares: F64) -> _Steps:
        """Touches at shares (n, S + 1) of some of the intervals."""
        moments, count = self._moments, shares.shape[1]
        effect, pose = moments.effect, moments.pose
        assert effect.matrices is not None
        ends = np.repeat(self._rows[which], count)
        s = shares.ravel()
        matrices = self._path(effect.matrices.reshape(len(effect.matrices), 1, 16), which, shares)
        to_world = self._path(pose.to_world.reshape(len(pose.to_world), 1, 16), which, shares)
        bones = surface = None
        if pose.bones is not None:
            own = pose.bones.reshape(len(pose.bones), -1, 12)
            bones = self._path(own, which, shares).reshape(len(s), -1, 3, 4)
        if pose.surface is not None:
            surface = self._path(pose.surface, which, shares).astype(np.float32)
        response = effect.response
        if response is not None:
            mix = s[:, None, None]
            response = (1.0 - mix) * response[ends - 1] + mix * response[ends]
        fine = EffectBlock(
            (1.0 - s) * effect.levels[ends - 1] + s * effect.levels[ends],
            self._parameters[ends],
            matrices.reshape(-1, 4, 4),
            effect.shapes,
            None if effect.shape_index is None else effect.shape_index[ends],
            response=response,
        )
        posed = PoseBlock(np.ones(len(s), np.bool_), to_world.reshape(-1, 4, 4), bones, surface)
        rows = np.arange(len(s))
        times = moments.times_s
        length_s = (times[ends] - times[ends - 1]) * s
        bounds = bounds_of(moments.skin, posed, rows)
        closer = replace(
            moments,
            effect=fine,
            rows=rows,
            indices=rows + rows // count,
            times_s=times[ends - 1] + length_s,
            posed=rows,
            pose=posed,
            bounds=bounds,
            places=BodyPlaces(moments.skin, posed, rows),
        )
        follows = rows % count != 0
        run = self._contacts(closer, follows, np.ones(len(rows), np.bool_))
        sums = np.zeros(len(rows))
        found = None if run is None else closer.touches(run.stream, fine.parameters, run)
        if found is not None:
            some = np.flatnonzero(found.is_touched)
            sets = found.set_of[some]
            totals = np.add.reduceat(found.weights, found.offsets[:-1]) if len(sets) else sets
            sums[some] = totals[sets]
        return _Steps(found, shares, sums.reshape(shares.shape))

    def _path(self, values: F64 | F32, which: I64, shares: F64) -> F64:
        """Values (T, N, D) of the block at shares (n, S) of the intervals, (n, S, N, D)."""
        if len(values) and (values == values[0]).all():
            still = values[0].astype(np.float64)
            return np.broadcast_to(still, (*shares.shape, *still.shape))
        parts = []
        sides = self._rows[which], self._before[which], self._after[which]
        for row, before, after, mine in zip(
            *(each.tolist() for each in sides), shares, strict=True
        ):
            left = [values[row - 1 - k].astype(np.float64) for k in range(before)]
            right = [values[row + k].astype(np.float64) for k in range(after)]
            parts.append(between(left, right, mine))
        return np.stack(parts)


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

    def add(self, k: int, steps: _Steps, n: int) -> None:
        """Take those before row ``k`` from the steps of interval ``n``, without its end."""
        assert steps.touches is not None
        fine, count = steps.touches, steps.shares.shape[1]
        rows = np.flatnonzero(steps.is_touched[n] & (steps.shares[n] < 1.0))
        for j in np.unique(fine.set_of[n * count + rows]).tolist():
            part = slice(int(fine.offsets[j]), int(fine.offsets[j + 1]))
            weights = fine.weights[part].astype(np.float64)
            self._found[k] = strongest(self._found.get(k), fine.vertices[part], weights)

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
