# SPDX-License-Identifier: GPL-3.0-or-later
"""Output process: owns all ports of devices, and silences the devices on any failure.

Run as ``python -m hfx_blender.devices.host.host PID PIPE`` by the process PID. Messages come over
standard input, stops and pauses also over the pipe of number PIPE, past all messages on their way.
Events go out over standard output as JSON messages. Needs neither Blender nor a
window.

Causes of silence: a stop message, the end of standard input or of process PID, SIGTERM, an
exception in this process, no message for 250 ms, a process that stood still (as in a computer that
sleeps), a lost output, a fault of a device script or of the render worker. Only an arm message
ends the silence.
"""

import gc
import logging
import os
import signal
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from math import isnan
from pathlib import Path
from typing import IO, Any, BinaryIO, Final

from ...errors import InputError
from ...files import resources
from ...processes.messages import (
    EVERY_DEVICE,
    Message,
    MessageError,
    MessageKind,
    decode_json,
    json_message,
    messages,
)
from ...processes.worker import urgent_pipe
from ..configuration import load_device
from ..configurations.person_profile import personal
from ..workers.message_bodies import decode_values
from ..workers.render_process import Questions, RenderProcess
from ..workers.script_process import ScriptProcess
from .clock import SYSTEM, Clock, shorten_slices
from .device_thread import FREEZE_S, DeviceThread
from .duty_budget_store import DutyBudgetStore, identities
from .opening import open_output
from .output import Output
from .pacing import MAX_OFFSET_S
from .process_watch import await_end

HEARTBEAT_S: Final = 0.25
"""Longest time between two messages, seconds; after a longer one Blender counts as frozen."""

PAUSE_S: Final = 10.0
"""Longest pause that Blender may announce, seconds; all devices are silent during a pause."""

MAX_DEVICES: Final = 64
_SILENCES: Final = (MessageKind.STOP, MessageKind.PAUSE)
_PLAYING: Final = (MessageKind.ARM, MessageKind.VALUES, MessageKind.HAPTICS, MessageKind.PULSE)
_WATCH_S: Final = 0.02
_MAX_EVENTS: Final = 1000

_log = logging.getLogger(__name__)


