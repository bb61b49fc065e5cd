# SPDX-License-Identifier: GPL-3.0-or-later
"""Device thread on a simulated clock: offsets, pauses, and late answers."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from fake_time import BAND, FakeClock, Played, frame
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.devices.host import pacing
from hfx_blender.devices.host.device_thread import FREEZE_S
from hfx_blender.devices.host.pacing import MAX_OFFSET_S, Pace
from hfx_blender.engine.rendering.device_config import DeviceConfig

RATES = (24, 25.25, 30, 50, 50.4, 60, 72, 90, 120, 144, 240)
SILENT_WITHIN_S = 0.05


def stream(played: Played, rate: float, seconds: float, amplitude: float) -> None:
    """Send frames at Blender's rate, each requested and answered at once."""
    for _ in range(round(seconds * rate)):
        thread = played.thread
        thread.feed(frame(amplitude), thread.question(played.clock.now_s))
        played.run(1.0 / rate)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("offset_ms", [0, 33, 400, 1000])
def test_silence_comes_after_the_offset_without_earlier_losses(rate: float, offset_ms: int) -> None:
    played = Played(offset_s=offset_ms / 1000.0)
    stream(played, rate, 0.5, 10.0)
    played.run(0.0)
    asked_s = played.clock.now_s
    stream(played, rate, offset_ms / 1000.0 + 0.2, 0.0)
    end_s = played.port.last_loud_s()
    assert end_s - asked_s <= offset_ms / 1000.0 + SILENT_WITHIN_S
    assert end_s - asked_s >= offset_ms / 1000.0 - 1.0 / rate  # not cut off before
    strengths = [v for _, v in played.port.strengths()]
    assert max(strengths) == 10.0
    first, last = strengths.index(10.0), len(strengths) - strengths[::-1].index(10.0)
    assert min(strengths[first:last]) == 10.0  # without a gap


@pytest.mark.parametrize("rate", [24, 60, 144, 240])
def test_every_frame_is_played_after_its_offset_as_far_as_the_device_takes_them(
    rate: float,
) -> None:
    played = Played(offset_s=1.0)
    began_s = played.clock.now_s
    for k in range(2 * rate):
        played.thread.feed(frame(1.0 + 10.0 * k / (2 * rate)))
        played.run(1.0 / rate)
    played.run(1.3)
    for time_s, strength in played.port.strengths():
        if began_s + 1.0 < time_s < began_s + 3.0:
            due = 1.0 + 10.0 * (time_s - began_s - 1.0) / 2.0
            assert due - 0.4 < strength <= due + 0.01  # at most a ramp and a tick late


@pytest.mark.parametrize("rate", [24, 72, 240])
@pytest.mark.parametrize(("before_ms", "after_ms"), [(0, 1000), (1000, 0), (300, 700), (700, 300)])
def test_an_offset_changed_while_playing_leaves_nothing_on(
    rate: float, before_ms: int, after_ms: int
) -> None:
    played = Played(offset_s=before_ms / 1000.0)
    stream(played, rate, 1.3, 10.0)
    played.thread.set_offset(after_ms / 1000.0)
    stream(played, rate, 0.3, 10.0)
    asked_s = played.clock.now_s
    stream(played, rate, after_ms / 1000.0 + 0.3, 0.0)
    assert played.port.last_loud_s() - asked_s <= after_ms / 1000.0 + SILENT_WITHIN_S


@given(
    rate=st.floats(24.0, 240.0),
    offsets=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4),
    jitter=st.lists(st.floats(0.5, 1.5), min_size=7, max_size=7),
)
@settings(max_examples=40)
def test_no_rate_no_jitter_and_no_change_of_the_offset_leaves_a_device_on(
    rate: float, offsets: list[float], jitter: list[float]
) -> None:
    played = Played()
    k = 0

    def frames(seconds: float, amplitude: float) -> None:
        nonlocal k
        end = played.clock.now_s + seconds
        while played.clock.now_s < end:
            played.thread.feed(frame(amplitude))
            played.run(jitter[k % 7] / rate)
            k += 1

    for offset_s in offsets:
        played.thread.set_offset(offset_s)
        frames(0.3, 10.0)
    asked_s = played.clock.now_s
    frames(1.3, 0.0)
    assert played.port.last_loud_s() - asked_s <= offsets[-1] + SILENT_WITHIN_S


def test_a_flood_of_frames_takes_only_so_much_memory_and_the_newest_is_played() -> None:
    played = Played(offset_s=MAX_OFFSET_S)
    for k in range(30_000):
        played.thread.feed(frame(10.0 if k < 29_000 else 0.0))
        played.clock.now_s += 0.0001
    assert len(played.thread.waiting) <= (MAX_OFFSET_S + FREEZE_S) / pacing.LEAST_APART_S + 2
    played.run(1.2)
    assert not played.port.is_loud()


