# SPDX-License-Identifier: GPL-3.0-or-later
"""Output process on a simulated clock: signs of life, sleep, pauses and slow scripts."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fake_time import FakeClock, Played, frame, run
from fake_worker import FakeWorker

from hfx_blender.devices.host.host import HEARTBEAT_S, PAUSE_S, Host
from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.workers import script_process
from hfx_blender.devices.workers.live_frame import LiveFrame
from hfx_blender.devices.workers.message_bodies import encode_values
from hfx_blender.devices.workers.script_process import FAULTS_WITHIN_S, ScriptProcess
from hfx_blender.processes.messages import EVERY_DEVICE, Message, MessageKind

WATCH_S = 0.02


class SlowScript:
    """Device script with a fixed delay and full strength in every answer."""

    def __init__(self, clock: FakeClock, answers_after_s: float) -> None:
        self._clock, self._after_s = clock, answers_after_s
        self._next: Callable[[np.ndarray], None] | None = None
        self.busy: tuple[float, Callable[[np.ndarray], None]] | None = None

    def start(self) -> None: ...

    def ask(self, haptics: bytes, answer: Callable[[np.ndarray], None]) -> None:
        self._next = answer
        self.work()

    def work(self) -> None:
        """Answer a finished request and start the next request."""
        now = self._clock.now()
        if self.busy is not None and self.busy[0] <= now:
            answer, self.busy = self.busy[1], None
            answer(frame())
        if self.busy is None and self._next is not None:
            self.busy, self._next = (now + self._after_s, self._next), None

    def is_overdue(self, now_s: float) -> bool:
        return False  # the timeout of 100 ms is a separate rule

    def close(self) -> None:
        self.busy = self._next = None


class Session:
    """Output process without threads, with one device."""

    def __init__(self, script_s: float | None = None, offset_s: float = 0.0) -> None:
        self.clock = FakeClock()
        self.host = Host(lambda *_, **__: None, self.clock)  # type: ignore[arg-type]
        self.played = Played(self.clock, offset_s=offset_s)
        self.script = None if script_s is None else SlowScript(self.clock, script_s)
        self.played.thread.script = self.script
        self.host.device_threads[1] = self.played.thread
        self.shown: list[Any] = []
        self.host.rendering.show = lambda body, questions: self.shown.append(questions)  # type: ignore[method-assign]

    def receive(self, kind: MessageKind, device: int = 1, body: bytes = b"") -> None:
        self.host.receive(Message(kind, device, body))

    def pass_time(self, seconds: float, beat: bool = False) -> None:
        """Advance the clock in steps, running the process."""
        end = self.clock.now_s + seconds
        while self.clock.now_s < end - 1e-9:
            run([self.played], min(0.001, end - self.clock.now_s))
            if self.script is not None:
                self.script.work()
            if round(self.clock.now_s * 1000) % 20 == 0:
                self.host.check_deadlines()
            if beat and round(self.clock.now_s * 1000) % 50 == 0:
                self.receive(MessageKind.HEARTBEAT, EVERY_DEVICE)

    def stream(self, seconds: float) -> None:
        """Send frames at 62.5 Hz for some seconds."""
        for _ in range(round(seconds / 0.016)):
            if self.script is None:
                self.receive(MessageKind.VALUES, body=encode_values(frame()))
            else:
                self.receive(MessageKind.HAPTICS)
            self.pass_time(0.016)


@pytest.mark.parametrize("script_s", [0.003, 0.006, 0.03, 0.07, 0.2])
@pytest.mark.parametrize(
    "kind", [MessageKind.PAUSE, MessageKind.SCENE, MessageKind.STOP, MessageKind.DISCONNECT]
)
@pytest.mark.parametrize("device", [1, EVERY_DEVICE])
def test_no_late_answer_of_a_script_is_played_after(
    script_s: float, kind: MessageKind, device: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session(script_s)
    monkeypatch.setattr(session.host.rendering, "describe", lambda body: None)
    session.stream(0.5)
    assert session.played.port.last_loud_s() > 0.0
    for extra_s in (0.0, 0.001, 0.005, 0.013):
        session.pass_time(extra_s)
        session.receive(kind, device)
        asked_s = session.clock.now_s
        session.pass_time(0.4, beat=True)
        assert session.played.port.last_loud_s() <= asked_s + 0.001
        if kind in (MessageKind.STOP, MessageKind.DISCONNECT):
            return
        session.stream(0.5)
        assert session.played.port.last_loud_s() > asked_s + 0.4


def test_many_pauses_of_a_slow_script_are_silent() -> None:
    session = Session(0.04)
    for k in range(48):
        session.stream(0.08 + 0.016 * (k % 3))
        session.pass_time(0.001 * (k % 16))
        session.receive(MessageKind.PAUSE, EVERY_DEVICE)
        asked_s = session.clock.now_s
        session.pass_time(0.06)
        assert session.played.port.last_loud_s() <= asked_s + 0.001, k


@pytest.mark.parametrize("offset_s", [0.0, 0.2])
def test_a_storm_of_mutes_leaves_the_device_as_the_last_one_says(offset_s: float) -> None:
    """A mute pauses one device; earlier requests for values are answered in between."""
    session = Session(offset_s=offset_s)
    rng = np.random.default_rng(1)
    for _ in range(12):
        session.stream(offset_s + 0.1)
        assert session.played.port.is_loud()
        for _ in range(int(rng.integers(1, 20))):  # pressed again and again
            session.receive(MessageKind.VALUES, body=encode_values(frame()))
            session.pass_time(float(rng.uniform(0.0, 0.003)))
            session.receive(MessageKind.PAUSE)
        asked_s = session.clock.now_s
        session.pass_time(0.06 + offset_s, beat=True)
        assert session.played.port.last_loud_s() <= asked_s + 0.001
    assert session.played.events() == ["armed"]


@pytest.mark.parametrize("kind", [MessageKind.ANSWER, MessageKind.HAPTICS])
@pytest.mark.parametrize("void", [MessageKind.PAUSE, MessageKind.SCENE, MessageKind.STOP])
def test_late_answers_of_a_renderer_are_dropped(
    kind: MessageKind, void: MessageKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session(0.0)
    monkeypatch.setattr(session.host.rendering, "describe", lambda body: None)
    session.receive(MessageKind.MOMENT, EVERY_DEVICE)
    session.receive(void, EVERY_DEVICE)
    if void is MessageKind.STOP:
        session.played.thread.arm()
    session.host.take_rendered(Message(kind, 1, encode_values(frame())), session.shown[0])
    session.pass_time(0.2, beat=True)
    assert session.played.port.last_loud_s() == -1.0
    session.receive(MessageKind.MOMENT, EVERY_DEVICE)
    session.host.take_rendered(Message(kind, 1, encode_values(frame())), session.shown[1])
    session.pass_time(0.1, beat=True)
    assert session.played.port.is_loud()


def test_answers_for_a_reconnected_device_are_dropped() -> None:
    session = Session()
    session.receive(MessageKind.MOMENT, EVERY_DEVICE)
    second = Played(session.clock)
    second.thread.arm()
    session.host.device_threads[1] = second.thread
    session.host.take_rendered(Message(MessageKind.ANSWER, 1, encode_values(frame())), {})
    second.run(0.1)
    assert second.port.last_loud_s() == -1.0


def test_without_signs_of_life_devices_stop_until_the_operator_plays() -> None:
    session = Session()
    session.stream(0.5)
    asked_s = session.clock.now_s
    session.pass_time(0.5)
    assert session.played.port.last_loud_s() <= asked_s + HEARTBEAT_S + 2 * WATCH_S
    assert session.played.reports[-1] == ("frozen", "Blender did not answer for 250 ms")
    session.stream(0.2)
    assert not session.played.port.is_loud()
    session.receive(MessageKind.ARM)
    session.stream(0.2)
    assert session.played.port.is_loud()


def test_signs_of_life_hold_a_still_scene() -> None:
    session = Session()
    session.stream(0.1)
    session.pass_time(5.0, beat=True)
    assert session.played.port.is_loud()


def test_a_pause_buys_ten_seconds_of_silence_and_no_more() -> None:
    session = Session()
    session.stream(0.1)
    session.receive(MessageKind.PAUSE, EVERY_DEVICE)
    session.pass_time(PAUSE_S - 0.1)
    assert session.played.thread.is_armed and not session.played.port.is_loud()
    session.pass_time(0.2)
    assert not session.played.thread.is_armed


FIRST: dict[str, Callable[[Session], None]] = {
    "the lane": lambda session: session.played.run(0.0),
    "the watch": lambda session: session.host.check_deadlines(),
    "the reader": lambda session: session.receive(MessageKind.VALUES, body=encode_values(frame())),
    "an answer": lambda session: session.script.work(),  # type: ignore[union-attr]
}


@pytest.mark.parametrize("first", FIRST)
@pytest.mark.parametrize("script_s", [None, 0.01])
@pytest.mark.parametrize("asleep_s", [0.4, 3.0, 1e5])
def test_after_a_sleep_old_values_are_dropped_in_any_order_of_waking(
    first: str, script_s: float | None, asleep_s: float
) -> None:
    if first == "an answer":
        script_s = 0.01
    session = Session(script_s)
    session.stream(0.5)
    if script_s is not None:
        session.receive(MessageKind.HAPTICS)
    count = len(session.played.port.given)
    session.clock.now_s += asleep_s
    FIRST[first](session)
    session.stream(0.1)  # frames left in the pipe
    session.pass_time(0.2)
    assert not any(v for _, v in session.played.port.strengths()[count:])
    text = dict(reversed(session.played.reports))["stopped"]
    assert text.startswith("the computer slept or did not run for")


# Scripts


def started(
    monkeypatch: pytest.MonkeyPatch,
) -> tuple[ScriptProcess, FakeWorker, list[str], FakeClock]:
    """Return a started, ready script process with a scripted worker."""
    workers = FakeWorker.replace(monkeypatch, script_process)
    clock, faults = FakeClock(), []
    script = ScriptProcess({}, faults.append, lambda text: None, clock)
    script.start()
    return script, workers[0], faults, clock


def test_answers_match_questions_and_a_mismatch_is_a_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    actual: list[str] = []
    values = encode_values(frame())
    script, worker, faults, _ = started(monkeypatch)
    script.ask(b"first", lambda values: actual.append("first"))
    script.ask(b"second", lambda values: actual.append("second"))  # first not sent yet
    worker.says(MessageKind.READY)
    worker.says(MessageKind.ANSWER, values, 1)
    worker.ends()
    assert actual == ["second"] and faults == ["its script has ended"]
    script, worker, faults, _ = started(monkeypatch)
    worker.says(MessageKind.READY)
    script.ask(b"first", lambda values: actual.append("wrong"))
    worker.says(MessageKind.ANSWER, values, 7)
    assert actual == ["second"] and faults == ["its script sent an answer without a question"]


def test_a_script_that_does_not_answer_within_100_ms_is_overdue_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    script, worker, _, clock = started(monkeypatch)
    worker.says(MessageKind.READY)
    script.ask(b"", lambda values: None)
    clock.now_s += 0.099
    assert not script.is_overdue(clock.now())
    clock.now_s += 0.002
    assert script.is_overdue(clock.now()) and not script.is_overdue(clock.now())
    assert worker.sent[-1] == Message(MessageKind.HAPTICS, 1, b"")
    assert FAULTS_WITHIN_S == 60.0


# Stops and pauses by the second pipe


SILENCES = [(kind, n) for kind in (MessageKind.STOP, MessageKind.PAUSE) for n in (1, EVERY_DEVICE)]


def ahead(session: Session, kind: MessageKind, device: int) -> None:
    session.host.receive_ahead(Message(kind, device, b"enough"))


@pytest.mark.parametrize(("kind", "device"), SILENCES)
def test_messages_from_before_a_silence_ahead_start_nothing(kind: MessageKind, device: int) -> None:
    session = Session()
    session.stream(0.1)
    assert session.played.port.is_loud()
    ahead(session, kind, device)
    silent_s = session.clock.now_s
    # The first pipe still holds messages from before the silence.
    for _ in range(20):
        session.receive(MessageKind.ARM, EVERY_DEVICE)
        session.receive(MessageKind.PULSE, body=b'{"actuator": 0}')
        session.stream(0.016)
    assert session.played.port.last_loud_s() <= silent_s + 0.001
    assert session.played.thread.is_armed == (kind is MessageKind.PAUSE)
    session.receive(kind, device, b"enough")
    session.stream(0.1)
    assert session.played.port.is_loud() == (kind is MessageKind.PAUSE)
    session.receive(MessageKind.ARM, EVERY_DEVICE)
    session.stream(0.1)
    assert session.played.port.is_loud()


@pytest.mark.parametrize("begin", [MessageKind.PULSE, MessageKind.VALUES, MessageKind.ARM])
@pytest.mark.parametrize(("kind", "device"), SILENCES)
def test_a_silence_ahead_at_the_start_of_a_message_voids_the_message(
    kind: MessageKind, device: int, begin: MessageKind
) -> None:
    session = Session()
    session.stream(0.1)
    is_void = session.host._is_void

    def is_void_then_silent(*arguments: Any) -> bool:
        session.host._is_void = is_void  # type: ignore[method-assign]
        result = is_void(*arguments)
        ahead(session, kind, device)  # in the other thread, after the test
        return result

    session.host._is_void = is_void_then_silent  # type: ignore[method-assign]
    silent_s = session.clock.now_s
    body = encode_values(frame()) if begin is MessageKind.VALUES else b'{"actuator": 0}'
    session.receive(begin, body=body)
    session.pass_time(0.2)
    assert session.played.port.last_loud_s() <= silent_s + 0.001


@pytest.mark.parametrize(("kind", "device"), SILENCES)
def test_a_silence_that_comes_late_by_the_second_pipe_stops_nothing_armed_since(
    kind: MessageKind, device: int
) -> None:
    session = Session()
    session.stream(0.1)
    session.receive(kind, device)
    session.receive(MessageKind.ARM, EVERY_DEVICE)
    session.stream(0.1)
    ahead(session, kind, device)
    session.pass_time(0.002)
    assert session.played.port.is_loud()
    # The next pair is executed as ever, in either order.
    ahead(session, kind, device)
    session.pass_time(0.002)
    assert not session.played.port.is_loud()


def test_a_silence_of_one_device_ahead_leaves_further_devices() -> None:
    session = Session()
    second = Played(session.clock)
    session.host.device_threads[2] = second.thread
    session.stream(0.1)
    ahead(session, MessageKind.STOP, 1)
    session.receive(MessageKind.MOMENT, EVERY_DEVICE, b"moment")
    assert list(session.shown[-1]) == [2]
    second.thread.feed(frame())
    run([session.played, second], 0.1)
    assert not session.played.port.is_loud() and second.port.is_loud()


class Released:
    """Stand-in for a lock: calls a function once, as soon as the lock is free."""

    def __init__(self, function: Callable[[], None]) -> None:
        self._waiting = [function]

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None:
        while self._waiting:
            self._waiting.pop()()


@pytest.mark.parametrize("kind", [MessageKind.STOP, MessageKind.PAUSE])
def test_a_silence_ahead_keeps_the_moment_sent_after_the_silence(
    kind: MessageKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread of the second pipe is halted as soon as the first pipe can go on; a scene that
    stands still sends no second moment."""
    session = Session()
    monkeypatch.setattr(session.host.rendering, "forget", session.shown.clear)
    monkeypatch.setattr(session.host.rendering, "describe", lambda body: None)
    session.stream(0.1)

    def first_pipe() -> None:
        session.receive(kind, EVERY_DEVICE, b"enough")
        session.receive(MessageKind.ARM, EVERY_DEVICE)
        session.receive(MessageKind.SCENE, EVERY_DEVICE)
        session.receive(MessageKind.MOMENT, EVERY_DEVICE, b"moment")

    monkeypatch.setattr(session.host, "_order", Released(first_pipe))
    ahead(session, kind, EVERY_DEVICE)
    assert [list(questions) for questions in session.shown] == [[1]]


