# SPDX-License-Identifier: GPL-3.0-or-later
"""Pacing between frames: complete ramps and update intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from live_process import BAND, playing

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.pacing import LONGEST_RAMP_S, Pace, Ramp, tick_s
from hfx_blender.engine.rendering.device_config import DeviceConfig

DEVICE = load_device(BAND)
TICK = 0.01


def updating_every(interval_ms: float) -> DeviceConfig:
    kinds = {
        n: replace(k, update_interval_ms=interval_ms) for n, k in DEVICE.actuator_types.items()
    }
    actuators = tuple(replace(a, type=kinds[a.type.name]) for a in DEVICE.actuators)
    return replace(DEVICE, actuator_types=kinds, actuators=actuators)


def test_the_first_frame_is_there_at_the_first_tick():
    ramp = Ramp(DEVICE, TICK)
    ramp.aim(playing(), 5.0)
    assert ramp.at(5.0).tolist() == playing().tolist()


def test_from_frame_to_frame_strengths_go_straight_and_frequencies_jump():
    ramp = Ramp(DEVICE, TICK)
    ramp.aim(playing(0.0), 1.0)
    second = np.tile([8.0, 200.0], 8)
    ramp.aim(second, 1.04)  # the next frame is expected 40 ms later
    actual = np.array([ramp.at(1.04 + k * TICK) for k in range(5)])
    assert actual[:, 0] == pytest.approx([2.0, 4.0, 6.0, 8.0, 8.0])
    assert (actual[:, 1] == 200.0).all()


@given(st.lists(st.tuples(st.floats(0.001, 0.3), st.floats(0.0, 15.0)), min_size=1, max_size=20))
@settings(deadline=None)
def test_no_frame_is_delayed_by_more_than_the_longest_ramp_and_none_overshoots(frames):
    ramp = Ramp(DEVICE, TICK)
    now, before = 0.0, 0.0
    for gap, strength in frames:
        now += gap
        ramp.aim(playing(strength), now)
        low, high = min(before, strength), max(before, strength)
        for tick in np.arange(0.0, 0.3, TICK):
            value = ramp.at(now + tick)[0]
            assert low - 1e-9 <= value <= high + 1e-9 or gap < 0.06
        assert ramp.at(now + LONGEST_RAMP_S)[0] == strength
        before = strength


@pytest.mark.parametrize("wrong", [np.zeros(0), np.zeros(3), np.zeros((2, 16)), None])
def test_an_invalid_frame_is_refused(wrong):
    ramp = Ramp(DEVICE, TICK)
    ramp.aim(playing(), 1.0)
    with pytest.raises(ValueError, match="it takes 16"):
        ramp.aim(wrong, 1.02)


@pytest.mark.parametrize("rate", [24.0, 25.25, 33.6, 50.4, 60.0])
def test_repeated_targets_are_reached_at_any_polling_rate(rate):
    ramp = Ramp(DEVICE, TICK)
    ramp.aim(playing(), 0.0)
    for k in range(1, 20):  # one call per frame, on a busy machine
        ramp.aim(playing(2.0), k / rate)
        actual = ramp.at(k / rate)
    assert actual[0] == 2.0


@pytest.mark.parametrize("rate", [24.0, 25.25, 33.6, 50.4])
def test_the_last_step_of_a_ramp_does_not_wait_for_the_next_frame(rate):
    ramp = Ramp(DEVICE, TICK)
    for k in range(3):
        ramp.aim(playing(8.0 + k), k / rate)
        due = k / rate
        while due < (k + 1) / rate:
            actual, at = ramp.at(due), due
            due = ramp.next_s(due + TICK, due)
        assert actual[0] == 8.0 + k and at < (k + 1) / rate


def test_silence_is_not_ramped_to_and_only_by_the_actuators_that_are_to_be_silent():
    ramp = Ramp(DEVICE, TICK)
    ramp.aim(playing(8.0), 0.0)
    ramp.at(0.0)
    values = playing(4.0)
    values[0] = 0.0
    ramp.aim(values, 0.04)
    actual = ramp.at(0.04)
    assert actual[0] == 0.0 and actual[2] == 7.0


def test_not_a_number_is_forgotten_with_the_next_frame():
    ramp = Ramp(DEVICE, TICK)
    ramp.aim(np.full(16, np.nan), 1.0)
    assert np.isnan(ramp.at(1.0)).all()  # for the guard to see
    ramp.aim(playing(), 1.02)
    assert ramp.at(1.02)[0] == 5.0  # half way from silence
    assert np.isfinite(ramp.at(1.03)).all()


def test_an_actuator_changes_no_more_often_than_allowed():
    device = updating_every(50.0)
    pace = Pace(device, TICK)
    rng = np.random.default_rng(1)
    actual = np.array([pace.paced(playing(rng.uniform(1, 15)), k * TICK)[0] for k in range(100)])
    changes = np.flatnonzero(np.diff(actual)) + 1
    assert len(changes) > 15
    assert np.diff(changes).min() >= 5


def test_a_contact_shorter_than_an_interval_is_given_when_its_turn_comes():
    pace = Pace(updating_every(50.0), TICK)
    strengths = [2.0, 2.0, 15.0, 2.0, 2.0, 2.0, 2.0, 2.0]
    actual = [pace.paced(playing(s), k * TICK)[0] for k, s in enumerate(strengths)]
    assert actual == [2.0] * 5 + [15.0] * 3


def test_silence_does_not_wait_for_an_interval():
    pace = Pace(updating_every(50.0), TICK)
    assert pace.paced(playing(), 0.0)[0] == 10.0
    assert pace.paced(playing(0.0), TICK)[0] == 0.0


@pytest.mark.parametrize(("interval_ms", "tick"), [(0.1, 0.005), (10, 0.01), (500, 0.05)])
def test_values_are_sent_at_the_device_rate_with_a_minimum(interval_ms, tick):
    assert tick_s(updating_every(interval_ms)) == tick


def test_values_at_frame_rate_are_sent_with_the_frame():
    ramp = Ramp(DEVICE, TICK)
    frames = np.arange(5) / 60.0
    for now in frames:
        ramp.aim(playing(1.0 + 60.0 * now), now)
        assert ramp.at(now)[0] == pytest.approx(1.0 + 60.0 * now)
    # The next frame is due 16.7 ms after the last: at 10 ms nothing goes out.
    after = ramp.next_s(frames[-1] + TICK, frames[-1])
    assert frames[-1] + 1.0 / 60.0 < after < frames[-1] + 1.0 / 60.0 + TICK


def test_a_frame_that_does_not_come_is_not_waited_for_twice():
    ramp = Ramp(DEVICE, TICK)
    for now in (0.0, 1.0 / 60.0):
        ramp.aim(playing(), now)
    late = ramp.next_s(1.0 / 60.0 + TICK, 1.0 / 60.0)
    assert ramp.next_s(late + TICK, late) == late + TICK


def test_slow_frames_are_ramped_to_and_complete_before_the_next():
    ramp = Ramp(DEVICE, TICK)
    ramp.aim(playing(0.0), 0.0)
    ramp.at(0.0)
    now = 1.0 / 24.0
    ramp.aim(playing(8.0), now)
    assert [ramp.at(now + k * TICK)[0] for k in range(4)] == pytest.approx([2.0, 4.0, 6.0, 8.0])
    assert ramp.next_s(now + 3 * TICK, now + 2 * TICK) == now + 3 * TICK
    assert ramp.next_s(now + 4 * TICK, now + 3 * TICK) > 2.0 / 24.0
