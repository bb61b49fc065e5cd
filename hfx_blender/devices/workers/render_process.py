# SPDX-License-Identifier: GPL-3.0-or-later
"""Parent side of the render worker: starts it, asks it, ends it.

One question at a time; of moments that wait, only the newest. Its answers are handed on with what
was asked, so that who gets them sees whether they still matter. A worker that does not answer in
time, ends or talks nonsense is ended, and every device that it renders for has a fault.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Final

from ...processes.messages import Message, MessageKind, message
from ...processes.worker import Worker
from ..host.clock import SYSTEM, Clock
from ..host.device_thread import Question

SCENE_S: Final = 60.0
"""Time limit of preparing a scene, seconds: body models are loaded, and distances on skin are
computed."""

MOMENT_S: Final = 0.25
"""Time limit of rendering a moment, seconds, as for Blender's own silence."""


Questions = Mapping[int, Question]
"""Requests to the device threads, by the device's number."""


class RenderProcess:
    """Process that renders moments for devices.

    Parameters
    ----------
    answer : callable
        Takes a message for one device, ANSWER, HAPTICS or FAULT, and the questions it answers.
    fault : callable
        Takes one sentence, which concerns all devices.
    prepared : callable
        Called when a scene can be rendered. All three are called from a thread.
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
        self._known: bytes | None = None  # the newest scene
        self._scene: bytes | None = None  # if it has not been sent yet
        self._moment: tuple[bytes, Questions] | None = None
        self._questions: Questions = {}  # in progress
        self._deadline_s: float | None = None  # while it is busy

    def describe(self, scene: bytes) -> None:
        """Set another scene: later moments belong to it."""
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
        """Set the newest moment, with the requests of each device."""
        with self._lock:
            self._moment = moment, questions
            self._ask_next()

    def forget(self) -> None:
        """Discard a moment that waits."""
        with self._lock:
            self._moment = None

    def restart(self) -> None:
        """Start again, if it had to be ended."""
        with self._lock:
            if self._worker is None and self._known is not None:
                self.describe(self._known)

    def is_overdue(self, now_s: float) -> bool:
        """Test for a late answer; then the process is ended."""
        with self._lock:
            is_late = self._deadline_s is not None and now_s > self._deadline_s
        if is_late:
            self.close()
        return is_late

    def close(self) -> None:
        """End the worker at once."""
        with self._lock:
            worker, self._worker = self._worker, None
            self._deadline_s, self._moment, self._questions = None, None, {}
        if worker is not None:
            worker.kill()

    def _ask_next(self) -> None:
        if self._worker is None or self._deadline_s is not None:
            return
        kind, limit_s = MessageKind.MOMENT, MOMENT_S
        questions: Questions = {}
        if self._scene is not None:
            kind, limit_s = MessageKind.SCENE, SCENE_S
            body, self._scene, self._is_preparing = self._scene, None, True
        elif self._moment is not None:
            (body, questions), self._moment = self._moment, None
        else:
            return
        self._questions, self._deadline_s = questions, self._clock.now() + limit_s
        self._worker.send(message(kind, body=body), is_awaited=True)

    # Called in a thread of the worker.

    def _take(self, worker: Worker, found: Message) -> None:
        with self._lock:
            if worker is not self._worker:
                return
            if found.kind is not MessageKind.READY:
                self._answer(found, self._questions)
                return
            self._deadline_s = None
            if self._is_preparing:
                self._is_preparing = False
                self._prepared()
            self._ask_next()

    def _ended(self, worker: Worker, reason: str) -> None:
        with self._lock:
            if worker is not self._worker:
                return
            self.close()
        self._fault(f"the process that renders {reason}")
