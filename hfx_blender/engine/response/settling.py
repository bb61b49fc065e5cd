# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of responses: impacts that still ring, and the skin that they were felt on.

While an impact rings, a vertex keeps its largest weight since the impact began. Give it the
touches of each stream in the order of time, in any parts: splitting time and putting it together
again gives the same bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F32, F64, I32, I64, Bool
from ..response_filters.controls import FilterKind, Operation
from ..response_filters.envelope import Impact
from ..response_filters.filters import folded
from ..samples import SampleRun, Stream
from .touches import Touches, strongest

LEAST: Final = 1e-4
"""A weaker response is silence."""

WeightedSet = tuple[I32, F32]
"""Vertices, ascending, and their weights."""


@dataclass(frozen=True, eq=False)
class Memory:
    """Memory of one stream between parts of time."""

    index: int = -2  # of the last sample
    time_s: float = -np.inf
    was_touched: bool = False
    impacts: tuple[tuple[Impact, ...], ...] = ()  # of each filter, in the order of time
    values: F64 | None = None  # (F,) of the last touch
    held: tuple[tuple[float, WeightedSet], ...] = ()  # by the time at which impacts began

    def rings(self, time_s: float) -> bool:
        """Test for an impact that is still felt at a time."""
        return any(impact.ends_s > time_s for each in self.impacts for impact in each)


class Settling:
    """The memories of all streams of a scene."""

    def __init__(self) -> None:
        self.memories: dict[Stream, Memory] = {}

    def settle(self, touches: Touches) -> SampleRun | None:
        """Samples of a stream's next touches; None without any."""
        memory = self.memories.get(touches.stream, Memory())
        if not len(touches):
            return None
        quiet = not len(touches.vertices) and not any(memory.impacts)
        if quiet:
            self.pass_over(touches.stream, int(touches.indices[-1]))
            return None
        run, self.memories[touches.stream] = settled(touches, memory)
        return run

    def pass_over(self, stream: Stream, index: int) -> None:
        """Record that nothing of a stream was touched, near or ringing up to a sample."""
        self.memories[stream] = Memory(index=index)

    def rings(self, stream: Stream) -> bool:
        """Test for an impact of a stream that may still be felt."""
        memory = self.memories.get(stream)
        return memory is not None and any(memory.impacts)

    def any_rings(self, time_s: float) -> bool:
        """Test for an impact of any stream that is still felt at a time."""
        return any(memory.rings(time_s) for memory in self.memories.values())


@dataclass(frozen=True, eq=False)
class _Ringing:
    """Impacts over the times of touches, those of one moment together."""

    impacts: list[list[Impact]]  # of each filter
    values: F64  # (n, F) of the filters; 0 where they are no impacts
    rings: Bool  # (n,)
    energies: dict[float, F64]  # (n,) the sum of all that began at a time
    ends: dict[float, Bool]  # (n,) whether all of these are over


def settled(touches: Touches, memory: Memory) -> tuple[SampleRun | None, Memory]:
    """Samples of touches that follow a memory, and the memory after them."""
    filters = touches.filters
    ringing = _ringing(touches, memory)
    values = _held_values(touches, memory, ringing.rings)
    multiplies = False
    for f, each in enumerate(filters):
        if each.kind is FilterKind.IMPACT:
            values[:, f] = ringing.values[:, f]
            multiplies |= each.operation is Operation.MULTIPLY
    influences = touches.controls[:, :, 0]
    starts = ringing.rings & multiplies
    response = folded(filters, (touches.is_touched | starts).astype(np.float64), values, influences)
    response[response < LEAST] = 0.0
    for f, each in enumerate(filters):
        if each.kind is FilterKind.PROXIMITY:
            values[:, f] = 0.0
    left = folded(filters, starts.astype(np.float64), values, influences)
    # What rings is felt at most as strongly as what is touched; both are multiplied by a level.
    shares = np.divide(left, response, out=np.zeros(len(left)), where=response > 0.0)
    is_felt = response * touches.levels > 0.0
    is_felt &= (touches.set_of >= 0) | ringing.rings  # without a set of its own, only ringing is
    sets, held = _held_sets(touches, memory, ringing, np.minimum(shares, 1.0), is_felt)
    run = _run(touches, np.flatnonzero(is_felt), sets, response)
    touched = np.flatnonzero(touches.is_touched)
    now = float(touches.times_s[-1])
    impacts = tuple(
        tuple(impact for impact in each if max(impact.ends_s, impact.peaks_s) > now)
        for each in ringing.impacts
    )
    begun = {impact.time_s for each in impacts for impact in each}
    return run, Memory(
        index=int(touches.indices[-1]),
        time_s=now,
        was_touched=bool(touches.is_touched[-1]),
        impacts=impacts,
        values=touches.values[touched[-1]] if len(touched) else memory.values,
        held=tuple(each for each in held.items() if each[0] in begun),
    )


