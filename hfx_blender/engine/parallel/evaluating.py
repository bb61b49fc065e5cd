# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates the blocks of a scene on several cores, in helper processes.

This process reads and hands out blocks, evaluates what nobody else has when it would have to
wait, and gives on what was felt in the order of time. A helper that fails costs what it had
begun: that is done here.
"""

from __future__ import annotations

import subprocess
import threading
import time
from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from typing import Any, Final

from ... import own_processes
from ..counters import Counters
from ..evaluate import Engine
from ..response.touches import Touches
from ..samples import SampleRun
from ..scene import AnimationBlock, HapticSurface, HapticVolume
from ..volume.mesh import MeshVolume
from .overlapping import short_turns
from .serialization import decode_object, encode_object, receive, send

Answer = tuple[list[SampleRun], list[Touches], Counters]

WORTH_S: Final = 2.0
"""Remaining time on one core, seconds, from which on helpers are started: each takes half a second
of a core to start."""

MOST: Final = 8
"""Largest number of processes: more would wait for the one that reads the scene and renders its
devices."""

_AHEAD: Final = 2  # blocks that a helper has at once, so that it never waits

_HELP: Final = 0.3
"""Threads that are busy for that part of the time of evaluating take a processor of their own."""


def evaluated(
    engine: Engine,
    blocks: Iterator[AnimationBlock],
    *,
    samples: int,
    processes: int,
    worth_s: float = WORTH_S,
) -> Generator[tuple[AnimationBlock, list[SampleRun]], None, None]:
    """Yield blocks with their samples, in their order: the same for any ``processes``.

    Parameters
    ----------
    engine : Engine
        Made for standard models; its counters count what has been given on.
    blocks : iterator of AnimationBlock
        Read on a little ahead of what is given on.
    samples : int
        How many they hold, to judge whether help pays.
    processes : int
        How many, with this one, and less one where threads of the engine have much to do.
    worth_s : float
        See :data:`WORTH_S`.
    """
    is_alone = processes < 2 or not _may_be_split(engine)
    begun: deque[_PendingBlock] = deque()
    wanted, spent_s, done = 0, 0.0, 0
    # Work that a block leaves to threads goes on while the next one is read and begun.
    ahead = int(engine.threads is not None)
    with short_turns() if ahead else nullcontext():
        for number, block in enumerate(blocks):
            begun.append(_PendingBlock(engine, block))
            if len(begun) <= ahead:
                continue
            head = begun.popleft()
            yield head.block, head.ended()
            count = len(head.block.own_indices)
            samples -= count
            if is_alone or number == ahead:  # the first loads models
                continue
            spent_s, done = spent_s + head.taken_s, done + count
            if spent_s / max(done, 1) * samples > worth_s:
                wanted = min(processes, MOST) - 1 - _threads_in_use(engine, spent_s)
                is_alone = wanted < 1
            if wanted > 0:
                break
        for each in begun:
            yield each.block, each.ended()
    if wanted < 1:
        return
    helpers = _helpers(engine, wanted)
    try:
        yield from _shared(engine, blocks, helpers)
    finally:
        for helper in helpers:
            helper.close()


def _threads_in_use(engine: Engine, spent_s: float) -> int:
    """Number of processors that the engine's threads use while this thread works for a time."""
    busy_s = 0.0 if engine.threads is None else engine.threads.busy_s
    return int(busy_s > _HELP * spent_s)


class _PendingBlock:
    """Block whose evaluation has begun; its counters are added when it ends."""

    def __init__(self, engine: Engine, block: AnimationBlock) -> None:
        start_s = time.thread_time()
        self.block = block
        self._counters, before = engine.counters, engine.counters.copy()
        self._end = engine.begin(block)
        self._counted = engine.counters.since(before)
        engine.counters.go_back(before)
        self.taken_s = time.thread_time() - start_s

    def ended(self) -> list[SampleRun]:
        """Finish the block and return its samples."""
        start_s = time.perf_counter()  # waiting for threads counts
        self._counters.add(self._counted)
        runs = self._end()
        self.taken_s += time.perf_counter() - start_s
        return runs


def _may_be_split(engine: Engine) -> bool:
    """Test that blocks can be evaluated independently, except for the settling of responses."""
    areas = [effect.area for effect in engine.scene.effects]
    responds = any(isinstance(area, HapticVolume) and area.response for area in areas)
    on_surfaces = any(isinstance(area, HapticSurface) for area in areas)
    return not (on_surfaces or (responds and engine.record))


@dataclass(eq=False)
class _Task:
    block: AnimationBlock
    answer: Future[Answer | None] | None = None  # None: not assigned yet

    def result(self) -> Answer | None:
        """Answer of a helper; None where it could not evaluate the block."""
        return None if self.answer is None else self.answer.result()


