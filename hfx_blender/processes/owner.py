# SPDX-License-Identifier: GPL-3.0-or-later
"""Child side of a worker process: messages from the process that started it, and back to it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import Final

from .messages import Message, MessageError, messages

_STDIN: Final = 0
_STDOUT: Final = 1
STDERR: Final = 2


def _end_now() -> None:
    os._exit(0)


class Owner:
    """The process that started this one, by :class:`.worker.Worker`.

    Standard input and output are its pipes from now on. When it ends, or closes its end, so does
    this process, whatever it is doing: a worker without an owner is of no use.

    Parameters
    ----------
    printed : int
        File descriptor for whatever else is printed to standard output, which must not come
        between the messages.
    at_end : callable
        Ends this process; called in a thread.
    """

    def __init__(self, printed: int = STDERR, at_end: Callable[[], object] = _end_now) -> None:
        self._out = os.fdopen(os.dup(_STDOUT), "wb")
        self._source = os.fdopen(os.dup(_STDIN), "rb")
        os.dup2(printed, _STDOUT)
        self._at_end = at_end
        self._sending = threading.Lock()
        self._received: SimpleQueue[Message] = SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def receive(self) -> Message:
        """Wait for the next message."""
        return self._received.get()

    def send(self, content: bytes) -> None:
        """Send messages, as :func:`.messages.message` makes them; from any thread."""
        with self._sending:
            self._out.write(content)
            self._out.flush()

    def _read(self) -> None:
        with suppress(MessageError, OSError):
            for message in messages(self._source):
                self._received.put(message)
        self._at_end()
