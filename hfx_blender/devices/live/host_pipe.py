# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's side of the output process: start, messages and events, without waiting."""

import json
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Final, NamedTuple, TypeVar

from ...engine.samples import Stream
from ...errors import DeviceError
from ...processes.messages import EVERY_DEVICE, Message, MessageKind, message
from ...processes.worker import Worker
from ..workers.live_frame import LiveFrame, encode_live_frame

_MAX_EVENTS: Final = 1000
_END_S: Final = 1.0
_MAX_REASON: Final = 1000  # bytes of a stop's text
_Taken = TypeVar("_Taken")

STOP_PATIENCE_S: Final = 0.2
"""Time limit for the confirmation of a stop, seconds. After it the output process is killed, which
closes its ports. Counts from the event "ready": no port is open before."""


@dataclass(frozen=True)
class Event:
    """Event of the output process; "gone" is created by :class:`.host_pipe.HostPipe`."""

    # ready prepared connected armed stopped frozen silent fault lost closed levels log gone
    event: str
    device: int  # number, or EVERY_DEVICE
    text: str = ""  # reason of a stop; for "connected" the label of the device at a server
    levels: tuple[float, ...] = ()  # 0..1 by actuator
    at_s: float = 0.0  # time of the report by time.monotonic(), equal in all processes


def event_of(body: bytes) -> Event | None:
    """Parse the JSON body of a message as an event; None for anything else."""
    try:
        content = json.loads(body)
        return Event(
            str(content["event"]),
            int(content["device"]),
            str(content.get("text", "")),
            tuple(float(level) for level in content.get("levels", ())),
            float(content.get("at_s", 0.0)),
        )
    except (ValueError, TypeError, KeyError):
        return None


class Unsent(NamedTuple):
    """Values of a device or the moment of all devices; invalid after :meth:`HostPipe.void`."""

    content: bytes | LiveFrame
    silences: int  # number of calls of void() for the device before
    places: Mapping[Stream, int]  # index of each stream in the header of the moment's scene