def test_a_pause_ahead_during_another_message_announces_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Blender may keep Python's lock from then on, so that the first pipe stays empty."""
    session = Session()
    session.stream(0.1)
    pauses = [lambda: ahead(session, MessageKind.PAUSE, EVERY_DEVICE)]

    class Ahead(Counter[tuple[MessageKind, int]]):
        """Lets the other thread run after each look, where no lock holds that thread back."""

        def __getitem__(self, key: tuple[MessageKind, int]) -> int:
            found = super().__getitem__(key)
            while pauses and not session.host._order.locked():
                pauses.pop()()
            return found

    monkeypatch.setattr(session.host, "_ahead", Ahead())
    session.receive(MessageKind.HEARTBEAT, EVERY_DEVICE)
    while pauses:
        pauses.pop()()
    session.pass_time(2.0)
    assert session.played.thread.is_armed
    assert session.host.patience_s == PAUSE_S


def test_a_moment_from_before_a_pause_ahead_asks_no_device() -> None:
    session = Session()
    session.stream(0.1)
    ahead(session, MessageKind.PAUSE, EVERY_DEVICE)
    session.receive(MessageKind.MOMENT, EVERY_DEVICE, b"moment")
    assert not session.shown[-1]
    session.receive(MessageKind.PAUSE, EVERY_DEVICE)
    session.receive(MessageKind.MOMENT, EVERY_DEVICE, b"moment")
    assert list(session.shown[-1]) == [1]


