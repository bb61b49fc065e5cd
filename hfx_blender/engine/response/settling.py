# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of contact responses: ringing impacts and the skin that they were felt on.

While an impact rings, a vertex keeps the largest weight since the impact began. The strongest
moment between two samples counts at the later sample. Touches of each stream must be given in the
order of time, in parts of any size: splitting time does not change a byte.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64, Bool
from ..response_filters.controls import FilterKind, Operation
from ..response_filters.envelope import RingingImpact
from ..response_filters.filters import folded
from ..samples import SampleRun, Stream
from .touches import Touches, WeightedSet, packed, strongest

LEAST: Final = 1e-4  # smallest response; weaker ones count as 0
_MORE: Final = 1.0 + 1e-6  # relative to the samples at both ends: less is rounding


@dataclass(frozen=True, eq=False)
class Memory:
    """Memory of a stream between parts of time."""

    index: int = -2  # of the last sample
    time_s: float = -np.inf
    was_touched: bool = False
    touched_s: float = -np.inf  # last moment with touched skin
    left: tuple[float, WeightedSet] | None = None  # level and weights of the last sample
    impacts: tuple[tuple[RingingImpact, ...], ...] = ()  # by filter, in the order of time
    values: F64 | None = None  # (F,) filter values of the last touch
    held: tuple[tuple[float, WeightedSet], ...] = ()  # (onset, kept weights) of each impact

    def rings(self, time_s: float) -> bool:
        """True if any impact ends after a time, seconds."""
        return any(impact.ends_s > time_s for impacts in self.impacts for impact in impacts)


class Settling:
    """Memories of all streams of a scene."""

    def __init__(self) -> None:
        self.memories: dict[Stream, Memory] = {}

    def settle(self, touches: Touches) -> SampleRun | None:
        """Samples of a stream's next touches, and update of the memory; None without samples above
        0. Without touched skin and impacts only the last index is remembered."""
        memory = self.memories.get(touches.stream, Memory())
        if not len(touches):
            return None
        quiet = not len(touches.vertices) and not any(memory.impacts)
        if quiet:
            self.pass_over(touches.stream, int(touches.indices[-1]))
            return None
        # Also without samples: impacts may ring on into the next part.
        run, self.memories[touches.stream] = settled(touches, memory)
        return run

    def pass_over(self, stream: Stream, index: int) -> None:
        """Forget all impacts of a stream: no touch, nearness or impact up to sample ``index``."""
        self.memories[stream] = Memory(index=index)

    def rings(self, stream: Stream) -> bool:
        """True if a stream's memory holds any impact, ended or not."""
        memory = self.memories.get(stream)
        return memory is not None and any(memory.impacts)

    def loud_until_s(self, stream: Stream) -> float:
        """Latest time until which an impact of a stream is loud, seconds; -inf without impacts."""
        impacts = self.memories.get(stream, Memory()).impacts
        return max((i.loud_until_s for of_filter in impacts for i in of_filter), default=-np.inf)

    def any_rings(self, time_s: float) -> bool:
        """True if an impact of any stream ends after a time, seconds."""
        return any(memory.rings(time_s) for memory in self.memories.values())


@dataclass(frozen=True, eq=False)
class _Timeline:
    """Samples of touches and moments between them: N times in ascending order."""

    samples: I64  # (n,) indices of the samples
    row_of: I64  # (N,) the sample itself, or the sample after a moment
    times_s: F64  # (N,)
    before_s: F64  # (N,) previous time; the own time after a gap, where peaks are ignored
    set_of: I64  # (N,)
    is_touched: Bool  # (N,)

    @classmethod
    def of(cls, touches: Touches, memory: Memory) -> "_Timeline":
        """Timeline of the samples of ``touches`` and the moments between, after those of
        ``memory``."""
        between, rows = touches.between, np.arange(len(touches))
        order = np.argsort(np.concatenate([between.rows, rows]), kind="stable")
        row_of = np.concatenate([between.rows, rows])[order]
        times = np.concatenate([between.times_s, touches.times_s])[order]
        before = np.concatenate([[memory.time_s], times[:-1]])
        # Moments and their sample share a row; across samples consecutive indices decide.
        follows = (np.diff(row_of, prepend=-1) == 0) | _follows(touches, memory)[row_of]
        is_between = np.ones(len(between.rows), np.bool_)
        return cls(
            np.flatnonzero(order >= len(between.rows)),
            row_of,
            times,
            np.where(follows, before, times),
            np.concatenate([between.set_of, touches.set_of])[order],
            np.concatenate([is_between, touches.is_touched])[order],
        )


