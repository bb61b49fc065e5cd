# SPDX-License-Identifier: GPL-3.0-or-later
"""The output process as Blender has it: started, written to and listened to without waiting."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from queue import SimpleQueue
from typing import IO, Final, TypeVar

from ...engine.samples import Stream
from ...errors import DeviceError
from ...processes import start as own_processes
from ..host.device_state import Event, event_of
from ..workers.live_frame import LiveFrame, encode_live_frame
from ..workers.messages import EVERY_DEVICE, MessageKind, message

_MAX_EVENTS: Final = 1000
_Taken = TypeVar("_Taken")

STOP_PATIENCE_S: Final = 0.2
"""Time limit for the confirmation of a stop, seconds, by a process that has reported ready (no
port is open before); then the output process is ended, and its ports close with it."""


class HostPipe:
    """Output processes, one after another. Only its threads wait for them."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        # Between threads without a lock, which Blender would wait for: each step is atomic.
        self._wake: SimpleQueue[None] = SimpleQueue()
        self._urgent: deque[bytes] = deque()
        self._newest: dict[int, bytes | LiveFrame] = {}
        self._silences = 0  # how often everything before became void
        self._is_closing = False
        self._events: deque[Event] = deque(maxlen=_MAX_EVENTS)
        self._is_ready = False
        self._asked_silence_s: float | None = None
        self.places: Mapping[Stream, int] = {}  # of the scene that moments are of

    @property
    def is_open(self) -> bool:
        """Test that a process was started and not ended by us; cheaper than asking if it runs."""
        return self._process is not None

    @property
    def is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    @property
    def pid(self) -> int | None:
        return self._process.pid if self._process is not None else None

    def start(self) -> None:
        """Start the output process.

        Raises
        ------
        DeviceError
            It cannot be started.
        """
        try:
            process = own_processes.start(
                own_processes.command("devices.host.host", str(os.getpid())),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                variables={"OPENBLAS_NUM_THREADS": "1"},  # values are few
                bufsize=0,
                start_new_session=True,  # Ctrl-C in Blender's terminal is not meant for it
            )
        except OSError as error:
            raise DeviceError(f"The output process cannot be started ({error}).") from None
        self._process, self._is_closing, self._asked_silence_s = process, False, None
        self._is_ready = False
        self._wake, self._urgent, self._newest = SimpleQueue(), deque(), {}
        for target in (self._write, self._listen):
            threading.Thread(target=target, args=(process,), daemon=True).start()

    def send(self, kind: MessageKind, device: int = EVERY_DEVICE, body: bytes = b"") -> None:
        """A message; they arrive in their order."""
        if not self.is_running:
            return
        if kind is MessageKind.HEARTBEAT and (self._urgent or self._newest):
            return  # whatever waits is one
        self._urgent.append(message(kind, device, body))
        self._nudge()

    def replace(self, device: int, newest: bytes | LiveFrame) -> None:
        """Set what a device is to play now, in place of what was not sent yet."""
        if self._process is None:
            return
        self._newest[device] = newest
        self._nudge()

    def void(self, device: int | None = None) -> None:
        """Discard everything that was to be played and was not sent."""
        if device is None:
            self._newest.clear()
        else:
            self._newest.pop(device, None)
        self._silences += 1

    def stop(self, reason: str) -> None:
        """Silence all devices now, before anything that waits."""
        if not self.is_running:
            return
        self.void()
        stop = message(MessageKind.STOP, EVERY_DEVICE, reason.encode())
        if self._urgent:
            self._urgent.append(stop)  # what waits may arm a device: a stop follows it, too
        self._urgent.appendleft(stop)
        if self._asked_silence_s is None:
            self._asked_silence_s = time.monotonic()
        self._nudge()

    def watch(self) -> None:
        """End the process if it has not confirmed a stop in time."""
        asked = self._asked_silence_s
        if not self._is_ready or asked is None:
            return
        if time.monotonic() - asked > STOP_PATIENCE_S and self.is_running:
            if self._process is not None:
                self._process.kill()
            self._asked_silence_s = None
            text = "the output process did not confirm the stop and was ended"
            self._events.append(Event("gone", EVERY_DEVICE, text))

    def close(self) -> bool:
        """Stop everything and end the process; at most a moment. Whether there was any."""
        process, self._process = self._process, None
        if process is None:
            return False
        self.void()
        self._urgent.clear()
        self._urgent.append(message(MessageKind.STOP))
        self._is_closing = True
        self._nudge()
        try:
            process.wait(1.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        return True

    def events(self) -> Iterator[Event]:
        """Events since the last call."""
        return _taken(self._events.popleft)

    def _nudge(self) -> None:
        """Wake the writer, unless it has been woken already."""
        if self._wake.empty():
            self._wake.put(None)

    # Threads: pipes may make them wait.

    def _write(self, process: subprocess.Popen[bytes]) -> None:
        stream, wake = process.stdin, self._wake
        assert stream is not None
        try:
            while True:
                wake.get()
                if process is not self._process and not self._is_closing:
                    return
                # New values first: urgent messages from before them are then present as well.
                silences, is_last, places = self._silences, self._is_closing, self.places
                newest = list(_taken(self._newest.popitem))[::-1]
                waiting = list(_taken(self._urgent.popleft))
                if waiting:
                    _write_all(stream, b"".join(waiting))
                data = b"".join(self._as_bytes(each, places) for _, each in newest)
                if silences != self._silences and not is_last:
                    continue  # a stop came meanwhile: values from before it are dropped
                _write_all(stream, data)
                if is_last:
                    return
        except (OSError, ValueError):
            pass  # the listener reports it
        finally:
            with suppress(OSError):
                stream.close()

    def _as_bytes(self, newest: bytes | LiveFrame, places: Mapping[Stream, int]) -> bytes:
        if not isinstance(newest, LiveFrame):
            return newest
        try:
            return message(MessageKind.MOMENT, EVERY_DEVICE, encode_live_frame(newest, places))
        except KeyError:
            return b""  # of the scene before
        except Exception as error:
            self.stop(f"what is felt cannot be handed over ({error})")
            return b""

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout, suppress(OSError, ValueError):
            buffered = os.fdopen(os.dup(process.stdout.fileno()), "rb")
            with buffered:
                for line in buffered:
                    self._receive(line)
        if process is self._process:
            self._events.append(Event("gone", EVERY_DEVICE, "the output process has ended"))

    def _receive(self, line: bytes) -> None:
        event = event_of(line)
        if event is None:
            return
        if event.event == "silent":
            self._asked_silence_s = None
            return
        if event.event == "ready":
            if self._asked_silence_s is not None:
                self._asked_silence_s = time.monotonic()
            self._is_ready = True
        self._events.append(event)


def _taken(take: Callable[[], _Taken]) -> Iterator[_Taken]:
    """Yield items until none is left; other threads may add some meanwhile."""
    with suppress(IndexError, KeyError):
        while True:
            yield take()


def _write_all(stream: IO[bytes], content: bytes) -> None:
    data = memoryview(content)
    while data:
        data = data[stream.write(data) or 0 :]
