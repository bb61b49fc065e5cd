# SPDX-License-Identifier: GPL-3.0-or-later
"""Device thread: values given to an output, with faulty outputs and senders."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from live_process import BAND, PATIENCE_S, playing

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host import device_thread
from hfx_blender.devices.host.clock import SYSTEM
from hfx_blender.devices.host.device_thread import PULSE_SHARE, DeviceThread
from hfx_blender.devices.host.output import OutputLostError

DEVICE = load_device(BAND)


class Recorder:
    """Output recording values, with optional faults and hangs."""

    def __init__(self) -> None:
        self.given: list[Any] = []
        self.fault: Exception | None = None
        self.hangs = threading.Event()
        self.goes_on = threading.Event()
        self.is_closed = False

    def send(self, values: np.ndarray) -> None:
        if self.fault is not None:
            raise self.fault
        if self.hangs.is_set():
            self.goes_on.wait(PATIENCE_S)
        self.given.append(values)

    def stop(self) -> None:
        self.given.append("stop")

    def close(self) -> None:
        self.is_closed = True

    def ends_in_stops(self) -> bool:
        return len(self.given) > 3 and all(isinstance(block, str) for block in self.given[-3:])

    def loud(self) -> list[np.ndarray]:
        return [block for block in self.given if not isinstance(block, str) and block[::2].any()]


@pytest.fixture(autouse=True)
def _holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make values valid forever; deadlines are tested on a simulated clock."""
    monkeypatch.setattr(device_thread, "FREEZE_S", 1e9)


