# SPDX-License-Identifier: GPL-3.0-or-later
"""Impacts between two samples: beginning, speed, and touched skin.

The strength of an impact follows from the beginning, the felt weights from contacts during the
decay. At samples alone, both would depend on the sampling rate. Contacts are evaluated at steps of
half a millisecond and at keys in three kinds of intervals: where a touch begins, where contacts
change while an impact is loud, and where a volume may have touched and turned back. Motion in an
interval is computed from F-curves where available, else estimated (:mod:`.motion_estimate`).
"""

from dataclasses import replace
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from ..response_filters.controls import FilterKind
from ..response_filters.envelope import LOUD
from ..samples import SampleRun
from .grazes import Contacts, follow_on, may_graze, may_touch
from .intervals import Intervals, IntervalSteps, TouchedSets, weight_sums
from .touches import Between, Moments, Touches

STEP_S: Final = 0.0005
"""Time between two steps, seconds; equal times for all rates that divide 2000 Hz."""

RESUMES_S: Final = 0.01
"""Longest pause within one touch, seconds; at 100 Hz a pause may lie between two samples."""

_OF_DECAY: Final = 0.02  # fraction of a time constant: the largest relative loss by a step
_FINER: Final = 16  # parts of a step around beginnings and strongest moments


def refined(
    moments: Moments,
    touches: Touches,
    parameters: F64,
    run: SampleRun | None,
    contacts: Contacts,
    *,
    loud_until_s: float,
    is_flat: bool,
    is_live: bool,
) -> Touches:
    """Touches of a volume with impacts, extended by moments between samples.

    Live, later samples are unknown: motion is straight, only the time of a touch's beginning is
    searched, and the speed is that since the last sample. ``parameters`` (T, P) are the effect's.
    ``run`` are the contacts since the sample before, on a straight path, without a response; those
    of ``touches`` are at the samples' own times, live since the sample before. Impacts before these
    samples are loud until ``loud_until_s``. ``is_flat``: the volume has no falloff.
    """
    follows = follow_on(moments)
    before = np.concatenate([[False], touches.is_touched[:-1]])
    is_passed = np.isin(touches.indices, [] if run is None else run.indices)
    begins = is_passed & ~before & follows
    closely = coarsely = np.zeros(len(touches), np.bool_)
    if not is_live:
        is_bent = may_graze(moments)
        # Untouched on the straight path between the samples, but the true path may be bent.
        grazes = ~is_passed & ~before & follows
        grazes &= may_touch(moments, grazes & is_bent, contacts)
        may_begin = begins | grazes
        closely, coarsely = _changes(touches, run, may_begin, follows, is_bent, loud_until_s)
        closely |= grazes
        touches = replace(touches, resumes_s=RESUMES_S)
    parts: list[TouchedSets] = []
    chosen = np.flatnonzero(begins | closely)
    # With a falloff, contacts since the step before weigh each place of the skin at its deepest
    # moment: only to find what is touched between two steps alone.
    for with_passages in (True,) if is_flat or is_live else (False, True):
        if len(chosen):
            options = {"is_straight": is_live, "with_passages": with_passages}
            intervals = Intervals(moments, chosen, parameters, contacts, **options)
            touches, sets, is_some = _looked_closely(moments, touches, intervals, is_live=is_live)
            parts += sets
            chosen = chosen[~is_some & begins[chosen]]
    chosen = np.flatnonzero(coarsely)
    if len(chosen) and not any(filter_.is_in_space for filter_ in moments.filters):
        options = {"is_straight": False, "with_passages": is_flat}
        intervals = Intervals(moments, chosen, parameters, contacts, **options)
        steps_s = _OF_DECAY * _slow_s(touches, chosen)
        parts += intervals.steps(np.arange(len(chosen)), intervals.shares(steps_s)).sets
    return _with_between(touches, parts)