@dataclass(frozen=True, eq=False)
class _Ringing:
    """Impacts over the N times of a timeline; impacts of one onset are summed."""

    impacts: list[list[RingingImpact]]  # by filter
    values: F64  # (N, F) filter values; 0 for other filters than impacts
    rings: Bool  # (N,) any impact is felt
    energies: dict[float, F64]  # (N,) by onset
    ends: dict[float, Bool]  # (N,) by onset: all impacts are over
    is_loud: Bool  # (n,) samples with relevant moments before


def settled(touches: Touches, memory: Memory) -> tuple[SampleRun | None, Memory]:
    """Samples of touches that follow a memory, and the memory after these touches. Evaluates
    impacts and the stack of filters; responses below 1e-4 count as 0. None in place of samples
    without any above 0."""
    filters = touches.filters
    line = _Timeline.of(touches, memory)
    begins = _begins(touches, memory)
    ringing = _ringing(touches, memory, line, begins)
    values = _held_values(touches, memory, ringing.rings[line.samples])[line.row_of]
    multiplies = False
    for f, filter_ in enumerate(filters):
        if filter_.kind is FilterKind.IMPACT:
            values[:, f] = ringing.values[:, f]
            multiplies |= filter_.operation is Operation.MULTIPLY
        elif filter_.kind is FilterKind.PROXIMITY:
            values[line.is_touched, f] = 1.0
    influences = touches.controls[line.row_of, :, 0]
    # An impact that multiplies needs a factor to act on without touch: 1 while the impact rings.
    starts = ringing.rings & multiplies
    response = folded(filters, (line.is_touched | starts).astype(np.float64), values, influences)
    # Two foldings of the stack: with touch and nearness, and without; their quotient scales ringing
    # skin.
    response[response < LEAST] = 0.0
    for f, filter_ in enumerate(filters):
        if filter_.kind is FilterKind.PROXIMITY:
            values[:, f] = 0.0
    untouched = folded(filters, starts.astype(np.float64), values, influences)
    # Ringing skin is felt at most as strongly as touched skin; both are multiplied by the level.
    shares = np.divide(untouched, response, out=np.zeros(len(untouched)), where=response > 0.0)
    levels = response * touches.levels[line.row_of]
    levels[(line.set_of < 0) & ~ringing.rings] = (
        0.0  # without touch and nearness only ringing is felt
    )
    shares = np.where(ringing.rings & (levels > 0.0), np.minimum(shares, 1.0), 0.0)
    held = _Held(touches, memory, line, ringing, shares, levels)
    felt_samples = [held.next(k, begins=bool(begins[k])) for k in range(len(touches))]
    run = _run(touches, felt_samples)
    touched = np.flatnonzero(touches.is_touched)
    end_s = float(touches.times_s[-1])
    impacts = tuple(
        tuple(impact for impact in of_filter if max(impact.ends_s, impact.peaks_s) > end_s)
        for of_filter in ringing.impacts
    )
    begun = {impact.time_s for of_filter in impacts for impact in of_filter}
    return run, Memory(
        index=int(touches.indices[-1]),
        time_s=end_s,
        was_touched=bool(touches.is_touched[-1]),
        touched_s=max(memory.touched_s, float(line.times_s[line.is_touched].max(initial=-np.inf))),
        left=held.left,
        impacts=impacts,
        values=touches.values[touched[-1]] if len(touched) else memory.values,
        held=tuple(item for item in held.sets.items() if item[0] in begun),
    )