def _shared(
    engine: Engine, blocks: Iterator[AnimationBlock], helpers: list[_Helper]
) -> Iterator[tuple[AnimationBlock, list[SampleRun]]]:
    tasks: deque[_Task] = deque()
    is_read = False
    while True:
        while not is_read and len(tasks) <= _AHEAD * len(helpers):
            block = next(blocks, None)
            is_read = block is None
            if block is not None:
                tasks.append(_Task(block))
                _assign(tasks, helpers)
        if not tasks:
            return
        head = tasks[0]
        if head.answer is not None and not head.answer.done():
            free = next((task for task in tasks if task.answer is None), None)
            if free is not None:
                free.answer = Future()
                free.answer.set_result(_evaluate_here(engine, free.block))
                _assign(tasks, helpers)
                continue
        answer = head.result() or _evaluate_here(engine, head.block)
        tasks.popleft()
        _assign(tasks, helpers)
        yield head.block, _settled(engine, answer)


def _assign(tasks: deque[_Task], helpers: list[_Helper]) -> None:
    for task in tasks:
        if task.answer is None:
            able = [helper for helper in helpers if helper.waiting < _AHEAD and helper.is_alive]
            if not able:
                return
            task.answer = min(able, key=lambda helper: helper.waiting).submit(task.block)


def _evaluate_here(engine: Engine, block: AnimationBlock) -> Answer:
    """Evaluate a block in this process, without counting yet."""
    before = engine.counters.copy()
    engine.responses.defers = True
    try:
        runs = engine.evaluate(block)
    finally:
        engine.responses.defers = False
        touches = engine.responses.take_deferred()
    counted = engine.counters.since(before)
    engine.counters.go_back(before)
    return runs, touches, counted


def _settled(engine: Engine, answer: Answer) -> list[SampleRun]:
    """Samples of the next block, counted, in the order of effects and bodies."""
    runs, touches, counted = answer
    engine.counters.add(counted)
    if not touches:
        return runs
    settled = engine.responses.settling.settle_all(touches)
    engine.counters.contacts += sum(run.contact_count for run in settled)
    effects = {effect.id: k for k, effect in enumerate(engine.scene.effects)}
    bodies = {body.id: k for k, body in enumerate(engine.scene.bodies)}
    return sorted(
        [*runs, *settled],
        key=lambda run: (effects[run.stream.effect_id], bodies.get(run.stream.body_id, 0)),
    )


def _helpers(engine: Engine, count: int) -> list[_Helper]:
    settings = encode_object((engine.scene, engine.record, engine.tolerance))
    found = []
    with suppress(OSError):  # a process that cannot be started is left out
        for _ in range(count):
            found.append(_Helper(settings))
    return found


@dataclass(eq=False)
class _Meshes:
    """Meshes that a helper knows: those of the last block that it was given."""

    numbers: dict[MeshVolume, int] = field(default_factory=dict)
    last: int = 0

    def of(self, block: AnimationBlock) -> tuple[list[int], dict[int, MeshVolume]]:
        """Numbers that stay known, and meshes that are new."""
        meshes = {
            shape: None
            for effect in block.effects
            for shape in effect.shapes
            if isinstance(shape, MeshVolume)
        }
        kept = {mesh: self.numbers[mesh] for mesh in meshes if mesh in self.numbers}
        fresh: dict[MeshVolume, int] = {}
        for mesh in meshes:
            if mesh not in kept:
                self.last += 1
                fresh[mesh] = self.last
        self.numbers = kept | fresh
        return list(kept.values()), {number: mesh for mesh, number in fresh.items()}


class _Helper:
    """Helper process that evaluates blocks for this one.

    Raises
    ------
    OSError
        It cannot be started.
    """

    def __init__(self, settings: bytes) -> None:
        self._process = own_processes.start(
            own_processes.command("engine.parallel.evaluation_worker"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # The cores have work.
            variables={"OPENBLAS_NUM_THREADS": "1"},
        )
        self._meshes = _Meshes()
        self._lock = threading.Lock()
        self._asked: deque[Future[Answer | None]] = deque()
        self._is_alive = True
        threading.Thread(target=self._listen, daemon=True).start()
        self._send(settings)

    @property
    def is_alive(self) -> bool:
        """State of the helper: False as soon as it can no longer be asked."""
        return self._is_alive

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def waiting(self) -> int:
        """Number of blocks without an answer."""
        return len(self._asked)

    def submit(self, block: AnimationBlock) -> Future[Answer | None]:
        """Hand the helper a block; the answer is None where it cannot evaluate it."""
        answer: Future[Answer | None] = Future()
        with self._lock:
            if not self._is_alive:
                answer.set_result(None)
                return answer
            self._asked.append(answer)
        kept, fresh = self._meshes.of(block)
        self._send(encode_object((kept, fresh)))
        self._send(encode_object(block, self._meshes.numbers))
        return answer

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.wait()
        stdin = self._process.stdin
        assert stdin is not None
        with suppress(OSError):
            stdin.close()

    def _send(self, body: bytes) -> None:
        stdin = self._process.stdin
        assert stdin is not None
        with suppress(OSError, ValueError):  # the listener notices
            send(stdin, body)

    def _listen(self) -> None:
        stdout = self._process.stdout
        assert stdout is not None
        try:
            with suppress(OSError, ValueError), stdout:
                while (body := receive(stdout)) is not None:
                    found: Any = decode_object(body)
                    self._asked[0].set_result(found)
                    self._asked.popleft()
        finally:  # on any error: nobody may wait for ever
            with self._lock:
                self._is_alive = False
                left = list(self._asked)
            for answer in left:
                if not answer.done():
                    answer.set_result(None)
