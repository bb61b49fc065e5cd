# SPDX-License-Identifier: GPL-3.0-or-later
"""The output process as Blender has it: started, written to and listened to without waiting."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from queue import SimpleQueue
from typing import Final, TypeVar

from ...engine.samples import Stream
from ...errors import DeviceError
from ...processes.messages import EVERY_DEVICE, Message, MessageKind, message
from ...processes.worker import Worker
from ..host.device_state import Event, event_of
from ..workers.live_frame import LiveFrame, encode_live_frame

_MAX_EVENTS: Final = 1000
_END_S: Final = 1.0
_Taken = TypeVar("_Taken")

STOP_PATIENCE_S: Final = 0.2
"""Time limit for the confirmation of a stop, seconds, by a process that has reported ready (no
port is open before); then the output process is ended, and its ports close with it."""


class HostPipe:
    """Output processes, one after another. Only its threads wait for them."""

    def __init__(self) -> None:
        self.worker: Worker | None = None
        # Between threads without a lock, which Blender would wait for: each step is atomic.
        self._wake: SimpleQueue[None] = SimpleQueue()
        self.urgent: deque[bytes] = deque()
        self.newest: dict[int, bytes | LiveFrame] = {}
        self._silences = 0  # how often everything before became void
        self._is_closing = False
        self._events: deque[Event] = deque(maxlen=_MAX_EVENTS)
        self._is_ready = False
        self._asked_silence_s: float | None = None
        self.places: Mapping[Stream, int] = {}  # of the scene that moments are of

    @property
    def is_open(self) -> bool:
        """Test that a process was started and not ended by us; cheaper than asking if it runs."""
        return self.worker is not None

    @property
    def is_running(self) -> bool:
        return self.worker is not None and self.worker.is_running

    @property
    def pid(self) -> int | None:
        return None if self.worker is None else self.worker.pid

    def start(self) -> None:
        """Start the output process.

        Raises
        ------
        DeviceError
            It cannot be started.
        """
        worker = self.worker = Worker(
            "devices.host.host",
            str(os.getpid()),
            received=self.take,
            ended=self._ended,
            outgoing=self.outgoing,
            variables={"OPENBLAS_NUM_THREADS": "1"},  # values are few
        )
        self._is_closing, self._is_ready, self._asked_silence_s = False, False, None
        self._wake, self.urgent, self.newest = SimpleQueue(), deque(), {}
        try:
            worker.start()
        except OSError as error:
            self.worker = None
            raise DeviceError(f"The output process cannot be started ({error}).") from None

    def send(self, kind: MessageKind, device: int = EVERY_DEVICE, body: bytes = b"") -> None:
        """A message; they arrive in their order."""
        if not self.is_running:
            return
        if kind is MessageKind.HEARTBEAT and (self.urgent or self.newest):
            return  # whatever waits is one
        self.urgent.append(message(kind, device, body))
        self._nudge()

    def replace(self, device: int, newest: bytes | LiveFrame) -> None:
        """Set what a device is to play now, in place of what was not sent yet."""
        if self.worker is None:
            return
        self.newest[device] = newest
        self._nudge()

    def void(self, device: int | None = None) -> None:
        """Discard everything that was to be played and was not sent."""
        if device is None:
            self.newest.clear()
        else:
            self.newest.pop(device, None)
        self._silences += 1

    def stop(self, reason: str) -> None:
        """Silence all devices now, before anything that waits."""
        if not self.is_running:
            return
        self.void()
        stop = message(MessageKind.STOP, EVERY_DEVICE, reason.encode())
        if self.urgent:
            self.urgent.append(stop)  # what waits may arm a device: a stop follows it, too
        self.urgent.appendleft(stop)
        if self._asked_silence_s is None:
            self._asked_silence_s = time.monotonic()
        self._nudge()

    def watch(self) -> None:
        """End the process if it has not confirmed a stop in time."""
        asked = self._asked_silence_s
        if not self._is_ready or asked is None:
            return
        if time.monotonic() - asked > STOP_PATIENCE_S and self.is_running:
            if self.worker is not None:
                self.worker.kill()
            self._asked_silence_s = None
            text = "the output process did not confirm the stop and was ended"
            self._events.append(Event("gone", EVERY_DEVICE, text))

    def close(self) -> bool:
        """Stop everything and end the process; at most a moment. Whether there was any."""
        worker, self.worker = self.worker, None
        if worker is None:
            return False
        self.void()
        self.urgent.clear()
        self.urgent.append(message(MessageKind.STOP))
        self._is_closing = True
        self._nudge()
        worker.close(_END_S)
        return True

    def events(self) -> Iterator[Event]:
        """Events since the last call."""
        return _taken(self._events.popleft)

    def _nudge(self) -> None:
        """Wake the writer, unless it has been woken already."""
        if self._wake.empty():
            self._wake.put(None)

    # Called in threads of the worker: pipes may make them wait.

    def outgoing(self, worker: Worker) -> Iterator[bytes]:
        """Yield what is to be written next, until the worker is closed."""
        wake = self._wake
        while True:
            wake.get()
            if worker is not self.worker and not self._is_closing:
                return
            # New values first: urgent messages from before them are then present as well.
            silences, is_last, places = self._silences, self._is_closing, self.places
            newest = list(_taken(self.newest.popitem))[::-1]
            waiting = list(_taken(self.urgent.popleft))
            if waiting:
                yield b"".join(waiting)
            data = b"".join(self.encoded(each, places) for _, each in newest)
            if silences != self._silences and not is_last:
                continue  # a stop came meanwhile: values from before it are dropped
            if data:
                yield data
            if is_last:
                return

    def encoded(self, newest: bytes | LiveFrame, places: Mapping[Stream, int]) -> bytes:
        if not isinstance(newest, LiveFrame):
            return newest
        try:
            return message(MessageKind.MOMENT, EVERY_DEVICE, encode_live_frame(newest, places))
        except KeyError:
            return b""  # of the scene before
        except Exception as error:
            self.stop(f"what is felt cannot be handed over ({error})")
            return b""

    def _ended(self, worker: Worker, _reason: str) -> None:
        if worker is self.worker:
            self._events.append(Event("gone", EVERY_DEVICE, "the output process has ended"))

    def take(self, _worker: Worker, found: Message) -> None:
        """Take an event of the output process."""
        event = event_of(found.body)
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
