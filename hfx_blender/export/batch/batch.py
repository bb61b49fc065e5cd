# SPDX-License-Identifier: GPL-3.0-or-later
"""Scheduler of a batch: assigns scenes, and parts of long scenes, to workers."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from typing import Any, Final, Protocol

from ...processes import process_end
from . import journal, pieces
from .units import Outcome, Unit

_LOOK_S: Final = 0.2  # a waiting thread cannot receive Ctrl-C on Windows

Progress = Callable[[float], None]
Tell = Callable[[Unit, Outcome], None]


class Workers(Protocol):
    """Interface of unit executors."""

    @property
    def slots(self) -> int:
        """Number of units in execution at a time."""
        ...

    def submit(self, unit: Unit, progress: Progress) -> Future[Outcome]:
        """Begin a unit; the future returns the outcome."""
        ...

    def close(self) -> None:
        """End all work, also units in execution, and wait for the end; may be called again."""
        ...


class ThisProcess:
    """Executor in this process; a crash ends the process and all units."""

    slots = 1

    def submit(self, unit: Unit, progress: Progress) -> Future[Outcome]:
        """Execute a unit in this thread and return a finished future; errors are outcomes."""
        from .work import run_safely

        future: Future[Outcome] = Future()
        future.set_result(run_safely(unit, progress))
        return future

    def close(self) -> None:
        """Do nothing: this executor has no processes to end."""


@dataclass(eq=False)
class _Scene:
    """State of one scene of the batch."""

    unit: Unit
    outcome: Outcome | None = None
    shares: dict[int, float] = field(default_factory=lambda: {0: 0.0})  # of each part
    parts: dict[int, dict[str, Any]] = field(default_factory=dict)  # recorded so far

    @property
    def share(self) -> float:
        """Finished share, 0..1: the mean of all parts, 1 with an outcome."""
        if self.outcome is not None:
            return 1.0
        return sum(self.shares.values()) / len(self.shares)


def run(
    units: Sequence[Unit],
    workers: Workers,
    *,
    resume: bool = False,
    progress: Progress = lambda share: None,
    tell: Tell = lambda unit, outcome: None,
) -> list[Outcome]:
    """Process a batch of scenes and return the outcomes in the order of the units.

    A failed scene does not stop the batch. ``units`` are of the kinds ``scene``, ``piece`` and
    ``join``. ``workers`` is not closed. ``resume`` takes unchanged results of an earlier run
    instead of a new export. ``progress`` is called with the finished share of the batch, 0..1,
    ``tell`` with each unit and the outcome, in order of completion.
    """
    batch = _Batch([_Scene(unit) for unit in units], workers, progress, tell)
    if resume:
        batch.leave_out_finished()
    return batch.run()


class _Batch:
    """State of a batch: scenes that wait, parts and merges that are ready, and running units. Ready
    parts and merges go before waiting scenes."""

    def __init__(
        self, scenes: list[_Scene], workers: Workers, progress: Progress, tell: Tell
    ) -> None:
        self._scenes = scenes
        self._workers = workers
        self._progress = progress
        self._tell = tell
        self._waiting: deque[_Scene] = deque(scenes)
        self._ready: deque[tuple[_Scene, int, Unit]] = deque()  # with the number of the part
        self._running: dict[Future[Outcome], tuple[_Scene, int, Unit]] = {}

    def leave_out_finished(self) -> None:
        """Give scenes with unchanged earlier results, by the journal, these as outcome; such scenes
        are not executed."""

        def results(scene: _Scene) -> Outcome:
            """Report of the scene, which includes its pieces, or record of the piece; or empty."""
            report = journal.finished(scene.unit)
            if report is not None:
                return {"report": report}
            record = pieces.finished(scene.unit) if scene.unit.kind == "piece" else None
            return {} if record is None else {"piece": record}

        with ThreadPoolExecutor() as pool:  # hashing releases Python's lock
            earlier_results = list(pool.map(results, self._scenes))
        for scene, earlier in zip(self._scenes, earlier_results, strict=True):
            if earlier:
                self._finish(scene, {"input": scene.unit.title, **earlier, "unchanged": True})
        self._waiting = deque(scene for scene in self._scenes if scene.outcome is None)

    def run(self) -> list[Outcome]:
        """Execute all units; returns the outcomes of the scenes in order. TerminatedError after a
        signal."""
        self._fill()
        while self._running:
            # The timeout lets the main thread check for signals while workers are busy.
            finished, _ = wait(self._running, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
            process_end.check()
            for future in finished:
                scene, number, unit = self._running.pop(future)
                self._take(scene, number, unit, future.result())
            self._fill()
        return [scene.outcome for scene in self._scenes if scene.outcome is not None]

    def _fill(self) -> None:
        """Assign units to idle workers."""
        while len(self._running) < self._workers.slots and (self._ready or self._waiting):
            if self._ready:
                scene, number, unit = self._ready.popleft()
            else:
                scene, number = self._waiting.popleft(), 0
                # Parts are useful only for workers without another scene.
                parts = 1 if self._waiting else self._workers.slots
                unit = replace(scene.unit, parts=parts)

            def report_progress(share: float, scene: _Scene = scene, number: int = number) -> None:
                scene.shares[number] = share
                self._show()

            self._running[self._workers.submit(unit, report_progress)] = scene, number, unit

    def _take(self, scene: _Scene, number: int, unit: Unit, outcome: Outcome) -> None:
        """Handle the outcome of a unit: queue parts or the merge of all parts, or finish the scene.
        The first failed part finishes its scene; later outcomes of the scene are ignored."""
        if scene.outcome is not None:
            return  # another part of the scene has failed
        if "split" in outcome:
            cut = outcome["split"]
            scene.shares = dict.fromkeys(range(len(cut)), 0.0)
            for k, part in enumerate(cut):
                part_unit = replace(unit, kind="part", part=tuple(part))
                self._ready.append((scene, k, part_unit))
        elif "part" in outcome:
            scene.shares[number] = 1.0
            scene.parts[number] = outcome["part"]
            # Parts finish in any order; the merge needs all of them, in order of time.
            if len(scene.parts) == len(scene.shares):
                ordered = tuple(scene.parts[k] for k in sorted(scene.parts))
                # First in the queue: a merge completes a scene, further parts only begin others.
                self._ready.appendleft((scene, 0, replace(unit, kind="merge", done=ordered)))
        else:
            # Parts still in the queue are useless if one of them has failed.
            self._ready = deque(entry for entry in self._ready if entry[0] is not scene)
            self._finish(scene, outcome)

    def _finish(self, scene: _Scene, outcome: Outcome) -> None:
        scene.outcome = outcome
        self._show()
        self._tell(scene.unit, outcome)

    def _show(self) -> None:
        self._progress(sum(scene.share for scene in self._scenes) / max(len(self._scenes), 1))
