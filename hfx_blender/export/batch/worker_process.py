# SPDX-License-Identifier: GPL-3.0-or-later
"""Handle of one worker process: started on demand, and started anew after a crash, after a time
limit, and after some units, so that nothing piles up in its memory."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import IO, Any

from ...errors import HfxError
from ...processes import start
from .units import Outcome, Unit, failure

RENEW_AFTER = 20
"""Units after which a worker is replaced by a new one."""

START_LIMIT_S = 300.0
_END_LIMIT_S = 10.0
_REPORTED_LINES = 40

Progress = Callable[[float], None]


class WorkerDiedError(Exception):
    """The process ended without an answer; says how."""


class TimeLimitError(Exception):
    """Raised after a process was ended because it took too long."""


def worker_command() -> list[str]:
    """Command line that starts a worker on this machine."""
    return start.command("export.batch.export_worker")


class WorkerProcess:
    """Worker process; used by one thread at a time, but closed by any.

    Parameters
    ----------
    variables : mapping, optional
        Of its environment, besides those of this process.
    """

    def __init__(self, variables: Mapping[str, str] | None = None) -> None:
        self._variables = {**(variables or {}), "PYTHONUTF8": "1"}
        self._command = worker_command()
        self._process: subprocess.Popen[str] | None = None
        self._answers: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._last_lines: deque[str] = deque(maxlen=_REPORTED_LINES)
        self._count = 0
        self._closed = False

    @property
    def pid(self) -> int | None:
        """Process id, or None."""
        return None if self._process is None else self._process.pid

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
        if self._process is None:
            self._start()
        assert self._process is not None and self._process.stdin is not None
        try:
            self._process.stdin.write(unit.as_json() + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError) as error:
            raise self._died() from error
        end = None if limit_s is None else time.monotonic() + limit_s
        while True:
            message = self._answer(end)
            if "progress" in message:
                progress(float(message["progress"]))
                continue
            self._count += 1
            outcome: Outcome = message["outcome"]
            if outcome.pop("retire", False):
                self._count = RENEW_AFTER
            return outcome

    def _start(self) -> None:
        if self._closed:
            raise WorkerDiedError("was not started again")
        group: dict[str, Any] = {"start_new_session": True}  # Ctrl-C is for the master only
        if os.name == "nt":
            group = {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
        self._last_lines.clear()
        self._count = 0
        self._answers = queue.SimpleQueue()
        process = start.start(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            variables=self._variables,
            **group,
        )
        self._process = process
        if self._closed:  # meanwhile: closing it missed the new process
            self.kill()
            raise WorkerDiedError("was not started again")
        assert process.stdout is not None and process.stderr is not None
        threading.Thread(
            target=self._listen, args=(process.stdout, self._answers), daemon=True
        ).start()
        self._overhearing = threading.Thread(
            target=self._collect_lines, args=(process.stderr,), daemon=True
        )
        self._overhearing.start()
        message = self._answer(time.monotonic() + START_LIMIT_S)
        if "cannot_start" in message:
            self.kill()
            raise HfxError(message["cannot_start"])

    def _listen(self, stream: IO[str], answers: queue.SimpleQueue[str | None]) -> None:
        with suppress(OSError, ValueError):
            for line in stream:
                answers.put(line)
        answers.put(None)

    def _collect_lines(self, stream: IO[str]) -> None:
        with suppress(OSError, ValueError):
            for line in stream:
                self._last_lines.append(line.rstrip())

    def _answer(self, end: float | None) -> dict[str, Any]:
        try:
            wait = None if end is None else max(end - time.monotonic(), 0.0)
            line = self._answers.get(timeout=wait)
        except queue.Empty:
            self.kill()
            raise TimeLimitError from None
        if line is None:
            raise self._died()
        try:
            found: dict[str, Any] = json.loads(line)
            return found
        except ValueError:
            self._last_lines.append(line)
            self.kill()
            raise WorkerDiedError("answered something else") from None

    def _died(self) -> WorkerDiedError:
        process = self._process
        self._process = None
        if process is None:
            return WorkerDiedError("was ended")
        try:
            code = process.wait(_END_LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        # Its last words may still be in the pipe; a child of its own may keep that open.
        self._overhearing.join(1.0)
        return WorkerDiedError(_end_of_process(code, list(self._last_lines)))

    def close(self) -> None:
        """End the process; it finishes nothing. May be called again, and by another thread."""
        self._closed = True
        self._end()

    def _end(self) -> None:
        process = self._process
        if process is None:
            return
        with suppress(OSError, ValueError):
            if process.stdin is not None:
                process.stdin.close()
        try:
            process.wait(_END_LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._process = None

    def kill(self) -> None:
        """End the process at once."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()


def _end_of_process(code: int, lines: list[str]) -> str:
    """Describe how a process ended."""
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        if name == "SIGKILL":
            return "was killed; the system does so when memory runs out"
        if name in ("SIGSEGV", "SIGBUS", "SIGILL", "SIGABRT", "SIGFPE"):
            return f"crashed ({name})"
        return f"was ended by {name}"
    last = next((line for line in reversed(lines) if line.strip()), "")
    return f"ended with code {code}" + (f" ({last.strip()[:200]})" if last else "")


def do_or_retry(
    worker: WorkerProcess, unit: Unit, progress: Progress, limit_s: float | None
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