def _ringing(touches: Touches, memory: Memory) -> _Ringing:
    impacts = _with_new_impacts(touches, memory)
    times = touches.times_s
    before = np.concatenate([[memory.time_s], times[:-1]])
    indices = np.concatenate([[memory.index], touches.indices[:-1]])
    before = np.where(indices == touches.indices - 1, before, times)  # nothing peaks in a gap
    rings = np.zeros(len(touches), np.bool_)
    values = np.zeros((len(touches), len(impacts)))
    energies: dict[float, F64] = {}
    ends: dict[float, Bool] = {}
    for f, each in enumerate(impacts):
        for impact in each:
            value, felt = impact.envelope(times, before), impact.rings(times, before)
            is_over = ~felt & (times >= impact.ends_s)
            values[:, f] += value
            rings |= felt
            energies[impact.time_s] = energies.get(impact.time_s, 0.0) + value
            ends[impact.time_s] = ends.get(impact.time_s, np.True_) & is_over
    return _Ringing(impacts, values, rings, energies, ends)


def _with_new_impacts(touches: Touches, memory: Memory) -> list[list[Impact]]:
    """Impacts of each filter: old ones that may still ring, and new ones."""
    begins = _begins(touches, memory)
    known = memory.impacts or ((),) * len(touches.filters)
    impacts = [list(each) for each in known]
    for f, each in enumerate(touches.filters):
        if each.kind is not FilterKind.IMPACT:
            continue
        for k in np.flatnonzero(begins).tolist():
            _, attack, decay, full = touches.controls[k, f, :4].tolist()
            strength = min(float(touches.speeds_m_s[k]) / full, 1.0)
            impacts[f].append(Impact(_onset_s(touches, k), strength, attack, decay))
    return impacts


def _begins(touches: Touches, memory: Memory) -> Bool:
    """Times (n,) since the sample before which an impact began."""
    before = np.concatenate([[memory.index], touches.indices[:-1]])
    was_touched = np.concatenate([[memory.was_touched], touches.is_touched[:-1]])
    begins: Bool = touches.is_touched & ~was_touched & (before == touches.indices - 1)
    return begins & (touches.speeds_m_s > 0.0)


def _onset_s(touches: Touches, k: int) -> float:
    onset = np.nan if touches.onsets_s is None else float(touches.onsets_s[k])
    return float(touches.times_s[k]) if np.isnan(onset) else onset


def _held_values(touches: Touches, memory: Memory, rings: Bool) -> F64:
    """Values (n, F): ringing samples keep the speed of the last touch, others untouched get 0.

    Only ringing samples may look back, so the memory ends with the last impact.
    """
    values = touches.values.copy()
    columns = [f for f, each in enumerate(touches.filters) if each.kind is FilterKind.SPEED]
    if columns and not touches.is_touched.all():
        last = _last(touches.is_touched)
        kept = np.zeros(len(touches.filters)) if memory.values is None else memory.values
        held = np.where((last >= 0)[:, None], touches.values[last], kept)
        held[~(rings | touches.is_touched)] = 0.0
        values[:, columns] = held[:, columns]
    return values


def _last(holds: Bool) -> I64:
    """Last index up to each at which ``holds`` is true, (n,); -1 before the first."""
    places: I64 = np.maximum.accumulate(np.where(holds, np.arange(len(holds)), -1))
    return places