def _ringing(touches: Touches, memory: Memory, line: _Timeline, begins: Bool) -> _Ringing:
    """Evaluate known impacts and a new impact at each sample in ``begins`` (n,), for each impact
    filter, over a timeline."""
    impacts = _with_new_impacts(touches, memory, begins)
    times, before = line.times_s, line.before_s
    rings = np.zeros(len(times), np.bool_)
    values = np.zeros((len(times), len(impacts)))
    energies: dict[float, F64] = {}
    ends: dict[float, Bool] = {}
    is_loud = begins.copy()
    # Beginning of the interval before each sample: its moments count if an impact is loud there.
    since = np.concatenate([[memory.time_s], touches.times_s[:-1]])
    for f, of_filter in enumerate(impacts):
        for impact in of_filter:
            value, is_felt = impact.envelope(times, before), impact.rings(times, before)
            is_over = ~is_felt & (times >= impact.ends_s)
            values[:, f] += value
            rings |= is_felt
            # Impacts of several filters with one onset keep one set of weights.
            energies[impact.time_s] = energies.get(impact.time_s, 0.0) + value
            ends[impact.time_s] = ends.get(impact.time_s, np.True_) & is_over
            is_loud |= (since >= impact.time_s) & (since < impact.loud_until_s)
    return _Ringing(impacts, values, rings, energies, ends, is_loud)


def _with_new_impacts(touches: Touches, memory: Memory, begins: Bool) -> list[list[RingingImpact]]:
    """Impacts by filter: first those of the memory, then a new one for each True in ``begins``
    (n,), with strength speed / full speed, at most 1. Empty for filters of another kind."""
    known = memory.impacts or ((),) * len(touches.filters)
    impacts = [list(of_filter) for of_filter in known]
    for f, filter_ in enumerate(touches.filters):
        if filter_.kind is not FilterKind.IMPACT:
            continue
        for k in np.flatnonzero(begins).tolist():
            _, attack, decay, full = touches.controls[k, f, :4].tolist()
            strength = min(float(touches.speeds_m_s[k]) / full, 1.0)
            impacts[f].append(RingingImpact(_onset_s(touches, k), strength, attack, decay))
    return impacts


def _follows(touches: Touches, memory: Memory) -> Bool:
    """Mask (n,) of samples whose index is the previous index plus 1; the first sample follows the
    memory."""
    before = np.concatenate([[memory.index], touches.indices[:-1]])
    return np.asarray(before == touches.indices - 1)


def _begins(touches: Touches, memory: Memory) -> Bool:
    """Mask (n,) of samples with the beginning of a touch in the interval before: untouched earlier,
    speed above 0, no gap, and no touch within ``resumes_s`` before. False without impact
    filters."""
    if not any(filter_.kind is FilterKind.IMPACT for filter_ in touches.filters):
        return np.zeros(len(touches), np.bool_)
    between = touches.between
    was_touched = np.concatenate([[memory.was_touched], touches.is_touched[:-1]])
    is_touched = touches.is_touched.copy()
    # A touch between two samples begins an impact too, also with free skin at both samples.
    is_touched[between.rows] = True
    begins = is_touched & ~was_touched & _follows(touches, memory) & (touches.speeds_m_s > 0.0)
    last = np.full(len(touches), -np.inf)
    # Last touched time before each sample, for pauses within a touch.
    last[between.rows] = between.times_s  # of equal rows the last one remains
    last[touches.is_touched] = touches.times_s[touches.is_touched]
    last = np.maximum.accumulate(np.concatenate([[memory.touched_s], last[:-1]]))
    for k in np.flatnonzero(begins).tolist():
        begins[k] = _onset_s(touches, k) - last[k] > touches.resumes_s
    return begins


def _onset_s(touches: Touches, k: int) -> float:
    """Onset of the touch before sample ``k``, seconds; the sample's own time if NaN or absent."""
    onset = np.nan if touches.onsets_s is None else float(touches.onsets_s[k])
    return float(touches.times_s[k]) if np.isnan(onset) else onset


def _held_values(touches: Touches, memory: Memory, rings: Bool) -> F64:
    """Copy of the filter values (n, F). Speed filters hold the last touched sample's value at
    samples in ``rings`` (n,), and are 0 at further untouched samples. Only ringing samples may look
    back, so the memory ends with the last impact."""
    values = touches.values.copy()
    columns = [f for f, filter_ in enumerate(touches.filters) if filter_.kind is FilterKind.SPEED]
    if columns and not touches.is_touched.all():
        touched = np.where(touches.is_touched, np.arange(len(touches)), -1)
        last = np.maximum.accumulate(touched)  # touch up to each sample; -1 before the first
        earlier = np.zeros(len(touches.filters)) if memory.values is None else memory.values
        held = np.where((last >= 0)[:, None], touches.values[last], earlier)
        held[~(rings | touches.is_touched)] = 0.0
        values[:, columns] = held[:, columns]
    return values


