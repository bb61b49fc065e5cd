# SPDX-License-Identifier: GPL-3.0-or-later
"""The output process's side of a device script: starts its worker, asks it, ends it.

One question at a time; of those that wait, only the newest. What does not answer in time, ends
or talks nonsense has a fault; after three faults in a minute the script stays off.
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ... import own_processes
from .approval import Approval
from .lane import PATIENCE_S, ScriptRefusedError
from .messages import Kind, MessageError, json_to, message, read_message, values_from

F64 = npt.NDArray[np.float64]

READY_S: Final = 10.0
"""A script has so long to start: it may import what it needs."""

FAULTS: Final = 3
FAULTS_WITHIN_S: Final = 60.0

WITHDRAWN: Final = "the approval of its script was withdrawn"
_WATCH_S: Final = 0.05

_log = logging.getLogger(__name__)


class ScriptProcess:
    """A device's script.

    Parameters
    ----------
    wish : mapping
        ``path``, ``configuration``, ``fingerprint``, ``device`` and ``folder``.
    answer : callable
        Takes values (columns,).
    fault, log : callable
        Take one sentence. All three are called from a thread.
    """

    def __init__(
        self,
        wish: Mapping[str, Any],
        answer: Callable[[F64], None],
        fault: Callable[[str], None],
        log: Callable[[str], None],
    ) -> None:
        self._wish = dict(wish)
        self._answer, self._fault, self._log = answer, fault, log
        self._approval = Approval(str(wish.get("fingerprint")))
        self._lock = threading.RLock()
        self._process: subprocess.Popen[bytes] | None = None
        self._is_ready = False
        self._deadline_s: float | None = None
        self._next: bytes | None = None
        self._faults: deque[float] = deque(maxlen=FAULTS)

    def start(self) -> None:
        """Start a new worker.

        Raises
        ------
        ScriptRefusedError
            It had three faults within a minute, or its approval was withdrawn.
        """
        with self._lock:
            self.close()
            if self._approval.is_withdrawn():
                raise ScriptRefusedError(WITHDRAWN)
            if len(self._faults) == FAULTS and self._faults[-1] - self._faults[0] < FAULTS_WITHIN_S:
                raise ScriptRefusedError(
                    f"its script stays off after {FAULTS} faults within "
                    f"{FAULTS_WITHIN_S:.0f} s; connect the device anew to try again"
                )
            self._process = subprocess.Popen(
                own_processes.command("devices.live.script_worker"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # it ends together with what it may have started
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
            self._is_ready, self._next = False, None
            self._deadline_s = time.monotonic() + READY_S
            threading.Thread(target=self._listen, args=(self._process,), daemon=True).start()
            if self._approval.was_given:
                threading.Thread(
                    target=self._watch_approval, args=(self._process,), daemon=True
                ).start()
            self._send(message(Kind.HEARTBEAT, 0, json_to(self._wish)))

    def ask(self, haptics: bytes) -> None:
        """Tell it the newest haptic data, when it has answered what it was asked before."""
        with self._lock:
            self._next = haptics
            self._ask_next()

    def is_overdue(self, now_s: float) -> bool:
        """Whether its answer, or its start, is late."""
        with self._lock:
            is_late = self._deadline_s is not None and now_s > self._deadline_s
            if is_late:
                self._faults.append(now_s)
                self._deadline_s = None
            return is_late

    def close(self) -> None:
        """End the worker at once, whatever it does."""
        with self._lock:
            process, self._process = self._process, None
            self._deadline_s = self._next = None
        if process is None:
            return
        _kill(process)
        with suppress(OSError):
            assert process.stdin is not None
            process.stdin.close()
        threading.Thread(target=process.wait, daemon=True).start()

    def _watch_approval(self, process: subprocess.Popen[bytes]) -> None:
        while process is self._process:
            if self._approval.is_withdrawn():
                self.close()
                self._fault(WITHDRAWN)
                return
            time.sleep(_WATCH_S)

    def _ask_next(self) -> None:
        if self._process is None or not self._is_ready or self._next is None:
            return
        if self._deadline_s is None:
            body, self._next = self._next, None
            self._deadline_s = time.monotonic() + PATIENCE_S
            self._send(message(Kind.HAPTICS, 0, body))

    def _send(self, data: bytes) -> None:
        """In a thread: a worker that does not read must not make the reader wait."""
        process = self._process
        if process is None or process.stdin is None:
            return
        stream = process.stdin

        def write() -> None:
            with suppress(OSError, ValueError):  # the listener tells
                stream.write(data)
                stream.flush()

        if len(data) <= _PIPE:
            write()  # one question at a time, all of it read before: this fits into the pipe
        else:
            threading.Thread(target=write, daemon=True).start()

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        stream = process.stdout
        assert stream is not None
        text = "its script has ended"
        try:
            with stream:
                while True:
                    found = read_message(stream)
                    if found is None:
                        break
                    with self._lock:
                        if process is not self._process:
                            return
                        if found.kind is Kind.FAULT:
                            text = f"its script failed: {found.body.decode(errors='replace')}"
                            break
                        if found.kind is Kind.LOG:
                            self._log(found.body.decode(errors="replace"))
                            continue
                        is_ready = found.kind is Kind.READY and not self._is_ready
                        is_answer = found.kind is Kind.ANSWER and self._is_ready
                        if self._deadline_s is None or not (is_ready or is_answer):
                            text = "its script spoke without being asked"
                            break
                        self._is_ready, self._deadline_s = True, None
                        self._ask_next()
                    if is_answer:
                        self._answer(values_from(found.body))
        except (MessageError, OSError, ValueError) as error:
            text = f"its script's process sent {error}"
        with self._lock:
            if process is not self._process:
                return
            self._faults.append(time.monotonic())
        self._fault(text)


_PIPE: Final = 4096
"""So much a pipe takes at once on every system."""


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