def _looked_closely(
    moments: Moments, touches: Touches, intervals: Intervals, *, is_live: bool
) -> tuple[Touches, list[TouchedSets], Bool]:
    """Add onsets and speeds of impacts to touches, and collect touched skin inside intervals: first
    in steps of at most :data:`STEP_S`, then in finer steps around beginnings of touches and
    strongest moments. Also returns a mask of the intervals with touched skin."""
    chosen = intervals.chosen
    slow_s = _slow_s(touches, chosen)
    steps_s = np.minimum(_OF_DECAY * slow_s, STEP_S)
    slow_s = slow_s / intervals.lengths_s
    steps = intervals.steps(np.arange(len(chosen)), intervals.shares(steps_s))
    is_some = steps.is_touched.any(axis=1)
    before = np.concatenate([[False], touches.is_touched[:-1]])[chosen]
    # Two searches: coarse steps find whether and roughly when skin is touched, finer ones around
    # the first touched and the strongest step give onset, speed and peak.
    new = np.flatnonzero((touches.is_touched[chosen] | is_some) & ~before)
    strong = np.flatnonzero(is_some) if not is_live else new[:0]
    if not len(new) and not len(strong):
        return touches, [], is_some
    finer = intervals.steps(*_closer_shares(steps, new, strong, slow_s))
    is_in = finer.is_touched[: len(new)]
    # Without any touched fine step the last step counts, the touched coarse step itself.
    is_in[:, -1] = True
    first = is_in.argmax(axis=1)
    onsets = np.full(len(touches), np.nan)
    if touches.onsets_s is not None:
        onsets = touches.onsets_s.copy()
    # The onset is the first touched fine step, at most 1/16 of a step late.
    onsets[chosen[new]] = intervals.times_s(new, finer.shares[np.arange(len(new)), first])
    touches = replace(touches, onsets_s=onsets)
    if is_live or finer.run is None:
        return touches, [], is_some
    column = np.concatenate([first, finer.strengths(slow_s)[len(new) :].argmax(axis=1)])
    flat = np.arange(len(column)) * finer.shares.shape[1] + column
    hits = np.flatnonzero(np.isin(flat, finer.rows))
    which, shares = finer.which[hits], finer.shares.ravel()[flat[hits]]
    sets = finer.run.set_of[np.searchsorted(finer.rows, flat[hits])]
    # Filters and speeds are evaluated at these moments only: nearness and speeds cost more than
    # contacts.
    speeds_over = (steps_s / intervals.lengths_s)[which] / _FINER
    answered = intervals.answered(which, shares, speeds_over, finer.run, sets)
    speeds = touches.speeds_m_s.copy()
    is_new = hits < len(new)
    speeds[chosen[which[is_new]]] = answered.speeds_m_s[is_new]
    k = np.flatnonzero(answered.is_touched)
    rows, times = chosen[which[k]], intervals.times_s(which[k], shares[k])
    with_filters = TouchedSets(
        rows, times, answered.set_of[k], answered.offsets, answered.vertices, answered.weights
    )
    is_in_space = any(filter_.is_in_space for filter_ in moments.filters)
    parts = [with_filters] if is_in_space else [with_filters, *steps.sets]
    return replace(touches, speeds_m_s=speeds), parts, is_some


def _changes(
    touches: Touches,
    run: SampleRun | None,
    begins: Bool,
    follows: Bool,
    is_bent: Bool,
    loud_until_s: float,
) -> tuple[Bool, Bool]:
    """Two masks (n,) of loud intervals before samples, in which contacts change: near a maximum of
    the summed weights, at possible pauses and turns; and all further changes. ``begins`` (n,):
    intervals in which a touch may begin. ``run`` None: both False."""
    impacts = [f for f, filter_ in enumerate(touches.filters) if filter_.kind is FilterKind.IMPACT]
    loudest_s = LOUD * touches.controls[:, impacts, 1:3].sum(axis=2).max(axis=1)
    until_s = np.where(begins, touches.times_s + loudest_s, loud_until_s)
    is_loud = np.zeros(len(touches), np.bool_)
    # An interval is loud if an impact of any earlier onset is loud at its start.
    is_loud[1:] = touches.times_s[:-1] < np.maximum.accumulate(until_s)[:-1]
    is_loud &= follows
    rises, falls = begins.copy(), np.zeros(len(touches), np.bool_)
    if run is None:
        return falls, falls
    set_of, sums = np.full(len(touches), -1), np.zeros(len(touches))
    at = np.searchsorted(touches.indices, run.indices)
    set_of[at], sums[at] = run.set_of, weight_sums(run)
    before = np.concatenate([[-1], set_of[:-1]])
    for k in np.flatnonzero(is_loud & (before >= 0) & (set_of != before)).tolist():
        if set_of[k] < 0:
            falls[k] = True
        else:
            rises[k], falls[k] = _changed(run, int(before[k]), int(set_of[k]))
    # A touch that ends and begins again within two samples may be a pause of one touch, also of one
    # without an impact: the volume was there when its clip began.
    pauses = follows & np.concatenate([[False], touches.is_touched[:-1]]) & ~touches.is_touched
    pauses[:-2] &= begins[1:-1] | begins[2:]
    changes = (rises & ~begins) | (falls & np.concatenate([[False], rises[:-1]]))
    less = np.diff(sums, prepend=0.0) <= 0.0, np.diff(sums, append=0.0) <= 0.0
    # Local maxima of the summed weights: the strongest moment lies in an interval on either side.
    is_most = ~less[0] & less[1]
    closely = changes & (is_most | np.concatenate([[False], is_most[:-1]])) | pauses
    # A turning volume may have covered more skin between two equal sets.
    closely |= is_loud & is_bent & (set_of >= 0) & (set_of == before)
    return closely, changes & ~closely