class Playing:
    """Device thread with a recording output and a list of reports."""

    def __init__(self) -> None:
        self.output = Recorder()
        self.reports: list[tuple[str, str]] = []
        self.thread = DeviceThread(0, DEVICE, lambda: self.output, self._report)
        self.thread.start()
        self.thread.arm()
        self.until(lambda: "armed" in self.events())

    def _report(self, event: str, _device: int, text: str = "", **_: Any) -> None:
        self.reports.append((event, text))

    def events(self) -> list[str]:
        return [event for event, _ in self.reports]

    def until(self, happened: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not happened():
            assert time.monotonic() < end, f"never happened: {self.reports}"
            time.sleep(0.002)

    def play(self, values: np.ndarray | None = None) -> None:
        self.thread.feed(playing() if values is None else values)
        self.until(self.output.loud)

    def stop(self) -> None:
        self.thread.stop("enough")
        self.until(lambda: self.output.ends_in_stops())


@pytest.fixture
def played() -> Iterator[Playing]:
    actual = Playing()
    yield actual
    actual.output.goes_on.set()
    actual.thread.close("the test is over")


def test_values_arrive_and_stay(played: Playing) -> None:
    played.play()
    count = len(played.output.given)
    played.until(lambda: len(played.output.given) > count + 3)
    assert played.output.given[-1].tolist() == playing().tolist()


def test_levels_after_silence_are_reported_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Studies log this report as the onset of a stimulus: no pause between reports delays it."""
    monkeypatch.setattr(device_thread, "_LEVELS_S", 1e9)
    played = Playing()
    loud, rest = playing(), DEVICE.neutral
    try:
        for previous, values, onsets in (
            (None, loud, 1),
            (loud, rest, 1),
            (rest, loud, 2),
            (loud, 0.5 * loud, 2),
        ):
            played.thread._report_levels(values, previous, 1.0)
            assert played.events().count("levels") == onsets
    finally:
        played.thread.close("the test is over")


def test_a_stop_is_sent_three_times_and_nothing_follows(played: Playing) -> None:
    played.play()
    played.stop()
    count = len(played.output.given)
    for _ in range(5):
        played.thread.feed(playing())
        played.thread.step(SYSTEM.now(), 0.01, playing(), played.thread.generation)
    assert len(played.output.given) == count
    assert ("stopped", "enough") in played.reports


def test_values_received_during_a_stop_are_dropped(played: Playing) -> None:
    played.play()
    played.stop()
    played.thread.feed(playing())
    count = len(played.output.given)
    played.thread.arm()
    played.until(lambda: len(played.output.given) > count + 3)
    assert not any(block[::2].any() for block in played.output.given[count:])


def test_an_output_is_stopped_right_after_opening(opening: Opening) -> None:
    opening.opens.set()
    opening.until("connected")
    assert opening.output.given[:3] == ["stop"] * 3


def test_after_a_stop_an_armed_device_starts_from_silence(played: Playing) -> None:
    played.play()
    played.stop()
    played.thread.arm()
    count = len(played.output.given)
    played.until(lambda: len(played.output.given) > count + 3)
    assert not any(block[::2].any() for block in played.output.given[count:])
    played.thread.feed(playing())
    played.until(lambda: played.output.given[-1][::2].any())


def test_a_stop_does_not_wait_for_an_output_that_hangs(played: Playing) -> None:
    played.play()
    played.output.hangs.set()
    played.until(lambda: played.thread.is_stuck(SYSTEM.now()))
    played.thread.fault("does not answer")
    played.until(lambda: played.output.ends_in_stops())
    assert not played.output.goes_on.is_set()
    # The hanging send ends after the stop, so the stop is repeated.
    count = len(played.output.given)
    played.output.goes_on.set()
    played.until(lambda: len(played.output.given) > count + 3 and played.output.ends_in_stops())


@pytest.mark.parametrize(
    ("fault", "event"), [(OutputLostError("unplugged"), "lost"), (ZeroDivisionError(), "fault")]
)
def test_a_faulty_output_is_stopped_and_reported(
    played: Playing, fault: Exception, event: str
) -> None:
    played.play()
    played.output.fault = fault
    played.until(lambda: event in played.events())
    played.until(lambda: played.output.ends_in_stops())


@pytest.mark.parametrize("nonsense", [np.full(16, np.nan), np.full(16, np.inf)])
def test_nonsense_is_silence(played: Playing, nonsense: np.ndarray) -> None:
    played.play()
    played.thread.feed(nonsense)
    count = len(played.output.given)
    played.until(lambda: len(played.output.given) > count + 5)
    assert not played.output.given[-1][::2].any()
    assert np.isfinite(played.output.given[-1]).all()


def test_more_than_is_allowed_is_cut(played: Playing) -> None:
    played.play(playing(1e9))
    assert max(block[::2].max() for block in played.output.loud()) == 15.0


def test_a_pulse_is_soft_short_and_of_one_actuator(played: Playing) -> None:
    played.thread.pulse(2)
    played.until(played.output.loud)
    played.until(lambda: not played.output.given[-1][::2].any())
    strengths = np.array([block[::2] for block in played.output.loud()])
    assert np.flatnonzero(strengths.any(axis=0)).tolist() == [2]
    assert 0.5 * PULSE_SHARE * 15.0 < strengths.max() <= PULSE_SHARE * 15.0


def test_a_pulse_of_an_actuator_that_is_on_or_off_is_on(monkeypatch: pytest.MonkeyPatch) -> None:
    actuator = DEVICE.actuators[2]
    strength = replace(actuator.type.strength, values=(0.0, 15.0))
    kind = replace(actuator.type, controls=(strength, *actuator.type.controls[1:]))
    actuators = list(DEVICE.actuators)
    actuators[2] = replace(actuator, type=kind)
    monkeypatch.setattr(sys.modules[__name__], "DEVICE", replace(DEVICE, actuators=(*actuators,)))
    played = Playing()
    try:
        played.thread.pulse(2)
        played.until(played.output.loud)
        played.until(lambda: not played.output.given[-1][::2].any())
        assert {block[4] for block in played.output.loud()} == {15.0}
    finally:
        played.thread.close("enough")
        played.thread.wait_closed()


def test_a_closed_thread_has_stopped_first(played: Playing) -> None:
    played.play()
    played.thread.close("bye")
    played.until(lambda: played.output.is_closed)
    assert played.output.given[-1] == "stop"


def test_a_failure_to_open_is_reported() -> None:
    def refuse() -> Any:
        raise OutputLostError("no such port")

    reports: list[tuple[str, str]] = []
    thread = DeviceThread(
        0, DEVICE, refuse, lambda event, _d, text="": reports.append((event, text))
    )
    thread.start()
    thread.arm()
    thread.wait_closed()
    assert reports == [("lost", "no such port")]


class Opening:
    """Device thread with a slow opening of the output."""

    def __init__(self) -> None:
        self.opens = threading.Event()
        self.output = Recorder()
        self.events: list[str] = []
        self.thread = DeviceThread(0, DEVICE, self._open, self._report)
        self.thread.start()

    def _open(self) -> Recorder:
        self.opens.wait(PATIENCE_S)
        return self.output

    def _report(self, event: str, _device: int, **_: Any) -> None:
        if event == "connected":  # arming has to wait for the opening
            second = threading.Thread(target=self.thread.arm)
            second.start()
            second.join(0.05)
        self.events.append(event)

    def until(self, event: str) -> None:
        end = time.monotonic() + PATIENCE_S
        while event not in self.events:
            assert time.monotonic() < end, f"never happened: {self.events}"
            time.sleep(0.002)


@pytest.fixture
def opening() -> Iterator[Opening]:
    actual = Opening()
    yield actual
    actual.opens.set()
    actual.thread.close("the test is over")


def test_a_slow_blender_during_opening_does_not_prevent_playing(
    opening: Opening,
) -> None:
    opening.thread.arm()
    opening.thread.freeze("Blender did not answer")
    opening.opens.set()
    opening.until("armed")
    assert "frozen" not in opening.events


def test_a_stop_during_opening_keeps_the_device_silent(played: Playing) -> None:
    opens = threading.Event()
    events: list[str] = []
    output = Recorder()

    def wait() -> Any:
        opens.wait(PATIENCE_S)
        return output

    thread = DeviceThread(1, DEVICE, wait, lambda event, _d, **_: events.append(event))
    thread.start()
    thread.arm()
    thread.stop("stopped by you")
    opens.set()
    played.until(lambda: "connected" in events)
    thread.feed(playing())
    thread.close("the test is over")
    thread.wait_closed()
    assert "armed" not in events and not output.loud()


def test_connected_is_reported_before_playing(opening: Opening) -> None:
    opening.opens.set()
    opening.until("armed")
    assert opening.events.index("connected") < opening.events.index("armed")


def test_a_freeze_stops_playing_devices(played: Playing) -> None:
    played.play()
    played.thread.freeze("Blender did not answer for 250 ms")
    played.until(lambda: played.output.ends_in_stops())
    assert ("frozen", "Blender did not answer for 250 ms") in played.reports


def test_a_thread_that_was_closed_leaves_no_thread_behind() -> None:
    before = threading.active_count()
    for _ in range(5):
        actual = Playing()
        actual.play()
        actual.thread.close("bye")
        actual.thread.wait_closed()
    end = time.monotonic() + PATIENCE_S
    while threading.active_count() > before:
        assert time.monotonic() < end, [thread.name for thread in threading.enumerate()]
        time.sleep(0.002)


def test_a_failure_to_open_leaves_no_thread() -> None:
    def refuse() -> Any:
        raise OutputLostError("no such port")

    before = threading.active_count()
    for _ in range(5):
        DeviceThread(0, DEVICE, refuse, lambda *_, **__: None).start()
    end = time.monotonic() + PATIENCE_S
    while threading.active_count() > before:
        assert time.monotonic() < end, [thread.name for thread in threading.enumerate()]
        time.sleep(0.002)