def test_a_pause_ahead_announces_work_of_blender_until_its_twin() -> None:
    session = Session()
    ahead(session, MessageKind.PAUSE, EVERY_DEVICE)
    assert session.host.patience_s == PAUSE_S
    session.receive(MessageKind.HEARTBEAT, EVERY_DEVICE)  # from before the pause
    assert session.host.patience_s == PAUSE_S
    session.receive(MessageKind.PAUSE, EVERY_DEVICE)
    assert session.host.patience_s == PAUSE_S
    session.receive(MessageKind.HEARTBEAT, EVERY_DEVICE)
    assert session.host.patience_s == HEARTBEAT_S


@pytest.mark.parametrize("is_ahead", [True, False])
def test_a_stop_is_confirmed_once_by_the_faster_pipe(is_ahead: bool) -> None:
    reported: list[str] = []
    host = Host(lambda event, *_, **__: reported.append(event), FakeClock())  # type: ignore[arg-type]
    stop = Message(MessageKind.STOP, EVERY_DEVICE, b"enough")
    first, second = (
        (host.receive_ahead, host.receive) if is_ahead else (host.receive, host.receive_ahead)
    )
    first(stop)
    assert reported == ["silent"]
    second(stop)
    assert reported == ["silent"]


def test_a_stop_ahead_is_confirmed_while_the_render_worker_starts() -> None:
    confirmed = threading.Event()
    host = Host(lambda event, *_, **__: confirmed.set(), FakeClock())  # type: ignore[arg-type]
    stop = Message(MessageKind.STOP, EVERY_DEVICE, b"enough")
    stopping = threading.Thread(target=host.receive_ahead, args=(stop,))
    with host.rendering._lock:  # held for as long as a worker process needs to start
        stopping.start()
        assert confirmed.wait(10.0)
    stopping.join()


