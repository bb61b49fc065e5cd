# SPDX-License-Identifier: GPL-3.0-or-later
"""Parent side of the render worker: start, scenes, moments, time limits and end.

The worker gets one scene or moment at a time; of unsent moments only the newest is sent. Answers
are passed on with the answered requests, so that late answers can be discarded. The worker is
killed after a missed time limit or invalid data; all devices then have a fault.
"""

import threading
from collections.abc import Callable, Mapping
from typing import Final

from ...processes.messages import Message, MessageKind, message
from ...processes.worker import Worker
from ..host.clock import SYSTEM, Clock
from ..host.device_thread import Question

SCENE_S: Final = 60.0
"""Time limit for preparing a scene, seconds: loads body models, computes distances on skin."""

MOMENT_S: Final = 0.25
"""Time limit for rendering a moment, seconds; equal to that for Blender's messages."""

Questions = Mapping[int, Question]  # requests of the device threads, by device number


class RenderProcess:
    """Process that renders moments for devices; all methods may be called from any thread.

    ``answer``: takes a message for one device (ANSWER, HAPTICS or FAULT) and the answered requests.
    ``fault``: takes the reason of a failure, which concerns all devices.
    ``prepared``: called when moments of the newest scene can be rendered.

    The callbacks are called in the worker's reading thread.
    """

    def __init__(
        self,
        answer: Callable[[Message, Questions], None],
        fault: Callable[[str], None],
        clock: Clock = SYSTEM,
        prepared: Callable[[], None] = lambda: None,
    ) -> None:
        self._answer, self._fault, self._clock = answer, fault, clock
        self._prepared = prepared
        self._is_preparing = False
        self._lock = threading.RLock()
        self._worker: Worker | None = None
        self._known: bytes | None = None  # newest scene
        self._scene: bytes | None = None  # newest scene, unsent
        self._moment: tuple[bytes, Questions] | None = None  # newest moment, unsent
        self._questions: Questions = {}  # of the moment in progress
        self._deadline_s: float | None = None  # of the scene or moment in progress

    def describe(self, scene: bytes) -> None:
        """Set the scene of later moments, discard an unsent moment; start the worker if missing."""
        with self._lock:
            self._known = self._scene = scene
            self.forget()
            if self._worker is None:
                worker = Worker(
                    "devices.workers.render_worker", received=self._take, ended=self._ended
                )
                worker.start()
                self._worker = worker
            self._ask_next()

    def show(self, moment: bytes, questions: Questions) -> None:
        """Set the newest moment and the requests of the playing devices.

        Replaces a moment not yet sent; sent at once if the worker is idle.
        """
        with self._lock:
            self._moment = moment, questions
            self._ask_next()

    def forget(self) -> None:
        """Discard an unsent moment."""
        with self._lock:
            self._moment = None

    def restart(self) -> None:
        """Start a killed worker again, with the newest scene."""
        with self._lock:
            # After a fault the user presses Play, without a new scene from Blender.
            if self._worker is None and self._known is not None:
                self.describe(self._known)

    def is_overdue(self, now_s: float) -> bool:
        """Test that a scene or moment exceeds its time limit at ``now_s``; then kill the worker."""
        with self._lock:
            is_late = self._deadline_s is not None and now_s > self._deadline_s
        if is_late:
            self.close()
        return is_late

    def close(self) -> None:
        """Kill the worker and discard all work; later messages are ignored."""
        with self._lock:
            worker, self._worker = self._worker, None
            self._deadline_s, self._moment, self._questions = None, None, {}
        if worker is not None:
            worker.kill()

    def _ask_next(self) -> None:
        """Send the unsent scene, else the unsent moment, and set its time limit; nothing if the
        worker is missing or busy."""
        if self._worker is None or self._deadline_s is not None:
            return
        kind, limit_s = MessageKind.MOMENT, MOMENT_S
        questions: Questions = {}
        # A scene goes before a moment, which may belong to it.
        if self._scene is not None:
            kind, limit_s = MessageKind.SCENE, SCENE_S
            body, self._scene, self._is_preparing = self._scene, None, True
        elif self._moment is not None:
            (body, questions), self._moment = self._moment, None
        else:
            return
        self._questions, self._deadline_s = questions, self._clock.now() + limit_s
        # An idle worker has read all earlier messages.
        self._worker.send(message(kind, body=body), is_awaited=True)

    # Called in the worker's reading thread.

    def _take(self, worker: Worker, received: Message) -> None:
        """Pass an answer on; at READY end the time limit and send the next scene or moment."""
        with self._lock:
            if worker is not self._worker:  # a killed worker
                return
            if received.kind is not MessageKind.READY:
                self._answer(received, self._questions)
                return
            # READY follows all answers to a scene or moment.
            self._deadline_s = None
            if self._is_preparing:
                self._is_preparing = False
                self._prepared()
            self._ask_next()

    def _ended(self, worker: Worker, reason: str) -> None:
        """Discard all work and report the fault, unless the worker was killed by :meth:`close`."""
        with self._lock:
            if worker is not self._worker:
                return
            self.close()
        self._fault(f"the process that renders {reason}")