class _Held:
    """Weights kept by impacts, and the resulting samples, one after another."""

    def __init__(
        self,
        touches: Touches,
        memory: Memory,
        line: _Timeline,
        ringing: _Ringing,
        shares: F64,
        levels: F64,
    ) -> None:
        self.sets = dict(memory.held)  # by the time at which impacts began
        self.left = memory.left
        self._touches, self._line, self._ringing = touches, line, ringing
        self._shares, self._levels = shares, levels  # (N,)
        self._merged = -1  # the last set that all impacts hold already
        self._own: tuple[int, WeightedSet | None] = -1, None
        if len(touches) and not _follows(touches, memory)[0]:
            self.left = None

    def next(self, k: int, *, begins: bool) -> tuple[float, WeightedSet] | None:
        """Level and weights of sample ``k``, stronger moments of the interval before included; None
        without a level or weight above 0. ``begins``: a new impact, without earlier weights. Each
        impact keeps the weights of its own contacts; several are averaged by the envelopes."""
        line, ringing = self._line, self._ringing
        row = int(line.samples[k])
        first = int(line.samples[k - 1]) + 1 if k else 0
        # A new impact keeps no weights of earlier contacts.
        if begins:
            onset = _onset_s(self._touches, k)
            self.sets[onset] = np.zeros(0, np.int32), np.zeros(0, np.float32)
            self._merged = -1
        strongest = None
        if self.sets and first < row and ringing.is_loud[k]:
            strongest = self._between(first, row)
        own = int(line.set_of[row])
        if self.sets and line.is_touched[row] and own != self._merged:
            now = self._touches.weighted_set(own)
            self.sets = {time: _merged(held, now) for time, held in self.sets.items()}
            self._merged = own
        weighted = self._touched_set(own)
        self.sets = {time: held for time, held in self.sets.items() if not ringing.ends[time][row]}
        if self.sets and self._shares[row] > 0.0:
            energies = [float(ringing.energies[time][row]) for time in self.sets]
            share = float(self._shares[row])
            weighted = _together(weighted, list(self.sets.values()), energies, share)
        level = float(self._levels[row])
        self.left = None
        if weighted is not None and len(weighted[0]) and level > 0.0:
            self.left = level, weighted
        return self.left if strongest is None else strongest

    def _touched_set(self, number: int) -> WeightedSet | None:
        """Vertex set of a number, cached from the last call; None for -1."""
        if number != self._own[0]:
            self._own = number, self._touches.weighted_set(number) if number >= 0 else None
        return self._own[1]

    def _between(self, first: int, row: int) -> tuple[float, WeightedSet] | None:
        """Level and weights from the strongest moment of each vertex, up to the sample at ``row``
        of the timeline; None if no earlier moment from ``first`` on is stronger. Adds touched
        weights to those kept by impacts."""
        line, ringing = self._line, self._ringing
        numbers = line.set_of[first : row + 1].tolist()
        own = [self._touches.weighted_set(j) if j >= 0 else None for j in numbers]
        known = [s for s in (*own, *self.sets.values()) if s is not None]
        if self.left is not None:
            known.append(self.left[1])
        # All sets over common columns, so that maxima and sums are plain array operations.
        vertices = np.unique(np.concatenate([vertex_ids for vertex_ids, _ in known]))
        weights = np.stack([_spread(weighted, vertices) for weighted in own])
        is_touched = line.is_touched[first : row + 1, None]
        largest = np.maximum.accumulate(np.where(is_touched, weights, 0.0), axis=0)
        sums, totals = np.zeros_like(largest), np.zeros((len(own), 1))
        # For each impact: running maximum of weights since its onset, weighted by the envelope
        # among all impacts.
        held = largest
        for time, before in self.sets.items():
            held = np.maximum(largest, _spread(before, vertices))
            energies = ringing.energies[time][first : row + 1, None]
            sums, totals = sums + energies * held, totals + energies
            is_kept = held[-1] > 0.0
            self.sets[time] = vertices[is_kept], held[-1, is_kept].astype(np.float32)
        rings = np.divide(sums, totals, out=held.copy(), where=totals > 0.0)
        rings *= self._shares[first : row + 1, None]
        levels = self._levels[first : row + 1]
        strengths = levels[:, None] * np.maximum(weights, rings)
        at_sample = strengths[-1]
        if self.left is not None:
            at_sample = np.maximum(at_sample, self.left[0] * _spread(self.left[1], vertices))
        peaks = strengths[:-1].max(axis=0)
        # A vertex counts as stronger inside only beyond rounding, so that constant contacts stay
        # equal sets.
        is_inside = peaks > _MORE * at_sample
        if not is_inside.any():
            return None
        products = np.where(is_inside, peaks, strengths[-1])
        # The level's own peak counts equally, because weights are at most 1.
        left = 0.0 if self.left is None else self.left[0]
        inside = float(levels[:-1].max())
        level = inside if inside > max(left, levels[-1]) else float(levels[-1])
        # At least the largest product, so that no weight exceeds 1.
        level = max(level, float(products.max()))
        shown = np.minimum(products / level, 1.0).astype(np.float32)
        return level, (vertices[shown > 0.0], shown[shown > 0.0])