def _changed(run: SampleRun, one: int, other: int) -> tuple[bool, bool]:
    """Test for a vertex with more weight in set number ``other`` of a run than in set number
    ``one``, and for a vertex with less; a missing vertex has weight 0."""
    parts = [slice(int(run.offsets[j]), int(run.offsets[j + 1])) for j in (one, other)]
    ids = np.concatenate([run.vertices[part] for part in parts])
    order = np.argsort(ids, kind="stable")
    # Second weights minus first weights, summed for each vertex: the sign is that of the change.
    signed = np.concatenate([-run.weights[parts[0]], run.weights[parts[1]]])[order]
    first = np.flatnonzero(np.concatenate([[True], np.diff(ids[order]) > 0]))
    more = np.add.reduceat(signed, first)
    return bool((more > 0.0).any()), bool((more < 0.0).any())


def _slow_s(touches: Touches, rows: I64) -> F64:
    """Slower time constant, attack or decay, at rows (n,), seconds; the shortest of the impacts."""
    impacts = [f for f, filter_ in enumerate(touches.filters) if filter_.kind is FilterKind.IMPACT]
    return np.asarray(touches.controls[rows][:, impacts, 1:3].max(axis=2).min(axis=1))


def _closer_shares(steps: IntervalSteps, new: I64, strong: I64, slow: F64) -> tuple[I64, F64]:
    """Intervals (m,) and 17 fractions each (m, 17): between the steps around the first touch for
    intervals ``new``, then around the largest decayed weight for intervals ``strong``."""
    touched, count = steps.is_touched, steps.shares.shape[1] - 1
    first = np.where(touched.any(axis=1), touched.argmax(axis=1), count)[new]
    most = np.where(touched, steps.strengths(slow), 0.0)[strong].argmax(axis=1)
    low = np.concatenate([steps.shares[new, first - 1], steps.shares[strong, most - 1]])
    most = np.minimum(most + 1, count)
    high = np.concatenate([steps.shares[new, first], steps.shares[strong, most]])
    return np.concatenate([new, strong]), np.linspace(low, high, _FINER + 1, axis=1)


def _with_between(touches: Touches, parts: list[TouchedSets]) -> Touches:
    """Touches with moments between samples, sorted by row, then time, and with the moments' vertex
    sets appended. Of successive moments with equal sets only the first and the last remain."""
    parts = [part for part in parts if len(part.rows)]  # a filter in space may leave no vertex
    if not parts:
        return touches
    counts = np.cumsum([len(touches.offsets) - 1, *(len(part.offsets) - 1 for part in parts)])
    totals = np.cumsum([touches.offsets[-1], *(part.offsets[-1] for part in parts)])
    pairs = zip(parts, counts.tolist(), totals.tolist(), strict=False)
    numbers, offsets = zip(*((p.set_of + n, p.offsets[1:] + t) for p, n, t in pairs), strict=True)
    rows = np.concatenate([part.rows for part in parts])
    times = np.concatenate([part.times_s for part in parts])
    order = np.lexsort((times, rows))
    rows, times, set_of = rows[order], times[order], np.concatenate(numbers)[order]
    # Of successive moments with equal sets only the first, the strongest, counts, and the last, the
    # touch's end.
    follows = np.concatenate([rows[1:] == rows[:-1], [False]])
    is_same = follows & np.concatenate([set_of[1:] == set_of[:-1], [False]])
    is_kept = ~np.concatenate([[False], is_same[:-1]]) | ~follows
    return replace(
        touches,
        between=Between(rows[is_kept], times[is_kept], set_of[is_kept]),
        offsets=np.concatenate([touches.offsets, *offsets]),
        vertices=np.concatenate([touches.vertices, *(part.vertices for part in parts)]),
        weights=np.concatenate([touches.weights, *(part.weights for part in parts)]),
    )
