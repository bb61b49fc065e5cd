# SPDX-License-Identifier: GPL-3.0-or-later
"""Unit executors on this machine: this process itself, or worker processes."""

from __future__ import annotations

import queue
import shutil
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final, Protocol

from ...files.staging import temporary_folder
from .units import Outcome, Unit
from .worker_process import UnitWorker, do_or_retry

Progress = Callable[[float], None]

_TIDY_LIMIT_S: Final = 10.0


class Workers(Protocol):
    """Interface of unit executors."""

    @property
    def slots(self) -> int:
        """Number of units that can be processed at once."""
        ...

    def submit(self, unit: Unit, progress: Progress) -> Future[Outcome]:
        """Begin a unit; the future gives its outcome."""
        ...

    def close(self) -> None:
        """End all work, whatever is being done."""
        ...


class ThisProcess:
    """Executor in this process: does each unit at once. A crash ends all of them."""

    slots = 1

    def submit(self, unit: Unit, progress: Progress) -> Future[Outcome]:
        """Do a unit now; the future is finished."""
        from .work import run_safely

        future: Future[Outcome] = Future()
        future.set_result(run_safely(unit, progress))
        return future

    def close(self) -> None:
        """Do nothing: no process is to be ended."""


class LocalWorkers:
    """Worker processes of this machine; one that crashes or hangs costs one unit.

    Parameters
    ----------
    jobs : int
        How many.
    limit_s : float, optional
        Seconds that a unit may take.
    """

    def __init__(self, jobs: int, limit_s: float | None = None) -> None:
        self.slots = jobs
        self._limit_s = limit_s
        self._stack = ExitStack()
        variables = {}
        # Their temporary files go with it, even if they crash or are killed.
        with suppress(OSError):  # else each finds what it can use
            folder = self._stack.enter_context(temporary_folder())
            variables = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))
        self._workers = [UnitWorker(variables) for _ in range(jobs)]
        self._idle: queue.LifoQueue[UnitWorker] = queue.LifoQueue()
        for worker in self._workers:
            self._idle.put(worker)
        self._pool = ThreadPoolExecutor(jobs)

    @property
    def pids(self) -> list[int]:
        """Process ids of the running workers."""
        return [worker.pid for worker in self._workers if worker.pid is not None]

    def submit(self, unit: Unit, progress: Progress) -> Future[Outcome]:
        """Begin a unit."""
        return self._pool.submit(self._run_queued, unit, progress)

    def _run_queued(self, unit: Unit, progress: Progress) -> Outcome:
        worker = self._idle.get()
        stage = Path(tempfile.mkdtemp(dir=unit.stage))
        outcome: Outcome = {"error": ""}
        try:
            outcome = do_or_retry(worker, unit.in_stage(stage), progress, self._limit_s)
            return outcome
        finally:
            if "error" in outcome:  # a process that died has not tidied up
                shutil.rmtree(stage, ignore_errors=True)
            self._idle.put(worker)

    def close(self) -> None:
        """End all workers; may be called again."""
        workers, self._workers = self._workers, []
        if not workers:
            return
        self._pool.shutdown(wait=False, cancel_futures=True)
        with ThreadPoolExecutor(len(workers)) as closing:  # a hanging process takes time
            list(closing.map(UnitWorker.close, workers))
        # Until units have tidied up. Not until their threads have ended: where Ctrl-C struck while
        # their outcomes were waited for, these may wait for a lock that is never released.
        end = time.monotonic() + _TIDY_LIMIT_S
        with suppress(queue.Empty):
            for _ in workers:
                self._idle.get(timeout=max(end - time.monotonic(), 0.0))
        self._stack.close()
