# SPDX-License-Identifier: GPL-3.0-or-later
"""Executor of units in worker processes of this machine.

A worker process starts with a first unit. A new process takes over after a crash, after a time
limit, and after :data:`RENEW_AFTER` units, which bounds the memory of a worker.
"""

from __future__ import annotations

import queue
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from hfx_blender.errors import HfxError
from hfx_blender.export.batch.units import Outcome, Unit, failure
from hfx_blender.processes.messages import MessageError, decode_json
from hfx_blender.processes.worker import Worker

from ..command_process.temporary_folder import temporary_folder
from .unit_messages import encode_unit

_PROCESS: Final = "hfx_tools.export_workers.unit_process"

RENEW_AFTER = 20
"""Number of units after which a new worker process replaces a worker."""

START_LIMIT_S = 300.0
"""Time limit for the start of a worker's Blender, seconds."""

LIMITED_START_S = 60.0
"""Time limit for the start of a worker for units with a shorter time limit, seconds."""

Progress = Callable[[float], None]


class WorkerDiedError(Exception):
    """Error of a process that ended without an answer; the text is the cause of the end."""


class TimeLimitError(Exception):
    """Error of a process that exceeded its time limit and was ended."""


class UnitWorker:
    """Worker process that exports units of a batch, started at the first unit. One thread at a time
    may call :meth:`do`; any thread may call :meth:`close`. ``variables`` are added to the
    environment."""

    def __init__(self, variables: Mapping[str, str] | None = None) -> None:
        self._variables = {**(variables or {}), "PYTHONUTF8": "1"}
        self._worker: Worker | None = None
        self._count = 0
        self._closed = False

    @property
    def pid(self) -> int | None:
        """Process id; None before the first unit and after the end."""
        worker = self._worker
        return None if worker is None else worker.pid

    def do(self, unit: Unit, progress: Progress, limit_s: float | None = None) -> Outcome:
        """Execute a unit in the worker, started if needed, and return the outcome. Raises
        TimeLimitError for a unit above ``limit_s`` seconds (None: no limit), whose process is
        ended; WorkerDiedError for a process that died or did not start in time, HfxError where
        Blender cannot be started, and OSError where no process can."""
        # Blender never returns some memory, so a process serves a limited number of units.
        if self._count >= RENEW_AFTER:
            self._end()
        worker = self._worker or self._start(limit_s)
        worker.send(encode_unit(unit))
        end = None if limit_s is None else time.monotonic() + limit_s
        while "outcome" not in (answer := self._answer(worker, end)):
            progress(float(answer["progress"]))
        self._count += 1
        outcome: Outcome = answer["outcome"]
        # A unit that left Blender in a doubtful state asks for a new process.
        if outcome.pop("retire", False):
            self._count = RENEW_AFTER
        return outcome

    def _start(self, limit_s: float | None) -> Worker:
        """Start a process and wait until its Blender runs; the wait is at most 300 s, or for units
        with a limit below 300 s at most ``limit_s``, but 60 s or more. Raises as :meth:`do`,
        WorkerDiedError also after :meth:`close`."""
        worker = Worker(
            "hfx_tools.export_workers.unit_process", variables=self._variables, keeps_errors=True
        )
        if not self._closed:
            worker.start()
        self._worker, self._count = worker, 0
        # close() may run in another thread during the start, and then misses the new process.
        if self._closed:
            self._end(0.0)
            raise WorkerDiedError("was not started again")
        start_s = START_LIMIT_S
        if limit_s is not None:
            start_s = min(start_s, max(limit_s, LIMITED_START_S))
        try:
            answer = self._answer(worker, time.monotonic() + start_s)
        except TimeLimitError:
            raise WorkerDiedError(f"did not start within {start_s:g} s") from None
        if "cannot_start" in answer:
            self._end(0.0)
            raise HfxError(answer["cannot_start"])
        return worker

    def _answer(self, worker: Worker, end: float | None) -> dict[str, Any]:
        """Next message of the process; raises TimeLimitError at time ``end`` of the monotonic
        clock, WorkerDiedError after an end or an invalid message. Each error ends the process."""
        try:
            message = worker.receive(None if end is None else max(end - time.monotonic(), 0.0))
            if message is not None:
                return decode_json(message.body)
            is_known = bool(worker.fault)
        except TimeoutError:
            self._end(0.0)
            raise TimeLimitError from None
        except MessageError:
            is_known = True
        if is_known:
            self._end(0.0)
            raise WorkerDiedError("answered something else")
        self._worker = None
        raise WorkerDiedError(worker.how_it_ended())

    def close(self) -> None:
        """End the process, killed after 10 s, with its unit, and prevent further starts; may be
        called again, from any thread."""
        self._closed = True
        self._end()

    def _end(self, limit_s: float | None = None) -> None:
        """End the process, if any, killed after ``limit_s`` seconds (None: 10)."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close(limit_s)


def do_or_retry(
    worker: UnitWorker, unit: Unit, progress: Progress, limit_s: float | None
) -> Outcome:
    """Execute a unit in a worker, twice if the worker dies; every error becomes an outcome."""
    # A crash may come from an earlier unit, so the unit gets a fresh process once. A time limit
    # or a fault of the scene would only repeat.
    reasons = []
    for _ in range(2):
        try:
            return worker.do(unit, progress, limit_s)
        except TimeLimitError:
            return failure(unit, f"took longer than the time limit of {limit_s:g} s", 3)
        except WorkerDiedError as error:
            reasons.append(str(error))
        except HfxError as error:
            return failure(unit, str(error), error.exit_code)
        except OSError as error:  # no more processes, for instance
            return failure(unit, f"no worker process can be started ({error})", 3)
    last = reasons[-1]
    return failure(unit, f"its worker process {last}, and so did a second one", 1)


_TIDY_LIMIT_S: Final = 10.0


class LocalWorkers:
    """Executor with ``jobs`` worker processes of this machine; a crash or hang costs one unit.
    ``limit_s`` is the time limit of a unit in seconds (None: no limit)."""

    def __init__(self, jobs: int, limit_s: float | None = None) -> None:
        self.slots = jobs
        self._limit_s = limit_s
        self._stack = ExitStack()
        variables = {}
        # A common temporary folder removes the files of killed workers, too.
        with suppress(OSError):  # fall back to the default temporary folders
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
        """Queue a unit for the next idle worker, without waiting; the future returns the
        outcome."""
        return self._pool.submit(self._run_queued, unit, progress)

    def _run_queued(self, unit: Unit, progress: Progress) -> Outcome:
        # Last in, first out: workers that run already are used before new ones start. Each unit
        # has a folder of its own, so that the files of a killed process can be removed.
        worker = self._idle.get()
        stage = Path(tempfile.mkdtemp(dir=unit.stage))
        outcome: Outcome = {"error": ""}
        try:
            outcome = do_or_retry(worker, replace(unit, stage=str(stage)), progress, self._limit_s)
            return outcome
        finally:
            # A dead process leaves its files. After success the files of a part stay for the merge.
            if "error" in outcome:
                shutil.rmtree(stage, ignore_errors=True)
            self._idle.put(worker)

    def close(self) -> None:
        """Cancel waiting units and end all workers, with units in execution, each killed after 10
        s; wait for their cleanup. May be called again."""
        workers, self._workers = self._workers, []
        if not workers:
            return
        self._pool.shutdown(wait=False, cancel_futures=True)
        with ThreadPoolExecutor(len(workers)) as closing:  # in parallel: a hanging process is slow
            list(closing.map(UnitWorker.close, workers))
        # Wait for the cleanup of units, not for the end of their threads: after Ctrl-C a thread may
        # wait for the lock of a future forever.
        end = time.monotonic() + _TIDY_LIMIT_S
        with suppress(queue.Empty):
            for _ in workers:
                self._idle.get(timeout=max(end - time.monotonic(), 0.0))
        self._stack.close()