def updating_every(*intervals_ms: float) -> DeviceConfig:
    """Return the band with the given update intervals, assigned to the actuators in turn."""
    kinds = [
        replace(a.type, update_interval_ms=intervals_ms[k % len(intervals_ms)])
        for k, a in enumerate(BAND.actuators)
    ]
    parts = zip(BAND.actuators, kinds, strict=True)
    return replace(BAND, actuators=tuple(replace(a, type=k) for a, k in parts))


@pytest.mark.parametrize("rate", [24, 30, 50, 72, 120, 240])
@pytest.mark.parametrize("offset_ms", [0, 13, 333, 1000])
@pytest.mark.parametrize("around", [(0.0,), (3.0,), (1.0, 2.0)])
@pytest.mark.parametrize("intervals_ms", [(10.0,), (5.0, 20.0), (10.0, 50.0)])
def test_a_lone_frame_is_at_full_strength_for_one_update_however_early_the_next_comes(
    rate: float, offset_ms: int, around: tuple[float, ...], intervals_ms: tuple[float, ...]
) -> None:
    played = Played(device=updating_every(*intervals_ms), offset_s=offset_ms / 1000.0)
    before, after = round(0.15 * rate), round((0.15 + offset_ms / 1000.0) * rate)
    for k in range(before + after):
        played.thread.feed(frame(10.0 if k == before else around[k % len(around)]))
        played.run((0.55 if k == before else 1.0) / rate)
    for actuator in range(len(intervals_ms)):
        given = [(t, float(v[2 * actuator])) for t, v in played.port.given]
        full_s = [after - t for (t, v), (after, _) in pairwise(given) if v == 10.0]
        assert sum(full_s) > min(intervals_ms) / 1000.0 - 1e-4


@pytest.mark.parametrize("interval_ms", [5.0, 16.0, 20.0, 25.0, 50.0])
@pytest.mark.parametrize("rate", [24, 60, 240])
def test_silence_after_changes_that_come_faster_than_updates_is_not_late(
    rate: float, interval_ms: float
) -> None:
    for early in (0.05, 0.3, 0.7):
        played = Played(device=updating_every(interval_ms))
        for k in range(round(0.2 * rate)):
            played.thread.feed(frame(8.0 + k % 3))
            played.run(1.0 / rate)
        played.thread.feed(frame(10.0))
        played.run(max(early / rate, 0.0011))
        asked_s = played.clock.now_s
        played.thread.feed(frame(0.0))
        played.run(0.2)
        assert played.port.last_loud_s() - asked_s <= SILENT_WITHIN_S + 1e-4


# Nothing new


@pytest.mark.parametrize("offset_s", [0.0, 0.2, 1.0])
def test_a_thread_that_gets_nothing_new_is_silent_by_itself(offset_s: float) -> None:
    played = Played(offset_s=offset_s)
    stream(played, 60, 0.5, 10.0)
    last_s = played.clock.now_s - 1.0 / 60
    played.run(offset_s + 0.1)
    assert played.port.is_loud()
    played.run(1.0)
    end_s = played.port.last_loud_s()
    assert last_s + offset_s < end_s <= last_s + offset_s + 0.3
    assert played.thread.is_armed  # new frames play
    stream(played, 60, offset_s + 0.1, 8.0)
    assert played.port.is_loud()


def test_signs_of_life_hold_the_last_values() -> None:
    played = Played()
    played.thread.feed(frame(), played.thread.question(played.clock.now_s))
    for _ in range(40):
        played.run(0.05)
        played.thread.sign(played.clock.now_s)
    assert played.port.is_loud()
    played.run(0.3)
    assert not played.port.is_loud()


def test_signs_of_life_keep_nothing_on_whose_answer_is_awaited() -> None:
    played = Played()
    played.thread.feed(frame(), played.thread.question(played.clock.now_s))
    played.run(0.05)
    played.thread.question(played.clock.now_s)
    began_s = played.clock.now_s
    for _ in range(40):
        played.run(0.05)
        played.thread.sign(played.clock.now_s)
    assert played.port.last_loud_s() <= began_s + 0.3


@pytest.mark.parametrize("asleep_s", [0.4, 3.0, 1e6])
def test_after_a_sleep_nothing_of_before_is_sent(asleep_s: float) -> None:
    played = Played(offset_s=0.1)
    stream(played, 60, 0.5, 10.0)
    count = len(played.port.given)
    played.clock.now_s += asleep_s
    played.run(1.0)
    assert len(played.port.given) > count
    assert not any(v for _, v in played.port.strengths()[count:])


