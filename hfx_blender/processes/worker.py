# SPDX-License-Identifier: GPL-3.0-or-later
"""Parent side of a worker process: start, messages both ways, time limits, and its end."""

from __future__ import annotations

import io
import os
import queue
import signal
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import IO, Any, Final

from . import start
from .messages import Message, MessageError, messages

END_LIMIT_S = 10.0
"""Time for a process to end after its input, seconds; then it is killed."""

_REPORTED_LINES: Final = 40
_LONGEST_LINE: Final = 200
_LAST_WORDS_S: Final = 1.0

_PIPE: Final = 4096
"""Bytes that an empty pipe takes at once on every system."""


class Worker:
    """Process that runs a module of this package, and the messages to and from it.

    Nobody waits for its pipes but threads of this object. The module talks by
    :class:`.owner.Owner`, and so ends with this process. A Ctrl-C that is meant for this process
    does not reach it; one that is killed takes with it what it has started. ::

        worker = Worker("generation.generation_process")
        worker.start()
        worker.send(json_message({"words": "oak"}))
        print(worker.receive(limit_s=60.0))
        worker.close()

    Parameters
    ----------
    module : str
        As :func:`.start.command` takes it; ``arguments`` are those of its command line.
    received : callable, optional
        Takes the worker and each message, in a thread, instead of :meth:`receive`. A text that it
        returns is a fault, at which reading ends.
    ended : callable, optional
        Takes the worker and how its messages ended, in that thread: "has ended", "sent ..." of
        what is no message, or the text of ``received``.
    outgoing : callable, optional
        Takes the worker and yields what is to be written next, in a thread of its own, instead of
        :meth:`send`. At its end the process's input ends.
    variables : mapping, optional
        Of its environment, besides those of :func:`.start.environment`.
    keeps_errors : bool
        Keep what it writes to standard error for :meth:`how_it_ended`. Otherwise that goes where
        this process's goes.
    """

    def __init__(
        self,
        module: str,
        *arguments: str | os.PathLike[str],
        received: Callable[[Worker, Message], str | None] | None = None,
        ended: Callable[[Worker, str], None] | None = None,
        outgoing: Callable[[Worker], Iterator[bytes]] | None = None,
        variables: Mapping[str, str] | None = None,
        keeps_errors: bool = False,
    ) -> None:
        self._module = module, *arguments
        self._variables, self._keeps_errors = variables, keeps_errors
        self._take = received or Worker._keep
        self._ended = ended or Worker._keep_end
        self._outgoing = outgoing or (lambda worker: iter(worker._unsent.get, None))
        self._unsent: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._received: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        self._last_lines: deque[str] = deque(maxlen=_REPORTED_LINES)
        self._readers: list[threading.Thread] = []
        self.process: subprocess.Popen[bytes] | None = None
        self.fault = ""
        """Fault of the process that sent no message, "sent ...", where :meth:`receive` is used."""

    @property
    def pid(self) -> int | None:
        """Process id; None before the start."""
        return None if self.process is None else self.process.pid

    @property
    def is_running(self) -> bool:
        return self.process is not None and self.process.poll() is None

    def start(self) -> None:
        """Start the process.

        Raises
        ------
        OSError
            It cannot be started.
        """
        self.process = start.start(
            start.command(*self._module),
            self._variables,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE if self._keeps_errors else None,
            bufsize=0,
            start_new_session=True,
        )
        threading.Thread(target=self._write, args=(self.process.stdin,), daemon=True).start()
        readers = {self._read: self.process.stdout, self._read_errors: self.process.stderr}
        self._readers = [
            threading.Thread(target=read, args=(stream,), daemon=True)
            for read, stream in readers.items()
            if stream is not None
        ]
        for reader in self._readers:
            reader.start()

    def send(self, content: bytes, *, is_awaited: bool = False) -> None:
        """Send messages, as :func:`.messages.message` makes them; they arrive in their order.

        Parameters
        ----------
        is_awaited : bool
            Promise that the process has read all before: little is then written without a thread,
            as an empty pipe takes it.
        """
        if not is_awaited or len(content) > _PIPE:
            self._unsent.put(content)
        elif self.process is not None:
            with suppress(OSError, ValueError):  # it has ended, which its reader tells
                _write_all(self.process.stdin, content)

    def receive(self, limit_s: float | None = None) -> Message | None:
        """Wait for the next message; None at the end, also of what is no message (:attr:`fault`).

        Raises
        ------
        TimeoutError
            None has come within ``limit_s``.
        """
        try:
            found = self._received.get(timeout=limit_s)
        except queue.Empty:
            raise TimeoutError from None
        if found is None:
            self._received.put(None)
        return found

    def wait(self, limit_s: float | None = None) -> int:
        """Wait for the end; the exit code. All that the process sent is known then.

        Raises
        ------
        subprocess.TimeoutExpired
            It did not end within ``limit_s``.
        """
        assert self.process is not None
        code = self.process.wait(limit_s)
        for reader in self._readers:  # a child of its own may keep a pipe open
            reader.join(_LAST_WORDS_S)
        return code

    def kill(self) -> None:
        """End the process at once, with all that it has started, and wait for nothing."""
        if self.process is None:
            return
        with suppress(OSError):
            if hasattr(os, "killpg"):
                os.killpg(self.process.pid, signal.SIGKILL)
            else:
                self.process.kill()
        self._unsent.put(None)
        threading.Thread(target=self.process.wait, daemon=True).start()

    def close(self, limit_s: float | None = None) -> None:
        """End the process's input, and wait for its end; it is killed if it takes too long."""
        if self.process is None:
            return
        self._unsent.put(None)
        try:
            self.process.wait(END_LIMIT_S if limit_s is None else limit_s)
        except subprocess.TimeoutExpired:
            self.kill()
            self.process.wait()

    def how_it_ended(self) -> str:
        """Describe the end of a process that is ending: ``crashed (SIGSEGV)``."""
        try:
            code = self.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.kill()
            code = self.wait()
        if code < 0:
            return _end_by_signal(-code)
        last = next((line for line in reversed(self._last_lines) if line), "")
        return f"ended with code {code}" + (f" ({last[:_LONGEST_LINE]})" if last else "")

    # Threads: pipes may make them wait.

    def _write(self, stream: IO[bytes]) -> None:
        with suppress(OSError, ValueError):  # it has ended, which its reader tells
            for content in self._outgoing(self):
                _write_all(stream, content)
        with suppress(OSError):
            stream.close()

    def _read(self, stream: io.RawIOBase) -> None:
        reason = "has ended"
        try:
            with io.BufferedReader(stream) as buffered:
                for message in messages(buffered):
                    fault = self._take(self, message)
                    if fault is not None:
                        reason = fault
                        break
        except (MessageError, OSError, ValueError) as error:
            reason = self.fault = f"sent {error}"
        self._ended(self, reason)

    def _read_errors(self, stream: io.RawIOBase) -> None:
        with suppress(OSError, ValueError), io.BufferedReader(stream) as lines:
            for line in lines:
                self._last_lines.append(line.decode(errors="replace").strip())

    def _keep(self, message: Message) -> None:
        self._received.put(message)

    def _keep_end(self, _reason: str) -> None:
        self._received.put(None)


def _write_all(stream: Any, content: bytes) -> None:
    data = memoryview(content)
    while data:
        data = data[stream.write(data) or 0 :]


def _end_by_signal(number: int) -> str:
    try:
        name = signal.Signals(number).name
    except ValueError:
        name = f"signal {number}"
    if name == "SIGKILL":
        return "was killed; the system does so when memory runs out"
    if name in ("SIGSEGV", "SIGBUS", "SIGILL", "SIGABRT", "SIGFPE"):
        return f"crashed ({name})"
    return f"was ended by {name}"
