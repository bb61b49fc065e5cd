# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of responses: impacts that still ring, and the skin that they were felt on.

Give it the touches of each stream in the order of time, in any parts: splitting time and
putting it together again gives the same bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F32, F64, I32, I64, Bool
from ..response_filters.controls import FilterKind, Operation
from ..response_filters.envelope import Impact, envelope
from ..response_filters.filters import folded
from ..samples import SampleRun, Stream
from .touches import Touches

LEAST: Final = 1e-4
"""A weaker response is silence."""


@dataclass(frozen=True, eq=False)
class Memory:
    """Memory of one stream between parts of time."""

    index: int = -2  # of the last sample
    was_touched: bool = False
    impacts: tuple[tuple[Impact, ...], ...] = ()  # of each filter, in the order of time
    values: F64 | None = None  # (F,) of the last touch
    vertices: I32 | None = None  # that were felt last
    weights: F32 | None = None

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
        quiet = not len(touches.vertices) and not memory.rings(float(touches.times_s[0]))
        if quiet:
            self.memories[touches.stream] = Memory(index=int(touches.indices[-1]))
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


def settled(touches: Touches, memory: Memory) -> tuple[SampleRun | None, Memory]:
    """Samples of touches that follow a memory, and the memory after them."""
    filters, times = touches.filters, touches.times_s
    impacts = _with_new_impacts(touches, memory)
    rings = np.zeros(len(touches), np.bool_)
    for impact in (impact for each in impacts for impact in each):
        rings |= (times >= impact.time_s) & (times < impact.ends_s)
    values = _held_values(touches, memory, rings)
    multiplies = False
    for f, each in enumerate(filters):
        if each.kind is FilterKind.IMPACT:
            values[:, f] = envelope(times, impacts[f])
            multiplies |= each.operation is Operation.MULTIPLY
    start = touches.is_touched | (rings & multiplies)
    response = folded(filters, start.astype(np.float64), values, touches.controls[:, :, 0])
    response[response < LEAST] = 0.0
    held = _last(touches.set_of >= 0)
    set_of = np.where(held >= 0, touches.set_of[held], -1)  # -1: the one that is remembered
    is_felt = response * touches.levels > 0.0
    # Without a set of its own, only ringing is felt.
    is_felt &= (touches.set_of >= 0) | rings
    is_felt &= (set_of >= 0) | (memory.vertices is not None)
    run = _run(touches, memory, np.flatnonzero(is_felt), set_of, response)
    last = int(touches.set_of.max(initial=-1))
    part = slice(int(touches.offsets[last]), int(touches.offsets[last + 1])) if last >= 0 else None
    touched = np.flatnonzero(touches.is_touched)
    now = float(times[-1])
    return run, Memory(
        index=int(touches.indices[-1]),
        was_touched=bool(touches.is_touched[-1]),
        impacts=tuple(tuple(i for i in each if i.ends_s > now) for each in impacts),
        values=touches.values[touched[-1]] if len(touched) else memory.values,
        vertices=memory.vertices if part is None else touches.vertices[part],
        weights=memory.weights if part is None else touches.weights[part],
    )


def _with_new_impacts(touches: Touches, memory: Memory) -> list[list[Impact]]:
    """Impacts of each filter: old ones that may still ring, and new ones."""
    before = np.concatenate([[memory.index], touches.indices[:-1]])
    was_touched = np.concatenate([[memory.was_touched], touches.is_touched[:-1]])
    begins = touches.is_touched & ~was_touched & (before == touches.indices - 1)
    known = memory.impacts or ((),) * len(touches.filters)
    impacts = [list(each) for each in known]
    for f, each in enumerate(touches.filters):
        if each.kind is not FilterKind.IMPACT:
            continue
        for k in np.flatnonzero(begins & (touches.speeds_m_s > 0.0)).tolist():
            _, attack, decay, full = touches.controls[k, f, :4].tolist()
            strength = min(float(touches.speeds_m_s[k]) / full, 1.0)
            impacts[f].append(Impact(float(touches.times_s[k]), strength, attack, decay))
    return impacts


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


def _run(
    touches: Touches, memory: Memory, felt: I64, set_of: I64, response: F64
) -> SampleRun | None:
    if not len(felt):
        return None
    sets = set_of[felt]
    is_new = np.diff(sets, prepend=sets[0] - 1) != 0
    chosen = sets[is_new].tolist()
    vertices: list[I32] = []
    weights: list[F32] = []
    for j in chosen:
        if j < 0:
            assert memory.vertices is not None and memory.weights is not None
            vertices.append(memory.vertices)
            weights.append(memory.weights)
        else:
            part = slice(int(touches.offsets[j]), int(touches.offsets[j + 1]))
            vertices.append(touches.vertices[part])
            weights.append(touches.weights[part])
    return SampleRun(
        stream=touches.stream,
        indices=touches.indices[felt],
        times_s=touches.times_s[felt],
        levels=touches.levels[felt] * response[felt],
        parameters=touches.parameters[felt],
        sets=np.cumsum(is_new) - 1,
        offsets=np.concatenate([[0], np.cumsum([len(v) for v in vertices])]).astype(np.int64),
        vertices=np.concatenate(vertices),
        weights=np.concatenate(weights),
    )
