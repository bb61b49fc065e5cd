# SPDX-License-Identifier: GPL-3.0-or-later
"""Worker processes: start, messages in both directions, time limits and end; both their sides."""

import io
import os
import queue
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import IO, Any, Final

from . import start
from .messages import Message, MessageError, messages

if sys.platform == "win32":
    import msvcrt

END_LIMIT_S = 10.0
"""Time limit for the exit of a process after the end of its input, seconds; then it is killed."""

_REPORTED_LINES: Final = 40
_LONGEST_LINE: Final = 200
_LAST_WORDS_S: Final = 1.0

_STDIN: Final = 0
_STDOUT: Final = 1
STDERR: Final = 2
_PIPE: Final = 4096  # bytes that an empty pipe takes without blocking, on every system


class Worker:
    """Parent side: messages to and from a process with a module of this package.

    Threads of this object read and write the pipes: a caller never waits for a pipe. The
    module uses :class:`Owner` and so ends with this process. Ctrl-C for this process does not
    reach the module; :meth:`kill` also ends all processes started by the module. ::

        worker = Worker("generation.generation_process")
        worker.start()
        worker.send(json_message({"words": "oak"}))
        print(worker.receive(limit_s=60.0))
        worker.close()

    ``module`` is named as for :func:`.start.command`, ``arguments`` are its command line,
    ``variables`` environment variables besides those of :func:`.start.environment`. Three
    functions take the worker first, and run in its threads:

    - ``received`` takes each message, in the reading thread, and replaces :meth:`receive`. A
      returned text is a fault, which ends the reading.
    - ``ended`` takes the reason for the end of the messages, in the reading thread: "has ended",
      "sent ..." for invalid data, or the text returned by ``received``.
    - ``outgoing`` yields bytes to write, in the writing thread, and replaces :meth:`send`. The end
      of the iterator ends the process's input.

    ``has_urgent_pipe`` opens a second pipe for :meth:`urge`; :func:`urgent_pipe` opens the other
    end by the last argument of the module.

    ``keeps_errors`` keeps the last lines of standard error for :meth:`how_it_ended`; by default
    standard error is that of this process. ``process`` is None before the start; ``fault`` is
    "sent ..." after invalid data, empty before.
    """

    def __init__(
        self,
        module: str,
        *arguments: str | os.PathLike[str],
        received: "Callable[[Worker, Message], str | None] | None" = None,
        ended: "Callable[[Worker, str], None] | None" = None,
        outgoing: "Callable[[Worker], Iterator[bytes]] | None" = None,
        variables: Mapping[str, str] | None = None,
        keeps_errors: bool = False,
        has_urgent_pipe: bool = False,
    ) -> None:
        self._has_urgent_pipe = has_urgent_pipe
        self._urgent: IO[bytes] | None = None
        self._module = module, *arguments
        self._variables, self._keeps_errors = variables, keeps_errors
        # Without functions of the caller both threads fill the queue of receive().
        self._take = received or (lambda worker, message: worker._received.put(message))
        self._ended = ended or (lambda worker, _reason: worker._received.put(None))
        self._outgoing = outgoing or (lambda worker: iter(worker._unsent.get, None))
        self._unsent: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._received: queue.SimpleQueue[Message | None] = queue.SimpleQueue()
        self._last_lines: deque[str] = deque(maxlen=_REPORTED_LINES)
        self._readers: list[threading.Thread] = []
        self.process: subprocess.Popen[bytes] | None = None
        self.fault = ""

    @property
    def pid(self) -> int | None:
        """Process id; None before the start."""
        return None if self.process is None else self.process.pid

    @property
    def is_running(self) -> bool:
        return self.process is not None and self.process.poll() is None

    def start(self) -> None:
        """Start the process and the threads of its pipes, without waiting for a message; OSError if
        no process can be started."""
        # A session of its own: Ctrl-C of the terminal does not reach the process, and kill() can
        # signal the whole process group.
        reading, number, inherited = None, "", {}
        if self._has_urgent_pipe:
            reading, number, inherited = self._open_urgent_pipe()
        try:
            self.process = start.start(
                start.command(*self._module, *filter(None, [number])),
                self._variables,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE if self._keeps_errors else None,
                bufsize=0,
                start_new_session=True,
                **inherited,
            )
        finally:
            if reading is not None:
                os.close(reading)
        threading.Thread(target=self._write, args=(self.process.stdin,), daemon=True).start()
        # A thread for each pipe, as reading blocks.
        readers = {self._read: self.process.stdout, self._read_errors: self.process.stderr}
        self._readers = [
            threading.Thread(target=read, args=(stream,), daemon=True)
            for read, stream in readers.items()
            if stream is not None
        ]
        for reader in self._readers:
            reader.start()

    def send(self, content: bytes, *, is_awaited: bool = False) -> None:
        """Send encoded messages, results of :func:`.messages.message`, in order, without waiting.
        ``is_awaited``: the process has read all earlier messages. Up to 4 KiB are then written in
        this thread, which saves the switch to the writing thread: an empty pipe does not block."""
        if not is_awaited or len(content) > _PIPE:
            self._unsent.put(content)
        elif self.process is not None:
            with suppress(OSError, ValueError):  # ended; the reading thread reports the end
                _write_all(self.process.stdin, content)

    def receive(self, limit_s: float | None = None) -> Message | None:
        """Wait for the next message; None after the last, and after invalid data (:attr:`fault`).
        Raises TimeoutError: no message has come within ``limit_s``, seconds; None waits without
        limit."""
        try:
            message = self._received.get(timeout=limit_s)
        except queue.Empty:
            raise TimeoutError from None
        if message is None:
            self._received.put(None)  # for the next call
        return message

    def _open_urgent_pipe(self) -> tuple[int, str, dict[str, Any]]:
        """Open the second pipe: its reading end here, the end's number in the process, and the
        arguments of Popen that hand the end over."""
        reading, writing = os.pipe()
        # A write never waits; Windows before Python 3.12 cannot, and its pipe takes 4 KiB.
        getattr(os, "set_blocking", lambda *_: None)(writing, False)
        self._urgent = os.fdopen(writing, "wb", 0)
        if sys.platform != "win32":
            return reading, str(reading), {"pass_fds": (reading,)}
        handle = msvcrt.get_osfhandle(reading)
        os.set_handle_inheritable(handle, True)
        startup = subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]})
        return reading, str(handle), {"startupinfo": startup}

    def urge(self, content: bytes) -> None:
        """Write an encoded message of 4 KiB at most to the second pipe, in this thread and past all
        unsent messages. A pipe without room, or to an ended process, is closed: later messages are
        dropped."""
        if self._urgent is not None:
            with suppress(OSError, ValueError):  # ended; closed
                if self._urgent.write(content) != len(content):  # None without room
                    self._urgent.close()

    def wait(self, limit_s: float | None = None) -> int:
        """Wait for the exit and return the exit code; all messages have been read then. Raises
        subprocess.TimeoutExpired: the process did not exit within ``limit_s``, seconds."""
        assert self.process is not None
        code = self.process.wait(limit_s)
        # With a limit, as a process started by the worker may keep a pipe open.
        for reader in self._readers:
            reader.join(_LAST_WORDS_S)
        return code

    def kill(self) -> None:
        """Kill the process, on POSIX its group, without waiting; does nothing before the start."""
        if self.process is None:
            return
        # The group includes processes that the module has started.
        with suppress(OSError):
            if hasattr(os, "killpg"):
                os.killpg(self.process.pid, signal.SIGKILL)
            else:
                self.process.kill()
        self._unsent.put(None)
        # Collects the exit code: otherwise a zombie process remains.
        threading.Thread(target=self.process.wait, daemon=True).start()

    def close(self, limit_s: float | None = None) -> None:
        """Close the process's input after all unsent messages and wait for the exit; kill the
        process after ``limit_s`` seconds (None: 10 s). No effect before the start; may be called
        again."""
        if self.process is None:
            return
        self._unsent.put(None)
        try:
            self.process.wait(END_LIMIT_S if limit_s is None else limit_s)
        except subprocess.TimeoutExpired:
            self.kill()
            self.process.wait()

    def how_it_ended(self) -> str:
        """Wait for the exit, kill after 10 s, and describe the end: "crashed (SIGSEGV)", or "ended
        with code 1 (<last line of standard error>)"."""
        try:
            code = self.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.kill()
            code = self.wait()
        if code < 0:
            return _end_by_signal(-code)
        last = next((line for line in reversed(self._last_lines) if line), "")
        return f"ended with code {code}" + (f" ({last[:_LONGEST_LINE]})" if last else "")

    # Run in threads: pipes may block.

    def _write(self, stream: IO[bytes]) -> None:
        with suppress(OSError, ValueError):  # ended; the reading thread reports the end
            for content in self._outgoing(self):
                _write_all(stream, content)
        with suppress(OSError):
            stream.close()

    def _read(self, stream: io.RawIOBase) -> None:
        """Pass on messages up to the end, invalid data, or a fault returned by the receiver, then
        the reason of the end."""
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


