# SPDX-License-Identifier: GPL-3.0-or-later
"""Parent side of the render worker: starts it, asks it, ends it.

One question at a time; of moments that wait, only the newest. Its answers are handed on with what
was asked, so that who gets them sees whether they still matter. A worker that does not answer in
time, ends or talks nonsense is ended, and every device that it renders for has a fault.
"""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Final

from ...processes import start
from ..host.clock import SYSTEM, Clock
from ..host.device_thread import Question
from .messages import Message, MessageError, MessageKind, message, read_message

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
        self._wake = threading.Condition(threading.RLock())
        self._process: subprocess.Popen[bytes] | None = None
        self._known: bytes | None = None  # the newest scene
        self._scene: bytes | None = None  # if it has not been sent yet
        self._moment: tuple[bytes, Questions] | None = None
        self._questions: Questions = {}  # in progress
        self._deadline_s: float | None = None  # while it is busy

    def describe(self, scene: bytes) -> None:
        """Set another scene: later moments belong to it."""
        with self._wake:
            self._known = self._scene = scene
            self.forget()
            self._start()
            self._wake.notify()

    def show(self, moment: bytes, questions: Questions) -> None:
        """Set the newest moment, with the requests of each device."""
        with self._wake:
            self._moment = moment, questions
            self._wake.notify()

    def forget(self) -> None:
        """Discard a moment that waits."""
        with self._wake:
            self._moment = None

    def restart(self) -> None:
        """Start again, if it had to be ended."""
        with self._wake:
            if self._process is None and self._known is not None:
                self.describe(self._known)

    def is_overdue(self, now_s: float) -> bool:
        """Test for a late answer; then the process is ended."""
        with self._wake:
            is_late = self._deadline_s is not None and now_s > self._deadline_s
        if is_late:
            self.close()
        return is_late

    def close(self) -> None:
        """End the worker at once."""
        with self._wake:
            process, self._process = self._process, None
            self._deadline_s, self._moment, self._questions = None, None, {}
            self._wake.notify_all()
        if process is not None:
            process.kill()
            threading.Thread(target=process.wait, daemon=True).start()

    def _start(self) -> None:
        if self._process is not None:
            return
        self._process = process = start.start(
            start.command("devices.workers.render_worker"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        for target in (self._write, self._listen):
            threading.Thread(target=target, args=(process,), daemon=True).start()

    def _write(self, process: subprocess.Popen[bytes]) -> None:
        """Write to the worker's pipe, which may block; only this thread waits."""
        stream = process.stdin
        assert stream is not None
        with suppress(OSError, ValueError):  # the listener reports it
            with stream:
                while True:
                    asked = self._next(process)
                    if asked is None:
                        return
                    stream.write(asked)
                    stream.flush()

    def _next(self, process: subprocess.Popen[bytes]) -> bytes | None:
        with self._wake:
            while process is self._process:
                if self._deadline_s is None and self._scene is not None:
                    body, self._scene, self._questions = self._scene, None, {}
                    self._deadline_s = self._clock.now() + SCENE_S
                    self._is_preparing = True
                    return message(MessageKind.SCENE, body=body)
                if self._deadline_s is None and self._moment is not None:
                    (body, self._questions), self._moment = self._moment, None
                    self._deadline_s = self._clock.now() + MOMENT_S
                    return message(MessageKind.MOMENT, body=body)
                self._wake.wait()
        return None

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        stream = process.stdout
        assert stream is not None
        text = "the process that renders has ended"
        try:
            with stream:
                while (found := read_message(stream)) is not None:
                    with self._wake:
                        if process is not self._process:
                            return
                        if found.kind is MessageKind.READY:
                            self._deadline_s = None
                            if self._is_preparing:
                                self._is_preparing = False
                                self._prepared()
                            self._wake.notify()
                        else:
                            self._answer(found, self._questions)
        except (MessageError, OSError, ValueError) as error:
            text = f"the process that renders sent {error}"
        with self._wake:
            if process is not self._process:
                return
            self.close()
        self._fault(text)