class Reporter:
    """Queue of events, written in a thread: a hanging reader must not stop a device.

    Of more than :data:`_MAX_EVENTS` unwritten events the oldest are dropped.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._events: deque[bytes] = deque(maxlen=_MAX_EVENTS)
        self._wake = threading.Condition()
        threading.Thread(target=self._run, name="events", daemon=True).start()

    def __call__(self, event: str, device: int = EVERY_DEVICE, **facts: Any) -> None:
        at_s = time.monotonic()  # "levels" follows the values at the port
        content = json_message({"event": event, "device": device, "at_s": at_s, **facts})
        with self._wake:
            self._events.append(content)
            self._wake.notify()

    def _run(self) -> None:
        while True:
            with self._wake:
                while not self._events:
                    self._wake.wait()
                content = b"".join(self._events)
                self._events.clear()
            try:
                self._stream.write(content)
                self._stream.flush()
            except (OSError, ValueError):
                return  # the reader has ended; the end of standard input follows


class Host:
    """Threads of all devices, and the dispatch of messages."""

    def __init__(self, report: Reporter, clock: Clock = SYSTEM) -> None:
        self._report, self._clock = report, clock
        self.device_threads: dict[int, DeviceThread] = {}  # by the devices' numbers
        self._wake = threading.Condition()
        self._last_sign_s = self._last_turn_s = clock.now()
        self.end_reason = ""  # of the process; "" before its end
        # Longest time to the next message, seconds, before Blender counts as frozen.
        self.patience_s = HEARTBEAT_S
        self._is_frozen = False
        # STOP and PAUSE executed ahead: read from the second pipe, and not yet from the first.
        self._ahead: Counter[tuple[MessageKind, int]] = Counter()
        self._order = threading.Lock()
        self._budgets = DutyBudgetStore(resources.time_on(), clock)
        threading.Thread(target=self._budgets.save_regularly, name="time on", daemon=True).start()
        # One worker renders for all devices: a moment is decoded once.
        self.rendering = RenderProcess(
            self.take_rendered, self.fail_rendering, clock, lambda: report("prepared")
        )

    def read(self, stream: IO[bytes], receive: Callable[[Message], None] | None = None) -> None:
        """Pass the messages of a stream to :meth:`receive`, by default; at its end or at a faulty
        message stop all devices and let this process end."""
        end, receive = "Blender has gone", receive or self.receive
        try:
            for message in messages(stream):
                receive(message)
        except MessageError as error:
            end = f"Blender sent {error}"
        except Exception as error:
            _log.exception("messages")
            end = f"{type(error).__name__}: {error}"
        self._finish(end)

    def end_with(self, pid: int) -> None:
        """Wait for process ``pid`` to start to exit; then stop all devices and let this process
        end. Runs in a thread."""
        # False where the system has no such test: the end of the pipe is then the only sign.
        if await_end(pid):
            self._finish("Blender has gone")

    def _finish(self, end: str) -> None:
        with self._wake:
            self.end_reason = end
            self._wake.notify()
        # In this thread: the main thread may wake up late. A copy of the threads, as a CONNECT may
        # add a thread.
        for thread in list(self.device_threads.values()):
            thread.stop(end)

    def receive(self, message: Message) -> None:
        """Execute a message just read. If none follows within 0.25 s (10 s after a PAUSE of all
        devices), the main thread stops armed devices. Raises MessageError for invalid JSON."""
        now = self._clock.now()
        self._stop_after_standstill(now)
        # A pause of all devices announces work of Blender that sends no messages.
        is_work = message[:2] == (MessageKind.PAUSE, EVERY_DEVICE)
        with self._order:
            is_work |= self._ahead[MessageKind.PAUSE, EVERY_DEVICE] > 0
            self.patience_s = PAUSE_S if is_work else HEARTBEAT_S
            self._last_sign_s = now
        self.take(message, now)
        for thread in list(self.device_threads.values()):
            thread.sign(now)

    def receive_ahead(self, message: Message) -> None:
        """Execute STOP or PAUSE of the second pipe, unless :meth:`take` was faster: a device may
        have been armed since. Other messages, and messages for further devices, are ignored."""
        kind, number = message.kind, message.device
        if kind not in _SILENCES:
            return
        with self._order:
            self._ahead[kind, number] += 1  # first: values on their way are void from now on
            if self._ahead[kind, number] <= 0:
                return
            if (kind, number) == (MessageKind.PAUSE, EVERY_DEVICE):
                self.patience_s, self._last_sign_s = PAUSE_S, self._clock.now()
            for thread in self._threads_of(number):
                self._pass_on(thread, message, 0.0)
            # Before the render worker's lock, which the start of a worker may hold for long.
            if (kind, number) == (MessageKind.STOP, EVERY_DEVICE):
                self._report("silent")
            # Before the first pipe goes on: the next moment there is newer than this silence.
            if number == EVERY_DEVICE:
                self.rendering.forget()

    def _is_void(self, kind: MessageKind, number: int) -> bool:
        """Test that a message of the first pipe, which would let a device play, was sent before a
        silence that was executed ahead."""
        silences = _SILENCES[:1] if kind is MessageKind.ARM else _SILENCES
        return any(self._ahead[x, n] > 0 for x in silences for n in (number, EVERY_DEVICE))

    def _threads_of(self, number: int) -> list[DeviceThread]:
        """Threads of a device's number, empty if unknown, or of :data:`EVERY_DEVICE`."""
        if number == EVERY_DEVICE:
            return list(self.device_threads.values())  # a copy, as a CONNECT may add a thread
        thread = self.device_threads.get(number)
        return [] if thread is None else [thread]

    def take(self, message: Message, read_s: float) -> None:
        """Execute a message that was read at ``read_s``, by the clock of this process.

        MOMENT goes to the render worker, with a request for each device that plays; messages for
        unknown devices are ignored.
        """
        kind = message.kind
        if kind is MessageKind.CONNECT:
            self._connect(message.device, decode_json(message.body))
            return
        if kind is MessageKind.MOMENT:
            # Numbered now: an answer is void if a stop or pause arrives before the answer.
            playing = [(n, thread) for n, thread in self.device_threads.items() if thread.is_armed]
            questions = {number: thread.question(read_s) for number, thread in playing}
            # After the numbering: a silence ahead comes before this test, or voids the numbers.
            for number, _ in playing:
                if self._is_void(kind, number):
                    del questions[number]
            self.rendering.show(message.body, questions)
            return
        is_ahead = False
        if kind in _SILENCES:
            with self._order:
                is_ahead = self._ahead[kind, message.device] > 0
                self._ahead[kind, message.device] -= 1
        # An unsent moment would start the devices again after the silence.
        if message.device == EVERY_DEVICE and kind in (*_SILENCES, MessageKind.SCENE):
            self.rendering.forget()
        # The threads come first: devices are silent before the render worker gets a new scene.
        for thread in self._threads_of(message.device):
            self._pass_on(thread, message, read_s)
        if kind is MessageKind.STOP and not is_ahead:
            self._report("silent")
        elif kind is MessageKind.SCENE:
            self.rendering.describe(message.body)
        elif kind is MessageKind.ARM:
            self.rendering.restart()

    def _pass_on(self, thread: DeviceThread, message: Message, read_s: float) -> None:
        """Execute STOP, ARM, PAUSE, SCENE (a pause), VALUES, HAPTICS, PULSE, SETTINGS or DISCONNECT
        for a device; other kinds, HAPTICS without a script, and messages from before a silence that
        was executed ahead, are ignored."""
        kind = message.kind
        # Numbered before the test: a silence ahead comes before the test, or voids the number.
        is_question = kind is MessageKind.HAPTICS and thread.script is not None
        is_question |= kind is MessageKind.VALUES
        question, generation = thread.question(read_s) if is_question else None, thread.generation
        if kind in _PLAYING and self._is_void(kind, thread.number):
            return
        if kind is MessageKind.STOP:
            thread.stop(message.body.decode(errors="replace") or "stopped by you")
        elif kind is MessageKind.ARM:
            thread.arm()
        elif kind in (MessageKind.PAUSE, MessageKind.SCENE):
            thread.pause()
        elif kind is MessageKind.VALUES:
            thread.feed(decode_values(message.body), question)
        elif kind is MessageKind.HAPTICS and thread.script is not None:
            thread.script.ask(message.body, partial(thread.feed, question=question))
        elif kind is MessageKind.PULSE:
            thread.pulse(int(decode_json(message.body).get("actuator", -1)), generation)
        elif kind is MessageKind.SETTINGS:
            thread.set_offset(_offset_s(decode_json(message.body)))
        elif kind is MessageKind.DISCONNECT:
            self.device_threads.pop(thread.number, None)
            thread.close("disconnected")

    def take_rendered(self, answer: Message, questions: Questions) -> None:
        """Forward an answer of the render worker: values to an armed device, haptic data to its
        script.
        A fault stops its device, or all armed devices. ``questions`` are the answered requests by
        device number; answers without a request are dropped.
        """
        if answer.device == EVERY_DEVICE:
            self.fail_rendering(answer.body.decode(errors="replace"))
            return
        thread = self.device_threads.get(answer.device)
        if thread is None or not thread.is_armed:
            return
        if answer.kind is MessageKind.FAULT:
            thread.fault(answer.body.decode(errors="replace"))
            return
        question = questions.get(answer.device)
        if question is None:  # the device was connected or armed after the request
            return
        if answer.kind is MessageKind.ANSWER:
            thread.feed(decode_values(answer.body), question)
        elif answer.kind is MessageKind.HAPTICS and thread.script is not None:
            thread.script.ask(answer.body, partial(thread.feed, question=question))

    def fail_rendering(self, text: str) -> None:
        """Stop all playing devices with a fault of the render worker."""
        for thread in list(self.device_threads.values()):
            if thread.is_armed:
                thread.fault(text)

    def _connect(self, number: int, request: dict[str, Any]) -> None:
        """Open the device of a CONNECT message in a new thread, which waits for the closing of an
        earlier thread of this number. More than 64 devices, or a fault, are reported as "lost"."""
        # Out of the table first, so that no message reaches a thread that closes.
        before = self.device_threads.pop(number, None)
        if before is not None:
            before.close("connected anew")
        if len(self.device_threads) >= MAX_DEVICES:
            self._report("lost", number, text=f"more than {MAX_DEVICES} devices")
            return
        folder = request.get("folder")
        try:
            device = load_device(
                str(request.get("configuration")), None if folder is None else Path(str(folder))
            )
            device = personal(device, str(request.get("profile", "")))
        except (InputError, OSError) as error:
            self._report("lost", number, text=str(error))
            return
        output, script = request.get("output"), request.get("script")
        target = output if isinstance(output, dict) else {}

        def opened() -> Output:
            if before is not None:
                before.wait_closed()  # both may use the same port
            return open_output(device, target)

        thread = DeviceThread(
            number,
            device,
            opened,
            self._report,
            offset_s=_offset_s(request),
            clock=self._clock,
            # Not before the output is open: a server chooses the device, which has the budget.
            budgets=lambda *labels: self._budgets.claimed(identities(device, target, *labels)),
        )
        if isinstance(script, dict):
            thread.script = ScriptProcess(
                {**script, "device": request.get("configuration"), "folder": folder},
                thread.fault,
                lambda text: self._report("log", number, text=text),
                self._clock,
            )
        self.device_threads[number] = thread
        thread.start()

    def watch(self) -> None:
        """Call :meth:`check_deadlines` about every 20 ms, until a signal or :attr:`end_reason`."""
        self._last_turn_s = self._clock.now()
        while not _signals:
            with self._wake:
                if self.end_reason:
                    return
                left_s = self._last_sign_s + self.patience_s - self._clock.now()
                wait_s = min(_WATCH_S, left_s + 0.001) if left_s > 0.0 else _WATCH_S
                self._clock.wait(self._wake, wait_s)
            self.check_deadlines()

    def check_deadlines(self) -> None:
        """Stop all devices after ``patience_s`` without a message, once, or after a standstill of
        this process; playing devices if the render worker is late; a device whose send is stuck."""
        now = self._clock.now()
        self._stop_after_standstill(now)
        self._last_turn_s = now
        threads = list(self.device_threads.values())
        was_frozen = self._is_frozen
        # Reported at the change only: Blender may stay frozen for minutes.
        self._is_frozen = now - self._last_sign_s > self.patience_s
        if self._is_frozen and not was_frozen:
            for thread in threads:
                thread.freeze(f"Blender did not answer for {self.patience_s * 1000:.0f} ms")
        if self.rendering.is_overdue(now):
            self.fail_rendering("the samples could not be rendered in time")
        for thread in threads:
            # A stalled driver holds its thread for ever, so this thread has to look.
            if thread.is_stuck(now):
                thread.fault("the port stalls or the computer is busy: no value taken in 100 ms")

    def _stop_after_standstill(self, now: float) -> None:
        """Stop all devices if this process did not run for more than :data:`FREEZE_S`. Called by
        the main thread and by the reading thread, before any use of old data: both may run first
        after a sleep of the computer."""
        gap_s = now - self._last_turn_s
        if gap_s > FREEZE_S:
            for thread in list(self.device_threads.values()):
                thread.stop(f"the computer slept or did not run for {gap_s:.1f} s")

    def silence(self, reason: str) -> None:
        """Stop all devices, then close their ports, waiting for each, and save duty budgets, at the
        end of the process."""
        # All stops come before the first close: closing waits, stopping does not.
        threads = list(self.device_threads.values())
        for thread in threads:
            thread.stop(reason)
        self.rendering.close()
        for thread in threads:
            thread.close(reason)
        for thread in threads:
            thread.wait_closed()
        self._budgets.save()