def _write_all(stream: Any, content: bytes) -> None:
    """Write all bytes to an unbuffered stream, which may take a part at a time."""
    data = memoryview(content)
    while data:
        data = data[stream.write(data) or 0 :]


def _end_by_signal(number: int) -> str:
    """Describe an exit by a signal: killed (SIGKILL), crashed (as SIGSEGV), or ended by."""
    try:
        name = signal.Signals(number).name
    except ValueError:
        name = f"signal {number}"
    if name == "SIGKILL":
        return "was killed; the system does so when memory runs out"
    if name in ("SIGSEGV", "SIGBUS", "SIGILL", "SIGABRT", "SIGFPE"):
        return f"crashed ({name})"
    return f"was ended by {name}"


def urgent_pipe(number: str) -> IO[bytes]:
    """Open the second pipe of a :class:`Worker` in the child process, for reading."""
    descriptor = int(number)
    if sys.platform == "win32":
        descriptor = msvcrt.open_osfhandle(descriptor, os.O_RDONLY)
    return os.fdopen(descriptor, "rb")


class Owner:
    """Child side: messages from and to the process with the :class:`Worker`.

    Standard input and output are used for messages from now on; prints to standard output go to
    the file descriptor ``printed``. ``at_end`` is called in a thread when the owner ends or closes
    its pipe; by default this process then exits at once.
    """

    def __init__(
        self, printed: int = STDERR, at_end: Callable[[], object] = lambda: os._exit(0)
    ) -> None:
        # Copies of both pipes: prints by any library go to another descriptor, not between
        # messages.
        self._out = os.fdopen(os.dup(_STDOUT), "wb")
        self._source = os.fdopen(os.dup(_STDIN), "rb")
        os.dup2(printed, _STDOUT)
        self._at_end = at_end
        self._sending = threading.Lock()
        self._received: queue.SimpleQueue[Message] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def receive(self) -> Message:
        """Wait for the next message."""
        return self._received.get()

    def send(self, content: bytes) -> None:
        """Send encoded messages; may be called from any thread."""
        with self._sending:
            self._out.write(content)
            self._out.flush()

    def _read(self) -> None:
        with suppress(MessageError, OSError):
            for message in messages(self._source):
                self._received.put(message)
        self._at_end()