def _held_sets(
    touches: Touches, memory: Memory, ringing: _Ringing, shares: F64, is_felt: Bool
) -> tuple[list[WeightedSet | None], dict[float, WeightedSet]]:
    """Sets of all times, with what rings on, ``shares`` (n,) as strongly; and what is held after.

    Each impact is felt where it was: the weights of several are averaged by their envelopes.
    """
    held = dict(memory.held)
    begins = _begins(touches, memory) & any(
        each.kind is FilterKind.IMPACT for each in touches.filters
    )
    sets: list[WeightedSet | None] = []
    merged = -1  # the last set that all impacts hold already
    last: tuple[int, WeightedSet | None] = -1, None
    for k, own in enumerate(touches.set_of.tolist()):
        if begins[k]:
            held[_onset_s(touches, k)] = np.zeros(0, np.int32), np.zeros(0, np.float32)
            merged = -1
        if held:
            peak = -1 if touches.peak_of is None else int(touches.peak_of[k])
            for j in (own if touches.is_touched[k] else -1, peak):
                if j < 0 or j == merged:
                    continue
                held = {time: _merged(each, _set(touches, j)) for time, each in held.items()}
            merged = own if touches.is_touched[k] else merged
            held = {time: each for time, each in held.items() if not ringing.ends[time][k]}
        if own != last[0]:
            last = own, _set(touches, own) if own >= 0 else None
        now = last[1]
        if held and ringing.rings[k] and is_felt[k] and shares[k] > 0.0:
            energies = [float(ringing.energies[time][k]) for time in held]
            now = _together(now, list(held.values()), energies, float(shares[k]))
        sets.append(now)
    return sets, held


def _set(touches: Touches, number: int) -> WeightedSet:
    part = slice(int(touches.offsets[number]), int(touches.offsets[number + 1]))
    return touches.vertices[part], touches.weights[part]


def _merged(one: WeightedSet, other: WeightedSet) -> WeightedSet:
    """Union of two sets with the larger weight of each vertex; ``one`` itself if that is all."""
    known = one[0], one[1].astype(np.float64)
    vertices, weights = strongest(known, other[0], other[1].astype(np.float64))
    if len(vertices) == len(one[0]) and (weights == one[1]).all():
        return one
    return vertices, weights.astype(np.float32)


def _together(
    now: WeightedSet | None, held: list[WeightedSet], energies: list[float], share: float
) -> WeightedSet:
    """Union of what is touched or near now and what rings, ``share`` as strongly."""
    total = sum(energies)
    if len(held) == 1 or not total > 0.0:
        vertices, weights = held[-1]
    else:
        vertices = held[0][0]  # the first impact holds all that later ones do
        sums = np.zeros(len(vertices))
        for (some, values), energy in zip(held, energies, strict=True):
            sums[np.searchsorted(vertices, some)] += energy / total * values
        weights = np.minimum(sums, 1.0).astype(np.float32)
    if share < 1.0:
        weights = (share * weights).astype(np.float32)
    if now is not None:
        vertices, weights = _merged((vertices, weights), now)
    is_felt = weights > 0.0
    return (vertices, weights) if is_felt.all() else (vertices[is_felt], weights[is_felt])


def _run(
    touches: Touches, felt: I64, sets: list[WeightedSet | None], response: F64
) -> SampleRun | None:
    chosen: list[WeightedSet] = []
    numbers: list[int] = []
    rows: list[int] = []
    for k in felt.tolist():
        found = sets[k]
        if found is None or not len(found[0]):
            continue
        if not chosen or not _equal(chosen[-1], found):
            chosen.append(found)
        numbers.append(len(chosen) - 1)
        rows.append(k)
    if not rows:
        return None
    return SampleRun(
        stream=touches.stream,
        indices=touches.indices[rows],
        times_s=touches.times_s[rows],
        levels=touches.levels[rows] * response[rows],
        parameters=touches.parameters[rows],
        sets=np.array(numbers, np.int64),
        offsets=np.concatenate([[0], np.cumsum([len(v) for v, _ in chosen])]).astype(np.int64),
        vertices=np.concatenate([v for v, _ in chosen]),
        weights=np.concatenate([w for _, w in chosen]),
    )


def _equal(one: WeightedSet, other: WeightedSet) -> bool:
    return (one[0] is other[0] and one[1] is other[1]) or (
        np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1])
    )