def test_a_delayed_turn_sends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played()
    played.thread.feed(frame())
    paced = Pace.paced

    def sleeps(pace: Pace, values: np.ndarray, now_s: float) -> np.ndarray:
        played.clock.now_s = now_s + 3.0
        return paced(pace, values, now_s)

    monkeypatch.setattr(Pace, "paced", sleeps)
    played.thread.turn()
    assert not played.port.given


# Pauses and late answers


@pytest.mark.parametrize("interval_ms", [0.1, 10.0, 50.0, 500.0])
@pytest.mark.parametrize("offset_s", [0.0, 0.5])
def test_a_pause_silences_the_next_turn_and_clears_the_queue(
    interval_ms: float, offset_s: float
) -> None:
    kinds = [replace(a.type, update_interval_ms=interval_ms) for a in BAND.actuators]
    parts = zip(BAND.actuators, kinds, strict=True)
    device = replace(BAND, actuators=tuple(replace(a, type=k) for a, k in parts))
    played = Played(device=device, offset_s=offset_s)
    for _ in range(100):  # up and down, for a ramp in progress
        played.thread.feed(frame(10.0))
        played.run(0.011)
        played.thread.feed(frame(3.0))
        played.run(0.037)
    assert played.port.is_loud()
    played.thread.pause()
    paused_s = played.clock.now_s
    played.run(2.0)
    assert played.port.last_loud_s() <= paused_s + 0.001
    assert played.events() == ["armed"]


VOIDS = {
    "a pause": lambda thread: thread.pause(),
    "a stop": lambda thread: thread.stop("enough"),
    "a freeze": lambda thread: thread.freeze("Blender did not answer"),
    "a stop and Play": lambda thread: (thread.stop("enough"), thread.arm()),
    "a fault and Play": lambda thread: (thread.fault("oops"), thread.arm()),
    "a disconnection": lambda thread: thread.close("disconnected"),
}


@pytest.mark.parametrize("name", VOIDS)
@pytest.mark.parametrize("offset_s", [0.0, 0.3])
def test_requests_before_a_stop_are_never_played_after(name: str, offset_s: float) -> None:
    played = Played(offset_s=offset_s)
    late = [played.thread.question(played.clock.now_s)]
    stream(played, 60, 0.5, 10.0)
    late += [played.thread.question(played.clock.now_s) for _ in range(3)]
    VOIDS[name](played.thread)
    began_s = played.clock.now_s
    for question in late:
        played.thread.feed(frame(), question)
        played.run(0.07)
        played.thread.sign(played.clock.now_s)
    played.run(1.0)
    assert played.port.last_loud_s() <= began_s + 0.001
    if played.thread.is_armed:
        stream(played, 60, offset_s + 0.2, 10.0)
        assert played.port.is_loud()


def test_an_answer_that_comes_after_a_newer_one_is_not_played() -> None:
    """A still scene fades out while the last moment is still being rendered."""
    played = Played()
    stream(played, 60, 0.2, 10.0)
    moment = played.thread.question(played.clock.now_s)
    played.thread.feed(frame(0.0), played.thread.question(played.clock.now_s))
    asked_s = played.clock.now_s
    played.thread.feed(frame(), moment)
    for _ in range(20):
        played.run(0.05)
        played.thread.sign(played.clock.now_s)
    assert played.port.last_loud_s() <= asked_s + SILENT_WITHIN_S


def test_a_turn_that_was_under_way_sends_nothing_after_a_pause(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    played = Played()
    played.thread.feed(frame())
    paced = Pace.paced

    def paused(pace: Pace, values: np.ndarray, now_s: float) -> np.ndarray:
        played.thread.pause()
        monkeypatch.undo()
        return paced(pace, values, now_s)

    monkeypatch.setattr(Pace, "paced", paused)
    played.run(0.2)
    assert played.port.given and played.port.last_loud_s() == -1.0


@pytest.mark.parametrize("count", [0, 1, 15, 17, 32])
def test_a_wrong_number_of_values_is_a_reported_fault(count: int) -> None:
    played = Played()
    stream(played, 60, 0.1, 10.0)
    played.thread.feed(np.full(count, 10.0))
    assert played.reports[-1] == ("fault", f"it was sent {count} values and takes 16")
    assert not played.thread.is_armed


def test_clocks_of_lanes_are_their_own() -> None:
    first, second = Played(), Played(FakeClock())
    first.run(1.0)
    assert second.clock.now() == 1000.0 and first.clock.now() == 1001.0