def _offset_s(request: dict[str, Any]) -> float:
    """Delay of values in seconds from ``offset_ms`` of a request, clipped to
    0..:data:`MAX_OFFSET_S`; 0 if missing or no number."""
    offset_ms = request.get("offset_ms", 0.0)
    if not isinstance(offset_ms, int | float) or isnan(offset_ms):
        return 0.0
    return min(max(float(offset_ms) / 1000.0, 0.0), MAX_OFFSET_S)


# Received signals to end this process.
_signals: list[int] = []


def main() -> None:
    """Run the output process until the process in ``sys.argv[1]`` ends or a signal comes; then stop
    all devices, close their ports and exit with 0."""
    shorten_slices()
    logging.basicConfig(level=logging.WARNING, format="hfx devices: %(message)s")
    for name in ("SIGTERM", "SIGINT", "SIGHUP", "SIGBREAK"):
        if hasattr(signal, name):
            # The handler only appends: an exception could leave a lock held.
            signal.signal(getattr(signal, name), lambda number, _frame: _signals.append(number))
    # Events get a copy of standard output; prints of libraries go to standard error, not between
    # the events.
    events = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    gc.freeze()  # a full collection would hold Python's lock for tens of milliseconds
    sys.setswitchinterval(0.001)  # a device thread waits for Python's lock for 1 ms at most
    host = Host(Reporter(events))
    reader = threading.Thread(
        target=host.read, args=(sys.stdin.buffer,), name="messages", daemon=True
    )
    parent = int(sys.argv[1]) if len(sys.argv) > 1 else os.getppid()
    if len(sys.argv) > 2:
        ahead = (urgent_pipe(sys.argv[2]), host.receive_ahead)
        threading.Thread(target=host.read, args=ahead, name="stops", daemon=True).start()
    watcher = threading.Thread(target=host.end_with, args=(parent,), name="Blender", daemon=True)
    reason = "the output process ended"
    try:
        reader.start()
        watcher.start()
        host._report("ready", text=str(os.getpid()))
        host.watch()
        if _signals:
            reason = "the output process was ended"
    finally:
        host.silence(reason)
        time.sleep(0.02)  # for the thread that writes the last events
        os._exit(0)  # past all threads: a port that hangs must not keep the process alive


if __name__ == "__main__":
    main()