def _spread(weighted_set: WeightedSet | None, vertices: I32) -> F64:
    """Weights (V,) at ascending ``vertices``, a superset of the set's; 0 elsewhere and for None."""
    weights = np.zeros(len(vertices))
    if weighted_set is not None:
        weights[np.searchsorted(vertices, weighted_set[0])] = weighted_set[1]
    return weights


def _merged(one: WeightedSet, second: WeightedSet) -> WeightedSet:
    """Union of two sets with the larger weight of each vertex, ascending; ``one`` itself if nothing
    grows."""
    # float64 holds each float32 exactly: an unchanged set compares as equal.
    known = one[0], one[1].astype(np.float64)
    vertices, weights = strongest(known, second[0], second[1].astype(np.float64))
    if len(vertices) == len(one[0]) and (weights == one[1]).all():
        return one
    return vertices, weights.astype(np.float32)


def _together(
    now: WeightedSet | None, held: list[WeightedSet], energies: list[float], share: float
) -> WeightedSet:
    """Union of a present set and ringing sets, the latter scaled by ``share`` 0..1; the larger
    weight of a vertex counts, weights 0 are dropped. Weights of several impacts are averaged by
    ``energies``. ``now`` None: nothing is touched or near."""
    total = sum(energies)
    if len(held) == 1 or not total > 0.0:
        vertices, weights = held[-1]
    else:
        vertices = held[0][0]  # the first impact holds a superset of later ones
        sums = np.zeros(len(vertices))
        for (ids, values), energy in zip(held, energies, strict=True):
            sums[np.searchsorted(vertices, ids)] += energy / total * values
        weights = np.minimum(sums, 1.0).astype(np.float32)
    if share < 1.0:
        weights = (share * weights).astype(np.float32)
    if now is not None:
        vertices, weights = _merged((vertices, weights), now)
    is_felt = weights > 0.0
    return (vertices, weights) if is_felt.all() else (vertices[is_felt], weights[is_felt])


def _run(
    touches: Touches, optional_samples: list[tuple[float, WeightedSet] | None]
) -> SampleRun | None:
    """Run of the samples (level, set), one per row of the touches, that are not None; None without
    any."""
    rows = [k for k, sample in enumerate(optional_samples) if sample is not None]
    if not rows:
        return None
    samples = [sample for sample in optional_samples if sample is not None]
    sets, offsets, vertices, weights = packed(weighted for _, weighted in samples)
    return SampleRun(
        stream=touches.stream,
        indices=touches.indices[rows],
        times_s=touches.times_s[rows],
        levels=np.array([level for level, _ in samples]),
        parameters=touches.parameters[rows],
        sets=sets,
        offsets=offsets,
        vertices=vertices,
        weights=weights,
    )
