# SPDX-License-Identifier: GPL-3.0-or-later
"""Parent side of a script worker: start, questions, time limits, approval and end.

The worker gets one question at a time; of unsent questions only the newest is sent. An answer
repeats the number of the question. A missed time limit, an exit and invalid data are faults; after
three faults in a minute the script is not started again.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from ...engine.arrays import F64
from ...processes.messages import Message, MessageKind, encode_json, message
from ...processes.worker import Worker
from ..host.clock import SYSTEM, Clock
from ..host.output import PATIENCE_S
from ..live.approval import Approval
from .message_bodies import decode_values

READY_S: Final = 10.0  # time limit for the start of a script, seconds, which includes its imports
FAULTS: Final = 3
FAULTS_WITHIN_S: Final = 60.0
"""Time in which :data:`FAULTS` faults keep a script off, seconds."""

Answer = Callable[[F64], None]  # takes values (columns,)
_NUMBERS: Final = 1 << 16

WITHDRAWN: Final = "the approval of its script was withdrawn"
_WATCH_S: Final = 0.05


class ScriptRefusedError(Exception):
    """Raised for a device's script that may not run: not approved, or faulty too often."""


class ScriptProcess:
    """Process of a device's script for a :class:`.device_thread.DeviceThread`; thread-safe.

    ``request``: ``path``, ``configuration``, ``fingerprint``, ``device`` and ``folder``.
    ``fault``, ``log``: take a sentence; called in threads, as answers are.
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
        self._next: tuple[bytes, Answer] | None = None  # newest unsent question
        self._number = 0  # of the last question
        self._answer: Answer | None = None  # receiver of the answer
        self._faults: deque[float] = deque(maxlen=FAULTS)  # times

    def start(self) -> None:
        """Start a new worker, after killing a running worker.

        Raises ScriptRefusedError: three faults within a minute, or the approval was withdrawn.
        """
        with self._lock:
            self.close()
            if self._approval.is_withdrawn():
                raise ScriptRefusedError(WITHDRAWN)
            # The deque holds the last three faults.
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
        """Send haptic data as soon as the last question is answered.

        ``answer`` is called with the values (columns,) in a thread; never for replaced data.
        """
        with self._lock:
            self._next = haptics, answer
            self._ask_next()

    def is_overdue(self, now_s: float) -> bool:
        """Test for a start or answer late at ``now_s``; True once, recorded as a fault."""
        with self._lock:
            is_late = self._deadline_s is not None and now_s > self._deadline_s
            if is_late:
                self._faults.append(now_s)
                self._deadline_s = None
            return is_late

    def close(self) -> None:
        """Kill the worker and all processes started by the script; later answers are ignored."""
        with self._lock:
            worker, self._worker = self._worker, None
            self._deadline_s = self._next = self._answer = None
        if worker is not None:
            worker.kill()

    def _watch_approval(self, worker: Worker) -> None:
        """Thread: poll the approval; if withdrawn, kill the worker and report the fault."""
        while worker is self._worker:
            if self._approval.is_withdrawn():
                self.close()
                self._fault(WITHDRAWN)
                return
            time.sleep(_WATCH_S)

    def _ask_next(self) -> None:
        """Send the unsent question and set its time limit of 0.1 s; nothing without a question, or
        if the worker is missing, starting or busy."""
        if self._worker is None or not self._is_ready or self._next is None:
            return
        # Idle: the deadline is set while a question is in progress.
        if self._deadline_s is None:
            (body, self._answer), self._next = self._next, None
            # The number fits the device field of a message, 16 bits.
            self._number = (self._number + 1) % _NUMBERS
            self._deadline_s = self._clock.now() + PATIENCE_S
            self._worker.send(message(MessageKind.HAPTICS, self._number, body), is_awaited=True)

    # Called in the worker's reading thread.

    def _take(self, worker: Worker, received: Message) -> str | None:
        """Execute READY, a LOG line, or the answer to the last question, and send the next
        question. Returns the reason of a fault, which ends the reading ("" for a killed worker),
        else None."""
        with self._lock:
            if worker is not self._worker:  # a killed worker
                return ""
            if received.kind is MessageKind.FAULT:
                return f"failed: {received.body.decode(errors='replace')}"
            if received.kind is MessageKind.LOG:
                self._log(received.body.decode(errors="replace"))
                return None
            is_ready = received.kind is MessageKind.READY and not self._is_ready
            is_answer = self._is_ready and received[:2] == (MessageKind.ANSWER, self._number)
            if self._deadline_s is None or not (is_ready or is_answer):
                return "sent an answer without a question"
            self._is_ready, self._deadline_s = True, None
            answer, self._answer = self._answer, None
            self._ask_next()
        # Outside the lock, as the receiver may call this object.
        if is_answer and answer is not None:
            answer(decode_values(received.body))
        return None

    def _ended(self, worker: Worker, reason: str) -> None:
        """Record and report a fault, unless the worker was killed by :meth:`close`."""
        with self._lock:
            if worker is not self._worker:
                return
            self._faults.append(self._clock.now())
        self._fault(f"its script {reason}")