# Mute


class ToleratedFaults(LiveClient):
    """Client recording messages in order."""

    def __init__(self) -> None:
        super().__init__()
        self.order: list[Any] = []
        self.pipe.send = lambda kind, device=EVERY_DEVICE, body=b"": self.order.append(  # type: ignore[method-assign]
            (kind, device)
        )
        self.pipe.silence = lambda kind, device: self.order.append((kind, device))  # type: ignore[method-assign]
        self.pipe.void = lambda device=None: self.order.append(("void", device))  # type: ignore[method-assign]
        self.pipe.replace = lambda device, newest: self.order.append("show")  # type: ignore[method-assign]


def test_mute_silences_only_the_muted_device_at_once() -> None:
    client = ToleratedFaults()
    for gains in ({}, {2: 0.5}, {2: 0.0}, {2: 0.0, 3: 1.0}, {2: 0.5}, {2: 0.0}):
        client.show(LiveFrame(0.0, [], gains))
    muted = [("void", EVERY_DEVICE), (MessageKind.PAUSE, 2), "show"]
    assert client.order == ["show", "show", *muted, "show", "show", *muted]


def test_a_pause_of_one_device_leaves_the_others_and_buys_no_time() -> None:
    session = Session()
    second = Played(session.clock)
    session.host.device_threads[2] = second.thread
    session.stream(0.1)
    second.thread.feed(frame())
    session.receive(MessageKind.PAUSE, 1)
    run([session.played, second], 0.1)
    assert not session.played.port.is_loud() and second.port.is_loud()
    assert session.host.patience_s == HEARTBEAT_S
