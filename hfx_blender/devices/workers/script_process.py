# SPDX-License-Identifier: GPL-3.0-or-later
"""Parent side of a script worker: starts it, asks it, ends it.

One question at a time; of those that wait, only the newest. Each has a number, which its answer
brings back. What does not answer in time, ends or talks nonsense has a fault; after three faults
in a minute the script stays off.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from ...engine.arrays import F64
from ...processes.messages import Message, MessageKind, encode_json, message
from ...processes.worker import Worker
from ..host.clock import SYSTEM, Clock
from ..host.device_thread import PATIENCE_S, ScriptRefusedError
from ..live.approval import Approval
from .message_bodies import decode_values

READY_S: Final = 10.0
"""Time limit of a script's start, seconds: it may import what it needs."""

FAULTS: Final = 3
FAULTS_WITHIN_S: Final = 60.0

Answer = Callable[[F64], None]
"""Takes values (columns,)."""

_NUMBERS: Final = 1 << 16

WITHDRAWN: Final = "the approval of its script was withdrawn"
_WATCH_S: Final = 0.05


class ScriptProcess:
    """A device's script.

    Parameters
    ----------
    wish : mapping
        ``path``, ``configuration``, ``fingerprint``, ``device`` and ``folder``.
    fault, log : callable
        Take one sentence; called from a thread, as answers are.
    """

    def __init__(
        self,
        request: Mapping[str, Any],
        fault: Callable[[str], None],
        log: Callable[[str], None],
        clock: Clock = SYSTEM,
    ) -> None:
        self._request = dict(request)
        self._fault, self._log, self._clock = fault, log, clock
        self._approval = Approval(str(request.get("fingerprint")))
        self._lock = threading.RLock()
        self._worker: Worker | None = None
        self._is_ready = False
        self._deadline_s: float | None = None
        self._next: tuple[bytes, Answer] | None = None
        self._number = 0  # of the last request
        self._answer: Answer | None = None  # who takes its answer
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
                    f"{FAULTS_WITHIN_S:.0f} s; connect the device again to retry"
                )
            worker = Worker("devices.workers.script_worker", received=self._take, ended=self._ended)
            worker.start()
            self._worker = worker
            self._is_ready, self._next = False, None
            self._deadline_s = self._clock.now() + READY_S
            if self._approval.was_given:
                threading.Thread(target=self._watch_approval, args=(worker,), daemon=True).start()
            request = encode_json(self._request)
            worker.send(message(MessageKind.HEARTBEAT, 0, request), is_awaited=True)

    def ask(self, haptics: bytes, answer: Answer) -> None:
        """Send the newest haptic data, as soon as the last have been answered.

        ``answer`` gets what it says to these, from a thread; nobody does if newer ones come first.
        """
        with self._lock:
            self._next = haptics, answer
            self._ask_next()

    def is_overdue(self, now_s: float) -> bool:
        """Test for a late answer, or a late start."""
        with self._lock:
            is_late = self._deadline_s is not None and now_s > self._deadline_s
            if is_late:
                self._faults.append(now_s)
                self._deadline_s = None
            return is_late

    def close(self) -> None:
        """End the worker at once, with all processes that the script has started."""
        with self._lock:
            worker, self._worker = self._worker, None
            self._deadline_s = self._next = self._answer = None
        if worker is not None:
            worker.kill()

    def _watch_approval(self, worker: Worker) -> None:
        while worker is self._worker:
            if self._approval.is_withdrawn():
                self.close()
                self._fault(WITHDRAWN)
                return
            time.sleep(_WATCH_S)

    def _ask_next(self) -> None:
        if self._worker is None or not self._is_ready or self._next is None:
            return
        if self._deadline_s is None:
            (body, self._answer), self._next = self._next, None
            self._number = (self._number + 1) % _NUMBERS
            self._deadline_s = self._clock.now() + PATIENCE_S
            self._worker.send(message(MessageKind.HAPTICS, self._number, body), is_awaited=True)

    # Called in a thread of the worker.

    def _take(self, worker: Worker, found: Message) -> str | None:
        with self._lock:
            if worker is not self._worker:
                return ""
            if found.kind is MessageKind.FAULT:
                return f"failed: {found.body.decode(errors='replace')}"
            if found.kind is MessageKind.LOG:
                self._log(found.body.decode(errors="replace"))
                return None
            is_ready = found.kind is MessageKind.READY and not self._is_ready
            is_answer = (
                found.kind is MessageKind.ANSWER and self._is_ready and found.device == self._number
            )
            if self._deadline_s is None or not (is_ready or is_answer):
                return "sent an answer without a question"
            self._is_ready, self._deadline_s = True, None
            answer, self._answer = self._answer, None
            self._ask_next()
        if is_answer and answer is not None:
            answer(decode_values(found.body))
        return None

    def _ended(self, worker: Worker, reason: str) -> None:
        with self._lock:
            if worker is not self._worker:
                return
            self._faults.append(self._clock.now())
        self._fault(f"its script {reason}")
