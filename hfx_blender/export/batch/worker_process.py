# SPDX-License-Identifier: GPL-3.0-or-later
"""Handle of one worker process: started on demand, and started anew after a crash, after a time
limit, and after some units, so that nothing piles up in its memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from ...errors import HfxError
from ...processes.messages import MessageError, decode_json, json_message
from ...processes.worker import Worker
from .units import Outcome, Unit, failure

RENEW_AFTER = 20
"""Units after which a worker is replaced by a new one."""

START_LIMIT_S = 300.0

Progress = Callable[[float], None]


class WorkerDiedError(Exception):
    """The process ended without an answer; says how."""


class TimeLimitError(Exception):
    """Raised after a process was ended because it took too long."""


class UnitWorker:
    """Worker that does units; used by one thread at a time, but closed by any.

    Parameters
    ----------
    variables : mapping, optional
        Of its environment, besides those of this process.
    """

    def __init__(self, variables: Mapping[str, str] | None = None) -> None:
        self._variables = {**(variables or {}), "PYTHONUTF8": "1"}
        self._worker: Worker | None = None
        self._count = 0
        self._closed = False

    @property
    def pid(self) -> int | None:
        """Process id, or None."""
        worker = self._worker
        return None if worker is None else worker.pid

    def do(self, unit: Unit, progress: Progress, limit_s: float | None = None) -> Outcome:
        """Have a unit done.

        Raises
        ------
        WorkerDiedError
            The process died; it is started anew for the next unit.
        TimeLimitError
            The same, as it took longer than ``limit_s``.
        HfxError
            Blender cannot be started on this machine.
        """
        if self._count >= RENEW_AFTER:
            self._end()
        worker = self._worker or self._start()
        worker.send(json_message(unit.as_json()))
        end = None if limit_s is None else time.monotonic() + limit_s
        while "outcome" not in (answer := self._answer(worker, end)):
            progress(float(answer["progress"]))
        self._count += 1
        outcome: Outcome = answer["outcome"]
        if outcome.pop("retire", False):
            self._count = RENEW_AFTER
        return outcome

    def _start(self) -> Worker:
        worker = Worker("export.batch.export_worker", variables=self._variables, keeps_errors=True)
        if not self._closed:
            worker.start()
        self._worker, self._count = worker, 0
        if self._closed:  # perhaps meanwhile: closing missed the new process
            self._end(0.0)
            raise WorkerDiedError("was not started again")
        answer = self._answer(worker, time.monotonic() + START_LIMIT_S)
        if "cannot_start" in answer:
            self._end(0.0)
            raise HfxError(answer["cannot_start"])
        return worker

    def _answer(self, worker: Worker, end: float | None) -> dict[str, Any]:
        try:
            found = worker.receive(None if end is None else max(end - time.monotonic(), 0.0))
            if found is not None:
                return decode_json(found.body)
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
        """End the process; it finishes nothing. May be called again, and by another thread."""
        self._closed = True
        self._end()

    def _end(self, limit_s: float | None = None) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close(limit_s)


def do_or_retry(
    worker: UnitWorker, unit: Unit, progress: Progress, limit_s: float | None
) -> Outcome:
    """Do a unit in a worker; if the worker dies, a new one tries once more."""
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