class HostPipe:
    """Messages to an output process and events from the process; can be started again.

    Only threads of this object wait for the process. Attributes: ``urgent``, unsent messages, all
    to be sent, in order; ``newest``, newest unsent values or moment of each device number;
    ``places``, index of each stream in the header of the present scene, for later moments.
    """

    def __init__(self) -> None:
        self.worker: Worker | None = None
        # Shared between threads without a lock, for which Blender would have to wait: each
        # operation on these containers is atomic in Python.
        self._wake: SimpleQueue[None] = SimpleQueue()
        self.urgent: deque[bytes] = deque()
        self.newest: dict[int, Unsent] = {}
        self._silences: Counter[int | None] = Counter()  # calls of void(), by argument
        self._is_closing = False
        self._events: deque[Event] = deque(maxlen=_MAX_EVENTS)
        self._is_ready = False
        self._asked_silence_s: float | None = None  # time of the oldest unconfirmed stop
        self._watched_s = self._halted_s = 0.0  # last watch(); standstills since the stop
        self.places: Mapping[Stream, int] = {}

    @property
    def is_running(self) -> bool:
        """Test that the output process runs."""
        return self.worker is not None and self.worker.is_running

    @property
    def pid(self) -> int | None:
        """Process id of the output process; None without a process."""
        return None if self.worker is None else self.worker.pid

    def start(self) -> None:
        """Start a new output process without waiting for its event "ready"; unsent messages and the
        state of an earlier process are discarded. DeviceError if no process can be started."""
        worker = self.worker = Worker(
            "devices.host.host",
            str(os.getpid()),
            received=self.take,
            ended=self._ended,
            outgoing=self.outgoing,
            has_urgent_pipe=True,
            variables={"OPENBLAS_NUM_THREADS": "1"},  # threads do not pay for small arrays
        )
        self._is_closing, self._is_ready, self._asked_silence_s = False, False, None
        # New containers: the writing thread of an earlier process may still wait on the old queue.
        self._wake, self.urgent, self.newest = SimpleQueue(), deque(), {}
        try:
            worker.start()
        except OSError as error:
            self.worker = None
            raise DeviceError(f"The output process cannot be started ({error}).") from None

    def send(self, kind: MessageKind, device: int = EVERY_DEVICE, body: bytes = b"") -> None:
        """Queue a message in order, a heartbeat only if nothing waits; dropped if not running."""
        if not self.is_running:
            return
        if kind is MessageKind.HEARTBEAT and (self.urgent or self.newest):
            return  # any unsent message is a sign of life
        self.urgent.append(message(kind, device, body))
        self._nudge()

    def replace(self, device: int, newest: bytes | LiveFrame) -> None:
        """Queue a device's values, or the moment of all devices, in place of an unsent entry."""
        if self.worker is None:  # `is_running` would be slow, at each frame
            return
        self.newest[device] = Unsent(newest, self._silences_of(device), self.places)
        self._nudge()

    def void(self, device: int | None = None) -> None:
        """Discard the unsent values of a device number; None: of all, with the moment."""
        if device is None:
            self.newest.clear()
        else:
            self.newest.pop(device, None)
        self._silences[device] += 1

    def _silences_of(self, device: int) -> int:
        """Number of calls of :meth:`void` for a device number or for all."""
        return self._silences[device] + self._silences[None]

    def silence(self, kind: MessageKind, device: int = EVERY_DEVICE, reason: str = "") -> None:
        """Discard unsent values of a device or of all, and send STOP or PAUSE by both pipes: by the
        second pipe at once, past all messages, and by the first pipe in order. Between both the
        output process ignores values for the device. A stop of all devices starts the time limit
        of :meth:`watch`, unless a stop is unconfirmed."""
        worker = self.worker
        if worker is None or not self.is_running:
            return
        self.void(None if device == EVERY_DEVICE else device)
        content = message(kind, device, reason.encode()[:_MAX_REASON])
        is_stop = kind is MessageKind.STOP and device == EVERY_DEVICE
        # Before the message, whose confirmation may arrive before this thread goes on.
        if is_stop and self._asked_silence_s is None:
            self._asked_silence_s = self._watched_s = time.monotonic()
            self._halted_s = 0.0
        # In this thread: the writing thread may wait for a full pipe, or for Python's lock, which
        # this thread may hold next for a whole frame.
        worker.urge(content)
        self.urgent.append(content)
        self._nudge()

    def watch(self) -> None:
        """Kill a ready process that has not confirmed a stop for 0.2 s; create the event "gone"."""
        now_s, since_s = time.monotonic(), self._asked_silence_s
        # A computer that slept or was too busy halted both processes: that time does not count.
        self._halted_s += max(now_s - self._watched_s - STOP_PATIENCE_S / 2.0, 0.0)
        self._watched_s = now_s
        if not self._is_ready or since_s is None:
            return
        if now_s - since_s - self._halted_s > STOP_PATIENCE_S and self.is_running:
            if self.worker is not None:
                self.worker.kill()
            self._asked_silence_s = None
            text = "the output process did not confirm the stop and was ended"
            self._events.append(Event("gone", EVERY_DEVICE, text))

    def close(self) -> bool:
        """Discard unsent values, stop all devices and end the process, killed after about a second.
        True; False, with no effect, without a process."""
        worker, self.worker = self.worker, None
        if worker is None:
            return False
        self.void()
        worker.urge(message(MessageKind.STOP))
        self.urgent.clear()
        self.urgent.append(message(MessageKind.STOP))
        self._is_closing = True
        self._nudge()
        worker.close(_END_S)
        return True

    def events(self) -> Iterator[Event]:
        """Yield the events since the last call."""
        return _taken(self._events.popleft)

    def _nudge(self) -> None:
        """Wake the writing thread, unless a wake-up is pending."""
        # Two wake-ups in a row do no harm: the second finds nothing to send.
        if self._wake.empty():
            self._wake.put(None)

    # Called in threads of the worker: pipes may block.

    def outgoing(self, worker: Worker) -> Iterator[bytes]:
        """Yield encoded messages for the writing thread, until the worker is closed or replaced.

        Urgent messages come before values; values from before a stop are dropped.
        """
        wake = self._wake
        while True:
            wake.get()
            if worker is not self.worker and not self._is_closing:
                return
            # Values are taken before the urgent messages but sent afterwards: a message queued
            # earlier than the values, as of the scene, is never sent later.
            is_last = self._is_closing
            newest = list(_taken(self.newest.popitem))[::-1]
            messages = list(_taken(self.urgent.popleft))
            if messages:
                yield b"".join(messages)
            encoded = [(self.encoded(unsent), unsent.silences, n) for n, unsent in newest]
            # After the encoding of all: a stop meanwhile voids what was queued before it.
            data = b"".join(data for data, count, n in encoded if count == self._silences_of(n))
            if data:
                yield data
            if is_last:
                return

    def encoded(self, unsent: Unsent) -> bytes:
        """Message of a moment; bytes are returned unchanged.

        Empty for a moment of an earlier scene. A moment that cannot be encoded stops all devices.
        """
        if not isinstance(unsent.content, LiveFrame):
            return unsent.content
        try:
            body = encode_live_frame(unsent.content, unsent.places)
            return message(MessageKind.MOMENT, EVERY_DEVICE, body)
        except KeyError:
            return b""  # a stream that the present scene does not have
        except Exception as error:
            self.silence(MessageKind.STOP, reason=f"what is felt cannot be handed over ({error})")
            return b""

    def _ended(self, worker: Worker, _reason: str) -> None:
        if worker is self.worker:
            self._events.append(Event("gone", EVERY_DEVICE, "the output process has ended"))

    def take(self, _worker: Worker, received: Message) -> None:
        """Append a received event for :meth:`events`. "silent" only confirms a stop; "ready" starts
        the time limit of a stop requested before; other messages are ignored."""
        event = event_of(received.body)
        if event is None:
            return
        if event.event == "silent":
            self._asked_silence_s = None
            return
        if event.event == "ready":
            if self._asked_silence_s is not None:
                self._asked_silence_s, self._halted_s = time.monotonic(), 0.0
            self._is_ready = True
        self._events.append(event)


def _taken(take: Callable[[], _Taken]) -> Iterator[_Taken]:
    """Yield the results of ``take`` until an IndexError or KeyError: the container is empty."""
    with suppress(IndexError, KeyError):
        while True:
            yield take()
